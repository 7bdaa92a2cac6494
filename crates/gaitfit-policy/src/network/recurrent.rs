//! LSTM and GRU layers at work: inference one step at a time, as a policy runs.
//!
//! Gates lie in PyTorch's order (`nn.LSTM`: i, f, g, o; `nn.GRU`: r, z, n), with both of its bias vectors.
//! LSTM (Hochreiter, Schmidhuber 1997, with forget gates): c′ = σ(f) c + σ(i) tanh(g), h′ = σ(o) tanh(c′).
//! GRU (Cho et al. 2014, the reset gate behind the product): n = tanh(xₙ + σ(r) hₙ), h′ = (1 − σ(z)) n + σ(z) h.

use super::matmul::{self, Matrix};
use super::scalar::Scalar;

/// Kind of a recurrent layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cell {
    /// Long short-term memory.
    Lstm,
    /// Gated recurrent unit.
    Gru,
}

impl Cell {
    /// Gates of a unit.
    pub fn gates(self) -> usize {
        match self {
            Self::Lstm => 4,
            Self::Gru => 3,
        }
    }

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lstm => "lstm",
            Self::Gru => "gru",
        }
    }
}

/// One layer of `hidden` units.
#[derive(Clone, Debug, PartialEq)]
pub struct RecurrentLayer {
    /// Width of its input.
    pub inputs: usize,
    /// Units.
    pub hidden: usize,
    /// From the input to the gates: `inputs × gates · hidden`, row-major.
    pub weight_ih: Vec<f32>,
    /// From the last output to the gates: `hidden × gates · hidden`, row-major.
    pub weight_hh: Vec<f32>,
    /// Of the input's product, `gates · hidden`.
    pub bias_ih: Vec<f32>,
    /// Of the last output's product, `gates · hidden`.
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

/// What recurrent layers remember of some environments. Empty for policies without.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Memory {
    layers: Vec<State>,
}

/// Of one layer, `environments × hidden` each; `cell` is empty for a GRU.
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

    /// The numbers of one kind, `environments × numbers`.
    pub(crate) fn numbers(&mut self, kind: usize) -> &mut [f32] {
        &mut self.layers[kind].output
    }

    /// The episode of environment `index` begins: it remembers nothing.
    ///
    /// # Panics
    /// If there is no such environment: an error of the caller.
    pub fn begin(&mut self, index: usize) {
        for state in &mut self.layers {
            for values in [&mut state.output, &mut state.cell] {
                if !values.is_empty() {
                    values[index * state.hidden..(index + 1) * state.hidden].fill(0.0);
                }
            }
        }
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

    /// Numbers of all weights and biases.
    pub fn parameters(&self) -> impl Iterator<Item = &[f32]> {
        self.layers
            .iter()
            .flat_map(|layer| [&layer.weight_ih[..], &layer.weight_hh, &layer.bias_ih, &layer.bias_hh])
    }

    /// Whether sizes follow each other: what is wrong, in words.
    pub(crate) fn mistake(&self) -> Option<String> {
        let gates = self.cell.gates();
        let mut inputs = self.inputs();
        for (number, layer) in self.layers.iter().enumerate() {
            let RecurrentLayer { hidden, .. } = *layer;
            let sizes =
                [layer.weight_ih.len(), layer.weight_hh.len(), layer.bias_ih.len(), layer.bias_hh.len()];
            let wide = hidden.checked_mul(gates)?;
            let wanted = [layer.inputs.checked_mul(wide), hidden.checked_mul(wide), Some(wide), Some(wide)];
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
        for (layer, state) in self.layers.iter().zip(&mut memory.layers) {
            layer.step(self.cell, rows, &x, state);
            x.clear();
            x.extend_from_slice(&state.output[..rows * layer.hidden]);
        }
        *output = x;
    }
}

fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exponential::<false>())
}

fn tanh(x: f32) -> f32 {
    x.hyperbolic_tangent::<false>()
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
        let zeros = vec![0.0; rows * hidden];
        let output = before.next().unwrap_or_else(|| zeros.clone());
        let mut state = State { hidden, output, cell: before.next().unwrap_or(zeros) };
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
        let of_input = product(x, self.inputs, &self.weight_ih);
        let of_output = product(&state.output, hidden, &self.weight_hh);
        for row in 0..rows {
            let gate = |number: usize, unit: usize| {
                let at = number * hidden + unit;
                let x = of_input[row * wide + at] + self.bias_ih[at];
                (x, of_output[row * wide + at] + self.bias_hh[at])
            };
            for unit in 0..hidden {
                let sum = |number: usize| {
                    let (x, h) = gate(number, unit);
                    x + h
                };
                let at = row * hidden + unit;
                match cell {
                    Cell::Lstm => {
                        let kept = sigmoid(sum(1)) * state.cell[at] + sigmoid(sum(0)) * tanh(sum(2));
                        state.cell[at] = kept;
                        state.output[at] = sigmoid(sum(3)) * tanh(kept);
                    }
                    Cell::Gru => {
                        let (x, h) = gate(2, unit);
                        let new = tanh(x + sigmoid(sum(0)) * h);
                        let old = sigmoid(sum(1));
                        state.output[at] = (1.0 - old) * new + old * state.output[at];
                    }
                }
            }
        }
    }
}
