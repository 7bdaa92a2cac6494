//! Recordings of walk-these-ways' deployment (`log.pkl`): a dictionary of robots, each [configuration, one dictionary a
//! step].

use crate::arrays::{Array, Arrays};
use crate::known::WALK_THESE_WAYS;
use crate::pickle::{Node, Pickle};
use indexmap::IndexMap;

/// A robot's arrays, and the rest that the file says.
pub(crate) struct Deployment {
    pub arrays: Arrays,
    pub assumed: Vec<String>,
    pub left_out: Vec<String>,
    pub gains: Option<(Vec<f64>, Vec<f64>)>,
}

/// Takes one robot's arrays out of the arrays of the whole pickle, and moves actions to the state that they answer.
/// `None`: it is no such recording.
pub(crate) fn deployment(pickle: &Pickle, arrays: &Arrays) -> Option<Deployment> {
    // The first robot of the file is read.
    let prefix = arrays.numbers.keys().find_map(|name| name.strip_suffix("/1/joint_pos_target"))?.to_owned();
    let rows = format!("{prefix}/1/");
    let mut numbers: IndexMap<String, Array> = IndexMap::new();
    let mut left_out = Vec::new();
    for (name, array) in &arrays.numbers {
        match name.strip_prefix(&rows) {
            Some(name) => drop(numbers.insert(name.to_owned(), array.clone())),
            None if name.ends_with("/1/joint_pos") => {
                left_out.push(format!("{name}: another robot's; only `{prefix}` is read"));
            }
            None => {}
        }
    }
    let steps = numbers.get("joint_pos")?.shape.first().copied()?;
    if steps < 2 {
        return None;
    }
    // A row's action is chosen, sent and waited for; then the row's state is read. A sample here is a state and the action
    // that answers it: the next row's.
    for (name, array) in &mut numbers {
        // An array of another length is not one of samples.
        if array.shape.first() != Some(&steps) {
            continue;
        }
        let width = array.data.len() / steps;
        if matches!(name.as_str(), "action" | "joint_pos_target") {
            array.data.drain(..width);
        } else {
            array.data.truncate((steps - 1) * width);
        }
        array.shape[0] = steps - 1;
    }
    let kept = ["time", "joint_pos", "joint_vel", "joint_pos_target", "action", "rpy", "body_angular_vel"];
    let commands = ["body_linear_vel_cmd", "body_angular_vel_cmd"];
    numbers.retain(|name, _| kept.contains(&name.as_str()) || commands.contains(&name.as_str()));
    Some(Deployment {
        arrays: Arrays { numbers, words: IndexMap::new() },
        assumed: vec![
            "walk-these-ways: a row's action was sent before its state was read, so actions and targets are one row earlier \
             here"
                .into(),
            "walk-these-ways: joints are in the order FL, FR, RL, RR; hip, thigh, calf".into(),
        ],
        left_out,
        gains: gains(pickle, &prefix),
    })
}

/// The gains of the configuration: `control.stiffness` and `control.damping`, one number for all joints whose names hold
/// the key.
fn gains(pickle: &Pickle, robot: &str) -> Option<(Vec<f64>, Vec<f64>)> {
    let get = |id: usize, key: &str| match &pickle.nodes[id] {
        Node::Dict(entries) => entries.iter().find_map(|(name, value)| match &pickle.nodes[*name] {
            Node::Text(text) if &**text == key => Some(*value),
            _ => None,
        }),
        _ => None,
    };
    let Node::List(parts) = &pickle.nodes[get(pickle.root, robot)?] else { return None };
    let control = get(*parts.first()?, "control")?;
    let values = |key: &str| -> Option<Vec<f64>> {
        let Node::Dict(entries) = &pickle.nodes[get(control, key)?] else { return None };
        let number = |joint: &&str| {
            entries.iter().find_map(|(name, value)| match (&pickle.nodes[*name], &pickle.nodes[*value]) {
                (Node::Text(name), Node::Number(value)) if format!("{joint}_joint").contains(&**name) => {
                    Some(*value)
                }
                _ => None,
            })
        };
        WALK_THESE_WAYS.iter().map(number).collect()
    };
    Some((values("stiffness")?, values("damping")?))
}
