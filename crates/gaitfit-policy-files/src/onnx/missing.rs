//! Advice on the description of a graph that states nothing about the robot.

use super::decoded::Decoded;
use super::graph;
use super::program::{self, End};
use gaitfit_model::shown;
use gaitfit_policy::PolicyError;
use gaitfit_policy::invalid;
use std::path::Path;

/// Numbers of the terms below that do not depend on the joints (three each of rates, gravity and command),
/// and terms of joints (positions, velocities, last action).
const TERMS: [usize; 2] = [9, 3];

/// Error for a file that states no joints, gains and observation, with the description to write.
pub fn without_metadata(name: &str, bytes: &[u8], folder: Option<&Path>) -> PolicyError {
    let ends = graph::decode(bytes, folder).and_then(|model| ends(&model));
    let [inputs, outputs] = match ends {
        Ok(ends) => ends,
        Err(error) => return error,
    };
    let listed = |ends: &[End]| {
        let words = ends.iter().map(|end| match end.width {
            Some(width) if ends.len() == 1 => width.to_string(),
            Some(width) => format!("{} ({width})", shown(&end.name)),
            None => format!("{} (any)", shown(&end.name)),
        });
        words.collect::<Vec<_>>().join(", ")
    };
    let joints = outputs.first().and_then(|end| end.width).unwrap_or(0);
    let observed = inputs.iter().filter_map(|end| end.width).max().unwrap_or(0);
    // Whole frames of the usual terms.
    let frame = TERMS[0] + TERMS[1] * joints;
    let frames = if joints > 0 && observed.is_multiple_of(frame) { observed / frame } else { 1 };
    let (order, history) = match frames {
        0 | 1 => (String::new(), String::new()),
        _ => (
            "history = { order = \"frames\" }   # or terms, newest_first\n".to_owned(),
            format!(", history = {frames}"),
        ),
    };
    let name = shown(name);
    invalid(format!(
        "it has no metadata of gaitfit, mjlab or unitree_rl_lab, so joints, pose, gains, control period and observation \
         are unknown. Write them into a TOML file beside it and give that (docs/policies.md), for example:\n\n\
         file = \"{name}\"            # takes {} numbers, gives {} actions\n\
         joints = [\"…\"]              # {joints} names, in the order of the actions\n\
         default_pose = [0.0]         # {joints} angles, rad\n\
         action_scale = 0.25\n\
         kp = 25.0\n\
         kd = 0.5\n\
         control_dt = 0.02            # s\n\
         {order}\
         observation = [              # {observed} numbers, in the network's order\n    \
         {{ quantity = \"base_angular_velocity\", scale = 0.25{history} }},\n    \
         {{ quantity = \"projected_gravity\"{history} }},\n    \
         {{ quantity = \"command\"{history} }},\n    \
         {{ quantity = \"joint_position\"{history} }},\n    \
         {{ quantity = \"joint_velocity\", scale = 0.05{history} }},\n    \
         {{ quantity = \"last_action\"{history} }},\n]",
        listed(&inputs),
        listed(&outputs),
    ))
}

/// Inputs that take the observation, and outputs, the action first.
fn ends(model: &Decoded) -> Result<[Vec<End>; 2], PolicyError> {
    match graph::walk(model) {
        Ok(chain) => {
            let end = |width: Option<usize>| vec![End { name: String::new(), width }];
            Ok([end(chain.inputs()), end(chain.width())])
        }
        Err(error) => {
            let ends = program::open_ends(model)?;
            if ends.iter().any(Vec::is_empty) || model.nodes.is_empty() { Err(error) } else { Ok(ends) }
        }
    }
}
