//! Inference: against scalar products in double precision, whatever the number of rows.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use crate::common;

use common::ACTIVATIONS;
use gaitfit_policy::network::{Activation, LayerNorm, Network, Scratch, Shape, ShapeError};
use gaitfit_random::{Purpose, Stream};

fn shape(activation: Activation) -> Shape {
    Shape { inputs: 45, hidden: vec![128, 33, 64], outputs: 12, activation }
}

fn input(rows: usize) -> Vec<f32> {
    let stream = Stream::new(3, Purpose::BOOTSTRAP);
    (0..rows * 45).map(|draw| 2.0 * stream.normal(draw as u32) as f32).collect()
}

/// The error function by its series.
fn erf(x: f64) -> f64 {
    let (mut term, mut sum) = (x, x);
    for n in 1..200 {
        term *= -x * x / f64::from(n);
        sum += term / f64::from(2 * n + 1);
    }
    sum * std::f64::consts::FRAC_2_SQRT_PI
}

fn reference(network: &Network, row: &[f32]) -> Vec<f64> {
    let mut x: Vec<f64> = row.iter().map(|&x| f64::from(x)).collect();
    let layers = network.shape.layers();
    for (number, layer) in layers.iter().enumerate() {
        let p = |index: usize| f64::from(network.parameters[index]);
        let y = (0..layer.outputs).map(|j| {
            let products = (0..layer.inputs).map(|i| x[i] * p(layer.weight.start + i * layer.outputs + j));
            let y = products.sum::<f64>() + p(layer.bias.start + j);
            match network.shape.activation {
                _ if number + 1 == layers.len() => y,
                Activation::Elu => {
                    if y > 0.0 {
                        y
                    } else {
                        y.exp_m1()
                    }
                }
                Activation::Relu => y.max(0.0),
                Activation::Tanh => y.tanh(),
                Activation::EluOf(alpha) => f64::from(alpha).mul_add(y.min(0.0).exp_m1(), y.max(0.0)),
                Activation::LeakyRelu(slope) => y.max(0.0) + f64::from(slope) * y.min(0.0),
                Activation::Selu => {
                    let below = 1.673_263_242_354_377_2 * y.min(0.0).exp_m1();
                    1.050_700_987_355_480_5 * (y.max(0.0) + below)
                }
                Activation::Silu => y / (1.0 + (-y).exp()),
                Activation::Gelu => 0.5 * y * (1.0 + erf(y / std::f64::consts::SQRT_2)),
                Activation::GeluTanh => {
                    let inner = (2.0 / std::f64::consts::PI).sqrt() * (y + 0.044_715 * y.powi(3));
                    0.5 * y * (1.0 + inner.tanh())
                }
            }
        });
        x = y.collect();
    }
    x
}

#[test]
fn forward_is_the_network_in_double_precision() {
    for activation in ACTIVATIONS {
        let network = Network::random(shape(activation), 5, 0, 1.0).unwrap();
        let mut scratch = Scratch::new();
        for rows in [0, 1, 7, 9, 256, 261, 600] {
            let input = input(rows);
            let mut output = vec![f32::NAN; rows * 12];
            network.forward(rows, &input, &mut output, &mut scratch);
            for (row, output) in input.chunks_exact(45).zip(output.chunks_exact(12)) {
                for (got, want) in output.iter().zip(reference(&network, row)) {
                    assert!(
                        (f64::from(*got) - want).abs() < 2e-6,
                        "{activation:?}, {rows} rows: {got} {want}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_nan_in_a_row_comes_out_of_that_row_alone() {
    for activation in ACTIVATIONS {
        let network = Network::random(shape(activation), 5, 0, 1.0).unwrap();
        let mut input = input(20);
        input[3 * 45 + 7] = f32::NAN;
        let mut output = vec![0.0; 20 * 12];
        network.forward(20, &input, &mut output, &mut Scratch::new());
        for (row, output) in output.chunks_exact(12).enumerate() {
            assert!(output.iter().all(|x| x.is_nan() == (row == 3)), "{activation:?}, row {row}: {output:?}");
        }
    }
}

#[test]
fn layers_lie_one_after_the_other() {
    let shape = Shape { inputs: 3, hidden: vec![4], outputs: 2, activation: Activation::Tanh };
    let layers = shape.layers();
    assert_eq!((layers[0].weight.clone(), layers[0].bias.clone()), (0..12, 12..16));
    assert_eq!((layers[1].weight.clone(), layers[1].bias.clone()), (16..24, 24..26));
    assert_eq!(shape.parameters(), 26);
    assert_eq!(shape.to_string(), "3-4-2");
}

#[test]
fn first_parameters_are_uniform_within_their_bounds() {
    let network = Network::random(shape(Activation::Elu), 9, 1, 0.1).unwrap();
    for (number, layer) in network.shape.layers().iter().enumerate() {
        let bound = f64::from(if number == 3 { 0.1_f32 } else { 1.0 }) / (layer.inputs as f64).sqrt();
        let weights = &network.parameters[layer.weight.clone()];
        let greatest = weights.iter().fold(0.0_f64, |a, &b| a.max(f64::from(b).abs()));
        assert!(
            greatest <= bound * 1.000_001 && greatest > 0.97 * bound,
            "layer {number}: {greatest} of {bound}"
        );
        let variance = weights.iter().map(|&w| f64::from(w).powi(2)).sum::<f64>() / weights.len() as f64;
        assert!((variance / (bound * bound / 3.0) - 1.0).abs() < 0.1, "layer {number}");
    }
    let other = Network::random(shape(Activation::Elu), 9, 0, 0.1).unwrap();
    assert_ne!(network.parameters[0], other.parameters[0]);
}

#[test]
fn networks_that_cannot_be_are_refused() {
    let empty = Shape { inputs: 3, hidden: vec![4, 0], outputs: 2, activation: Activation::Elu };
    assert_eq!(Network::random(empty, 0, 0, 1.0), Err(ShapeError::EmptyLayer("hidden layer 2".into())));
    let shape = Shape { inputs: 3, hidden: vec![], outputs: 2, activation: Activation::Elu };
    let error = Network::new(shape, &[0.0; 7]).unwrap_err();
    assert_eq!(error.to_string(), "a network of 3-2 has 8 parameters, 7 were given");
}

#[test]
fn a_layer_norm_and_an_output_function_by_hand() {
    // One row: (1, 3) through the unit matrix, normed to (−1, 1) / √(1 + 3) = ∓0.5, scaled and shifted, then ReLU.
    let shape = Shape { inputs: 2, hidden: vec![2], outputs: 1, activation: Activation::Relu };
    let parameters = [1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 2.0, 0.5];
    let norm = LayerNorm { weight: vec![2.0, 4.0], bias: vec![1.5, -0.5], epsilon: 3.0 };
    let plain = Network::new(shape, &parameters).unwrap();
    let mut network = Network { norms: vec![Some(norm)], ..plain.clone() };
    network.check().unwrap();
    let forward = |network: &Network| {
        let mut output = [f32::NAN; 2];
        network.forward(2, &[1.0, 3.0, 3.0, 1.0], &mut output, &mut Scratch::new());
        output
    };
    // (−0.5 · 2 + 1.5, 0.5 · 4 − 0.5) = (0.5, 1.5) and (2.5, −2.5 → 0).
    assert_eq!(forward(&network), [0.5 + 2.0 * 1.5 + 0.5, 2.5 + 0.5]);
    network.output = Some(Activation::Tanh);
    for (got, want) in forward(&network).into_iter().zip([4.0f32.tanh(), 3.0f32.tanh()]) {
        assert!((got - want).abs() < 1e-6);
    }
    assert_eq!(plain.untrainable(), None);
    assert!(network.untrainable().unwrap().contains("layer norm"));
    network.norms = vec![];
    assert_eq!(network.untrainable(), None);
    network.norms = vec![Some(LayerNorm { weight: vec![1.0; 3], bias: vec![0.0; 3], epsilon: 1.0 })];
    assert!(
        network.check().unwrap_err().to_string().contains("hidden layer 1 has 3 numbers and the layer 2")
    );
}
