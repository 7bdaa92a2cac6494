//! Operators that only move numbers.
//!
//! The places of an input's numbers go through the operator as a constant; what comes out says where each number of the result
//! is taken from.

use super::nodes::MAX_PARTS;
use super::shapes::{axis, count};
use super::{MAX_NUMBERS, Program, Value};
use crate::onnx::attributes::Attributes;
use crate::onnx::constant::Constant;
use crate::onnx::moves::moved;
use crate::onnx::node_error::{NodeError, misfit, unread};
use crate::onnx::proto::Node;
use gaitfit_policy::graph::Operator;

impl Program {
    /// The numbers of the first input at other places. All other inputs are constants.
    pub(super) fn moved(&mut self, node: &Node, attributes: &Attributes) -> Result<Value, NodeError> {
        let input = self.value(node, 0)?;
        let mut others: Vec<Constant> = Vec::new();
        for number in 1..node.input.len() {
            // Between others an input that is left out has its default, which no exporter leaves out.
            if !Self::has(node, number) {
                return Err(unread(format!("its input {} is left out before others", number + 1)));
            }
            let constant = self.constant(node, number);
            others.push(constant.ok_or(unread("where it cuts depends on the observation"))?.clone());
        }
        let places = numbered(&input.dims, 0).ok_or(misfit("its input has too many numbers"))?;
        let inputs: Vec<&Constant> = std::iter::once(&places).chain(&others).collect();
        let moved = moved(&node.op_type, &inputs, attributes, MAX_NUMBERS).ok_or_else(|| {
            let dims = &input.dims;
            misfit(format!(
                "it does not fit its input of shape {dims:?}, or gives more than {MAX_NUMBERS} numbers"
            ))
        })?;
        self.taken(&[input], moved)
    }

    /// The numbers of `inputs` whose places `moved` lists, counted on through all inputs.
    fn taken(&mut self, inputs: &[Value], moved: Constant) -> Result<Value, NodeError> {
        let Constant { dims, values, .. } = moved;
        if let [one] = inputs
            && values.len() == one.dims.iter().product::<usize>()
            // Nothing moved: only the shape changes, which costs no step.
            && values.iter().enumerate().all(|(number, &place)| place == number as f64)
        {
            return Ok(Value { operand: one.operand, dims });
        }
        // Places count on through all inputs; the ends of the inputs tell which one a place lies in.
        let mut ends = Vec::new();
        let mut end = 0;
        for input in inputs {
            end += input.dims.iter().product::<usize>();
            ends.push(end);
        }
        let place = |place: f64| {
            let place = place as usize;
            let from = ends.partition_point(|&end| end <= place);
            let start = if from == 0 { 0 } else { ends[from - 1] };
            [from as u32, (place - start) as u32]
        };
        let places = values.into_iter().map(place).collect();
        self.step(Operator::Take(places), &inputs.iter().collect::<Vec<_>>(), dims)
    }

    pub(super) fn concat(&mut self, node: &Node, attributes: &Attributes) -> Result<(), NodeError> {
        let inputs = (0..node.input.len()).map(|number| self.value(node, number));
        let inputs = inputs.collect::<Result<Vec<_>, _>>()?;
        // Numbers of places are joined instead of values: the result says where each value comes from.
        let mut places = Vec::new();
        let mut start = 0;
        for input in &inputs {
            places.push(numbered(&input.dims, start).ok_or(misfit("its inputs have too many numbers"))?);
            start += input.dims.iter().product::<usize>();
            count(&[start]).ok_or(misfit("its inputs have too many numbers"))?;
        }
        let joined = moved("Concat", &places.iter().collect::<Vec<_>>(), attributes, MAX_NUMBERS)
            .ok_or_else(|| {
                let shapes: Vec<&[usize]> = inputs.iter().map(|input| &input.dims[..]).collect();
                misfit(format!("its inputs have the shapes {shapes:?}, which cannot be joined"))
            })?;
        let value = self.taken(&inputs, joined)?;
        self.give(node, 0, value)
    }

    pub(super) fn split(&mut self, node: &Node, attributes: &Attributes) -> Result<(), NodeError> {
        let dims = self.dims(node, 0)?;
        let axis = axis(attributes.integer("axis", 0), &dims)?;
        let length = dims[axis];
        let sizes: Vec<usize> = if Self::has(node, 1) {
            let sizes =
                self.constant(node, 1).ok_or(NodeError::NotConstant("its sizes are not constants"))?;
            sizes.values.iter().take(MAX_PARTS).map(|&size| size as usize).collect()
        } else if let Some(sizes) = attributes.list("split") {
            sizes.iter().take(MAX_PARTS).map(|&size| usize::try_from(size).unwrap_or(0)).collect()
        } else {
            // Even parts, the last the rest.
            let many = node.output.len().max(1);
            let size = length.div_ceil(many);
            (0..many).map(|number| size.min(length.saturating_sub(number * size))).collect()
        };
        let total = sizes.iter().try_fold(0_usize, |sum, &size| sum.checked_add(size));
        if total != Some(length) || sizes.len() < node.output.len() {
            return Err(misfit(format!("its parts {sizes:?} are not those of an axis of {length}")));
        }
        // The parts of a constant are constants: whole numbers stay such, and are divided as such.
        let constant = self.constant(node, 0).cloned();
        let input = if constant.is_none() { Some(self.value(node, 0)?) } else { None };
        let places = constant.or_else(|| numbered(&dims, 0));
        let places = places.ok_or(misfit("its input has too many numbers"))?;
        let mut start = 0;
        for (number, &size) in sizes.iter().enumerate().take(node.output.len()) {
            let bound = |place: usize| Constant::wholes(vec![place as f64]);
            let cut = [bound(start), bound(start + size), bound(axis)];
            start += size;
            // A part without numbers gets no value; a node that takes it is refused.
            if size == 0 {
                continue;
            }
            let part = moved("Slice", &[&places, &cut[0], &cut[1], &cut[2]], attributes, MAX_NUMBERS);
            let part = part.ok_or(misfit("its parts do not fit"))?;
            match (&input, node.output.get(number).filter(|name| !name.is_empty())) {
                (Some(input), _) => {
                    let value = self.taken(std::slice::from_ref(input), part)?;
                    self.give(node, number, value)?;
                }
                (None, Some(name)) => self.keep(name, part)?,
                (None, None) => {}
            }
        }
        Ok(())
    }
}

/// Places of a value of the shape `dims` as a constant of that shape, from `start` on.
fn numbered(dims: &[usize], start: usize) -> Option<Constant> {
    let count = count(dims)?;
    let places = (start..start + count).map(|place| place as f64).collect();
    Some(Constant { dims: dims.to_vec(), ..Constant::wholes(places) })
}
