//! Reading robot files.

use crate::Error;
use gaitfit_log::CheckSpec;
use gaitfit_model::{Model, ReadOptions, Root};
use std::path::Path;

/// The built-in Go2.
pub fn go2() -> Result<Model, Error> {
    Ok(gaitfit_model::builtin::go2()?)
}

/// How the robot's base hangs in the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hold {
    /// As the file says.
    File,
    /// Clamped.
    Clamped,
}

/// Reads an MJCF or URDF robot.
pub fn read(path: &Path, lenient: bool, hold: Hold) -> Result<Model, Error> {
    let root = match hold {
        Hold::File => None,
        Hold::Clamped => Some(Root::Fixed),
    };
    Ok(gaitfit_model::read(path, &ReadOptions { lenient, root })?)
}

/// What a log of this robot is checked against; limits under both the robot's names and the log's.
pub fn check_spec(model: &Model, log_joints: &[String]) -> CheckSpec {
    let mut spec = CheckSpec::default();
    let mut names = Vec::with_capacity(model.joints.len());
    for (index, joint) in model.joints.iter().enumerate() {
        let of_log = log_joints.iter().find(|name| model.find_joint(name) == Some(index));
        let name = of_log.unwrap_or(&joint.name).clone();
        if let Some(range) = joint.range {
            spec.position_limits.insert(name.clone(), range);
        }
        if let Some(limit) = joint.velocity_limit {
            spec.velocity_limits.insert(name.clone(), limit);
        }
        if let Some(effort) = model.effort(index) {
            spec.effort_limits.insert(name.clone(), effort);
        }
        names.push(name);
    }
    spec.joints = Some(names);
    spec
}
