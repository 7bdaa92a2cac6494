//! The parts of an ONNX file, each decoded from its bytes.

use super::constant::Constant;
use super::proto::{Node, ValueInfo};
use gaitfit_policy::{PolicyError, invalid};
use prost::Message;
use std::collections::HashMap;

/// Max number of nodes and constants of a graph, entries of metadata, attributes and inputs of a node.
pub const MAX_PARTS: usize = 1024;

/// A model's parts.
pub struct Decoded {
    pub(super) nodes: Vec<Node>,
    pub(super) constants: HashMap<String, Constant>,
    pub(super) inputs: Vec<ValueInfo>,
    pub(super) outputs: Vec<ValueInfo>,
    /// Version of ONNX's own operators.
    pub(super) opset: i64,
    /// Encoded entries.
    pub metadata: Vec<Vec<u8>>,
}

/// One message, with an error that says what it was.
pub fn decode_message<T: Message + Default>(bytes: &[u8], what: &str) -> Result<T, PolicyError> {
    T::decode(bytes).map_err(|error| {
        invalid(format!("no whole ONNX file: its {what} is cut short or damaged ({error}); export it again"))
    })
}

/// Messages, each with an error that says what it was.
pub fn decode_all<T: Message + Default>(all: &[Vec<u8>], what: &str) -> Result<Vec<T>, PolicyError> {
    // An entry of two bytes in the file takes far more memory once it is decoded.
    if all.len() > MAX_PARTS {
        return Err(invalid(format!("it has {} {what}s; a policy has at most {MAX_PARTS}", all.len())));
    }
    all.iter().map(|bytes| decode_message(bytes, what)).collect()
}
