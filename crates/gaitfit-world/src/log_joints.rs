//! From a log's joints to a robot's, by name.

use crate::Error;
use gaitfit_log::Trajectory;
use gaitfit_model::Model;
use std::collections::BTreeMap;
use std::path::Path;

/// The samples with the robot's joints `wanted` (indices of `model.joints`), in that order and under the robot's
/// names; and the log's own names of them. `joint_names`: the robot's name of a log's joint, where they differ.
///
/// # Errors
/// A joint of the log that the robot lacks, two that are the same, a wanted one that is missing.
pub fn of_robot(
    trajectory: &Trajectory,
    path: &Path,
    joint_names: &BTreeMap<String, String>,
    model: &Model,
    wanted: &[usize],
) -> Result<(Trajectory, Vec<String>), Error> {
    let joints = &model.joints;
    let listed = || joints.iter().map(|joint| joint.name.as_str()).collect::<Vec<_>>().join(", ");
    let robot_joint = |of_log: &String| model.find_joint(joint_names.get(of_log).unwrap_or(of_log));
    let shown = path.display();
    let advice = "map names in [joint_names], or use the robot file the log was made with";
    // All columns of the log are matched first: a joint that the robot lacks shows that log and robot do not
    // belong together.
    let mut columns: Vec<Option<&String>> = vec![None; joints.len()];
    for of_log in &trajectory.joints {
        let Some(joint) = robot_joint(of_log) else {
            return Err(Error::failed(format!(
                "{shown}: the log has a joint `{of_log}` that the robot lacks (it has {}); {advice}.",
                listed()
            )));
        };
        if let Some(other) = columns[joint].replace(of_log) {
            return Err(Error::failed(format!(
                "{shown}: the log's joints `{other}` and `{of_log}` are both the robot's `{}`; {advice}.",
                joints[joint].name
            )));
        }
    }
    let mut names = Vec::with_capacity(wanted.len());
    for &joint in wanted {
        let Some(of_log) = columns[joint] else {
            return Err(Error::failed(format!(
                "{shown}: the log lacks the robot's joint `{}` (it has {}); {advice}.",
                joints[joint].name,
                trajectory.joints.join(", ")
            )));
        };
        names.push(of_log);
    }
    let mut ordered =
        trajectory.select_joints(&names).map_err(|error| Error::failed(format!("{shown}: {error}")))?;
    let of_robot = wanted.iter().map(|&joint| joints[joint].name.clone()).collect();
    // From here on the samples go by the robot's names; messages to the user keep the log's.
    let of_log = std::mem::replace(&mut ordered.joints, of_robot);
    Ok((ordered, of_log))
}
