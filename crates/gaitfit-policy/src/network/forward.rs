//! Forward pass over one tile of rows, keeping every layer's output for the backward pass.

use super::{Activation, Layer, LayerNorm, lanes, matmul, matmul::Matrix, scalar::Scalar};

/// Computes layer `index` of `layers`: `output[..rows × outputs]` from `input[..rows × inputs]`.
pub(crate) fn layer<T: Scalar>(
    layers: &[Layer],
    index: usize,
    activation: Activation,
    parameters: &[T],
    rows: usize,
    input: &[T],
    output: &mut [T],
) {
    let layer = &layers[index];
    // A function of the output, where a network has one, is the caller's.
    if index + 1 == layers.len() {
        return sums(layer, parameters, rows, input, output);
    }
    let output = &mut output[..rows * layer.outputs];
    let x = Matrix::row_major(input, rows, layer.inputs);
    let w = Matrix::row_major(&parameters[layer.weight.clone()], layer.inputs, layer.outputs);
    matmul::multiply(output, x, w, false);
    lanes::add_bias_and_activate(output, &parameters[layer.bias.clone()], activation);
}

/// A layer without a function; as [`layer`].
pub(crate) fn sums<T: Scalar>(layer: &Layer, parameters: &[T], rows: usize, input: &[T], output: &mut [T]) {
    let output = &mut output[..rows * layer.outputs];
    let bias = &parameters[layer.bias.clone()];
    // Few outputs would leave the vectors of a matrix product half empty.
    if (2..=lanes::NARROW).contains(&layer.outputs) {
        let input = &input[..rows * layer.inputs];
        return lanes::multiply_narrow(output, input, &parameters[layer.weight.clone()], bias);
    }
    let x = Matrix::row_major(input, rows, layer.inputs);
    let w = Matrix::row_major(&parameters[layer.weight.clone()], layer.inputs, layer.outputs);
    matmul::multiply(output, x, w, false);
    lanes::add_bias(output, bias);
}

/// A hidden layer whose sums are normalised before its activation; as [`layer`].
pub(crate) fn normed_layer(
    layer: &Layer,
    norm: &LayerNorm,
    activation: Activation,
    parameters: &[f32],
    rows: usize,
    input: &[f32],
    output: &mut [f32],
) {
    let output = &mut output[..rows * layer.outputs];
    let x = Matrix::row_major(input, rows, layer.inputs);
    let w = Matrix::row_major(&parameters[layer.weight.clone()], layer.inputs, layer.outputs);
    matmul::multiply(output, x, w, false);
    lanes::add_bias(output, &parameters[layer.bias.clone()]);
    norm.apply(output);
    // The norm's bias goes into the pass of the activation.
    lanes::add_bias_and_activate(output, &norm.bias, activation);
}
