//! LSTM and GRU layers at work: inference one step at a time, as a policy runs. [`super::cell`] has the formulas.

use super::cell::{Cell, Step};
use super::matmul::{self, Matrix};
use super::recurrent_shape::{Part, RecurrentShape};
use gaitfit_random::{Purpose, Stream};

/// One layer of `hidden` units.
#[derive(Clone, Debug, PartialEq)]
pub struct RecurrentLayer {
    /// Width of its input.
    pub inputs: usize,
    /// Units.
    pub hidden: usize,
    /// Weights from the input to the gates: `inputs × gates · hidden`, row-major.
    pub weight_ih: Vec<f32>,
    /// Weights from the last output to the gates: `hidden × gates · hidden`, row-major.
    pub weight_hh: Vec<f32>,
    /// Bias of the input's product, `gates · hidden`.
    pub bias_ih: Vec<f32>,
    /// Bias of the last output's product, `gates · hidden`.
    pub bias_hh: Vec<f32>,
}

/// Layers that remember, one behind the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Recurrent {
    /// Kind of all layers.
    pub cell: Cell,
    /// The layers; at least one.
    pub layers: Vec<RecurrentLayer>,
}

/// Memory of recurrent layers, for some environments. Empty for policies without such layers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Memory {
    layers: Vec<State>,
}

/// Memory of one layer, `environments × hidden` each; `cell` is empty for a GRU.
#[derive(Clone, Debug, Default, PartialEq)]
struct State {
    hidden: usize,
    output: Vec<f32>,
    cell: Vec<f32>,
}

impl Memory {
    /// Zeros for `environments` robots: so many numbers of each kind.
    pub(crate) fn zeros(kinds: impl Iterator<Item = usize>, environments: usize) -> Self {
        let state = |hidden| State { hidden, output: vec![0.0; environments * hidden], cell: Vec::new() };
        Self { layers: kinds.map(state).collect() }
    }

    /// The state of one kind, `environments × numbers`.
    pub(crate) fn of_kind(&mut self, kind: usize) -> &mut [f32] {
        &mut self.layers[kind].output
    }

    /// The episode of environment `index` begins: it remembers nothing.
    ///
    /// # Panics
    /// If there is no such environment: an error of the caller.
    pub fn begin(&mut self, index: usize) {
        for (values, width) in self.arrays_mut() {
            values[index * width..(index + 1) * width].fill(0.0);
        }
    }

    /// Whether nothing is ever remembered: there are no layers.
    pub fn is_empty(&self) -> bool {
        self.layers.is_empty()
    }

    /// Numbers that are remembered of one environment.
    pub fn width(&self) -> usize {
        self.arrays().map(|(_, width)| width).sum()
    }

    /// Number of environments; `None` without layers.
    pub fn environments(&self) -> Option<usize> {
        self.arrays().next().map(|(values, width)| values.len() / width)
    }

    /// Appends what is remembered of environment `index` to `row`: layer after layer the output, then an LSTM's cell.
    ///
    /// # Panics
    /// If there is no such environment: an error of the caller.
    pub fn append_row(&self, index: usize, row: &mut Vec<f32>) {
        for (values, width) in self.arrays() {
            row.extend_from_slice(&values[index * width..(index + 1) * width]);
        }
    }

    /// Takes up what [`Memory::append_row`] gave of an environment of a memory of the same layers; `false` for a row of
    /// another width or an environment that is not there.
    pub fn set_row(&mut self, index: usize, row: &[f32]) -> bool {
        if row.len() != self.width() || self.environments().is_some_and(|count| index >= count) {
            return false;
        }
        let mut rest = row;
        for (values, width) in self.arrays_mut() {
            let (mine, others) = rest.split_at(width);
            values[index * width..(index + 1) * width].copy_from_slice(mine);
            rest = others;
        }
        true
    }

    /// All that is remembered, for a file.
    pub fn numbers(&self) -> Vec<f32> {
        self.arrays().flat_map(|(values, _)| values).copied().collect()
    }

    /// Takes up what [`Memory::numbers`] of a memory of the same sizes gave; `false` for another number of numbers.
    pub fn set_numbers(&mut self, numbers: &[f32]) -> bool {
        let mut rest = numbers;
        if self.arrays().map(|(values, _)| values.len()).sum::<usize>() != numbers.len() {
            return false;
        }
        for (values, _) in self.arrays_mut() {
            let (mine, others) = rest.split_at(values.len());
            values.copy_from_slice(mine);
            rest = others;
        }
        true
    }

    /// The arrays and their widths.
    fn arrays(&self) -> impl Iterator<Item = (&Vec<f32>, usize)> {
        let arrays =
            self.layers.iter().flat_map(|layer| [(&layer.output, layer.hidden), (&layer.cell, layer.hidden)]);
        // A GRU's cells are empty, and have no width by which they could be cut.
        arrays.filter(|(values, _)| !values.is_empty())
    }

    fn arrays_mut(&mut self) -> impl Iterator<Item = (&mut Vec<f32>, usize)> {
        let arrays = self
            .layers
            .iter_mut()
            .flat_map(|layer| [(&mut layer.output, layer.hidden), (&mut layer.cell, layer.hidden)]);
        arrays.filter(|(values, _)| !values.is_empty())
    }
}

impl Recurrent {
    /// Width of the input.
    pub fn inputs(&self) -> usize {
        self.layers.first().map_or(0, |layer| layer.inputs)
    }

    /// Width of the output.
    pub fn outputs(&self) -> usize {
        self.layers.last().map_or(0, |layer| layer.hidden)
    }

    /// Random parameters, uniform in ±1/√hidden (PyTorch's choice). Draws are [`Purpose::WEIGHTS`] of `seed` at environment
    /// `index` (which network of the run it is) and step = layer.
    pub fn random(shape: &RecurrentShape, seed: u64, index: u32) -> Self {
        let layers = shape.layers().into_iter().enumerate().map(|(number, layer)| {
            let stream = Stream::new(seed, Purpose::WEIGHTS).environment(index).step(number as u32);
            let bound = (1.0 / (layer.hidden as f64).sqrt()) as f32;
            // The count goes on over all four parts of a layer, so no two numbers share a draw.
            let mut draw = 0;
            let mut uniform = |count: usize| -> Vec<f32> {
                let next = |_| {
                    draw += 1;
                    (2.0 * stream.uniform_f32(draw - 1) - 1.0) * bound
                };
                (0..count).map(next).collect()
            };
            let [weight_ih, weight_hh, bias_ih, bias_hh] =
                layer.parts.each_ref().map(|range| uniform(range.len()));
            RecurrentLayer {
                inputs: layer.inputs,
                hidden: layer.hidden,
                weight_ih,
                weight_hh,
                bias_ih,
                bias_hh,
            }
        });
        Self { cell: shape.cell, layers: layers.collect() }
    }

    /// Its sizes.
    pub fn shape(&self) -> RecurrentShape {
        let hidden = self.layers.iter().map(|layer| layer.hidden).collect();
        RecurrentShape { cell: self.cell, inputs: self.inputs(), hidden }
    }

    /// Numbers of all weights and biases, in the order of [`RecurrentShape::parts`].
    pub fn parameters(&self) -> impl Iterator<Item = &[f32]> {
        self.layers
            .iter()
            .flat_map(|layer| [&layer.weight_ih[..], &layer.weight_hh, &layer.bias_ih, &layer.bias_hh])
    }

    /// As [`Self::parameters`], to change, with the place of each in the flat vector of
    /// [`RecurrentShape::parts`].
    pub fn parameters_mut(&mut self) -> impl Iterator<Item = (Part, &mut [f32])> {
        let parts = self.shape().parts();
        let arrays = self.layers.iter_mut().flat_map(|layer| {
            let RecurrentLayer { weight_ih, weight_hh, bias_ih, bias_hh, .. } = layer;
            [weight_ih, weight_hh, bias_ih, bias_hh].map(Vec::as_mut_slice)
        });
        parts.into_iter().zip(arrays)
    }

    /// Whether sizes follow each other: what is wrong, in words.
    pub fn mistake(&self) -> Option<String> {
        let gates = self.cell.gates();
        let mut inputs = self.inputs();
        for (number, layer) in self.layers.iter().enumerate() {
            let RecurrentLayer { hidden, .. } = *layer;
            let sizes =
                [layer.weight_ih.len(), layer.weight_hh.len(), layer.bias_ih.len(), layer.bias_hh.len()];
            // A product that overflows is no size of an array: `None` differs from all of them.
            let wide = hidden.checked_mul(gates);
            let product = |rows: usize| wide.and_then(|wide| rows.checked_mul(wide));
            let wanted = [product(layer.inputs), product(hidden), wide, wide];
            if hidden == 0 || layer.inputs == 0 || layer.inputs != inputs || sizes.map(Some) != wanted {
                return Some(format!(
                    "{} layer {} takes {} numbers of {inputs}, has {hidden} units and parts of {sizes:?} numbers",
                    self.cell.name(),
                    number + 1,
                    layer.inputs
                ));
            }
            inputs = hidden;
        }
        self.layers.is_empty().then(|| "it has no recurrent layers".to_owned())
    }

    /// Nothing remembered, for `environments` robots.
    pub fn memory(&self, environments: usize) -> Memory {
        let state = |layer: &RecurrentLayer| {
            let size = environments * layer.hidden;
            let cell = if self.cell == Cell::Lstm { size } else { 0 };
            State { hidden: layer.hidden, output: vec![0.0; size], cell: vec![0.0; cell] }
        };
        Memory { layers: self.layers.iter().map(state).collect() }
    }

    /// One step of `rows` environments: `input` is `rows × inputs`, `output` becomes `rows × outputs`; both row-major.
    ///
    /// # Panics
    /// If a slice or the memory is of another size: an error of the caller.
    pub fn step(&self, rows: usize, input: &[f32], memory: &mut Memory, output: &mut Vec<f32>) {
        let mut x = input[..rows * self.inputs()].to_vec();
        // The new output of each layer is the input of the next one.
        for (layer, state) in self.layers.iter().zip(&mut memory.layers) {
            layer.step(self.cell, rows, &x, state);
            x.clear();
            x.extend_from_slice(&state.output[..rows * layer.hidden]);
        }
        *output = x;
    }
}

impl RecurrentLayer {
    /// `times` steps of `rows` robots. `x` gives a robot's input, `times × inputs`; `before` its output before the first step,
    /// and of an LSTM its cell. A row of `out` is all outputs, then the last output and, of an LSTM, the last cell.
    pub(crate) fn along<'a>(
        &self,
        cell: Cell,
        (rows, times): (usize, usize),
        x: impl Fn(usize) -> &'a [f32],
        before: &[Vec<f32>],
        out: &mut [f32],
    ) {
        let (inputs, hidden) = (self.inputs, self.hidden);
        let mut before = before.iter().cloned();
        // ONNX begins at zero where a graph gives no state.
        let zeros = vec![0.0; rows * hidden];
        let output = before.next().unwrap_or_else(|| zeros.clone());
        let mut state = State { hidden, output, cell: before.next().unwrap_or(zeros) };
        // Numbers of one robot: its outputs at all steps, and the last state.
        let wide = out.len() / rows;
        for time in 0..times {
            let x: Vec<f32> =
                (0..rows).flat_map(|row| &x(row)[time * inputs..(time + 1) * inputs]).copied().collect();
            self.step(cell, rows, &x, &mut state);
            for (row, out) in out.chunks_exact_mut(wide).enumerate() {
                let new = &state.output[row * hidden..(row + 1) * hidden];
                out[time * hidden..(time + 1) * hidden].copy_from_slice(new);
            }
        }
        for (row, out) in out.chunks_exact_mut(wide).enumerate() {
            // Behind the outputs of all steps: the last output once more, and an LSTM's cell.
            let ends = [&state.output, &state.cell].map(|one| &one[row * hidden..(row + 1) * hidden]);
            let ends = ends[0].iter().chain(ends[1].iter().filter(|_| cell == Cell::Lstm));
            out[times * hidden..].iter_mut().zip(ends).for_each(|(out, &end)| *out = end);
        }
    }

    fn step(&self, cell: Cell, rows: usize, x: &[f32], state: &mut State) {
        let (hidden, wide) = (self.hidden, self.bias_ih.len());
        let product = |values: &[f32], width: usize, weight: &[f32]| {
            let mut gates = vec![0.0f32; rows * wide];
            let weight = Matrix::row_major(weight, width, wide);
            matmul::multiply(&mut gates, Matrix::row_major(values, rows, width), weight, false);
            gates
        };
        let mut gates = product(x, self.inputs, &self.weight_ih);
        let mut of_output = product(&state.output, hidden, &self.weight_hh);
        // Copies, because the step writes over the state that it reads.
        let (output_before, cell_before) = (state.output.clone(), state.cell.clone());
        // For a GRU both cells are empty slices, also where `along` has given it an array.
        let remembered = if cell == Cell::Lstm { rows * hidden } else { 0 };
        let step = Step {
            gates: &mut gates,
            of_output: &mut of_output,
            bias_ih: &self.bias_ih,
            bias_hh: &self.bias_hh,
            output_before: &output_before[..rows * hidden],
            cell_before: &cell_before[..remembered],
            output: &mut state.output[..rows * hidden],
            cell: &mut state.cell[..remembered],
        };
        step.take(cell);
    }
}
