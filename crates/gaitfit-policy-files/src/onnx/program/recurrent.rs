//! `LSTM` and `GRU` anywhere in a graph, along any number of time steps.

use super::{Program, Value};
use crate::onnx::attributes::Attributes;
use crate::onnx::node_error::{NodeError, misfit, unread};
use crate::onnx::proto::Node;
use crate::onnx::recurrent::{layer_of, plain};
use gaitfit_policy::graph::Operator;
use gaitfit_policy::network::Cell;

impl Program {
    pub(super) fn recurrent(&mut self, node: &Node, attributes: &Attributes) -> Result<(), NodeError> {
        let cell = plain(node, attributes)?;
        let named =
            |number: usize| node.input.get(number).map(String::as_str).filter(|name| !name.is_empty());
        let layer = layer_of(&self.constants, cell, [named(1), named(2), named(3)])?;
        let x = self.value(node, 0)?;
        let [times, 1, inputs] = x.dims[..] else {
            return Err(unread(format!(
                "its input has the shape {:?}; [time steps, 1, numbers] is run",
                x.dims
            )));
        };
        let hidden = layer.hidden;
        let gates = cell.gates() * hidden;
        let fits =
            inputs == layer.inputs && layer.bias_ih.len() == gates && layer.weight_hh.len() == hidden * gates;
        if !fits {
            return Err(misfit(format!(
                "it takes {} numbers of {inputs}, and has {hidden} units",
                layer.inputs
            )));
        }
        let mut given = vec![x];
        let states = if cell == Cell::Lstm { 2 } else { 1 };
        // Inputs 5 and 6 are the output and the cell before the first step; one that is left out is zero.
        for number in 5..5 + states {
            let state = if Self::has(node, number) {
                self.value(node, number)?
            } else {
                Value { operand: self.place(vec![0.0; hidden])?, dims: vec![1, 1, hidden] }
            };
            if state.dims.iter().product::<usize>() != hidden {
                return Err(misfit(format!(
                    "its state has the shape {:?}, it has {hidden} units",
                    state.dims
                )));
            }
            given.push(state);
        }
        self.count_products(&[times, gates, inputs + hidden])?;
        let operator = Operator::Recurrent { cell, layer: Box::new(layer), times };
        let all = self.step(operator, &given.iter().collect::<Vec<_>>(), vec![(times + states) * hidden])?;
        // Outputs of the node: those of all steps, then the last output and an LSTM's last cell.
        for number in 0..1 + states {
            let (start, count, dims) = match number {
                0 => (0, times * hidden, vec![times, 1, 1, hidden]),
                _ => ((times + number - 1) * hidden, hidden, vec![1, 1, hidden]),
            };
            let places = (start..start + count).map(|place| [0, place as u32]).collect();
            let part = self.step(Operator::Take(places), &[&all], dims)?;
            self.give(node, number, part)?;
        }
        Ok(())
    }
}
