//! Walking a graph from its input to its output, one node after the other.

use super::chain::Chain;
use super::constant::Constant;
use super::fuse::fuse;
use super::metadata;
use super::proto::{Attribute, Dimension, FLOAT, Graph, Model, Node, Tensor, ValueInfo};
use super::recurrent::{Remembered, is_recurrent};
use crate::PolicyError;
use crate::error::invalid;
use crate::files::layers::{Affine, transpose};
use crate::network::{Activation, LayerNorm, SELU};
use gaitfit_model::shown;
use prost::Message;
use std::collections::HashMap;

/// Most nodes and constants of a graph, entries of metadata, attributes and inputs of a node.
const MOST_PARTS: usize = 1024;
/// Most numbers of all constants together, those computed from others included.
const MOST_NUMBERS: usize = 32 << 20;

/// What the file's operators are called in the advice of errors.
const UNDERSTOOD: &str = "a multilayer perceptron of Gemm or MatMul, with Elu, Relu, Tanh, LeakyRelu, Selu, SiLU or GELU between the layers";

/// A model's parts.
pub struct Decoded {
    nodes: Vec<Node>,
    constants: HashMap<String, Constant>,
    inputs: Vec<ValueInfo>,
    outputs: Vec<ValueInfo>,
    /// Encoded entries.
    pub metadata: Vec<Vec<u8>>,
}

/// One message, with an error that says what it was.
pub fn decode_message<T: Message + Default>(bytes: &[u8], what: &str) -> Result<T, PolicyError> {
    T::decode(bytes).map_err(|error| {
        invalid(format!("no whole ONNX file: its {what} is cut short or damaged ({error}); export it again"))
    })
}

fn decode_all<T: Message + Default>(all: &[Vec<u8>], what: &str) -> Result<Vec<T>, PolicyError> {
    if all.len() > MOST_PARTS {
        return Err(invalid(format!("it has {} {what}s; a policy has at most {MOST_PARTS}", all.len())));
    }
    all.iter().map(|bytes| decode_message(bytes, what)).collect()
}

/// Takes a file apart, without understanding the graph yet.
pub fn decode(bytes: &[u8]) -> Result<Decoded, PolicyError> {
    let model: Model = decode_message(bytes, "model")?;
    if model.metadata_props.len() > MOST_PARTS {
        return Err(invalid(format!("it has more than {MOST_PARTS} entries of metadata")));
    }
    metadata::check(bytes, &model)?;
    let graph =
        model.graph.ok_or_else(|| invalid("it holds no graph, so it is no ONNX model or it is cut short"))?;
    let graph: Graph = decode_message(&graph, "graph")?;
    let mut constants = HashMap::new();
    for tensor in decode_all::<Tensor>(&graph.initializer, "initializer")? {
        constants.insert(tensor.name.clone(), Constant::read(tensor)?);
    }
    Ok(Decoded {
        nodes: decode_all(&graph.node, "node")?,
        constants,
        inputs: decode_all(&graph.input, "input")?,
        outputs: decode_all(&graph.output, "output")?,
        metadata: model.metadata_props,
    })
}

/// The layers between the graph's one input and its one output.
pub fn walk(model: &Decoded) -> Result<Chain, PolicyError> {
    // Old files list the initializers among the inputs.
    let mut inputs = model.inputs.iter().filter(|input| !model.constants.contains_key(&input.name));
    let remembers = model.nodes.iter().any(|node| is_recurrent(&node.op_type));
    let Some(input) = inputs.next() else {
        return Err(invalid("its graph has no input"));
    };
    let states: HashMap<String, Remembered> = inputs
        .enumerate()
        .map(|(origin, state)| (state.name.clone(), Remembered { origin, layer: None }))
        .collect();
    if !states.is_empty() && !remembers {
        return Err(invalid(
            "its graph does not have exactly one input: only policies of one observation are read",
        ));
    }
    let (Some(output), true) = (model.outputs.first(), model.outputs.len() == 1 || remembers) else {
        return Err(invalid(format!("its graph has {} outputs; a policy has one", model.outputs.len())));
    };
    let mut walk = Walk {
        constants: model.constants.clone(),
        numbers: model.constants.values().map(|constant| constant.values.len()).sum(),
        head: input.name.clone(),
        states,
        steps: false,
        input_width: last_dimension(input)?,
        chain: Chain::default(),
    };
    let ends: Vec<String> = model.outputs.iter().map(|output| output.name.clone()).collect();
    let nodes = fuse(model.nodes.clone(), &model.constants, &ends);
    for node in &nodes {
        walk.node(node).map_err(|why| {
            let name =
                if node.name.is_empty() { node.output.first().unwrap_or(&node.name) } else { &node.name };
            invalid(format!("node {} ({}): {why}", shown(name), shown(&node.op_type)))
        })?;
    }
    if walk.head != output.name {
        return Err(invalid(format!(
            "its output {} is not what the last layer gives; only {UNDERSTOOD} is read",
            shown(&output.name)
        )));
    }
    if walk.chain.is_empty() {
        return Err(invalid("its graph has no layers"));
    }
    Ok(walk.chain)
}

fn last_dimension(value: &ValueInfo) -> Result<Option<usize>, PolicyError> {
    let shape = value.kind.as_ref().and_then(|kind| kind.tensor.as_ref()?.shape.as_ref());
    let Some(last) = shape.and_then(|shape| shape.dim.last()) else { return Ok(None) };
    let last: Dimension = decode_message(last, "input")?;
    Ok(last.dim_value.and_then(|width| usize::try_from(width).ok()).filter(|&width| width > 0))
}

pub(super) struct Walk {
    pub(super) constants: HashMap<String, Constant>,
    /// Numbers in `constants`.
    numbers: usize,
    /// Name of the value that the chain gives now.
    pub(super) head: String,
    /// What the graph remembers from its last run, or will from this.
    pub(super) states: HashMap<String, Remembered>,
    /// Whether the chain's value has an axis of time steps before its rows.
    pub(super) steps: bool,
    /// The observation's width, where the file states it.
    input_width: Option<usize>,
    pub(super) chain: Chain,
}

impl Walk {
    fn node(&mut self, node: &Node) -> Result<(), String> {
        if !matches!(node.domain.as_str(), "" | "ai.onnx") {
            return Err(format!(
                "it is of the operator set `{}`; only {UNDERSTOOD} is read",
                shown(&node.domain)
            ));
        }
        if node.input.len() > MOST_PARTS || node.attribute.len() > MOST_PARTS {
            return Err(format!("it has more than {MOST_PARTS} inputs or attributes"));
        }
        let output = node.output.first().ok_or("it has no output")?.clone();
        if output == self.head || self.constants.contains_key(&output) {
            return Err("its output has a name that is taken".to_owned());
        }
        let attributes = Attributes::decode(node)?;
        if node.op_type == "Constant" {
            return self.keep(output, attributes.constant()?);
        }
        if is_recurrent(&node.op_type) {
            return self.recurrent(node, &attributes);
        }
        if self.remembers(node) {
            return Ok(());
        }
        // Optional inputs that are left out have empty names.
        let inputs: Vec<&str> =
            node.input.iter().map(String::as_str).filter(|name| !name.is_empty()).collect();
        if let Some(other) =
            inputs.iter().find(|&&name| name != self.head && !self.constants.contains_key(name))
        {
            return Err(format!(
                "it takes `{}`, which is not what the node before it gives; only {UNDERSTOOD} is read",
                shown(other)
            ));
        }
        if !inputs.contains(&self.head.as_str()) {
            let constants: Vec<&Constant> =
                inputs.iter().filter_map(|&name| self.constants.get(name)).collect();
            let folded = Constant::fold(&node.op_type, &constants)
                .ok_or_else(|| format!("it computes a constant; only {UNDERSTOOD} is read"))?;
            return self.keep(output, folded);
        }
        if !self.changes_steps(node, &attributes) {
            self.apply(node, &inputs, &attributes)?;
        }
        self.head = output;
        Ok(())
    }

    fn keep(&mut self, name: String, constant: Constant) -> Result<(), String> {
        self.numbers += constant.values.len();
        if self.numbers > MOST_NUMBERS {
            return Err(format!("the graph's constants have more than {MOST_NUMBERS} numbers"));
        }
        self.constants.insert(name, constant);
        Ok(())
    }

    /// One operator on the chain's value.
    fn apply(&mut self, node: &Node, inputs: &[&str], attributes: &Attributes) -> Result<(), String> {
        let first = inputs.first() == Some(&self.head.as_str());
        let constant = |index: usize| inputs.get(index).and_then(|name| self.constants.get(*name));
        let one = Constant::scalar(1.0);
        let zero = Constant::scalar(0.0);
        match (node.op_type.as_str(), first) {
            ("Identity" | "Dropout", true) => Ok(()),
            ("Flatten", true) if attributes.integer("axis", 1) == 1 => Ok(()),
            ("Cast", true) if attributes.integer("to", 0) == i64::from(FLOAT) => Ok(()),
            ("Reshape", true) => {
                let width = self.chain.width().or(self.input_width);
                let harmless = constant(1).is_some_and(|shape| keeps_rows(&shape.values, width));
                if harmless { Ok(()) } else { Err("it reshapes rows; only [−1, width] is read".to_owned()) }
            }
            ("Elu", true) => self.chain.activate(Activation::elu(attributes.number("alpha", 1.0))),
            ("LeakyRelu", true) => {
                self.chain.activate(Activation::LeakyRelu(attributes.number("alpha", 0.01)))
            }
            ("Selu", true) => {
                let [alpha, gamma] = SELU.map(|value| value as f32);
                let own = [attributes.number("alpha", alpha), attributes.number("gamma", gamma)];
                if own != [alpha, gamma] {
                    return Err(format!("its alpha and gamma are {own:?}; only SELU's own are read"));
                }
                self.chain.activate(Activation::Selu)
            }
            ("Silu" | "Swish", true) if attributes.number("alpha", 1.0) == 1.0 => {
                self.chain.activate(Activation::Silu)
            }
            ("GeluTanh", true) => self.chain.activate(Activation::GeluTanh),
            ("Gelu", true) => self.chain.activate(match attributes.text("approximate") {
                b"tanh" => Activation::GeluTanh,
                _ => Activation::Gelu,
            }),
            ("LayerNormalization", true) if matches!(attributes.integer("axis", -1), -1 | 1) => {
                let row = |constant: Option<&Constant>, other: f32| match constant {
                    Some(constant) => constant
                        .as_row()
                        .map(|row| row.iter().map(|&x| x as f32).collect::<Vec<f32>>())
                        .ok_or("its weight or bias does not act alike on every row"),
                    None => Ok(vec![other; self.chain.width().unwrap_or(0)]),
                };
                if inputs.len() > 3 || inputs.len() > 1 && constant(1).is_none() {
                    return Err("its weight is not a constant".to_owned());
                }
                self.chain.norm(LayerNorm {
                    weight: row(constant(1), 1.0)?,
                    bias: row(constant(2), 0.0)?,
                    epsilon: attributes.number("epsilon", LayerNorm::EPSILON),
                })
            }
            ("Relu", true) => self.chain.activate(Activation::Relu),
            ("Tanh", true) => self.chain.activate(Activation::Tanh),
            ("MatMul", true) => {
                let layer = linear(constant(1).ok_or("its weight is not a constant")?, false)?;
                self.chain.layer(layer)
            }
            ("Gemm", true) => {
                let weight = constant(1).ok_or("its weight is not a constant")?;
                let layer = gemm(weight, constant(2), attributes)?;
                self.chain.layer(layer)
            }
            ("Add" | "Sub" | "Mul" | "Div", _) => {
                let other =
                    constant(usize::from(first)).ok_or("it needs a constant beside the layers' value")?;
                let inverse = |name: &str, constant: &Constant| {
                    Constant::fold(name, &[constant]).ok_or("its constant cannot be used")
                };
                match (node.op_type.as_str(), first) {
                    ("Add", _) => self.chain.elementwise(&one, other),
                    ("Mul", _) => self.chain.elementwise(other, &zero),
                    ("Sub", true) => self.chain.elementwise(&one, &inverse("Neg", other)?),
                    ("Sub", false) => self.chain.elementwise(&Constant::scalar(-1.0), other),
                    ("Div", true) => self.chain.elementwise(&inverse("Reciprocal", other)?, &zero),
                    _ => Err("it divides by what the layers give".to_owned()),
                }
            }
            _ => Err(format!("it is not understood here; only {UNDERSTOOD} is read")),
        }
    }
}

/// A weight matrix; `transposed` is `outputs × inputs`.
fn linear(weight: &Constant, transposed: bool) -> Result<Affine, String> {
    let [rows, columns] = weight.dims[..] else {
        return Err(format!("its weight has shape {:?}; a matrix is needed", weight.dims));
    };
    let single: Vec<f32> = weight.values.iter().map(|&x| x as f32).collect();
    let (inputs, outputs, weight) =
        if transposed { (columns, rows, transpose(&single, rows, columns)) } else { (rows, columns, single) };
    Ok(Affine { inputs, outputs, weight, bias: vec![0.0; outputs] })
}

/// alpha · x W + beta · c.
fn gemm(weight: &Constant, bias: Option<&Constant>, attributes: &Attributes) -> Result<Affine, String> {
    if attributes.integer("transA", 0) != 0 {
        return Err("it transposes the layers' value (transA), which mixes rows".to_owned());
    }
    let mut layer = linear(weight, attributes.integer("transB", 0) != 0)?;
    let (alpha, beta) = (attributes.number("alpha", 1.0), attributes.number("beta", 1.0));
    for weight in &mut layer.weight {
        *weight *= alpha;
    }
    if let Some(bias) = bias {
        let row = bias.as_row().ok_or("its bias does not act alike on every row")?;
        if row.len() != 1 && row.len() != layer.outputs {
            return Err(format!("its bias has {} numbers, its weight gives {}", row.len(), layer.outputs));
        }
        layer.bias = (0..layer.outputs).map(|index| beta * row[index.min(row.len() - 1)] as f32).collect();
    }
    Ok(layer)
}

/// Whether a reshape to `shape` leaves rows of `width` as they are.
fn keeps_rows(shape: &[f64], width: Option<usize>) -> bool {
    let width = width.map(|width| width as f64);
    match *shape {
        // 0 keeps the length of that axis.
        [rows, last] => {
            (rows == -1.0 && (Some(last) == width || last == 0.0))
                || (rows == 0.0 && (last == -1.0 || last == 0.0 || Some(last) == width))
        }
        _ => false,
    }
}

/// A node's attributes.
pub(super) struct Attributes(Vec<Attribute>);

impl Attributes {
    pub(super) fn decode(node: &Node) -> Result<Self, String> {
        let all = node.attribute.iter().map(|bytes| Attribute::decode(bytes.as_slice()));
        all.collect::<Result<_, _>>()
            .map(Self)
            .map_err(|error| format!("its attributes are damaged ({error})"))
    }

    fn find(&self, name: &str) -> Option<&Attribute> {
        self.0.iter().find(|attribute| attribute.name == name)
    }

    pub(super) fn text(&self, name: &str) -> &[u8] {
        self.find(name).map_or(b"", |attribute| &attribute.s)
    }

    /// A list of whole numbers.
    pub(super) fn list(&self, name: &str) -> Option<&[i64]> {
        self.find(name).map(|attribute| &attribute.ints[..])
    }

    /// Whether there is an attribute of this name.
    pub(super) fn has(&self, name: &str) -> bool {
        self.find(name).is_some()
    }

    /// The one number of a list.
    pub(super) fn one_of(&self, name: &str) -> Option<i64> {
        match self.find(name)?.ints[..] {
            [one] => Some(one),
            _ => None,
        }
    }

    pub(super) fn integer(&self, name: &str, default: i64) -> i64 {
        self.find(name).map_or(default, |attribute| attribute.i)
    }

    fn number(&self, name: &str, default: f32) -> f32 {
        self.find(name).map_or(default, |attribute| attribute.f)
    }

    /// The value of a `Constant` node.
    pub(super) fn constant(&self) -> Result<Constant, String> {
        let attribute = self.0.first().filter(|_| self.0.len() == 1).ok_or("it has no single value")?;
        match (attribute.name.as_str(), &attribute.t) {
            ("value", Some(tensor)) => Constant::read(tensor.clone()).map_err(|error| error.to_string()),
            ("value_float", _) => Ok(Constant::scalar(f64::from(attribute.f))),
            ("value_int", _) => Ok(Constant::scalar(attribute.i as f64)),
            ("value_floats", _) => Ok(vector(attribute.floats.iter().map(|&x| f64::from(x)).collect())),
            ("value_ints", _) => Ok(vector(attribute.ints.iter().map(|&x| x as f64).collect())),
            _ => Err("its value is not a tensor of numbers".to_owned()),
        }
    }
}

fn vector(values: Vec<f64>) -> Constant {
    Constant { dims: vec![values.len()], values }
}
