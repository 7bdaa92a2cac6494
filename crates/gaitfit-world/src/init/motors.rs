//! Limits of motors that nobody meant: exporters write placeholders where they know none.

use super::anatomy::Anatomy;
use super::sizes::{Sizes, tidy};
use gaitfit_model::{JointKind, Model, listed, shown};

/// Torque limits of legs over m g l: the Go2's, which other robots are compared with. Walking robots have 0.3 to 3.
const USUAL_EFFORT: f64 = 1.0;
const MAX_EFFORT: f64 = 8.0;
/// Speeds of legs' joints, rad/s: the fastest that walking robots have is about 45.
const MAX_SPEED: f64 = 60.0;
/// A range beyond this bounds nothing: more than a turn to both sides, rad.
const MAX_RANGE: f64 = 2.0 * std::f64::consts::TAU;
/// Max number of joints that a message names; it counts the others.
const NAMED: usize = 3;

/// Sentences about limits of the legs' joints that look like placeholders. Torque limits also get a guess.
pub fn placeholders(model: &Model, anatomy: &Anatomy, sizes: &Sizes) -> Vec<String> {
    [JointKind::Hinge, JointKind::Slide]
        .into_iter()
        .flat_map(|kind| of_kind(model, anatomy, sizes, kind))
        .collect()
}

/// The sentences of [`placeholders`] about joints of one kind.
fn of_kind(model: &Model, anatomy: &Anatomy, sizes: &Sizes, kind: JointKind) -> Vec<String> {
    // A slide carries weight without a lever.
    let (lever, unit_name) = if kind.is_hinge() { (sizes.leg, "m g l") } else { (1.0, "m g") };
    let unit = sizes.mass * sizes.gravity * lever;
    let torque = if kind.is_hinge() { "torque" } else { "force" };
    let max_speed = kind.like("rad/s", MAX_SPEED);
    let max_range = match kind {
        JointKind::Hinge => MAX_RANGE,
        // Longer legs have longer slides.
        JointKind::Slide => kind.like("rad", MAX_RANGE) * sizes.length().max(1.0),
    };
    let moved = || anatomy.moved.iter().copied().filter(|&joint| model.joints[joint].kind == kind);
    let mut doubts = Vec::new();
    let strong: Vec<usize> = moved()
        .filter(|&joint| model.effort(joint).is_some_and(|effort| effort > MAX_EFFORT * unit))
        .collect();
    if let Some(&first) = strong.first() {
        let effort = model.effort(first).unwrap_or_default();
        doubts.push(format!(
            "{torque} limits of {} look like placeholders: {} {} is {:.0} {unit_name}, and legs have about {USUAL_EFFORT:.0}. A \
             guess is {:?} {}: write what the motor and its gear give into the robot's file (URDF: <limit effort>, MJCF: \
             `forcerange` of the actuator)",
            named(model, &strong),
            tidy(effort),
            kind.unit("N·m"),
            effort / unit,
            tidy(USUAL_EFFORT * unit),
            kind.unit("N·m")
        ));
    }
    let fast =
        moved().filter(|&joint| model.joints[joint].velocity_limit.is_some_and(|speed| speed > max_speed));
    let fast: Vec<usize> = fast.collect();
    if let Some(&first) = fast.first() {
        let speed = model.joints[first].velocity_limit.unwrap_or_default();
        doubts.push(format!(
            "speed limits of {} look like placeholders: {} {}, where legs have {} to {}. Simulations do not use them",
            named(model, &fast),
            tidy(speed),
            kind.unit("rad/s"),
            kind.like("rad/s", 10.0),
            kind.like("rad/s", 45.0)
        ));
    }
    let wide =
        moved().filter(|&joint| model.joints[joint].range.is_some_and(|[low, high]| high - low > max_range));
    let wide: Vec<usize> = wide.collect();
    if let Some(&first) = wide.first() {
        let [low, high] = model.joints[first].range.unwrap_or_default();
        doubts.push(format!(
            "ranges of {} look like placeholders: {:?} to {:?} {} bounds nothing. Write where the joint stops into the \
             robot's file (`range`; URDF: <limit lower upper>)",
            named(model, &wide),
            tidy(low),
            tidy(high),
            kind.unit("rad")
        ));
    }
    doubts
}

fn named(model: &Model, joints: &[usize]) -> String {
    listed(joints.iter().map(|&joint| shown(&model.joints[joint].name)), NAMED)
}
