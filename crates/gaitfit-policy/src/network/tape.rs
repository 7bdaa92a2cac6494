//! Forward and backward passes over one tile of rows. The derivatives are written out by hand.
//!
//! With x₀ the input, xₗ₊₁ = f(xₗ Wₗ + bₗ) and D = ∂loss/∂(xₗ Wₗ + bₗ), the chain rule gives from the last layer to
//! the first: ∂loss/∂Wₗ = xₗᵀ D, ∂loss/∂bₗ = Σ_rows D, and for the layer before D ← (D Wₗᵀ) ∘ f′(xₗ)
//! (Rumelhart, Hinton, Williams 1986).

use aligned_vec::AVec;

use super::{Activation, Shape, Weights, forward, lanes, matmul, matmul::Matrix, scalar::Scalar};

/// Layer outputs and derivatives of one network at a time on a tile of up to a fixed number of rows. Networks take
/// turns in the same memory, which the caches so hold longer.
pub struct Tape<T> {
    /// Output of every layer, `rows × outputs`.
    outputs: Vec<AVec<T>>,
    /// f′ of every layer whose derivative is not computed from its output, `rows × outputs`; the others are empty.
    slopes: Vec<AVec<T>>,
    /// ∂loss/∂output of the last layer, `rows × outputs`; the caller fills it before [`Self::backward`].
    output_derivative: AVec<T>,
    /// Derivatives between the layers, two buffers in turn.
    derivatives: [AVec<T>; 2],
    /// Derivative of a narrow layer's weights, transposed.
    narrow: AVec<T>,
}

impl<T: Scalar> Tape<T> {
    /// For networks of `shapes` and tiles of up to `rows` rows.
    pub fn new(shapes: &[&Shape], rows: usize) -> Self {
        let mut tape = Self {
            outputs: Vec::new(),
            slopes: Vec::new(),
            output_derivative: AVec::new(0),
            derivatives: [AVec::new(0), AVec::new(0)],
            narrow: AVec::new(0),
        };
        // Buffers only grow, because networks take turns in them.
        let grow = |buffer: &mut AVec<T>, width: usize| {
            buffer.resize(buffer.len().max(rows * width), T::ZERO);
        };
        // Each buffer is as large as the largest network needs it, because they take turns.
        for shape in shapes {
            let layers = shape.layers();
            tape.outputs.resize_with(tape.outputs.len().max(layers.len()), || AVec::new(0));
            for (output, layer) in tape.outputs.iter_mut().zip(&layers) {
                grow(output, layer.outputs);
            }
            grow(&mut tape.output_derivative, shape.outputs);
            for derivative in &mut tape.derivatives {
                grow(derivative, shape.widest());
            }
        }
        tape
    }

    /// The network's output after [`Self::forward`], and where its derivative goes; both `rows × outputs`.
    pub fn output(&mut self, shape: &Shape, rows: usize) -> (&[T], &mut [T]) {
        let size = rows * shape.outputs;
        (&self.outputs[shape.hidden.len()][..size], &mut self.output_derivative[..size])
    }

    /// Evaluates `input`, `rows × inputs`, and keeps every layer's output.
    pub fn forward(&mut self, weights: &Weights<'_, T>, rows: usize, input: &[T]) {
        let &Weights { shape, parameters, .. } = weights;
        let layers = shape.layers();
        self.slopes.resize_with(self.outputs.len(), || AVec::new(0));
        for (index, layer) in layers.iter().enumerate() {
            let (before, after) = self.outputs.split_at_mut(index);
            let (input, output) = (before.last().map_or(input, |output| output), &mut after[0]);
            let Some(function) = kept_slope(weights, index) else {
                forward::layer(&layers, index, shape.activation, parameters, rows, input, output);
                continue;
            };
            let (slopes, size) = (&mut self.slopes[index], rows * layer.outputs);
            slopes.resize(slopes.len().max(size), T::ZERO);
            forward::sums(layer, parameters, rows, input, output);
            lanes::activate_with_slopes(&mut output[..size], &mut slopes[..size], function);
        }
    }

    /// Drops the rows whose derivative of [`Self::output`] is 0 throughout, of which PPO's clips make some: they add
    /// nothing to a gradient. The others close up in their order, in `input` too, so that sums over many rows keep their
    /// bits. Returns how many rows are left for [`Self::backward`].
    pub fn drop_idle(&mut self, weights: &Weights<'_, T>, rows: usize, input: &mut [T]) -> usize {
        let shape = weights.shape;
        let width = shape.outputs;
        let mut left = 0;
        for row in 0..rows {
            if self.output_derivative[row * width..(row + 1) * width].iter().all(|&d| d == T::ZERO) {
                continue;
            }
            // Up to the first idle row all stand where they should.
            if left < row {
                let close_up = |values: &mut [T], width: usize| {
                    values.copy_within(row * width..(row + 1) * width, left * width);
                };
                close_up(input, shape.inputs);
                close_up(&mut self.output_derivative, width);
                for (&width, output) in shape.hidden.iter().zip(&mut self.outputs) {
                    close_up(output, width);
                }
                // Slopes of other layers may be left from another network.
                for (index, &width) in shape.hidden.iter().chain([&shape.outputs]).enumerate() {
                    if kept_slope(weights, index).is_some() {
                        close_up(&mut self.slopes[index], width);
                    }
                }
            }
            left += 1;
        }
        left
    }

    /// Adds ∂loss/∂parameters to `gradient` (same layout), after [`Self::forward`] of the same `input` and with the
    /// derivative of [`Self::output`] filled.
    pub fn backward(&mut self, weights: &Weights<'_, T>, rows: usize, input: &[T], gradient: &mut [T]) {
        let shape = weights.shape;
        let layers = shape.layers();
        let last = layers.len() - 1;
        if kept_slope(weights, last).is_some() {
            // From the derivative by the output to that by the last layer's sums.
            let derivatives = self.output_derivative[..rows * shape.outputs].iter_mut();
            derivatives.zip(self.slopes[last].iter()).for_each(|(derivative, &slope)| *derivative *= slope);
        }
        let [even, odd] = &mut self.derivatives;
        let (mut current, mut next) = (even, odd);
        // From the last layer to the first, as in the formulas at the top of the file.
        for (index, layer) in layers.iter().enumerate().rev() {
            let size = rows * layer.outputs;
            let last = index + 1 == layers.len();
            let derivative = if last { &self.output_derivative[..size] } else { &current[..size] };
            let x = if index == 0 { input } else { &self.outputs[index - 1] };
            let derivative_matrix = Matrix::row_major(derivative, rows, layer.outputs);
            let x_matrix = Matrix::row_major(x, rows, layer.inputs);
            let of_weight = &mut gradient[layer.weight.clone()];
            // With outputs along the vectors they would be half empty. A single column has its own kernel.
            if (2..=lanes::NARROW).contains(&layer.outputs) && layer.outputs < layer.inputs {
                let size = layer.inputs * layer.outputs;
                self.narrow.resize(self.narrow.len().max(size), T::ZERO);
                let product = &mut self.narrow[..size];
                matmul::multiply(product, derivative_matrix.transposed(), x_matrix, false);
                // The product is outputs × inputs: its column i is row i of the weight's derivative.
                for (i, row) in of_weight.chunks_exact_mut(layer.outputs).enumerate() {
                    let column = product[i..].iter().step_by(layer.inputs);
                    row.iter_mut().zip(column).for_each(|(sum, &term)| *sum += term);
                }
            } else {
                matmul::multiply(of_weight, x_matrix.transposed(), derivative_matrix, true);
            }
            if last {
                // Biases of hidden layers are summed with the slopes, in the pass below.
                lanes::add_column_sums(&mut gradient[layer.bias.clone()], derivative);
            }
            // Nobody reads the derivative by the network's input.
            if index == 0 {
                break;
            }
            // D Wᵀ, and times f′ below: the derivative by the sums of the layer before.
            let w = &weights.transposed[layer.weight.clone()];
            let w = Matrix::row_major(w, layer.outputs, layer.inputs);
            let size = rows * layer.inputs;
            matmul::multiply(&mut next[..size], derivative_matrix, w, false);
            let sums = &mut gradient[layers[index - 1].bias.clone()];
            let kept = kept_slope(weights, index - 1).map(|_| &self.slopes[index - 1]);
            let h = kept.map_or(&x[..size], |slopes| &slopes[..size]);
            lanes::multiply_by_derivative(&mut next[..size], h, sums, shape.activation);
            std::mem::swap(&mut current, &mut next);
        }
    }

    /// Fills `of_input` with ∂loss/∂input, `rows × inputs`, after [`Self::backward`] with [`Weights::behind_another`].
    pub fn to_input(&self, weights: &Weights<'_, T>, rows: usize, of_input: &mut [T]) {
        let layers = weights.shape.layers();
        let Some(first) = layers.first() else { return };
        // The way back left the first layer's derivative in the buffer whose turn it was.
        let derivative = match layers.len() {
            1 => &self.output_derivative,
            count => &self.derivatives[(count - 1) % 2],
        };
        let derivative = Matrix::row_major(derivative, rows, first.outputs);
        let weight =
            Matrix::row_major(&weights.transposed[first.weight.clone()], first.outputs, first.inputs);
        matmul::multiply(of_input, derivative, weight, false);
    }
}

/// The function of a layer's sums, if the tape keeps its derivative.
fn kept_slope<T>(weights: &Weights<'_, T>, layer: usize) -> Option<Activation> {
    if layer == weights.shape.hidden.len() {
        return weights.output;
    }
    Some(weights.shape.activation).filter(|activation| !activation.slope_follows_from_output())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn idle_rows_are_dropped_and_the_others_close_up_in_order() {
        let shape = Shape { inputs: 2, hidden: vec![3], outputs: 2, activation: Activation::Elu };
        let mut tape = Tape::<f64>::new(&[&shape], 6);
        let mut input: Vec<f64> = (0..12).map(f64::from).collect();
        let parameters: Vec<f64> = (0..shape.parameters()).map(|i| 0.1 * i as f64 - 0.7).collect();
        let weights = Weights::new(&shape, &parameters);
        tape.forward(&weights, 6, &input);
        let hidden = tape.outputs[0].clone();
        let derivative = [0.0, 0.0, 0.0, 1.0, f64::NAN, 0.0, 0.0, -0.0, 2.0, 3.0, 0.0, 0.0];
        tape.output(&shape, 6).1.copy_from_slice(&derivative);
        assert_eq!(tape.drop_idle(&weights, 6, &mut input), 3);
        assert_eq!(input[..6], [2.0, 3.0, 4.0, 5.0, 8.0, 9.0]);
        let kept = [&hidden[3..9], &hidden[12..15]].concat();
        assert_eq!(tape.outputs[0][..9], kept);
        assert_eq!(tape.output_derivative[..2], [0.0, 1.0]);
        assert!(tape.output_derivative[2].is_nan());
        assert_eq!(tape.output_derivative[3..6], [0.0, 2.0, 3.0]);
    }
}
