//! Networks as the C++ template names them: arrays of numbers and functions as text.

use super::number;
use crate::layers::take_apart;
use gaitfit_policy::network::{Activation, Network, RecurrentLayer, SELU};
use serde::Serialize;

/// Numbers in a line of an array.
const IN_LINE: usize = 8;

/// A network.
#[derive(Serialize)]
pub(super) struct Perceptron {
    name: &'static str,
    /// "45-128-12 elu".
    about: String,
    inputs: usize,
    outputs: usize,
    layers: Vec<Layer>,
    /// The functions' bodies; `x` is the argument.
    hidden: Option<String>,
    output: Option<String>,
}

#[derive(Serialize)]
struct Layer {
    inputs: usize,
    outputs: usize,
    weight: String,
    bias: String,
    norm: Option<Norm>,
    function: Option<String>,
}

#[derive(Serialize)]
struct Norm {
    weight: String,
    bias: String,
    epsilon: String,
}

/// A recurrent layer.
#[derive(Serialize)]
pub(super) struct Remembering {
    inputs: usize,
    pub hidden: usize,
    gates: usize,
    weight_ih: String,
    weight_hh: String,
    bias_ih: String,
    bias_hh: String,
}

/// `network` under a name of its own.
pub(super) fn perceptron(name: &'static str, network: &Network) -> Perceptron {
    let layers = take_apart(network);
    let last = layers.len() - 1;
    let layer = |(index, layer): (usize, &crate::layers::Affine)| Layer {
        inputs: layer.inputs,
        outputs: layer.outputs,
        weight: array(&layer.weight),
        bias: array(&layer.bias),
        norm: network.norms.get(index).and_then(Option::as_ref).map(|norm| Norm {
            weight: array(&norm.weight),
            bias: array(&norm.bias),
            epsilon: literal(norm.epsilon),
        }),
        // Functions are named after their network, because encoder and actor may have different ones.
        function: match (index == last, network.output) {
            (false, _) => Some(format!("{name}_hidden")),
            (true, Some(_)) => Some(format!("{name}_output")),
            (true, None) => None,
        },
    };
    Perceptron {
        name,
        about: format!("{} {}", network.shape, network.shape.activation),
        inputs: network.shape.inputs,
        outputs: network.shape.outputs,
        layers: layers.iter().enumerate().map(layer).collect(),
        // A network of one layer never calls it.
        hidden: (last > 0).then(|| body(network.shape.activation)),
        output: network.output.map(body),
    }
}

/// A layer that remembers, of so many gates.
pub(super) fn remembering(layer: &RecurrentLayer, gates: usize) -> Remembering {
    Remembering {
        inputs: layer.inputs,
        hidden: layer.hidden,
        gates,
        weight_ih: array(&layer.weight_ih),
        weight_hh: array(&layer.weight_hh),
        bias_ih: array(&layer.bias_ih),
        bias_hh: array(&layer.bias_hh),
    }
}

/// A number with all its bits: the shortest decimal that is read as the same number.
pub(super) fn literal(value: f32) -> String {
    // The shortest text that reads back as the same bits. The exponent makes it a floating-point literal.
    format!("{value:e}f")
}

/// The inside of an array's braces.
pub(super) fn array(values: &[f32]) -> String {
    let line = |line: &[f32]| line.iter().map(|&value| literal(value)).collect::<Vec<_>>().join(", ");
    values.chunks(IN_LINE).map(line).collect::<Vec<_>>().join(",\n    ")
}

/// Body of a function of `x`, as C++.
fn body(function: Activation) -> String {
    let elu = |alpha: String| format!("return x > 0.0f ? x : {alpha}(exponential(x) - 1.0f);");
    match function {
        Activation::Elu => elu(String::new()),
        Activation::EluOf(alpha) => elu(literal(alpha) + " * "),
        // Written so that NaN stays NaN, as in PyTorch.
        Activation::Relu => "return x < 0.0f ? 0.0f : x;".to_owned(),
        Activation::Tanh => "return tangent(x);".to_owned(),
        Activation::LeakyRelu(slope) => format!("return x > 0.0f ? x : {} * x;", literal(slope)),
        Activation::Selu => {
            let [alpha, lambda] = SELU.map(|value| literal(value as f32));
            format!("return {lambda} * (x > 0.0f ? x : {alpha} * (exponential(x) - 1.0f));")
        }
        Activation::Silu => "return x / (1.0f + exponential(-x));".to_owned(),
        Activation::Gelu => {
            // 1 + erf(x) loses digits where x is negative; double precision leaves enough of them.
            let root = number(std::f64::consts::FRAC_1_SQRT_2);
            format!("return static_cast<float>(0.5 * x * (1.0 + std::erf(x * {root})));")
        }
        Activation::GeluTanh => {
            "const float inner = 0.7978845608f * (x + 0.044715f * x * x * x);\n  return 0.5f * x * (1.0f + tangent(inner));"
                .to_owned()
        }
    }
}
