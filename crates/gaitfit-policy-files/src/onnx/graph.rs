//! Walking a graph from its input to its output, one node after the other.

use super::attributes::Attributes;
use super::chain::Chain;
use super::constant::{Constant, MAX_NUMBERS as MAX_MOVED};
use super::decoded::{Decoded, MAX_PARTS, decode_all, decode_message};
use super::external::{self, Beside};
use super::fuse::fuse;
use super::linear::{gemm, keeps_rows, linear};
use super::metadata;
use super::moves::moved;
use super::node_error::{NodeError, misfit, unread};
use super::parts::Parts;
use super::proto::{Dimension, FLOAT, Graph, Model, Node, OperatorSet, Tensor, ValueInfo};
use super::recurrent::{Remembered, is_recurrent};
use gaitfit_model::shown;
use gaitfit_policy::PolicyError;
use gaitfit_policy::invalid;
use gaitfit_policy::network::{Activation, LayerNorm};
use prost::Message;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Max number of numbers of all constants together, those computed from others included.
const MAX_NUMBERS: usize = 32 << 20;

/// Max number of axes of an input; more are refused later.
const MAX_AXES: usize = 8;

/// Operators of files that name no version.
const LATEST: i64 = 17;

/// Name of the file's operators in the advice of errors.
const UNDERSTOOD: &str = "a multilayer perceptron of Gemm or MatMul, with Elu, Relu, Tanh, LeakyRelu, Selu, SiLU or GELU between the layers";

/// Takes a file apart, without understanding the graph yet. `folder`: where the file lies; tensors in other files are
/// looked for there.
pub fn decode(bytes: &[u8], folder: Option<&Path>) -> Result<Decoded, PolicyError> {
    let graph = graph_of(bytes)?;
    let mut beside = Beside::new(folder);
    let mut constants = HashMap::new();
    for mut tensor in decode_all::<Tensor>(&graph.0.initializer, "initializer")? {
        beside.fill(&mut tensor)?;
        constants.insert(tensor.name.clone(), Constant::read(tensor)?);
    }
    Ok(Decoded {
        nodes: decode_all(&graph.0.node, "node")?,
        constants,
        inputs: decode_all(&graph.0.input, "input")?,
        outputs: decode_all(&graph.0.output, "output")?,
        opset: graph.2,
        metadata: graph.1,
    })
}

/// Returns the model as one file: without metadata, and with the numbers of tensors that lie in other files.
pub fn inlined(bytes: &[u8], folder: Option<&Path>) -> Result<Vec<u8>, PolicyError> {
    let model: Model = decode_message(bytes, "model")?;
    let (mut graph, _, _) = graph_of(bytes)?;
    let mut beside = Beside::new(folder);
    for encoded in &mut graph.initializer {
        let mut tensor: Tensor = decode_message(encoded, "initializer")?;
        // Tensors inside the file keep their bytes. Only those of other files are encoded again.
        if tensor.data_location != 0 {
            beside.fill(&mut tensor)?;
            (tensor.data_location, tensor.external_data) = (0, Vec::new());
            *encoded = tensor.encode_to_vec();
        }
    }
    let graph = Some(graph.encode_to_vec());
    let model = Model { graph, metadata_props: Vec::new(), producer_name: String::new(), ..model };
    Ok(model.encode_to_vec())
}

/// The files beside a graph's own that hold its tensors' numbers, in the order of the tensors.
pub fn others(bytes: &[u8]) -> Result<Vec<PathBuf>, PolicyError> {
    let mut files = Vec::new();
    for tensor in decode_all::<Tensor>(&graph_of(bytes)?.0.initializer, "initializer")? {
        if let Some(place) = external::place(&tensor)?
            && !files.contains(&place.file)
        {
            files.push(place.file);
        }
    }
    Ok(files)
}

/// The graph of a file, its encoded metadata, and the version of ONNX's own operators.
fn graph_of(bytes: &[u8]) -> Result<(Graph, Vec<Vec<u8>>, i64), PolicyError> {
    let model: Model = decode_message(bytes, "model")?;
    if model.metadata_props.len() > MAX_PARTS {
        return Err(invalid(format!("it has more than {MAX_PARTS} entries of metadata")));
    }
    metadata::check(bytes, &model)?;
    let graph =
        model.graph.ok_or_else(|| invalid("it holds no graph, so it is no ONNX model or it is cut short"))?;
    let sets = decode_all::<OperatorSet>(&model.opset_import, "operator set")?;
    // A model may import several operator sets. ONNX's own has an empty domain, or this name.
    let onnx = sets.iter().find(|set| matches!(set.domain.as_str(), "" | "ai.onnx"));
    let version = onnx.map_or(LATEST, |set| set.version);
    Ok((decode_message(&graph, "graph")?, model.metadata_props, version))
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
    // Only recurrent layers have states, and a state is the one further input that the walk understands.
    if !states.is_empty() && !remembers {
        return Err(invalid(
            "its graph does not have exactly one input: only policies of one observation are read",
        ));
    }
    // Behind a memory the further outputs are the states.
    let (Some(output), true) = (model.outputs.first(), model.outputs.len() == 1 || remembers) else {
        return Err(invalid(format!("its graph has {} outputs; a policy has one", model.outputs.len())));
    };
    // A row has two axes, the robots' and that of its numbers. Axes between them may hold several rows of a robot.
    let lengths = dimensions(input)?;
    let between = lengths.get(1..lengths.len().saturating_sub(1)).unwrap_or_default();
    let mut walk = Walk {
        constants: model.constants.clone(),
        numbers: model.constants.values().map(|constant| constant.values.len()).sum(),
        head: input.name.clone(),
        states,
        memories: model.nodes.iter().filter(|node| is_recurrent(&node.op_type)).count(),
        steps: false,
        axes: lengths.len().max(2),
        stacked: between.iter().flatten().any(|&length| length > 1),
        input_width: last_dimension(input)?,
        chain: Chain::default(),
        parts: Parts::default(),
    };
    let ends: Vec<String> = model.outputs.iter().map(|output| output.name.clone()).collect();
    // Functions of several nodes become one first, because the walk follows a single value.
    let nodes = fuse(model.nodes.clone(), &model.constants, &ends);
    walk.parts.need(&nodes, &ends);
    for node in &nodes {
        walk.node(node).map_err(|why| {
            let name =
                if node.name.is_empty() { node.output.first().unwrap_or(&node.name) } else { &node.name };
            invalid(format!("node {} ({}): {why}", shown(name), shown(&node.op_type)))
        })?;
    }
    // The output itself may be a part, such as the mean of a row with mean and standard deviation.
    walk.take_part(&output.name)
        .map_err(|why| invalid(format!("its output {}: {why}", shown(&output.name))))?;
    if walk.head != output.name {
        return Err(invalid(format!(
            "its output {} is not what the last layer gives; only {UNDERSTOOD} is read",
            shown(&output.name)
        )));
    }
    // A graph that passes its input on would be a policy without weights.
    if walk.chain.is_empty() {
        return Err(invalid("its graph has no layers"));
    }
    Ok(walk.chain)
}

fn last_dimension(value: &ValueInfo) -> Result<Option<usize>, PolicyError> {
    let shape = value.kind.as_ref().and_then(|kind| kind.tensor.as_ref()?.shape.as_ref());
    let Some(last) = shape.and_then(|shape| shape.dim.last()) else { return Ok(None) };
    let last: Dimension = decode_message(last, "input")?;
    // An axis of length 0 or less is not a width; it counts as one that the file leaves open.
    Ok(last.dim_value.and_then(|width| usize::try_from(width).ok()).filter(|&width| width > 0))
}

/// Lengths of an input's or output's axes; `None` for one that the file leaves open.
pub(super) fn dimensions(value: &ValueInfo) -> Result<Vec<Option<usize>>, PolicyError> {
    let shape = value.kind.as_ref().and_then(|kind| kind.tensor.as_ref()?.shape.as_ref());
    let Some(shape) = shape else { return Ok(Vec::new()) };
    let length = |dimension: &Vec<u8>| {
        let dimension: Dimension = decode_message(dimension, "input")?;
        let length = dimension.dim_value.and_then(|length| usize::try_from(length).ok());
        Ok(length.filter(|&length| length > 0))
    };
    // One more than the limit, so that a later check still sees that there are too many.
    shape.dim.iter().take(MAX_AXES + 1).map(length).collect()
}

/// Whether `axis` is the last one of a value with so many axes.
pub(super) fn is_last(axis: i64, axes: usize) -> bool {
    axis == -1 || usize::try_from(axis).is_ok_and(|axis| axis + 1 == axes)
}

pub(super) struct Walk {
    pub(super) constants: HashMap<String, Constant>,
    /// Numbers in `constants`.
    numbers: usize,
    /// Name of the value that the chain gives now.
    pub(super) head: String,
    /// States of the graph before its last run and after this one, by name.
    pub(super) states: HashMap<String, Remembered>,
    /// Layers with a memory in the graph.
    pub(super) memories: usize,
    /// Whether the chain's value has an axis of time steps before its rows.
    pub(super) steps: bool,
    /// Number of axes of the chain's value.
    pub(super) axes: usize,
    /// Whether the chain's value has several rows of each robot.
    stacked: bool,
    /// The observation's width, where the file states it.
    input_width: Option<usize>,
    pub(super) chain: Chain,
    /// Parts of the chain's value, by name, and what only unneeded parts lead to.
    pub(super) parts: Parts,
}

impl Walk {
    fn node(&mut self, node: &Node) -> Result<(), NodeError> {
        if !matches!(node.domain.as_str(), "" | "ai.onnx") {
            return Err(unread(format!(
                "it is of the operator set `{}`; only {UNDERSTOOD} is read",
                shown(&node.domain)
            )));
        }
        if node.input.len() > MAX_PARTS || node.attribute.len() > MAX_PARTS {
            return Err(misfit(format!("it has more than {MAX_PARTS} inputs or attributes")));
        }
        let output = node.output.first().ok_or(misfit("it has no output"))?.clone();
        // A name that is given twice would leave open which value later nodes take.
        if output == self.head || self.constants.contains_key(&output) {
            return Err(misfit("its output has a name that is taken"));
        }
        let attributes = Attributes::decode(node)?;
        if node.op_type == "Constant" {
            return self.keep(output, attributes.constant()?);
        }
        if is_recurrent(&node.op_type) {
            return self.recurrent(node, &attributes);
        }
        if self.remembers(node, &attributes) {
            return Ok(());
        }
        // A part that no action needs may be computed by operators that are not read, such as a standard
        // deviation.
        if self.parts.is_unneeded(node) {
            return Ok(());
        }
        for name in &node.input {
            self.take_part(name)?;
        }
        // Optional inputs that are left out have empty names.
        let inputs: Vec<&str> =
            node.input.iter().map(String::as_str).filter(|name| !name.is_empty()).collect();
        if let Some(other) =
            inputs.iter().find(|&&name| name != self.head && !self.constants.contains_key(name))
        {
            return Err(unread(format!(
                "it takes `{}`, which is not what the node before it gives; only {UNDERSTOOD} is read",
                shown(other)
            )));
        }
        if !inputs.contains(&self.head.as_str()) {
            let constants: Vec<&Constant> =
                inputs.iter().filter_map(|&name| self.constants.get(name)).collect();
            let folded = Constant::fold(&node.op_type, &constants, &attributes)
                .or_else(|| moved(&node.op_type, &constants, &attributes, MAX_MOVED))
                .ok_or_else(|| unread(format!("it computes a constant; only {UNDERSTOOD} is read")))?;
            return self.keep(output, folded);
        }
        if self.cuts(node, &attributes)? {
            return Ok(());
        }
        if !self.changes_steps(node, &attributes) {
            self.apply(node, &inputs, &attributes)?;
        }
        self.head = output;
        // Parts were of the value before.
        self.parts.clear();
        Ok(())
    }

    fn keep(&mut self, name: String, constant: Constant) -> Result<(), NodeError> {
        // A small file can compute large constants from each other. At 8 bytes a number the limit is 256 MiB.
        self.numbers += constant.values.len();
        if self.numbers > MAX_NUMBERS {
            return Err(misfit(format!("the graph's constants have more than {MAX_NUMBERS} numbers")));
        }
        self.constants.insert(name, constant);
        Ok(())
    }

    /// One operator on the chain's value.
    fn apply(&mut self, node: &Node, inputs: &[&str], attributes: &Attributes) -> Result<(), NodeError> {
        let first = inputs.first() == Some(&self.head.as_str());
        let constant = |index: usize| inputs.get(index).and_then(|name| self.constants.get(*name));
        let one = Constant::scalar(1.0);
        let zero = Constant::scalar(0.0);
        match (node.op_type.as_str(), first) {
            // Dropout does nothing outside a training.
            ("Identity" | "Dropout", true) => Ok(()),
            // The numbers of a robot become one row, in the same order.
            ("Flatten", true) if attributes.integer("axis", 1) == 1 => {
                self.flat();
                Ok(())
            }
            ("Cast", true) if attributes.integer("to", 0) == i64::from(FLOAT) => Ok(()),
            ("Reshape", true) => self.reshape(inputs.get(1).copied()),
            ("Elu", true) => self.chain.activate(Activation::elu(attributes.number("alpha", 1.0))),
            ("LeakyRelu", true) => {
                self.chain.activate(Activation::LeakyRelu(attributes.number("alpha", 0.01)))
            }
            ("Selu", true) => match attributes.other_selu() {
                None => self.chain.activate(Activation::Selu),
                Some(stated) => {
                    Err(unread(format!("its alpha and gamma are {stated:?}; only SELU's own are read")))
                }
            },
            // ONNX has a factor on x within the sigmoid; only with 1 it is SiLU.
            ("Silu" | "Swish", true) if attributes.number("alpha", 1.0) == 1.0 => {
                self.chain.activate(Activation::Silu)
            }
            ("GeluTanh", true) => self.chain.activate(Activation::GeluTanh),
            ("Gelu", true) => self.chain.activate(match attributes.text("approximate") {
                b"tanh" => Activation::GeluTanh,
                _ => Activation::Gelu,
            }),
            ("LayerNormalization", true) if is_last(attributes.integer("axis", -1), self.axes) => {
                let norm = self.layer_norm(inputs, attributes)?;
                self.chain.norm(norm)
            }
            ("Relu", true) => self.chain.activate(Activation::Relu),
            ("Tanh", true) => self.chain.activate(Activation::Tanh),
            ("MatMul" | "Gemm", true) if self.stacked => {
                Err(unread("it works on several rows of the observation, one by one"))
            }
            ("MatMul", true) => {
                let layer = linear(
                    constant(1).ok_or(NodeError::NotConstant("its weight is not a constant"))?,
                    false,
                )?;
                self.chain.layer(layer)
            }
            ("Gemm", true) => {
                let weight = constant(1).ok_or(NodeError::NotConstant("its weight is not a constant"))?;
                let layer = gemm(weight, constant(2), attributes)?;
                self.chain.layer(layer)
            }
            ("Clip", true) => {
                // Operator sets before 11 have attributes.
                let limit = |number: usize, key: &str, other: f64| {
                    let Some(name) = node.input.get(number).filter(|name| !name.is_empty()) else {
                        return Ok(if attributes.has(key) {
                            f64::from(attributes.number(key, 0.0))
                        } else {
                            other
                        });
                    };
                    let constant = self.constants.get(name).and_then(Constant::as_scalar);
                    constant.ok_or(NodeError::NotConstant("its limits are not constants"))
                };
                let low = limit(1, "min", f64::NEG_INFINITY)?;
                let high = limit(2, "max", f64::INFINITY)?;
                self.chain.clip(low, high)
            }
            ("Max" | "Min", _) if inputs.len() == 2 => {
                // If the layers' value is the first input, the constant is the second.
                let other = constant(usize::from(first)).and_then(Constant::as_scalar);
                let limit = other.ok_or(misfit("it needs one constant number beside the layers' value"))?;
                match node.op_type.as_str() {
                    "Max" => self.chain.clip(limit, f64::INFINITY),
                    _ => self.chain.clip(f64::NEG_INFINITY, limit),
                }
            }
            ("Add" | "Sub" | "Mul" | "Div", _) => {
                let other = constant(usize::from(first))
                    .ok_or(misfit("it needs a constant beside the layers' value"))?;
                let inverse = |name: &str, constant: &Constant| {
                    Constant::fold(name, &[constant], attributes).ok_or(misfit("its constant cannot be used"))
                };
                match (node.op_type.as_str(), first) {
                    ("Add", _) => self.chain.elementwise(&one, other),
                    ("Mul", _) => self.chain.elementwise(other, &zero),
                    ("Sub", true) => self.chain.elementwise(&one, &inverse("Neg", other)?),
                    // c − x is x times −1, and then c is added.
                    ("Sub", false) => self.chain.elementwise(&Constant::scalar(-1.0), other),
                    ("Div", true) => self.chain.elementwise(&inverse("Reciprocal", other)?, &zero),
                    _ => Err(unread("it divides by what the layers give")),
                }
            }
            _ => Err(unread(format!(
                "it is not understood here; only {UNDERSTOOD} is read. Export the actor's layers without what stands around \
                 them, or run the whole file as a function in Python (gaitfit.Policy, docs/python.md)"
            ))),
        }
    }

    /// A reshape of the chain's value to the constant `shape`.
    fn reshape(&mut self, shape: Option<&str>) -> Result<(), NodeError> {
        let width = self.chain.width().or(self.input_width);
        let harmless = shape
            .and_then(|name| self.constants.get(name))
            .is_some_and(|shape| keeps_rows(&shape.values, width, self.axes, self.stacked));
        if !harmless {
            return Err(unread("it reshapes rows; only [−1, width] is read"));
        }
        self.flat();
        Ok(())
    }

    /// All axes behind the first become one.
    fn flat(&mut self) {
        if self.stacked {
            // Until now it was that of each of several rows.
            self.input_width = None;
        }
        (self.axes, self.stacked) = (2, false);
    }

    /// The weights of a layer norm.
    fn layer_norm(&self, inputs: &[&str], attributes: &Attributes) -> Result<LayerNorm, NodeError> {
        let constant = |index: usize| inputs.get(index).and_then(|name| self.constants.get(*name));
        let row = |constant: Option<&Constant>, other: f32| match constant {
            Some(constant) => constant
                .as_row()
                .map(|row| row.iter().map(|&x| x as f32).collect::<Vec<f32>>())
                .ok_or(unread("its weight or bias does not act alike on every row")),
            None => Ok(vec![other; self.chain.width().unwrap_or(0)]),
        };
        if inputs.len() > 3 || inputs.len() > 1 && constant(1).is_none() {
            return Err(NodeError::NotConstant("its weight is not a constant"));
        }
        Ok(LayerNorm {
            weight: row(constant(1), 1.0)?,
            bias: row(constant(2), 0.0)?,
            epsilon: attributes.number("epsilon", LayerNorm::EPSILON),
        })
    }
}
