//! Whether a policy is one that a Go2 may be given.

use gaitfit_policy::Policy;

use crate::RobotError;
use crate::guard::Limits;
use crate::unitree::motors_of;

/// Slowest policy, s: a robot falls in less than that.
const SLOWEST: f64 = 0.1;

/// Whether a Go2 with these limits can do what `policy` asks for: the guard would change each command of another one, and
/// its logs would state gains that were not in force.
///
/// # Errors
/// A policy of another robot, gains beyond the limits, a default pose outside the joints' ranges, a control period above
/// 0.1 s.
pub fn suits(policy: &Policy, limits: &Limits) -> Result<(), RobotError> {
    let interface = &policy.interface;
    let unfit = |problem: String, remedy| Err(RobotError::Unfit { problem, remedy });
    if !interface.robot.is_empty() && !interface.robot.to_lowercase().contains("go2") {
        return unfit(
            format!("is of the robot `{}`, and this is a Go2", interface.robot.escape_debug()),
            "take a policy of the Go2; if it is one by another name, name the robot in a .toml beside it: robot = \"go2\"",
        );
    }
    if interface.control_dt > SLOWEST {
        return unfit(
            format!("acts every {} s, and a Go2 is run every {SLOWEST} s or faster", interface.control_dt),
            "check control_dt, which is in seconds",
        );
    }
    let motors = motors_of(&interface.joints)?;
    for (index, (joint, &motor)) in interface.joints.iter().zip(&motors).enumerate() {
        // What `gaitfit_policy::read` gives has a number for each joint.
        let entry = |row: &[f64]| row.get(index).copied().unwrap_or(f64::NAN);
        let gains = [("kp", entry(&interface.kp), limits.kp), ("kd", entry(&interface.kd), limits.kd)];
        for (name, gain, max) in gains {
            if !(0.0..=f64::from(max)).contains(&gain) {
                return unfit(
                    format!("has {name} = {gain} at joint `{joint}`, and the guard lets 0 to {max} through"),
                    "train with gains within the limits, kp to 100 and kd to 5",
                );
            }
        }
        let (angle, low, high) = (entry(&interface.default_pose), limits.lower[motor], limits.upper[motor]);
        if !(f64::from(low)..=f64::from(high)).contains(&angle) {
            return unfit(
                format!("stands with joint `{joint}` at {angle} rad, outside its range, {low} to {high}"),
                "check the order of default_pose, which is that of joints, and its unit, rad",
            );
        }
    }
    Ok(())
}
