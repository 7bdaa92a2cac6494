//! Forward and backward passes over one tile of rows. The derivatives are written out by hand.
//!
//! With x₀ the input, xₗ₊₁ = f(xₗ Wₗ + bₗ) and D = ∂loss/∂(xₗ Wₗ + bₗ), the chain rule gives from the last layer to
//! the first: ∂loss/∂Wₗ = xₗᵀ D, ∂loss/∂bₗ = Σ_rows D, and for the layer before D ← (D Wₗᵀ) ∘ f′(xₗ)
//! (Rumelhart, Hinton, Williams 1986).

use super::{
    Aligned, Layer, Shape, Weights, dense,
    dense::{Rows, RowsMut},
    dispatch::stride,
    lanes,
    scalar::Scalar,
};

/// A network's layer outputs and derivatives on a tile of up to a fixed number of rows.
pub(crate) struct Tape<T: Scalar> {
    shape: Shape,
    layers: Vec<Layer>,
    /// Output of every hidden layer, rows [`stride`] apart.
    hidden: Vec<Aligned<T>>,
    /// Output of the last layer, `rows × outputs`.
    output: Vec<T>,
    /// ∂loss/∂output of the last layer, `rows × outputs`; the caller fills it before [`Self::backward`].
    output_derivative: Vec<T>,
    /// Derivatives between the layers, two buffers in turn; rows [`stride`] apart.
    derivatives: [Aligned<T>; 2],
    /// Gradient of a transposed weight.
    transposed: Vec<T>,
}

impl<T: Scalar> Tape<T> {
    /// For tiles of up to `rows` rows.
    pub(crate) fn new(shape: &Shape, rows: usize) -> Self {
        let layers = shape.layers();
        let widest = shape.hidden.iter().copied().max().unwrap_or(0);
        let buffer = || Aligned::zeros(rows * stride(widest));
        Self {
            layers,
            hidden: shape.hidden.iter().map(|&width| Aligned::zeros(rows * stride(width))).collect(),
            output: vec![T::ZERO; rows * shape.outputs],
            output_derivative: vec![T::ZERO; rows * shape.outputs],
            derivatives: [buffer(), buffer()],
            transposed: Vec::new(),
            shape: shape.clone(),
        }
    }

    /// The network's output after [`Self::forward`], and where its derivative goes; both `rows × outputs`.
    pub(crate) fn output(&mut self, rows: usize) -> (&[T], &mut [T]) {
        let size = rows * self.shape.outputs;
        (&self.output[..size], &mut self.output_derivative[..size])
    }

    /// Evaluates `input`, whose rows are [`stride`] apart, and keeps every layer's output.
    pub(crate) fn forward(&mut self, weights: &Weights<T>, rows: usize, input: &[T]) {
        for (index, layer) in self.layers.iter().enumerate() {
            let (before, after) = self.hidden.split_at_mut(index);
            let x = Rows { data: before.last().map_or(input, |x| x), stride: stride(layer.inputs) };
            let (y, activation) = match after.first_mut() {
                Some(y) => (RowsMut { data: y, stride: stride(layer.outputs) }, Some(self.shape.activation)),
                None => (RowsMut { data: &mut self.output, stride: layer.outputs }, None),
            };
            dense::forward(x, rows, &weights.layers[index][0], &weights.biases[index], activation, y);
        }
    }

    /// Adds ∂loss/∂parameters to `gradient` (laid out as [`Layer`] says), after [`Self::forward`] of the same `input`
    /// and with the derivative of [`Self::output`] filled.
    pub(crate) fn backward(&mut self, weights: &Weights<T>, rows: usize, input: &[T], gradient: &mut [T]) {
        let [even, odd] = &mut self.derivatives;
        let (mut current, mut next) = (even, odd);
        for (index, layer) in self.layers.iter().enumerate().rev() {
            let Layer { inputs, outputs, .. } = *layer;
            let data = if index == 0 { input } else { &self.hidden[index - 1] };
            let x = Rows { data, stride: stride(inputs) };
            let of_weight = &mut gradient[layer.weight.clone()];
            let delta = if index + 1 == self.layers.len() {
                let delta = Rows { data: &self.output_derivative, stride: outputs };
                // A narrow last layer's rows are not padded, and would leave vectors half empty: its transpose.
                self.transposed.clear();
                self.transposed.resize(inputs * outputs, T::ZERO);
                dense::add_products(delta, x, rows, [outputs, inputs], &mut self.transposed);
                for (i, row) in of_weight.chunks_exact_mut(outputs).enumerate() {
                    let column = self.transposed[i..].iter().step_by(inputs);
                    row.iter_mut().zip(column).for_each(|(gradient, &sum)| *gradient += sum);
                }
                lanes::add_column_sums(&mut gradient[layer.bias.clone()], &delta.data[..rows * outputs]);
                delta
            } else {
                let delta = Rows { data: current, stride: stride(outputs) };
                dense::add_products(x, delta, rows, [inputs, outputs], of_weight);
                delta
            };
            if index == 0 {
                break;
            }
            let d = RowsMut { data: next, stride: stride(inputs) };
            let sums = &mut gradient[self.layers[index - 1].bias.clone()];
            let transposed = &weights.layers[index][1];
            dense::backward(delta, rows, transposed, x, self.shape.activation, d, sums);
            std::mem::swap(&mut current, &mut next);
        }
    }
}
