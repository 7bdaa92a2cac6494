//! Limits of a robot's model that a log of it is checked against.

use super::CheckSpec;
use gaitfit_model::{JointKind, Model};
use std::collections::HashMap;

impl CheckSpec {
    /// Joints and limits of `model`, each under the log's name of the joint where `log_joints` has it
    /// ([`Model::find_joint`]), else under the robot's.
    pub fn of_robot(model: &Model, log_joints: &[String]) -> CheckSpec {
        // The log may use other names for the joints than the robot's file.
        let mut of_log: HashMap<usize, &String> = HashMap::new();
        for name in log_joints {
            if let Some(index) = model.find_joint(name) {
                // If two columns are of one joint, the first counts.
                of_log.entry(index).or_insert(name);
            }
        }
        let mut spec = CheckSpec::default();
        let mut names = Vec::with_capacity(model.joints.len());
        for (index, joint) in model.joints.iter().enumerate() {
            let name = of_log.get(&index).copied().unwrap_or(&joint.name).clone();
            if let Some(range) = joint.range {
                spec.position_limits.insert(name.clone(), range);
            }
            if let Some(limit) = joint.velocity_limit {
                spec.velocity_limits.insert(name.clone(), limit);
            }
            if let Some(effort) = model.effort(index) {
                spec.effort_limits.insert(name.clone(), effort);
            }
            if joint.kind == JointKind::Slide {
                spec.slides.insert(name.clone());
            }
            names.push(name);
        }
        spec.joints = Some(names);
        spec
    }

    /// Whether a joint turns or slides.
    pub(super) fn kind(&self, joint: &str) -> JointKind {
        if self.slides.contains(joint) { JointKind::Slide } else { JointKind::Hinge }
    }
}
