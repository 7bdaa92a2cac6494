//! A policy as an ONNX graph.

use super::metadata;
use super::proto::{
    Attribute, Dimension, Entry, FLOAT, Graph, Model, Node, OperatorSet, TensorShape, TensorType, Type,
    ValueInfo,
};
use super::write_memory::{STATES, remember};
use super::write_parts::{constant, float, integer, push};
use crate::layers::take_apart;
use gaitfit_policy::invalid;
use gaitfit_policy::network::{Activation, Network, Recurrent, SELU};
use gaitfit_policy::{Front, Policy, PolicyError};
use prost::Message;

/// Version of the file layout, and of the operators: the first set with `LayerNormalization`, and the layout
/// of ONNX 1.12, which has it.
const IR_VERSION: i64 = 8;
const OPSET: i64 = 17;

/// The graph's end points.
const INPUT: &str = "obs";
const OUTPUT: &str = "actions";

/// The bytes of an ONNX model that maps `obs` (F32, N × observation width, scaled as the interface says) to
/// `actions` (F32, N × joints, before clipping and scaling). The normaliser is its first two nodes, `Mul` and `Add`;
/// every layer is a `Gemm` with PyTorch's `outputs × inputs` weight. The interface is in its metadata.
///
/// A recurrent policy has the ends of rsl_rl's exporter: it also takes what it remembered, `h_in` and an LSTM's `c_in`
/// (F32, layers × N × units), and gives it anew, `h_out` and `c_out`. Zeros begin an episode.
///
/// # Errors
/// A policy whose parts do not fit ([`Policy::check`]), a two-part one, or one whose recurrent layers differ in width.
pub fn write(policy: &Policy) -> Result<Vec<u8>, PolicyError> {
    whole(policy, None)
}

/// As [`write()`], for one row at a time: the end points are 1 × width. Programs that make their input by the shape that
/// the file says, such as unitree_rl_lab's, cannot take N rows.
///
/// # Errors
/// As there.
pub fn write_single(policy: &Policy) -> Result<Vec<u8>, PolicyError> {
    whole(policy, Some(1))
}

fn whole(policy: &Policy, rows: Option<i64>) -> Result<Vec<u8>, PolicyError> {
    policy.check()?;
    policy.refuse_function("an ONNX file")?;
    if matches!(policy.front, Some(gaitfit_policy::Front::Graph(_))) {
        return Err(invalid(
            "the policy is a graph of operators from an ONNX file: use that file. For graph and interface in one file use \
             safetensors (gaitfit export --safetensors)",
        ));
    }
    // The reader of ONNX files follows one chain of layers, and an encoder makes two paths.
    if let Some(Front::Encoder(_)) = policy.front {
        return Err(invalid(
            "two-part policies are not written as ONNX; use safetensors (gaitfit export --safetensors)",
        ));
    }
    let memory = policy.actor_memory();
    if memory.is_some_and(|memory| memory.layers.iter().any(|layer| layer.hidden != memory.outputs())) {
        return Err(invalid(
            "recurrent layers of different widths are not written as ONNX; use safetensors (gaitfit export --safetensors)",
        ));
    }
    let scale = policy.normaliser.as_ref().map(|normaliser| normaliser.scale());
    // A graph must have a name, a policy need not know its robot.
    let robot = &policy.interface.robot;
    let name = if robot.is_empty() { "policy" } else { robot };
    metadata::seal(model(name, (memory, &policy.actor), scale, metadata::entries(policy)?, rows))
}

/// The bytes of an ONNX model of a network alone: `obs` (F32, N × inputs) to `actions` (F32, N × outputs). Before its
/// layers each input is multiplied by the first number of its pair in `scale` and then gains the second.
///
/// # Errors
/// A network or scale whose parts do not fit together.
pub fn write_network(name: &str, network: &Network, scale: &[(f32, f32)]) -> Result<Vec<u8>, PolicyError> {
    network.check().map_err(|error| invalid(error.to_string()))?;
    if scale.len() != network.shape.inputs {
        return Err(invalid(format!("{} scales for {} inputs", scale.len(), network.shape.inputs)));
    }
    Ok(model(name, (None, network), Some(scale.to_vec()), Vec::new(), None))
}

/// The model of a network behind its scale and memory, for so many rows at a time; for any number of them without one.
fn model(
    name: &str,
    (memory, network): (Option<&Recurrent>, &Network),
    scale: Option<Vec<(f32, f32)>>,
    metadata: Vec<Entry>,
    rows: Option<i64>,
) -> Vec<u8> {
    let mut nodes: Vec<Node> = Vec::new();
    let mut constants: Vec<Vec<u8>> = Vec::new();
    let mut head = INPUT.to_owned();
    if let Some(scale) = scale {
        let (factor, offset): (Vec<f32>, Vec<f32>) = scale.into_iter().unzip();
        for (operator, name, values) in
            [("Mul", "normaliser.factor", factor), ("Add", "normaliser.offset", offset)]
        {
            constants.push(constant(name, &[values.len()], &values));
            head = push(&mut nodes, operator, name, [head, name.to_owned()].to_vec(), Vec::new());
        }
    }
    let observed = memory.map_or(network.shape.inputs, Recurrent::inputs);
    let (mut input, mut output) =
        (vec![end(INPUT, &[], observed, rows)], vec![end(OUTPUT, &[], network.shape.outputs, rows)]);
    if let Some(memory) = memory {
        head = remember(&mut nodes, &mut constants, memory, head);
        for (state, [before, after]) in STATES.into_iter().enumerate() {
            // Only an LSTM has a cell besides its output.
            if state < memory.cell.remembered() {
                let layers = [memory.layers.len()];
                input.push(end(before, &layers, memory.outputs(), rows));
                output.push(end(after, &layers, memory.outputs(), rows));
            }
        }
    }
    let layers = take_apart(network);
    for (index, layer) in layers.iter().enumerate() {
        // As `nn.Sequential` numbers them: activations count too.
        let name = format!("actor.{}", 2 * index);
        let (weight, bias) = (format!("{name}.weight"), format!("{name}.bias"));
        constants.push(constant(&weight, &[layer.outputs, layer.inputs], &layer.transposed()));
        constants.push(constant(&bias, &[layer.outputs], &layer.bias));
        // The weight is stored as PyTorch stores it, `outputs × inputs`.
        head = push(&mut nodes, "Gemm", &name, vec![head, weight, bias], vec![integer("transB", 1)]);
        if let Some(norm) = network.norms.get(index).and_then(Option::as_ref) {
            let name = format!("{name}.norm");
            let parts = [("weight", &norm.weight), ("bias", &norm.bias)];
            let names = parts.map(|(part, _)| format!("{name}.{part}"));
            for ((_, values), name) in parts.into_iter().zip(&names) {
                constants.push(constant(name, &[values.len()], values));
            }
            let inputs = [vec![head], names.to_vec()].concat();
            let attributes = vec![integer("axis", -1), float("epsilon", norm.epsilon)];
            head = push(&mut nodes, "LayerNormalization", &name, inputs, attributes);
        }
        // The layers' function stands between layers, not behind the last one.
        let last = index + 1 == layers.len();
        let function = if last { network.output } else { Some(network.shape.activation) };
        if let Some(function) = function {
            head = activate(&mut nodes, &mut constants, &format!("actor.{}", 2 * index + 1), head, function);
        }
    }
    // Names of nodes' outputs are made from theirs; the graph's output needs the name that it promises.
    if let Some(last) = nodes.last_mut() {
        last.output = vec![OUTPUT.to_owned()];
    }
    let graph = Graph {
        node: nodes.iter().map(Message::encode_to_vec).collect(),
        name: name.to_owned(),
        initializer: constants,
        input,
        output,
    };
    let model = Model {
        ir_version: IR_VERSION,
        producer_name: metadata::PRODUCER.to_owned(),
        producer_version: env!("CARGO_PKG_VERSION").to_owned(),
        graph: Some(graph.encode_to_vec()),
        opset_import: vec![OperatorSet { domain: String::new(), version: OPSET }.encode_to_vec()],
        metadata_props: metadata.iter().map(Message::encode_to_vec).collect(),
    };
    model.encode_to_vec()
}

/// Adds a function's nodes and gives the name of their output. Functions without an operator of their own are written as
/// PyTorch's exporter does.
fn activate(
    nodes: &mut Vec<Node>,
    constants: &mut Vec<Vec<u8>>,
    name: &str,
    head: String,
    function: Activation,
) -> String {
    let single = |operator: &str, nodes: &mut Vec<Node>, attributes: Vec<Attribute>| {
        push(nodes, operator, name, vec![head.clone()], attributes)
    };
    let mut number = |part: &str, value: f32| {
        let full = format!("{name}.{part}");
        constants.push(constant(&full, &[], &[value]));
        full
    };
    let step = |nodes: &mut Vec<Node>, operator: &str, part: &str, inputs: [String; 2]| {
        push(nodes, operator, &format!("{name}.{part}"), inputs.to_vec(), Vec::new())
    };
    match function {
        Activation::Elu => single("Elu", nodes, vec![float("alpha", 1.0)]),
        Activation::EluOf(alpha) => single("Elu", nodes, vec![float("alpha", alpha)]),
        Activation::Relu => single("Relu", nodes, Vec::new()),
        Activation::Tanh => single("Tanh", nodes, Vec::new()),
        Activation::LeakyRelu(slope) => single("LeakyRelu", nodes, vec![float("alpha", slope)]),
        Activation::Selu => {
            let [alpha, gamma] = SELU.map(|value| value as f32);
            single("Selu", nodes, vec![float("alpha", alpha), float("gamma", gamma)])
        }
        Activation::Silu => {
            let gate = push(nodes, "Sigmoid", &format!("{name}.gate"), vec![head.clone()], Vec::new());
            step(nodes, "Mul", "product", [head.clone(), gate])
        }
        Activation::Gelu => {
            let [root, one, half] = [("root", std::f32::consts::SQRT_2), ("one", 1.0), ("half", 0.5)]
                .map(|(part, value)| number(part, value));
            let scaled = step(nodes, "Div", "scaled", [head.clone(), root]);
            let erf = push(nodes, "Erf", &format!("{name}.erf"), vec![scaled], Vec::new());
            let sum = step(nodes, "Add", "sum", [erf, one]);
            let product = step(nodes, "Mul", "product", [head.clone(), sum]);
            step(nodes, "Mul", "halved", [product, half])
        }
        Activation::GeluTanh => {
            let root = std::f32::consts::FRAC_2_PI.sqrt();
            let [root, cubic, one, half] =
                [("root", root), ("cubic", 0.044_715), ("one", 1.0), ("half", 0.5)]
                    .map(|(part, value)| number(part, value));
            let square = step(nodes, "Mul", "square", [head.clone(), head.clone()]);
            let cube = step(nodes, "Mul", "cube", [head.clone(), square]);
            let small = step(nodes, "Mul", "small", [cubic, cube]);
            let inner = step(nodes, "Add", "inner", [head.clone(), small]);
            let scaled = step(nodes, "Mul", "scaled", [root, inner]);
            let tanh = push(nodes, "Tanh", &format!("{name}.tanh"), vec![scaled], Vec::new());
            let sum = step(nodes, "Add", "sum", [one, tanh]);
            let product = step(nodes, "Mul", "product", [head.clone(), sum]);
            step(nodes, "Mul", "halved", [half, product])
        }
    }
}

/// An end point of `rows` rows, N without a number, of `width` numbers; `before` are the lengths of axes before the rows.
fn end(name: &str, before: &[usize], width: usize, rows: Option<i64>) -> Vec<u8> {
    // A named dimension is how ONNX leaves a length open.
    let any = rows.is_none().then(|| "N".to_owned());
    let rows = Dimension { dim_value: rows, dim_param: any };
    let fixed = |length: usize| Dimension { dim_value: Some(length as i64), dim_param: None };
    let before = before.iter().copied().map(fixed);
    let all = before.chain([rows, fixed(width)]);
    let shape = TensorShape { dim: all.map(|dimension| dimension.encode_to_vec()).collect() };
    let tensor = TensorType { elem_type: FLOAT, shape: Some(shape) };
    ValueInfo { name: name.to_owned(), kind: Some(Type { tensor: Some(tensor) }) }.encode_to_vec()
}
