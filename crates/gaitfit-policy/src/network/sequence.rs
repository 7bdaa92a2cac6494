//! Recurrent layers over the steps of a rollout, and back: truncated back-propagation through time (Werbos 1990).
//!
//! Rows are numbered `step × robots + robot`. The layers begin in the state that each robot remembered when the rollout
//! began; nothing is propagated behind it, nor behind the beginning of an episode.

use aligned_vec::{AVec, avec};

use super::cell::{Back, Cell, Step};
use super::matmul::{self, Matrix};
use super::recurrent_shape::RecurrentShape;
use super::scalar::Scalar;
use super::{Recurrent, lanes};

/// Parameters of recurrent layers as the passes of a gradient want them.
pub struct RecurrentWeights<T> {
    /// Shape of the layers.
    pub shape: RecurrentShape,
    /// As [`RecurrentShape::parts`] has them.
    parameters: AVec<T>,
    /// Both matrices of each layer transposed, in the same places.
    transposed: AVec<T>,
}

impl<T: Scalar> RecurrentWeights<T> {
    /// The weights of layers of `shape`, with these parameters in the order of [`RecurrentShape::parts`].
    ///
    /// # Panics
    /// If there are fewer: an error of the caller.
    pub fn new(shape: RecurrentShape, parameters: &[T]) -> Self {
        let mut transposed = avec![T::ZERO; parameters.len()];
        for layer in shape.layers() {
            let wide = shape.cell.gates() * layer.hidden;
            let [input, output, ..] = layer.parts;
            for (range, inputs) in [(input, layer.inputs), (output, layer.hidden)] {
                let weight = &parameters[range.clone()];
                // Row j of the transpose is column j of the weight, whose elements are `wide` apart.
                for (j, row) in transposed[range].chunks_exact_mut(inputs).enumerate() {
                    let column = weight[j..].iter().step_by(wide);
                    row.iter_mut().zip(column).for_each(|(to, &from)| *to = from);
                }
            }
        }
        Self { shape, parameters: AVec::from_slice(0, parameters), transposed }
    }
}

impl From<&Recurrent> for RecurrentWeights<f32> {
    fn from(recurrent: &Recurrent) -> Self {
        let parameters: Vec<f32> = recurrent.parameters().flatten().copied().collect();
        Self::new(recurrent.shape(), &parameters)
    }
}

/// Inputs of recurrent layers over some steps of some robots.
#[derive(Clone, Copy)]
pub struct Sequences<'a, T> {
    /// Steps.
    pub steps: usize,
    /// Robots side by side.
    pub robots: usize,
    /// The layers' input; `steps × robots × inputs`.
    pub input: &'a [T],
    /// Whether an episode begins with a step, so that nothing is remembered before it; `steps × robots`.
    pub begins: &'a [bool],
    /// Memory before the first step; `robots × remembered`, as [`super::Memory::append_row`] gives it.
    pub start: &'a [T],
}

/// Numbers of one layer that the way back needs.
struct LayerTape<T> {
    /// `rows × gates · hidden`.
    gates: AVec<T>,
    /// `rows × gates · hidden`.
    of_output: AVec<T>,
    /// Output before and after every step, `rows × hidden`.
    output_before: AVec<T>,
    output: AVec<T>,
    /// Cell of an LSTM before and after every step.
    cell_before: AVec<T>,
    cell: AVec<T>,
}

/// Forward and backward passes; memory that is kept between calls and grows as needed.
pub struct SequenceTape<T> {
    layers: Vec<LayerTape<T>>,
    /// ∂loss/∂output of the last layer, `rows × outputs`.
    derivative: AVec<T>,
    /// Derivatives by what one step leaves the next.
    of_state: AVec<T>,
    of_cell: AVec<T>,
}

impl<T: Scalar> Default for SequenceTape<T> {
    fn default() -> Self {
        let [derivative, of_state, of_cell] = std::array::from_fn(|_| AVec::new(0));
        Self { layers: Vec::new(), derivative, of_state, of_cell }
    }
}

impl<T: Scalar> LayerTape<T> {
    fn new() -> Self {
        let [gates, of_output, output_before, output, cell_before, cell] =
            std::array::from_fn(|_| AVec::new(0));
        Self { gates, of_output, output_before, output, cell_before, cell }
    }

    fn resize(&mut self, cell: Cell, rows: usize, hidden: usize) {
        for array in [&mut self.gates, &mut self.of_output] {
            array.resize(rows * cell.gates() * hidden, T::ZERO);
        }
        for array in [&mut self.output_before, &mut self.output] {
            array.resize(rows * hidden, T::ZERO);
        }
        // A GRU has no cell: its arrays stay empty.
        let size = if cell == Cell::Lstm { rows * hidden } else { 0 };
        for array in [&mut self.cell_before, &mut self.cell] {
            array.resize(size, T::ZERO);
        }
    }
}

/// Fills the memory that a step begins with: `start` in the first step, else the result of the step before;
/// zeros where an episode begins.
fn carry<T: Scalar>(before: &mut [T], after: &[T], start: &[T], step: usize, begins: &[bool]) {
    if before.is_empty() {
        // This is the cell of a GRU: there is none to carry.
        return;
    }
    let size = start.len();
    let target = &mut before[step * size..(step + 1) * size];
    target.copy_from_slice(if step == 0 { start } else { &after[(step - 1) * size..step * size] });
    clear(target, begins);
}

/// Zeros in the rows of robots whose episodes begin.
fn clear<T: Scalar>(values: &mut [T], begins: &[bool]) {
    let width = values.len() / begins.len().max(1);
    if width == 0 {
        return;
    }
    for (row, _) in values.chunks_exact_mut(width).zip(begins).filter(|(_, begins)| **begins) {
        row.fill(T::ZERO);
    }
}

impl<T: Scalar> SequenceTape<T> {
    /// Evaluates all steps and keeps what [`Self::backward`] needs.
    ///
    /// # Panics
    /// If a slice is shorter than its size: an error of the caller.
    pub fn forward(&mut self, weights: &RecurrentWeights<T>, sequences: &Sequences<'_, T>) {
        let &Sequences { steps, robots, input, begins, start } = sequences;
        let (shape, rows) = (&weights.shape, steps * robots);
        let remembered = shape.remembered();
        let spans = shape.layers();
        self.layers.resize_with(spans.len(), LayerTape::new);
        self.derivative.resize(rows * shape.outputs(), T::ZERO);
        let mut place = 0;
        // Layer by layer, each over all steps: a layer needs nothing of those behind it.
        for (index, span) in spans.iter().enumerate() {
            // The layer below is read while this one is written.
            let (below, rest) = self.layers.split_at_mut(index);
            let layer = &mut rest[0];
            let hidden = span.hidden;
            let wide = shape.cell.gates() * hidden;
            layer.resize(shape.cell, rows, hidden);
            // A row of `start` has the layers one behind the other, each with its output and then its cell.
            let mut start_of = |width: usize| -> Vec<T> {
                let from = place;
                place += width;
                start.chunks_exact(remembered).flat_map(|row| &row[from..from + width]).copied().collect()
            };
            let output_start = start_of(hidden);
            let cell_start = start_of(if shape.cell == Cell::Lstm { hidden } else { 0 });
            let [weight_ih, weight_hh, bias_ih, bias_hh] =
                span.parts.each_ref().map(|range| &weights.parameters[range.clone()]);
            let x = below.last().map_or(input, |layer| &layer.output);
            let x = Matrix::row_major(x, rows, span.inputs);
            // The inputs of all steps are known, so they are multiplied at once. Only outputs go step by
            // step.
            matmul::multiply(&mut layer.gates, x, Matrix::row_major(weight_ih, span.inputs, wide), false);
            for step in 0..steps {
                let begins = &begins[step * robots..(step + 1) * robots];
                carry(&mut layer.output_before, &layer.output, &output_start, step, begins);
                carry(&mut layer.cell_before, &layer.cell, &cell_start, step, begins);
                let range = |width: usize| step * robots * width..(step + 1) * robots * width;
                let states = range(hidden);
                // A GRU has no cells, so its slices are empty.
                let cells = if shape.cell == Cell::Lstm { states.clone() } else { 0..0 };
                let of_output = &mut layer.of_output[range(wide)];
                let before = &layer.output_before[states.clone()];
                let weight = Matrix::row_major(weight_hh, hidden, wide);
                matmul::multiply(of_output, Matrix::row_major(before, robots, hidden), weight, false);
                let taken = Step {
                    gates: &mut layer.gates[range(wide)],
                    of_output,
                    bias_ih,
                    bias_hh,
                    output_before: before,
                    cell_before: &layer.cell_before[cells.clone()],
                    output: &mut layer.output[states],
                    cell: &mut layer.cell[cells],
                };
                taken.take(shape.cell);
            }
        }
    }

    /// The layers' output after [`Self::forward`], and where its derivative goes; both `steps × robots × outputs`.
    pub fn output(&mut self) -> (&[T], &mut [T]) {
        (self.layers.last().map_or(&[], |layer| &layer.output), &mut self.derivative)
    }

    /// Adds ∂loss/∂parameters to `gradient`, in the order of [`RecurrentShape::parts`], after [`Self::forward`] of the
    /// same `sequences` and with the derivative of [`Self::output`] filled. What is kept is used up.
    pub fn backward(
        &mut self,
        weights: &RecurrentWeights<T>,
        sequences: &Sequences<'_, T>,
        gradient: &mut [T],
    ) {
        let &Sequences { steps, robots, input, begins, .. } = sequences;
        let (shape, rows) = (&weights.shape, steps * robots);
        let cell = shape.cell;
        // From the last layer to the first, each over all steps from the last to the first.
        for (index, span) in shape.layers().iter().enumerate().rev() {
            let (below, rest) = self.layers.split_at_mut(index);
            let layer = &mut rest[0];
            let hidden = span.hidden;
            let wide = cell.gates() * hidden;
            let [weight_ih, weight_hh, bias_ih, bias_hh] = span.parts.clone();
            // Nothing follows the last step of a rollout, so the way back begins with zeros.
            self.of_state.clear();
            self.of_state.resize(robots * hidden, T::ZERO);
            self.of_cell.clear();
            self.of_cell.resize(if cell == Cell::Lstm { robots * hidden } else { 0 }, T::ZERO);
            for step in (0..steps).rev() {
                let range = |width: usize| step * robots * width..(step + 1) * robots * width;
                let states = range(hidden);
                let cells = if cell == Cell::Lstm { states.clone() } else { 0..0 };
                // Derivative by this step's output: through later steps, and through what stands behind the
                // layers.
                lanes::add(&mut self.of_state, &self.derivative[states.clone()]);
                let back = Back {
                    gates: &mut layer.gates[range(wide)],
                    of_output: &mut layer.of_output[range(wide)],
                    output_before: &layer.output_before[states],
                    cell_before: &layer.cell_before[cells.clone()],
                    cell: &layer.cell[cells],
                    of_state: &mut self.of_state,
                    of_cell: &mut self.of_cell,
                };
                back.take(cell, hidden);
                let products = layer.of_products(cell);
                // Through the weights to the output before; where an episode begins there is none.
                let d = Matrix::row_major(&products[range(wide)], robots, wide);
                let weight = Matrix::row_major(&weights.transposed[weight_hh.clone()], wide, hidden);
                matmul::multiply(&mut self.of_state, d, weight, true);
                let begins = &begins[step * robots..(step + 1) * robots];
                clear(&mut self.of_state, begins);
                clear(&mut self.of_cell, begins);
            }
            // Here the derivatives by the products of all steps are known.
            let x = below.last().map_or(input, |layer| &layer.output);
            let x = Matrix::row_major(x, rows, span.inputs);
            let before = Matrix::row_major(&layer.output_before, rows, hidden);
            let of_input = Matrix::row_major(&layer.gates, rows, wide);
            let products = layer.of_products(cell);
            let of_output = Matrix::row_major(products, rows, wide);
            // Weights are the same at all steps: their derivatives are one product over all rows.
            matmul::multiply(&mut gradient[weight_ih.clone()], x.transposed(), of_input, true);
            matmul::multiply(&mut gradient[weight_hh], before.transposed(), of_output, true);
            lanes::add_column_sums(&mut gradient[bias_ih], &layer.gates);
            lanes::add_column_sums(&mut gradient[bias_hh], products);
            // The derivative by this layer's input is that by the output of the layer below.
            if index > 0 {
                let weight = Matrix::row_major(&weights.transposed[weight_ih], wide, span.inputs);
                self.derivative.resize(rows * span.inputs, T::ZERO);
                matmul::multiply(&mut self.derivative, of_input, weight, false);
            }
        }
    }
}

impl<T> LayerTape<T> {
    /// Derivatives by the output's products, after the way back.
    fn of_products(&self, cell: Cell) -> &[T] {
        match cell {
            Cell::Lstm => &self.gates,
            Cell::Gru => &self.of_output,
        }
    }
}
