//! `LSTM` and `GRU` nodes, and what exporters put around them: an axis for time steps, and states cut into layers.

use super::attributes::Attributes;
use super::constant::Constant;
use super::graph::Walk;
use super::node_error::{NodeError, misfit, unread};
use super::proto::Node;
use crate::layers::transpose;
use gaitfit_policy::network::{Cell, RecurrentLayer};
use std::collections::HashMap;

/// A state that goes into a graph or comes out of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Remembered {
    /// Index of the graph's state, from 0.
    pub origin: usize,
    /// The layer that it was cut out for.
    pub layer: Option<usize>,
}

/// Whether nodes of this operator remember.
pub(super) fn is_recurrent(operator: &str) -> bool {
    matches!(operator, "LSTM" | "GRU")
}

impl Walk {
    /// Whether the node only passes on what is remembered. Its outputs then are states too.
    pub(super) fn remembers(&mut self, node: &Node, attributes: &Attributes) -> bool {
        let passes =
            ["Slice", "Gather", "Squeeze", "Unsqueeze", "Identity", "Concat", "Split", "Transpose", "Cast"];
        let known = node.input.first().and_then(|name| self.states.get(name)).copied();
        let Some(mut state) = known.filter(|_| passes.contains(&node.op_type.as_str())) else { return false };
        let index = node.input.get(1).and_then(|name| self.constants.get(name)).and_then(Constant::as_scalar);
        // Before operator set 10 a slice's beginning is an attribute.
        let index = index.or_else(|| attributes.one_of("starts").map(|start| start as f64));
        // Layers lie along a state's first axis: the cut's beginning is the layer's number, from the end if it is negative.
        if matches!(node.op_type.as_str(), "Slice" | "Gather") {
            let from = |index: f64| if index < 0.0 { self.memories as f64 } else { 0.0 };
            // A number before the first layer is no layer's.
            state.layer = index.map(|index| match index + from(index) {
                layer if layer >= 0.0 => layer as usize,
                _ => usize::MAX,
            });
        }
        for (number, output) in node.output.iter().enumerate() {
            if node.op_type == "Split" {
                state.layer = Some(number);
            }
            self.states.insert(output.clone(), state);
        }
        true
    }

    /// Whether a node only gives rows an axis of one time step, or takes it or that of directions away. Of the axes of
    /// what a memory gives (steps, directions, rows, units) only rows and units are longer than one, so that nodes which
    /// keep the units last leave the order of the numbers alone.
    pub(super) fn changes_steps(&mut self, node: &Node, attributes: &Attributes) -> bool {
        if node.input.first() != Some(&self.head) {
            return false;
        }
        let behind_memory = self.chain.remembering() > 0 && self.chain.is_empty();
        match node.op_type.as_str() {
            "Unsqueeze" | "Squeeze" => {}
            "Transpose" if behind_memory => {
                let order = attributes.list("perm").unwrap_or_default();
                // The units stay last if the axis with the largest number stays last.
                return order.len() >= 3 && order.iter().max() == order.last();
            }
            "Reshape" if behind_memory => {
                let shape = node.input.get(1).and_then(|name| self.constants.get(name));
                let units = self.chain.width().map(|units| units as f64);
                let many = shape
                    .filter(|shape| shape.values.len() >= 3 && shape.values.last().copied() == units)
                    .map(|shape| shape.values.len());
                self.axes = many.unwrap_or(self.axes);
                return many.is_some();
            }
            _ => return false,
        }
        let listed = attributes.list("axes").map(<[i64]>::to_vec);
        let given = node.input.get(1).and_then(|name| self.constants.get(name));
        let axes = listed.or_else(|| given.map(|axes| axes.values.iter().map(|&axis| axis as i64).collect()));
        if node.op_type == "Unsqueeze" {
            // ONNX layers take steps × rows × inputs: the observation becomes one step, once, before the
            // first layer.
            let first = !self.steps && self.chain.remembering() == 0 && axes == Some(vec![0]);
            self.steps |= first;
            self.axes += usize::from(first);
            return first;
        }
        let gone = axes.filter(|axes| {
            behind_memory && !axes.is_empty() && axes.iter().all(|axis| matches!(axis, 0 | 1))
        });
        self.axes = self.axes.saturating_sub(gone.as_ref().map_or(0, Vec::len));
        gone.is_some()
    }

    /// One layer with a memory.
    pub(super) fn recurrent(&mut self, node: &Node, attributes: &Attributes) -> Result<(), NodeError> {
        let input =
            |number: usize| node.input.get(number).map(String::as_str).filter(|name| !name.is_empty());
        let cell = if node.op_type == "LSTM" { Cell::Lstm } else { Cell::Gru };
        if input(0) != Some(&self.head) || !self.steps {
            return Err(misfit("its input is not the observation as one time step"));
        }
        plain(node, attributes)?;
        let number = self.chain.remembering();
        let mut origins = Vec::new();
        // The initial output and the initial cell, by ONNX's order of inputs.
        for place in [5, 6] {
            let Some(name) = input(place) else { continue };
            match self.states.get(name) {
                Some(state) if state.layer.is_none_or(|layer| layer == number) => origins.push(state.origin),
                Some(_) => {
                    return Err(misfit(format!("`{}` is another layer's state", gaitfit_model::shown(name))));
                }
                // Constant states would not be remembered.
                None => return Err(misfit("its initial state is not an input of the graph")),
            }
        }
        let expected: Vec<usize> = (0..if cell == Cell::Lstm { 2 } else { 1 }).collect();
        // In another order an LSTM's cell would be taken as its output.
        if origins != expected {
            return Err(misfit(
                "its states are not the graph's inputs in their order (h_in, and c_in of an LSTM)",
            ));
        }
        let layer = layer_of(&self.constants, cell, [input(1), input(2), input(3)])?;
        self.chain.recurrent(cell, layer)?;
        // Behind the outputs of all steps come the last output and the last cell: the new states.
        for (origin, output) in node.output.iter().skip(1).enumerate() {
            self.states.insert(output.clone(), Remembered { origin, layer: Some(number) });
        }
        self.head = node.output.first().cloned().unwrap_or_default();
        // What it gives has a further axis, that of the directions.
        self.axes += 1;
        Ok(())
    }
}

/// Returns the kind of a node's cell.
///
/// # Errors
/// A node that PyTorch does not export.
pub(super) fn plain(node: &Node, attributes: &Attributes) -> Result<Cell, NodeError> {
    let input = |number: usize| node.input.get(number).filter(|name| !name.is_empty());
    let cell = if node.op_type == "LSTM" { Cell::Lstm } else { Cell::Gru };
    for name in ["activations", "clip", "activation_alpha", "activation_beta"] {
        if attributes.has(name) {
            return Err(unread(format!("its attribute {name} is not read")));
        }
    }
    let direction = attributes.text("direction");
    if !(direction.is_empty() || direction == b"forward")
        || attributes.integer("layout", 0) != 0
        || attributes.integer("input_forget", 0) != 0
        // PyTorch's reset gate acts behind the product with the last output; ONNX's default is before it.
        || cell == Cell::Gru && attributes.integer("linear_before_reset", 0) != 1
    {
        return Err(unread("only forward layers as PyTorch exports them are read"));
    }
    if input(4).is_some() || input(7).is_some() {
        return Err(misfit("sequence lengths and peepholes are not read"));
    }
    Ok(cell)
}

/// Weights in PyTorch's order of gates.
pub(super) fn layer_of(
    constants: &HashMap<String, Constant>,
    cell: Cell,
    [w, r, b]: [Option<&str>; 3],
) -> Result<RecurrentLayer, NodeError> {
    let constant = |name: Option<&str>| name.and_then(|name| constants.get(name));
    // ONNX has i, o, f, c and z, r, h.
    let order: &[usize] = if cell == Cell::Lstm { &[0, 2, 3, 1] } else { &[1, 0, 2] };
    let gates = cell.gates();
    let matrix = |name: Option<&str>| -> Result<(usize, usize, Vec<f32>), NodeError> {
        let constant = constant(name).ok_or(NodeError::NotConstant("its weight is not a constant"))?;
        let [1, wide, inputs] = constant.dims[..] else {
            return Err(unread(format!(
                "its weight has shape {:?}; [1, gates, inputs] is read",
                constant.dims
            )));
        };
        if wide == 0 || inputs == 0 || wide % gates != 0 {
            return Err(misfit(format!(
                "its weight has shape {:?}, no multiple of {gates} gates",
                constant.dims
            )));
        }
        // The rows of one gate stand together, so whole blocks are put into PyTorch's order.
        let block = wide / gates * inputs;
        let ordered: Vec<f32> = order
            .iter()
            .flat_map(|&gate| &constant.values[gate * block..(gate + 1) * block])
            .map(|&x| x as f32)
            .collect();
        Ok((wide, inputs, transpose(&ordered, wide, inputs)))
    };
    let (wide, inputs, weight_ih) = matrix(w)?;
    let (_, hidden, weight_hh) = matrix(r)?;
    // ONNX has both biases in one constant: that of the input's product, then that of the output's.
    let biases = match (b, constant(b)) {
        // A layer without biases leaves the input out.
        (None, _) => vec![0.0; 2 * wide],
        (_, Some(constant)) if constant.values.len() == 2 * wide => constant.values.clone(),
        _ => return Err(NodeError::NotConstant("its bias is not a constant of both gates' biases")),
    };
    let bias = |half: usize| -> Vec<f32> {
        let units = wide / gates;
        let from = |gate: usize| half * wide + gate * units;
        order.iter().flat_map(|&gate| &biases[from(gate)..from(gate) + units]).map(|&x| x as f32).collect()
    };
    Ok(RecurrentLayer { inputs, hidden, weight_ih, weight_hh, bias_ih: bias(0), bias_hh: bias(1) })
}
