//! What is inside a robot's limits: a Go2's written down apart from its file.

use gaitfit_robot::{Command, Robot, RobotState};

use crate::toy::go2;

/// What is outside, in words; `None` where all of a command is inside for a robot in `state`.
pub fn violation(command: &Command, state: &RobotState) -> Option<String> {
    violation_of(&go2(), command, state)
}

/// Range, torque and largest gains of a motor.
#[allow(clippy::approx_constant, reason = "the numbers of the vendor's file")]
fn bounds(robot: &Robot, motor: usize) -> ([f32; 2], f32, [f32; 2]) {
    if robot.name != "go2" {
        let it = &robot.motors[motor];
        let range = it.range.unwrap_or([f32::NEG_INFINITY, f32::INFINITY]);
        return (range, it.torque, [robot.guard.kp, robot.guard.kd]);
    }
    let (kind, front) = (motor % 3, motor < 6);
    let (range, torque) = match kind {
        0 => ([-1.0472, 1.0472], 23.7),
        1 if front => ([-1.5708, 3.4907], 23.7),
        1 => ([-0.5236, 4.5379], 23.7),
        _ => ([-2.7227, -0.83776], 45.43),
    };
    (range, torque, [100.0, 5.0])
}

/// The same of a command to any robot.
pub fn violation_of(robot: &Robot, command: &Command, state: &RobotState) -> Option<String> {
    for motor in 0..robot.motors.len() {
        let (range, torque, [kp, kd]) = bounds(robot, motor);
        let one = &command[motor];
        let felt = one.kp * (one.q - state.q[motor]) + one.kd * (one.dq - state.dq[motor]) + one.tau;
        let wrong = if !one.is_finite() {
            "not finite"
        } else if one.kp > 0.0 && !(range[0]..=range[1]).contains(&one.q) {
            "target outside the range"
        } else if !(0.0..=kp).contains(&one.kp) || !(0.0..=kd).contains(&one.kd) {
            "gains"
        } else if one.dq != 0.0
            && !(robot.motors[motor].is_wheel() && one.dq.abs() <= robot.motors[motor].speed)
        {
            "a velocity is wanted"
        } else if felt.abs() > torque * 1.0001 {
            "torque"
        } else {
            continue;
        };
        return Some(format!("motor {motor}: {wrong}: {one:?}, {felt} N·m at {}", state.q[motor]));
    }
    None
}
