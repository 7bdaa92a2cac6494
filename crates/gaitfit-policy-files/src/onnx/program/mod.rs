//! Graphs that are no plain perceptron, as steps for [`gaitfit_policy::Graph`].
//!
//! Shapes are computed here, for one robot; so everything that depends on shapes alone becomes a constant, and a graph that
//! does not fit together is refused with its node.

mod convolution;
mod ends;
mod guess;
mod moves;
mod nodes;
mod products;
mod recurrent;
mod shapes;
#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests;

use super::attributes::Attributes;
use super::constant::Constant;
use super::decoded::Decoded;
use super::proto::Node;
use crate::onnx::node_error::{NodeError, misfit};
use gaitfit_model::shown;
use gaitfit_policy::graph::{Operand, Operator, Plan, Step};
use gaitfit_policy::{Graph, Inputs, Interface, PolicyError, invalid};
use std::collections::{HashMap, HashSet};

/// Max number of numbers of all values together, a robot.
const MAX_NUMBERS: usize = 1 << 18;
/// Max number of multiplications of all matrix products together, a robot.
const MAX_PRODUCTS: usize = 1 << 28;
/// Max number of numbers of all constants that steps use.
const MAX_CONSTANTS: usize = 32 << 20;

/// A value of the graph, or a constant with its numbers in the plan.
#[derive(Clone, Debug)]
struct Value {
    operand: Operand,
    dims: Vec<usize>,
}

/// A plan under construction. Errors are sentence parts that follow the operator's name.
struct Program {
    plan: Plan,
    constants: HashMap<String, Constant>,
    /// Constants that are in the plan.
    placed: HashMap<String, usize>,
    values: HashMap<String, Value>,
    /// Version of the operators.
    opset: i64,
    /// Numbers of all values, multiplications and numbers of constants so far.
    numbers: usize,
    products: usize,
    placed_numbers: usize,
}

/// The graph of `model` behind an observation; what its inputs take, where `inputs` does not name them, is guessed by their
/// widths. `source`: the file. Also what was assumed, in words.
pub fn compile(
    model: &Decoded,
    interface: &Interface,
    inputs: &Inputs,
    output: Option<&str>,
    source: Vec<u8>,
) -> Result<(Graph, Vec<String>), PolicyError> {
    let joints = interface.joints.len();
    let action = ends::action(model, output, Some(joints))?;
    let needed = needed(model, &action);
    let mut program = Program {
        plan: Plan { observed: interface.observation_width(), outputs: joints, ..Plan::default() },
        constants: model.constants.clone(),
        placed: HashMap::new(),
        values: HashMap::new(),
        opset: model.opset,
        numbers: 0,
        products: 0,
        placed_numbers: 0,
    };
    let (states, notes) = program.ends(model, &needed, &action, interface, inputs)?;
    // ONNX demands that nodes stand in the order in which they are computed.
    for node in &model.nodes {
        // What the action does not depend on, such as a critic, may have any operator.
        if !node.output.iter().any(|name| needed.contains(name)) {
            continue;
        }
        program.node(node).map_err(|why| {
            let name =
                if node.name.is_empty() { node.output.first().unwrap_or(&node.name) } else { &node.name };
            invalid(format!("node {} ({}): {why}", shown(name), shown(&node.op_type)))
        })?;
    }
    let given = program.values.get(&action).cloned().ok_or_else(|| {
        invalid(format!("its output {} does not depend on the observation", shown(&action)))
    })?;
    // Axes of length 1 may stand around the action, so numbers are counted and not axes.
    let count: usize = given.dims.iter().product();
    if count != joints {
        return Err(invalid(format!(
            "joints names {joints} joints, its output {} gives {count} numbers {:?}: they must be as many. Name the output \
             that is the action in a TOML file, output = \"…\"; outputs: {}",
            shown(&action),
            given.dims,
            ends::names(&model.outputs)
        )));
    }
    // Last, because the outputs that states become are values of nodes.
    program.carry(states)?;
    let mut plan = program.plan;
    plan.actions = given.operand;
    plan.source = source;
    plan.output = action;
    Ok((Graph::new(plan), notes))
}

/// An input or output, and how many numbers of a robot it has, where the file says it.
#[derive(Clone, Debug, PartialEq)]
pub struct End {
    pub name: String,
    pub width: Option<usize>,
}

/// Inputs that take the observation, and outputs, the action first where it is known.
pub fn open_ends(model: &Decoded) -> Result<[Vec<End>; 2], PolicyError> {
    let states = ends::pairs(model);
    let end = |value: &super::proto::ValueInfo| -> Result<End, PolicyError> {
        let dims = super::graph::dimensions(value)?;
        // The first axis is that of the robots.
        let known: Option<Vec<usize>> = dims.into_iter().skip(1).collect();
        let width = known.filter(|dims| !dims.is_empty()).and_then(|dims| shapes::count(&dims));
        Ok(End { name: value.name.clone(), width })
    };
    let taking = model.inputs.iter().filter(|input| !model.constants.contains_key(&input.name));
    let taking = taking.filter(|input| !states.iter().any(|(name, _)| *name == input.name));
    let inputs = taking.take(ends::MAX_ENDS).map(end).collect::<Result<Vec<_>, _>>()?;
    let giving = model.outputs.iter().filter(|output| !states.iter().any(|(_, name)| *name == output.name));
    let mut outputs = giving.take(ends::MAX_ENDS).map(end).collect::<Result<Vec<_>, _>>()?;
    if let Ok(action) = ends::action(model, None, None)
        && let Some(place) = outputs.iter().position(|output| output.name == action)
    {
        // `stated` takes the first output as the action.
        outputs.swap(0, place);
    }
    Ok([inputs, outputs])
}

/// Numbers of the observation and of the action, as far as the ends of a graph state them.
pub fn stated(model: &Decoded) -> Result<Option<[usize; 2]>, PolicyError> {
    let [inputs, outputs] = open_ends(model)?;
    let width = |ends: &[End]| ends.first().and_then(|end| end.width);
    Ok(width(&inputs).zip(width(&outputs)).map(|(inputs, outputs)| [inputs, outputs]))
}

/// The names that the action depends on: of values, and of inputs whose next value is an output.
fn needed(model: &Decoded, action: &str) -> HashSet<String> {
    let mut needed = HashSet::from([action.to_owned()]);
    let states = ends::pairs(model);
    loop {
        // A state that the action needs makes the output needed that it becomes, and with it further nodes:
        // repeated until nothing is added.
        let before = needed.len();
        // Nodes stand in order, so one pass from the last to the first follows all dependences.
        for node in model.nodes.iter().rev() {
            if node.output.iter().any(|name| needed.contains(name)) {
                needed.extend(node.input.iter().filter(|name| !name.is_empty()).cloned());
            }
        }
        let more: Vec<String> = states
            .iter()
            .filter(|(input, _)| needed.contains(input))
            .map(|(_, output)| output.clone())
            .collect();
        needed.extend(more);
        if needed.len() == before {
            return needed;
        }
    }
}

impl Program {
    /// One node.
    fn node(&mut self, node: &Node) -> Result<(), NodeError> {
        let output = node.output.first().ok_or(misfit("it has no output"))?;
        for output in node.output.iter().filter(|name| !name.is_empty()) {
            if self.constants.contains_key(output) || self.values.contains_key(output) {
                return Err(misfit("its output has a name that is taken"));
            }
        }
        nodes::bounded(node)?;
        let attributes = Attributes::decode(node)?;
        if node.op_type == "Constant" {
            return self.keep(output, attributes.constant()?);
        }
        let unknown = |name: &&String| {
            !name.is_empty() && !self.constants.contains_key(*name) && !self.values.contains_key(*name)
        };
        if let Some(name) = node.input.iter().find(unknown) {
            return Err(misfit(format!("it takes `{}`, which no node before it gives", shown(name))));
        }
        // What does not depend on the observation is computed now, and leaves no step to run.
        if self.shape_of(node, &attributes)? || self.fold(node, &attributes)? {
            return Ok(());
        }
        self.operator(node, &attributes)
    }

    /// `Shape` and `Size`, which are known here.
    fn shape_of(&mut self, node: &Node, attributes: &Attributes) -> Result<bool, NodeError> {
        if !matches!(node.op_type.as_str(), "Shape" | "Size") {
            return Ok(false);
        }
        let dims = self.dims(node, 0)?;
        let constant = if node.op_type == "Size" {
            Constant { whole: true, ..Constant::scalar(dims.iter().product::<usize>() as f64) }
        } else {
            let place = |key: &str, other: usize| {
                let place = attributes.integer(key, other as i64);
                // ONNX counts negative places from the end, and bounds what lies beyond an end.
                let place = if place < 0 { place.saturating_add(dims.len() as i64) } else { place };
                place.clamp(0, dims.len() as i64) as usize
            };
            let (start, end) = (place("start", 0), place("end", dims.len()));
            // An end before the start gives an empty list instead of a panic.
            let part = dims.get(start..end.max(start)).unwrap_or_default();
            Constant::wholes(part.iter().map(|&length| length as f64).collect())
        };
        self.keep(&node.output[0], constant)?;
        Ok(true)
    }

    /// A constant whose inputs are constants, in double precision.
    fn fold(&mut self, node: &Node, attributes: &Attributes) -> Result<bool, NodeError> {
        let named = node.input.iter().filter(|name| !name.is_empty());
        let inputs: Option<Vec<&Constant>> = named.map(|name| self.constants.get(name)).collect();
        let Some(inputs) = inputs else { return Ok(false) };
        let Some(constant) = super::constant::folded(&node.op_type, &inputs, attributes) else {
            return Ok(false);
        };
        self.keep(&node.output[0], constant)?;
        Ok(true)
    }

    fn keep(&mut self, name: &str, constant: Constant) -> Result<(), NodeError> {
        self.placed_numbers = self.placed_numbers.saturating_add(constant.values.len());
        if self.placed_numbers > MAX_CONSTANTS {
            return Err(misfit(format!("the graph's constants have more than {MAX_CONSTANTS} numbers")));
        }
        self.constants.insert(name.to_owned(), constant);
        Ok(())
    }

    /// The shape of a node's input.
    fn dims(&self, node: &Node, number: usize) -> Result<Vec<usize>, NodeError> {
        let name = node.input.get(number).filter(|name| !name.is_empty());
        let name = name.ok_or_else(|| misfit(format!("its input {} is missing", number + 1)))?;
        let value = self.values.get(name).map(|value| &value.dims);
        let dims = value.or_else(|| self.constants.get(name).map(|constant| &constant.dims));
        dims.cloned().ok_or_else(|| misfit(format!("`{}` is not known", shown(name))))
    }

    /// A node's input as a constant, where it is one.
    fn constant(&self, node: &Node, number: usize) -> Option<&Constant> {
        self.constants.get(node.input.get(number).filter(|name| !name.is_empty())?)
    }

    /// Whether a node has this input.
    fn has(node: &Node, number: usize) -> bool {
        node.input.get(number).is_some_and(|name| !name.is_empty())
    }

    /// A node's input; a constant is put into the plan.
    fn value(&mut self, node: &Node, number: usize) -> Result<Value, NodeError> {
        let dims = self.dims(node, number)?;
        let name = &node.input[number];
        if let Some(value) = self.values.get(name) {
            return Ok(value.clone());
        }
        let placed = match self.placed.get(name) {
            Some(&placed) => Operand::Constant(placed),
            None => {
                let numbers = self.constants.get(name).map(|constant| constant.values.as_slice());
                let numbers = numbers.unwrap_or_default().iter().map(|&x| x as f32).collect();
                let operand = self.place(numbers)?;
                if let Operand::Constant(placed) = operand {
                    self.placed.insert(name.clone(), placed);
                }
                operand
            }
        };
        Ok(Value { operand: placed, dims })
    }

    /// Puts a constant into the plan.
    fn place(&mut self, numbers: Vec<f32>) -> Result<Operand, NodeError> {
        if numbers.is_empty() {
            return Err(misfit("it works on an empty constant"));
        }
        self.placed_numbers = self.placed_numbers.saturating_add(numbers.len());
        if self.placed_numbers > MAX_CONSTANTS {
            return Err(misfit(format!("the graph's constants have more than {MAX_CONSTANTS} numbers")));
        }
        self.plan.constants.push(numbers);
        Ok(Operand::Constant(self.plan.constants.len() - 1))
    }

    /// A new value of the shape `dims`.
    fn room(&mut self, dims: &[usize]) -> Result<usize, NodeError> {
        // `count` refuses what is too large, and the filter what is empty, which leaves nothing to compute.
        let count = shapes::count(dims).filter(|&count| count > 0).ok_or_else(|| {
            misfit(format!("it gives numbers of shape {dims:?}, which is empty or more than {MAX_NUMBERS}"))
        })?;
        // The limit is for the sum, so that many small values cannot pass it.
        self.numbers = self.numbers.saturating_add(count);
        if self.numbers > MAX_NUMBERS {
            return Err(misfit(format!("the graph's values have more than {MAX_NUMBERS} numbers")));
        }
        self.plan.counts.push(count);
        Ok(self.plan.counts.len() - 1)
    }

    /// Counts the multiplications of matrix products.
    fn count_products(&mut self, sizes: &[usize]) -> Result<(), NodeError> {
        // Sizes come from the file. A product that overflows counts as the largest one, which is refused below.
        let more = sizes.iter().try_fold(1_usize, |all, &size| all.checked_mul(size));
        self.products = self.products.saturating_add(more.unwrap_or(usize::MAX));
        if self.products > MAX_PRODUCTS {
            return Err(misfit(format!("the graph has more than {MAX_PRODUCTS} multiplications")));
        }
        Ok(())
    }

    /// A further step, and what it gives.
    fn step(&mut self, operator: Operator, inputs: &[&Value], dims: Vec<usize>) -> Result<Value, NodeError> {
        // Also for a step on constants, which is computed with the size of this place.
        let output = self.room(&dims)?;
        let inputs: Vec<Operand> = inputs.iter().map(|value| value.operand).collect();
        let step = Step { operator, inputs, output };
        // Steps on constants alone are computed now, not at every control step.
        if step.inputs.iter().all(|input| matches!(input, Operand::Constant(_))) {
            let numbers = self.plan.constant_of(&step);
            return Ok(Value { operand: self.place(numbers)?, dims });
        }
        self.plan.steps.push(step);
        Ok(Value { operand: Operand::Value(output), dims })
    }

    /// Names what a node gives.
    fn give(&mut self, node: &Node, number: usize, value: Value) -> Result<(), NodeError> {
        let Some(name) = node.output.get(number).filter(|name| !name.is_empty()) else { return Ok(()) };
        match value.operand {
            Operand::Value(_) => {
                self.values.insert(name.clone(), value);
                Ok(())
            }
            Operand::Constant(placed) => {
                // Later nodes may need it as a constant: a shape, an axis, a weight.
                let values = self.plan.constants[placed].iter().map(|&x| f64::from(x)).collect();
                self.placed.insert(name.clone(), placed);
                self.keep(name, Constant { dims: value.dims, values, whole: false })
            }
        }
    }
}
