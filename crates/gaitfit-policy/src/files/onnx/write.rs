//! A policy as an ONNX graph.

use super::metadata;
use super::proto::{
    Attribute, Dimension, FLOAT, FLOAT_ATTRIBUTE, Graph, INT_ATTRIBUTE, Model, Node, OperatorSet, Tensor,
    TensorShape, TensorType, Type, ValueInfo,
};
use crate::files::layers::take_apart;
use crate::network::Activation;
use crate::{Policy, PolicyError};
use prost::Message;

/// Version of the file layout, and of the operators.
const IR_VERSION: i64 = 8;
const OPSET: i64 = 17;

/// The graph's end points.
const INPUT: &str = "obs";
const OUTPUT: &str = "actions";

/// The bytes of an ONNX model that maps `obs` (F32, N × observation width, scaled as the interface says) to
/// `actions` (F32, N × joints, before clipping and scaling). The normaliser is its first two nodes, `Mul` and `Add`;
/// every layer is a `Gemm` with PyTorch's `outputs × inputs` weight. The interface is in its metadata.
///
/// # Errors
/// A policy whose parts do not fit ([`Policy::check`]).
pub fn write(policy: &Policy) -> Result<Vec<u8>, PolicyError> {
    policy.check()?;
    let mut nodes: Vec<Node> = Vec::new();
    let mut constants: Vec<Vec<u8>> = Vec::new();
    let mut head = INPUT.to_owned();
    if let Some(normaliser) = &policy.normaliser {
        let (factor, offset): (Vec<f32>, Vec<f32>) = normaliser.scale().into_iter().unzip();
        for (operator, name, values) in
            [("Mul", "normaliser.factor", factor), ("Add", "normaliser.offset", offset)]
        {
            constants.push(constant(name, &[values.len()], &values));
            head = push(&mut nodes, operator, name, [head, name.to_owned()].to_vec(), Vec::new());
        }
    }
    let layers = take_apart(&policy.actor);
    for (index, layer) in layers.iter().enumerate() {
        let name = format!("actor.{}", 2 * index);
        let (weight, bias) = (format!("{name}.weight"), format!("{name}.bias"));
        constants.push(constant(&weight, &[layer.outputs, layer.inputs], &layer.transposed()));
        constants.push(constant(&bias, &[layer.outputs], &layer.bias));
        head = push(&mut nodes, "Gemm", &name, vec![head, weight, bias], vec![integer("transB", 1)]);
        if index + 1 < layers.len() {
            let (operator, attributes) = match policy.actor.shape.activation {
                Activation::Elu => ("Elu", vec![float("alpha", 1.0)]),
                Activation::Relu => ("Relu", Vec::new()),
                Activation::Tanh => ("Tanh", Vec::new()),
            };
            head = push(&mut nodes, operator, &format!("actor.{}", 2 * index + 1), vec![head], attributes);
        }
    }
    if let Some(last) = nodes.last_mut() {
        last.output = vec![OUTPUT.to_owned()];
    }
    let graph = Graph {
        node: nodes.iter().map(Message::encode_to_vec).collect(),
        // A graph must have a name, a policy need not know its robot.
        name: Some(&policy.interface.robot)
            .filter(|name| !name.is_empty())
            .map_or("policy".into(), Clone::clone),
        initializer: constants,
        input: vec![end(INPUT, policy.actor.shape.inputs)],
        output: vec![end(OUTPUT, policy.actor.shape.outputs)],
    };
    let model = Model {
        ir_version: IR_VERSION,
        producer_name: "gaitfit".to_owned(),
        producer_version: env!("CARGO_PKG_VERSION").to_owned(),
        graph: Some(graph.encode_to_vec()),
        opset_import: vec![OperatorSet { domain: String::new(), version: OPSET }.encode_to_vec()],
        metadata_props: metadata::entries(policy)?.iter().map(Message::encode_to_vec).collect(),
    };
    Ok(model.encode_to_vec())
}

/// Adds a node and gives the name of its output.
fn push(
    nodes: &mut Vec<Node>,
    operator: &str,
    name: &str,
    input: Vec<String>,
    attributes: Vec<Attribute>,
) -> String {
    let output = format!("{name}.out");
    nodes.push(Node {
        input,
        output: vec![output.clone()],
        name: name.to_owned(),
        op_type: operator.to_owned(),
        attribute: attributes.iter().map(Message::encode_to_vec).collect(),
        domain: String::new(),
    });
    output
}

fn integer(name: &str, i: i64) -> Attribute {
    Attribute { name: name.to_owned(), i, kind: INT_ATTRIBUTE, ..Attribute::default() }
}

fn float(name: &str, f: f32) -> Attribute {
    Attribute { name: name.to_owned(), f, kind: FLOAT_ATTRIBUTE, ..Attribute::default() }
}

fn constant(name: &str, dims: &[usize], values: &[f32]) -> Vec<u8> {
    Tensor {
        dims: dims.iter().map(|&length| length as i64).collect(),
        data_type: FLOAT,
        name: name.to_owned(),
        raw_data: values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        ..Tensor::default()
    }
    .encode_to_vec()
}

/// An end point of N rows of `width` numbers.
fn end(name: &str, width: usize) -> Vec<u8> {
    let rows = Dimension { dim_value: None, dim_param: Some("N".to_owned()) };
    let width = Dimension { dim_value: Some(width as i64), dim_param: None };
    let shape = TensorShape { dim: vec![rows.encode_to_vec(), width.encode_to_vec()] };
    let tensor = TensorType { elem_type: FLOAT, shape: Some(shape) };
    ValueInfo { name: name.to_owned(), kind: Some(Type { tensor: Some(tensor) }) }.encode_to_vec()
}
