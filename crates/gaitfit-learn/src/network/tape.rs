//! Forward and backward passes over one tile of rows. The derivatives are written out by hand.
//!
//! With x₀ the input, xₗ₊₁ = f(xₗ Wₗ + bₗ) and D = ∂loss/∂(xₗ Wₗ + bₗ), the chain rule gives from the last layer to
//! the first: ∂loss/∂Wₗ = xₗᵀ D, ∂loss/∂bₗ = Σ_rows D, and for the layer before D ← (D Wₗᵀ) ∘ f′(xₗ)
//! (Rumelhart, Hinton, Williams 1986).

use super::{Layer, Shape, forward, lanes, matmul, matmul::Matrix, scalar::Scalar};

/// A network's layer outputs and derivatives on a tile of up to a fixed number of rows.
pub(crate) struct Tape<T> {
    shape: Shape,
    layers: Vec<Layer>,
    /// Output of every layer, `rows × outputs`.
    outputs: Vec<Vec<T>>,
    /// ∂loss/∂output of the last layer, `rows × outputs`; the caller fills it before [`Self::backward`].
    output_derivative: Vec<T>,
    /// Derivatives between the layers, two buffers in turn.
    derivatives: [Vec<T>; 2],
}

impl<T: Scalar> Tape<T> {
    /// For tiles of up to `rows` rows.
    pub(crate) fn new(shape: &Shape, rows: usize) -> Self {
        let layers = shape.layers();
        let outputs = layers.iter().map(|layer| vec![T::ZERO; rows * layer.outputs]).collect();
        let buffer = vec![T::ZERO; rows * shape.widest()];
        Self {
            layers,
            outputs,
            output_derivative: vec![T::ZERO; rows * shape.outputs],
            derivatives: [buffer.clone(), buffer],
            shape: shape.clone(),
        }
    }

    /// The network's output after [`Self::forward`], and where its derivative goes; both `rows × outputs`.
    pub(crate) fn output(&mut self, rows: usize) -> (&[T], &mut [T]) {
        let size = rows * self.shape.outputs;
        let output = self.outputs.last().map_or(&[][..], |output| &output[..size]);
        (output, &mut self.output_derivative[..size])
    }

    /// Evaluates `input`, `rows × inputs`, and keeps every layer's output.
    pub(crate) fn forward(&mut self, parameters: &[T], rows: usize, input: &[T]) {
        for index in 0..self.layers.len() {
            let (before, after) = self.outputs.split_at_mut(index);
            let input = before.last().map_or(input, |output| output);
            forward::layer(
                &self.layers,
                index,
                self.shape.activation,
                parameters,
                rows,
                input,
                &mut after[0],
            );
        }
    }

    /// Adds ∂loss/∂parameters to `gradient` (same layout), after [`Self::forward`] of the same `input` and with the
    /// derivative of [`Self::output`] filled.
    pub(crate) fn backward(&mut self, parameters: &[T], rows: usize, input: &[T], gradient: &mut [T]) {
        let [even, odd] = &mut self.derivatives;
        let (mut current, mut next) = (even, odd);
        for (index, layer) in self.layers.iter().enumerate().rev() {
            let size = rows * layer.outputs;
            let last = index + 1 == self.layers.len();
            let derivative = if last { &self.output_derivative[..size] } else { &current[..size] };
            let x = if index == 0 { input } else { &self.outputs[index - 1] };
            let derivative_matrix = Matrix::row_major(derivative, rows, layer.outputs);
            let x_transposed = Matrix::row_major(x, rows, layer.inputs).transposed();
            matmul::multiply(&mut gradient[layer.weight.clone()], x_transposed, derivative_matrix, true);
            if last {
                lanes::add_column_sums(&mut gradient[layer.bias.clone()], derivative);
            }
            if index == 0 {
                break;
            }
            let w = Matrix::row_major(&parameters[layer.weight.clone()], layer.inputs, layer.outputs);
            let size = rows * layer.inputs;
            matmul::multiply(&mut next[..size], derivative_matrix, w.transposed(), false);
            let sums = &mut gradient[self.layers[index - 1].bias.clone()];
            lanes::multiply_by_derivative(&mut next[..size], &x[..size], sums, self.shape.activation);
            std::mem::swap(&mut current, &mut next);
        }
    }
}
