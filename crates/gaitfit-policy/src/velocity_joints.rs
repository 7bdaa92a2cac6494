//! Joints whose targets are velocities, such as wheels.

use crate::{Interface, InterfaceError};

impl Interface {
    pub(crate) fn check_velocity_joints(&self) -> Result<(), InterfaceError> {
        for (index, name) in self.velocity_joints.iter().enumerate() {
            let wrong = |why: String| Err(InterfaceError(format!("velocity_joints names {name}, {why}")));
            if self.velocity_joints[..index].contains(name) {
                return wrong("twice; name every joint once".to_owned());
            }
            let Some(joint) = self.joints.iter().position(|joint| joint == name) else {
                return wrong("which is not among joints; a held joint has a position".to_owned());
            };
            let (kp, kd, pose) = (self.kp[joint], self.kd[joint], self.default_pose[joint]);
            if kp != 0.0 {
                return wrong(format!(
                    "whose kp is {kp}; a motor with a target velocity has no position gain: set its kp to 0"
                ));
            }
            if kd == 0.0 {
                return wrong("whose kd is 0; its torque is kd (target - velocity): give it a kd".to_owned());
            }
            if pose != 0.0 {
                return wrong(format!(
                    "whose default_pose is {pose}; action 0 is the velocity 0: set it to 0"
                ));
            }
        }
        Ok(())
    }

    /// For each joint of the policy, whether its target is a velocity.
    pub fn velocity_targets(&self) -> Vec<bool> {
        self.joints.iter().map(|joint| self.velocity_joints.contains(joint)).collect()
    }
}
