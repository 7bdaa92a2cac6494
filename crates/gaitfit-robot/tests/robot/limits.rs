//! What is inside a Go2's limits, written down apart from the guard.

use gaitfit_robot::unitree::MOTORS;
use gaitfit_robot::{Command, RobotState};

/// What is outside, in words; `None` where all of a command is inside for a robot in `state`.
#[allow(clippy::approx_constant, reason = "the numbers of the vendor's file")]
pub fn violation(command: &Command, state: &RobotState) -> Option<String> {
    for motor in 0..MOTORS {
        let (kind, front) = (motor % 3, motor < 6);
        let (range, torque) = match kind {
            0 => ([-1.0472, 1.0472], 23.7),
            1 if front => ([-1.5708, 3.4907], 23.7),
            1 => ([-0.5236, 4.5379], 23.7),
            _ => ([-2.7227, -0.83776], 45.43),
        };
        let one = &command[motor];
        let felt = one.kp * (one.q - state.q[motor]) + one.kd * (one.dq - state.dq[motor]) + one.tau;
        let wrong = if !one.is_finite() {
            "not finite"
        } else if one.kp > 0.0 && !(range[0]..=range[1]).contains(&one.q) {
            "target outside the range"
        } else if !(0.0..=100.0).contains(&one.kp) || !(0.0..=5.0).contains(&one.kd) {
            "gains"
        } else if one.dq != 0.0 {
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
