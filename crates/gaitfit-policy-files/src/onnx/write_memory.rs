//! The recurrent layers of a policy's ONNX graph.

use super::proto::Node;
use super::write_parts::{constant, integer, push, whole_numbers};
use crate::layers::transpose;
use gaitfit_policy::network::{Cell, Recurrent, RecurrentLayer};

/// Names of each state's input and output: of the layers' outputs, and of an LSTM's cells.
pub(super) const STATES: [[&str; 2]; 2] = [["h_in", "h_out"], ["c_in", "c_out"]];

/// Adds the layers' nodes behind `head`, rows of observations, and gives the name of their output: an axis of one time
/// step, each layer, and rows again. What the layers remember goes out as [`STATES`].
pub(super) fn remember(
    nodes: &mut Vec<Node>,
    constants: &mut Vec<Vec<u8>>,
    memory: &Recurrent,
    head: String,
) -> String {
    let states = &STATES[..memory.cell.remembered()];
    let count = memory.layers.len();
    // Constants that name an axis: 0 is that of steps, 1 that of directions.
    for (axis, name) in ["memory.steps", "memory.directions"].into_iter().enumerate() {
        constants.push(whole_numbers(name, &[axis as i64]));
    }
    let steps = || "memory.steps".to_owned();
    let mut head = push(nodes, "Unsqueeze", "memory.step", vec![head, steps()], Vec::new());
    let mut kept = vec![Vec::new(); states.len()];
    for (number, layer) in memory.layers.iter().enumerate() {
        let name = format!("memory.{number}");
        let mut inputs = vec![head];
        inputs.extend(parts(constants, memory.cell, layer, &name));
        // Lengths of sequences: absent.
        inputs.push(String::new());
        for [before, _] in states {
            // The states of a single layer are the graph's own; those of several are cut out of it and joined
            // again.
            inputs.push(if count == 1 {
                (*before).to_owned()
            } else {
                cut(nodes, constants, before, number)
            });
        }
        let mut attributes = vec![integer("hidden_size", layer.hidden as i64)];
        let operator = match memory.cell {
            Cell::Lstm => "LSTM",
            Cell::Gru => {
                // As in PyTorch's GRU, the reset gate acts behind the product with the last output.
                attributes.push(integer("linear_before_reset", 1));
                "GRU"
            }
        };
        let output = push(nodes, operator, &name, inputs, attributes);
        for (kept, [_, after]) in kept.iter_mut().zip(states) {
            kept.push(if count == 1 { (*after).to_owned() } else { format!("{name}.{after}") });
        }
        if let Some(node) = nodes.last_mut() {
            node.output.extend(kept.iter().filter_map(|kept| kept.last().cloned()));
        }
        // ONNX's layers give steps × directions × rows × units, and here is one direction.
        let axes = "memory.directions".to_owned();
        head = push(nodes, "Squeeze", &format!("{name}.direction"), vec![output, axes], Vec::new());
    }
    if count > 1 {
        for (kept, [_, after]) in kept.into_iter().zip(states) {
            push(nodes, "Concat", &format!("memory.{after}"), kept, vec![integer("axis", 0)]);
            if let Some(node) = nodes.last_mut() {
                node.output = vec![(*after).to_owned()];
            }
        }
    }
    push(nodes, "Squeeze", "memory.rows", vec![head, steps()], Vec::new())
}

/// One layer's part of a state.
fn cut(nodes: &mut Vec<Node>, constants: &mut Vec<Vec<u8>>, state: &str, number: usize) -> String {
    let [from, to] = [number, number + 1].map(|place| {
        let name = format!("memory.place_{place}");
        let value = whole_numbers(&name, &[place as i64]);
        // Neighbouring layers share a place, whose constant is written once.
        if !constants.contains(&value) {
            constants.push(value);
        }
        name
    });
    let inputs = vec![state.to_owned(), from, to, "memory.steps".to_owned()];
    push(nodes, "Slice", &format!("memory.{number}.{state}"), inputs, Vec::new())
}

/// Weights and biases as constants of the operators' layout, by name.
fn parts(constants: &mut Vec<Vec<u8>>, cell: Cell, layer: &RecurrentLayer, name: &str) -> [String; 3] {
    // ONNX has the gates i, o, f, c and z, r, h; PyTorch i, f, g, o and r, z, n.
    let order: &[usize] = if cell == Cell::Lstm { &[0, 3, 1, 2] } else { &[1, 0, 2] };
    let wide = layer.bias_ih.len();
    let blocks = |values: &[f32]| -> Vec<f32> {
        let size = values.len() / cell.gates();
        order.iter().flat_map(|&gate| values[gate * size..(gate + 1) * size].iter().copied()).collect()
    };
    let matrix = |values: &[f32], inputs: usize| blocks(&transpose(values, inputs, wide));
    let (w, r) = (matrix(&layer.weight_ih, layer.inputs), matrix(&layer.weight_hh, layer.hidden));
    let bias = [blocks(&layer.bias_ih), blocks(&layer.bias_hh)].concat();
    let parts = [
        ("w", vec![1, wide, layer.inputs], w),
        ("r", vec![1, wide, layer.hidden], r),
        ("b", vec![1, 2 * wide], bias),
    ];
    parts.map(|(part, dims, values)| {
        let name = format!("{name}.{part}");
        constants.push(constant(&name, &dims, &values));
        name
    })
}
