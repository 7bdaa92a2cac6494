//! Nodes, attributes and constants of a graph that is written.

use super::proto::{Attribute, FLOAT, FLOAT_ATTRIBUTE, INT_ATTRIBUTE, INT64, Node, Tensor};
use prost::Message;

/// Adds a node and gives the name of its output.
pub(super) fn push(
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

/// An attribute that is a whole number.
pub(super) fn integer(name: &str, i: i64) -> Attribute {
    Attribute { name: name.to_owned(), i, kind: INT_ATTRIBUTE, ..Attribute::default() }
}

/// An attribute that is a number.
pub(super) fn float(name: &str, f: f32) -> Attribute {
    Attribute { name: name.to_owned(), f, kind: FLOAT_ATTRIBUTE, ..Attribute::default() }
}

/// A constant of whole numbers, in one row.
pub(super) fn whole_numbers(name: &str, values: &[i64]) -> Vec<u8> {
    Tensor {
        dims: vec![values.len() as i64],
        data_type: INT64,
        name: name.to_owned(),
        // ONNX's raw data are little-endian on every machine.
        raw_data: values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        ..Tensor::default()
    }
    .encode_to_vec()
}

/// A constant of numbers.
pub(super) fn constant(name: &str, dims: &[usize], values: &[f32]) -> Vec<u8> {
    Tensor {
        dims: dims.iter().map(|&length| length as i64).collect(),
        data_type: FLOAT,
        name: name.to_owned(),
        raw_data: values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        ..Tensor::default()
    }
    .encode_to_vec()
}
