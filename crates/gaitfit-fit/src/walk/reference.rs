//! The place of a log in the motion that its policy follows.

use gaitfit_log::Trajectory;
use gaitfit_policy::observation::{Layout, Sensed};
use gaitfit_policy::{Interface, MotionPlace, Quantity};

/// The place of sample `row`; the motion's beginning, unturned, if the log does not state it.
pub fn place(log: &Trajectory, row: usize) -> MotionPlace {
    let stated = log.motion.as_deref().and_then(|motion| motion.get(2 * row..2 * row + 2));
    stated.map_or_else(MotionPlace::default, |place| MotionPlace { time: place[0], heading: place[1] })
}

/// Makes sure that a log of a policy with a motion states its place in it. Without these columns the motion begins with the log,
/// turned to face as the robot then does. Joints are in the policy's order. Returns what was assumed, in words.
///
/// # Errors
/// A log without the base's orientation, if the policy observes [`Quantity::ReferenceOrientation`]; a sentence.
pub fn settle(log: &mut Trajectory, interface: &Interface, name: &str) -> Result<Option<String>, String> {
    if interface.reference.is_none() {
        return Ok(None);
    }
    let quaternion = log.base.as_ref().and_then(|base| base.quaternion.as_deref()?.first_chunk::<4>());
    let turned = interface.observation.iter().any(|term| term.quantity == Quantity::ReferenceOrientation);
    if turned && quaternion.is_none() {
        return Err(format!(
            "the policy observes {}, and the log has no orientation of the base: record columns base_quat_w, base_quat_x, \
             base_quat_y, base_quat_z.",
            Quantity::ReferenceOrientation.name()
        ));
    }
    if log.motion.is_some() {
        return Ok(None);
    }
    let mut sensed = Sensed::new(interface.joints.len());
    if let Some(quaternion) = quaternion {
        sensed.orientation = quaternion.map(|x| x as f32);
    }
    for (angle, &value) in sensed.joint_position.iter_mut().zip(&log.position) {
        *angle = value as f32;
    }
    let heading = Layout::new(interface, &interface.observation).motion_heading(&sensed);
    let Some(&first) = log.time.first() else { return Ok(None) };
    log.motion = Some(log.time.iter().flat_map(|time| [time - first, heading]).collect());
    Ok(Some(format!(
        "{name}: it does not state its place in the motion (columns motion_time, motion_heading); it is taken to begin with the motion"
    )))
}
