//! Joints of a log whose targets are velocities, as of wheels.

use gaitfit_log::Trajectory;
use gaitfit_model::shown;
use gaitfit_policy::Interface;

/// Checks the log's `velocity_joints` against the policy's. A log without any takes the policy's. Then makes the angles of these
/// joints continuous.
///
/// # Errors
/// A message if the log names other joints than the policy.
pub fn settle(log: &mut Trajectory, interface: &Interface) -> Result<(), String> {
    // A log that names wheels must name the policy's, or targets in rad would be taken for rad/s.
    let stated = &log.velocity_joints;
    if !stated.is_empty() {
        if let Some(joint) = stated.iter().find(|joint| !interface.velocity_joints.contains(joint)) {
            return Err(format!(
                "velocity_joints of the log names `{}`, but the policy sends this joint angles: correct velocity_joints in the log or \
                 in the policy's description.",
                shown(joint)
            ));
        }
        if let Some(joint) = interface.velocity_joints.iter().find(|joint| !stated.contains(joint)) {
            return Err(format!(
                "the policy sends `{}` velocities, but velocity_joints of the log does not name it: correct velocity_joints in the log \
                 or in the policy's description.",
                shown(joint)
            ));
        }
    }
    log.velocity_joints.clone_from(&interface.velocity_joints);
    log.unwrap_wheels();
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::walk::fixtures::{policy, puppet, scene};

    #[test]
    fn a_log_has_the_policys_velocity_joints_and_others_are_refused() {
        let mut policy = policy(&scene(), 1);
        let joints = policy.interface.joints.clone();
        let silent = puppet(&policy, 1, 1.0);
        policy.interface.velocity_joints = vec![joints[3].clone(), joints[7].clone()];
        let settled = |stated: &[usize]| {
            let mut log = silent.clone();
            log.velocity_joints = stated.iter().map(|&joint| joints[joint].clone()).collect();
            settle(&mut log, &policy.interface).map(|()| log.velocity_joints)
        };
        assert_eq!(settled(&[]).unwrap(), policy.interface.velocity_joints);
        assert_eq!(settled(&[7, 3]).unwrap(), policy.interface.velocity_joints);
        let error = settled(&[3, 5]).unwrap_err();
        assert!(error.contains(&joints[5]) && error.contains("angles"), "{error}");
        let error = settled(&[3]).unwrap_err();
        assert!(error.contains(&joints[7]) && error.contains("does not name it"), "{error}");
    }

    #[test]
    fn velocity_targets_are_not_replayed_on_a_clamped_robot() {
        let policy = policy(&scene(), 1);
        let joint = &policy.interface.joints[3];
        let mut log = puppet(&policy, 1, 1.0);
        log.velocity_joints = vec![joint.clone()];
        let error = crate::air::logs::recording(&log, std::path::Path::new("a.csv")).unwrap_err().to_string();
        assert!(error.contains("a.csv: the targets of joint") && error.contains(joint), "{error}");
    }
}
