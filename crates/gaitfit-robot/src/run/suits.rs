//! Whether a policy is one that a robot may be given.

use gaitfit_policy::{Interface, Policy};

use crate::RobotError;
use crate::robot::{BUILT_IN, Motor, Robot};

/// Slowest policy, s: a robot falls in less than that.
const SLOWEST: f64 = 0.1;

/// Whether `robot` can do what `policy` asks for: the guard would change each command of another one, and its logs would state
/// gains that were not in force.
///
/// # Errors
/// A policy that follows a motion, or of another robot, gains beyond the limits, a default pose outside the joints' ranges, a
/// control period above 0.1 s, velocity targets of joints that are no wheels; joints that are held so.
pub fn suits(policy: &Policy, robot: &Robot) -> Result<(), RobotError> {
    let (interface, limits, title) = (&policy.interface, robot.limits(), &robot.title);
    let unfit = |problem: String, remedy: String| Err(RobotError::Unfit { problem, remedy });
    // First whether the policy is for this robot at all, then its numbers joint by joint.
    if interface.reference.is_some() {
        return unfit(
            "follows a motion, which gaitfit does not run on a robot yet: the motion would play while the robot stands and waits, \
             and jump back to its beginning at each walk"
                .to_owned(),
            "evaluate it in a simulator (`gaitfit evaluate`), and run it on the robot with the program that it was made for"
                .to_owned(),
        );
    }
    if !is_of(interface, robot) {
        return unfit(
            format!("is of the robot `{}`, and this is a {title}", interface.robot.escape_debug()),
            format!(
                "take a policy of the {title}; if it is one by another name, name the robot in a .toml beside it: robot = {:?}",
                robot.name
            ),
        );
    }
    if interface.control_dt > SLOWEST {
        return unfit(
            format!(
                "acts every {} s, and a {title} is run every {SLOWEST} s or faster",
                interface.control_dt
            ),
            "check control_dt, which is in seconds".to_owned(),
        );
    }
    let motors = robot.motors_of(&interface.joints)?;
    for (joint, &motor) in interface.joints.iter().zip(&motors) {
        if interface.velocity_joints.contains(joint) && !robot.motors[motor].is_wheel() {
            return unfit(
                format!(
                    "gives joint `{}` velocities, and this joint of a {title} is no wheel",
                    joint.escape_debug()
                ),
                "leave it out of velocity_joints and give it kp; a wheel is a motor whose robot file gives it no range and kp = 0"
                    .to_owned(),
            );
        }
    }
    let postures = robot.postures(interface)?;
    // What `gaitfit_policy_files::read` gives has a number for each joint.
    // All motors are looked at: those that the policy does not move are held with gains too.
    for (motor, joint) in robot.joints().iter().enumerate() {
        let gains = [("kp", postures.kp[motor], limits.kp), ("kd", postures.kd[motor], limits.kd)];
        for (name, gain, max) in gains {
            // NaN is in no range and is refused too.
            if !(0.0..=max).contains(&gain) {
                return unfit(
                    format!("has {name} = {gain} at joint `{joint}`, and the guard lets 0 to {max} through"),
                    format!(
                        "train with gains within the limits, kp to {} and kd to {}",
                        limits.kp, limits.kd
                    ),
                );
            }
        }
        // A joint with velocity targets has no position gain.
        if robot.motors[motor].is_wheel() && postures.kp[motor] > 0.0 {
            return unfit(
                format!(
                    "has kp = {} at the wheel `{joint}`, which may have turned many times: it would spin back to one angle",
                    postures.kp[motor]
                ),
                "name it in velocity_joints, or leave it out of the policy: then it is braked".to_owned(),
            );
        }
        let (angle, low, high) = (postures.standing[motor], limits.lower[motor], limits.upper[motor]);
        if !(low..=high).contains(&angle) {
            return unfit(
                format!("stands with joint `{joint}` at {angle} rad, outside its range, {low} to {high}"),
                "check the order of default_pose, which is that of joints, and its unit, rad".to_owned(),
            );
        }
    }
    Ok(())
}

/// Whether a policy is of `robot` by the name of its robot. A policy without a name may be of any robot.
fn is_of(interface: &Interface, robot: &Robot) -> bool {
    let named = interface.robot.to_lowercase();
    let match_length = |robot: &Robot| {
        let known = robot.policies.iter().filter(|name| named.contains(name.as_str()));
        known.map(String::len).max().unwrap_or(0)
    };
    // `go2w` contains `go2`, but it is no Go2.
    let nearer = |(name, _): &(&str, &str)| {
        let other = Robot::built_in(name);
        other.is_ok_and(|other| other.name != robot.name && match_length(&other) > match_length(robot))
    };
    // unitree_mujoco's description of the Go2-W has the name `go2`. Only a Go2-W has wheels to roll.
    let rolls = !interface.velocity_joints.is_empty();
    let begins = || robot.policies.iter().any(|name| name.starts_with(&named));
    named.is_empty()
        || (match_length(robot) > 0 && !BUILT_IN.iter().any(nearer))
        || (rolls && robot.motors.iter().any(Motor::is_wheel) && begins())
}
