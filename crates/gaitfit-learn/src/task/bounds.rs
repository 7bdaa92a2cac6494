//! Which actions a robot can use.

use super::Task;
use gaitfit_model::JointKind;

/// Largest action of a joint whose range or effort does not bound it, in units of the action scale.
const LARGEST: f64 = 100.0;
/// Largest velocity that a joint with velocity targets is asked for, rad/s.
const FASTEST: f64 = 100.0;
/// Max distance from the default pose to which a hinge without limits is sent, rad: half a turn each way; a
/// slide the like of it, m.
const HALF_TURN: f64 = std::f64::consts::PI;

impl Task {
    /// For each joint of the policy the smallest and the largest action that makes a difference, in units of the action
    /// scale; always finite, and 0 lies between. Targets go over the joint's range, and as far beyond it as the PD controller
    /// needs for the motor's whole torque at the range's end (effort / kp); the action's clip bounds them, too.
    pub fn action_bounds(&self) -> Vec<[f32; 2]> {
        let (model, interface) = (self.walker.model(), &self.walker.interface);
        let bounds = |(index, name): (usize, &String)| {
            let joint = model.find_joint(name);
            let (home, scale) = (interface.default_pose[index], interface.action_scale[index]);
            // A velocity target knows no range; the fastest wheel bounds it.
            if interface.velocity_joints.contains(name) {
                let largest = interface.clip(index).min(LARGEST).min(FASTEST / scale.abs()) as f32;
                return [-largest, largest];
            }
            let range = joint.and_then(|joint| model.joints[joint].range);
            let kind = joint.map_or(JointKind::Hinge, |joint| model.joints[joint].kind);
            let far = kind.like("rad", HALF_TURN);
            let [low, high] = range.unwrap_or([home - far, home + far]);
            let effort = joint.and_then(|joint| model.effort(joint)).filter(|effort| effort.is_finite());
            let kp = interface.kp[index];
            // Without a range there is no end to press against, and without stiffness no target makes a torque.
            let beyond = effort.filter(|_| range.is_some() && kp > 0.0).map_or(0.0, |effort| effort / kp);
            let largest = interface.clip(index).min(LARGEST);
            // 0 / 0 where the scale is 0 and the target is home: such an action moves nothing.
            let action = |target: f64| {
                let action = (target - home) / scale;
                if action.is_nan() { 0.0 } else { action.clamp(-largest, largest) as f32 }
            };
            // A negative scale swaps the ends.
            let ends = [action(low - beyond), action(high + beyond)];
            let [low, high] = if scale < 0.0 { [ends[1], ends[0]] } else { ends };
            // A pose outside the range, as some robots start in, is within reach.
            [low.min(0.0), high.max(0.0)]
        };
        interface.joints.iter().enumerate().map(bounds).collect()
    }
}
