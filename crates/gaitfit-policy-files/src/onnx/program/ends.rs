//! A graph's inputs and outputs: what takes the observation, what is remembered, and what is the action.

use super::guess::guessed;
use super::{Program, Value, shapes};
use crate::onnx::decoded::Decoded;
use crate::onnx::graph::dimensions;
use crate::onnx::node_error::{NodeError, misfit, unread};
use crate::onnx::proto::ValueInfo;
use gaitfit_model::shown;
use gaitfit_policy::Inputs;
use gaitfit_policy::graph::{Carried, Feed, Operand};
use gaitfit_policy::invalid;
use gaitfit_policy::{Interface, PolicyError};
use std::collections::HashSet;

/// Names of outputs that are actions, the likeliest first.
const ACTIONS: [&str; 8] = [
    "actions",
    "action",
    "continuous_actions",
    "deterministic_continuous_actions",
    "mean",
    "mu",
    "output",
    "output_0",
];
/// Max number of inputs and outputs.
pub(super) const MAX_ENDS: usize = 64;

/// An input that is remembered, and the output that it becomes.
pub(super) type State = (String, Value, String);

/// Names for messages.
pub(super) fn names(ends: &[ValueInfo]) -> String {
    let names: Vec<String> = ends.iter().take(MAX_ENDS).map(|end| shown(&end.name)).collect();
    names.join(", ")
}

/// The inputs that are no constants: old files list these too.
fn inputs(model: &Decoded) -> impl Iterator<Item = &ValueInfo> {
    model.inputs.iter().filter(|input| !model.constants.contains_key(&input.name))
}

/// The output that is the action of so many joints: the one that is named so, or the only one of that width.
pub(super) fn action(
    model: &Decoded,
    named: Option<&str>,
    joints: Option<usize>,
) -> Result<String, PolicyError> {
    if model.outputs.len() > MAX_ENDS || model.inputs.len() > 1024 {
        return Err(invalid(format!("its graph has more than {MAX_ENDS} outputs, or more than 1024 inputs")));
    }
    let has = |name: &str| model.outputs.iter().any(|output| output.name == name);
    if let Some(name) = named {
        return if has(name) {
            Ok(name.to_owned())
        } else {
            let outputs = names(&model.outputs);
            Err(invalid(format!("it has no output {}, which `output` names; it has {outputs}", shown(name))))
        };
    }
    // The only output is the action, whatever its name.
    if let [one] = &model.outputs[..] {
        return Ok(one.name.clone());
    }
    let known = ACTIONS.iter().find(|name| has(name)).map(|name| (*name).to_owned());
    let mut fitting = Vec::new();
    for output in &model.outputs {
        // The joints are on the last axis.
        let width = dimensions(output)?.last().copied().flatten();
        if width.is_some() && width == joints {
            fitting.push(output.name.clone());
        }
    }
    // If one is taken and none is left, it was the only one.
    let only = fitting.pop().filter(|_| fitting.is_empty());
    known.or(only).ok_or_else(|| {
        invalid(format!(
            "its graph has {} outputs; name the one that is the action in a TOML file, output = \"…\": {}",
            model.outputs.len(),
            names(&model.outputs)
        ))
    })
}

/// Inputs with the outputs that they become: `h_in` and `h_out`, `state` and `next_state` and the like.
pub(super) fn pairs(model: &Decoded) -> Vec<(String, String)> {
    let stem = |name: &str| {
        let name = name.to_lowercase();
        let ends = ["_in", ".in", "_input", "_out", ".out", "_output", "_n"];
        let name = ends.iter().find_map(|end| name.strip_suffix(end)).unwrap_or(&name).to_owned();
        let starts = ["next_", "new_", "in_", "out_", "input_", "output_"];
        starts.iter().find_map(|start| name.strip_prefix(start)).unwrap_or(&name).to_owned()
    };
    let mut pairs = Vec::new();
    for input in inputs(model).take(MAX_ENDS) {
        // An input that is named like an observation is no state, whatever output resembles it.
        let observed =
            ["obs", "observation", "observations", "input", "policy"].contains(&input.name.as_str());
        let output = model
            .outputs
            .iter()
            .find(|output| output.name != input.name && stem(&output.name) == stem(&input.name));
        if let (Some(output), false) = (output, observed) {
            pairs.push((input.name.clone(), output.name.clone()));
        }
    }
    pairs
}

impl Program {
    /// Values for the inputs that are `needed`. Gives those that are remembered, and what was assumed.
    pub(super) fn ends(
        &mut self,
        model: &Decoded,
        needed: &HashSet<String>,
        action: &str,
        interface: &Interface,
        given: &Inputs,
    ) -> Result<(Vec<State>, Vec<String>), PolicyError> {
        let taking: Vec<&ValueInfo> = inputs(model).collect();
        if taking.len() > MAX_ENDS {
            return Err(invalid(format!("its graph has more than {MAX_ENDS} inputs")));
        }
        if let Some(name) = given.keys().find(|name| !taking.iter().any(|input| input.name == **name)) {
            let (name, inputs) = (shown(name), names(&model.inputs));
            return Err(invalid(format!("`inputs` names {name}, and the graph's inputs are {inputs}")));
        }
        let mut pairs = pairs(model);
        // The action, and inputs that the description feeds, are not remembered, whatever their names.
        pairs.retain(|(input, output)| output != action && !given.contains_key(input));
        let mut open = Vec::new();
        for input in taking.iter().filter(|input| needed.contains(&input.name)) {
            let is_state = pairs.iter().any(|(name, _)| *name == input.name);
            if !is_state && !given.contains_key(&input.name) {
                let dims = dimensions(input)?;
                // The first of several axes is that of the robots.
                let known =
                    dims.iter().skip(usize::from(dims.len() > 1)).copied().collect::<Option<Vec<_>>>();
                let known = known.filter(|dims| !dims.is_empty());
                open.push((input.name.clone(), known.and_then(|dims| shapes::count(&dims))));
            }
        }
        let mut inputs = guessed(interface, &open)?;
        let mut notes = Vec::new();
        if inputs.len() > 1 {
            let words = inputs.iter().map(|(name, taken)| {
                let taken = serde_json::to_value(taken).ok();
                let taken = taken.as_ref().and_then(|taken| taken.as_str()).unwrap_or_default().to_owned();
                format!("{} = \"{taken}\"", shown(name))
            });
            notes.push(format!(
                "what its inputs take follows from their widths: inputs = {{ {} }}",
                words.collect::<Vec<_>>().join(", ")
            ));
        }
        inputs.extend(given.clone());
        let mut states = Vec::new();
        for input in taking.iter().filter(|input| needed.contains(&input.name)) {
            let name = input.name.clone();
            let inside = |why: NodeError| invalid(format!("its input {}: {why}", shown(&name)));
            let open = dimensions(input)?;
            let value = if let Some((_, output)) = pairs.iter().find(|(input, _)| *input == name) {
                // A state's open axis is that of the rows: one robot.
                let dims: Vec<usize> = open.iter().map(|length| length.unwrap_or(1)).collect();
                let value = Value { operand: Operand::Value(self.room(&dims).map_err(inside)?), dims };
                states.push((name.clone(), value.clone(), output.clone()));
                value
            } else {
                let taken = inputs.get(&name).ok_or_else(|| inside(misfit("nothing says what it takes")))?;
                let places = taken.places(interface)?;
                let dims = filled(&open, places.len()).map_err(inside)?;
                let slot = self.room(&dims).map_err(inside)?;
                self.plan.feeds.push(Feed { name: name.clone(), value: slot, places });
                Value { operand: Operand::Value(slot), dims }
            };
            self.values.insert(name, value);
        }
        inputs.retain(|name, _| needed.contains(name));
        self.plan.inputs = inputs;
        Ok((states, notes))
    }

    /// Connects the remembered inputs with the outputs that they become.
    pub(super) fn carry(&mut self, states: Vec<State>) -> Result<(), PolicyError> {
        for (name, value, output) in states {
            let from = self.values.get(&output);
            let from = from.filter(|from| shapes::count(&from.dims) == shapes::count(&value.dims));
            let (Some(from), Operand::Value(slot)) = (from, value.operand) else {
                let (input, output) = (shown(&name), shown(&output));
                return Err(invalid(format!(
                    "its input {input} and its output {output} differ in size, so it is unknown what {input} takes: \
                     state it in a TOML file, inputs = {{ {input} = … }} (docs/policies-foreign.md)"
                )));
            };
            let count: usize = value.dims.iter().product();
            let from = from.operand;
            self.plan.carried.push(Carried { name, value: slot, from, count });
        }
        Ok(())
    }
}

/// The shape of an input of `count` numbers, for one robot: `open` may leave the robots, and one more axis, open.
fn filled(open: &[Option<usize>], count: usize) -> Result<Vec<usize>, NodeError> {
    if open.is_empty() {
        return Ok(vec![1, count]);
    }
    let mut dims: Vec<Option<usize>> = open.to_vec();
    // By custom the first axis is that of the rows.
    if dims.len() > 1 && dims[0].is_none() {
        dims[0] = Some(1);
    }
    // A product that overflows fits nothing, as 0 does.
    let known = dims.iter().flatten().try_fold(1_usize, |all, &length| all.checked_mul(length)).unwrap_or(0);
    let mut missing: Vec<&mut Option<usize>> = dims.iter_mut().filter(|length| length.is_none()).collect();
    if let [one] = &mut missing[..]
        && known > 0
        && count.is_multiple_of(known)
    {
        **one = Some(count / known);
    }
    let dims: Option<Vec<usize>> = dims.into_iter().collect();
    match dims {
        Some(dims) if shapes::count(&dims) == Some(count) => Ok(dims),
        _ => {
            let shape: Vec<String> = open
                .iter()
                .map(|length| length.map_or("any".to_owned(), |length| length.to_string()))
                .collect();
            Err(unread(format!(
                "it has the shape [{}], and takes {count} numbers of the observation: export the graph for one robot or any \
                 number, and check `inputs` and `observation`",
                shape.join(", ")
            )))
        }
    }
}
