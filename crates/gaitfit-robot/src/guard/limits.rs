//! Limits of a robot's motors, and the command nearest to the wanted one that keeps them.

use crate::command::{Command, MotorCommand};
use crate::per_motor::PerMotor;
use crate::state::RobotState;

/// Limits of a robot's motors and joints, motor order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Least angle, rad; of a wheel −∞.
    pub lower: PerMotor<f32>,
    /// Largest angle, rad; of a wheel ∞.
    pub upper: PerMotor<f32>,
    /// Largest speed, rad/s.
    pub speed: PerMotor<f32>,
    /// Largest torque, N·m.
    pub torque: PerMotor<f32>,
    /// Largest position gain, N·m/rad.
    pub kp: f32,
    /// Largest velocity gain, N·m·s/rad.
    pub kd: f32,
}

/// Share of the largest torque that damping may use. The rest is for a joint that turns faster by now than in the
/// last state.
const DAMPING_ROOM: f32 = 0.9;

impl Limits {
    /// The limits for damping a robot whose last state may be old: its torque has room.
    pub fn for_damping(&self) -> Self {
        Self { torque: self.torque.map(|torque| DAMPING_ROOM * torque), ..*self }
    }

    /// The command nearest to `wanted` that is inside the limits for a robot in `state`: angles within the joints' range,
    /// gains within theirs, and the torque that the motor board will make of it within the motor's. A joint that turns at
    /// its largest speed is not driven further.
    ///
    /// The torque is that of the given state. Between two commands the joint moves; at 500 Hz it is off by
    /// kp · speed · 2 ms.
    ///
    /// `None` where a number of `wanted` is not finite, or so large that the command is not.
    pub fn admit(&self, wanted: &Command, state: &RobotState) -> Option<Command> {
        let mut command = *wanted;
        for (motor, slot) in command.iter_mut().enumerate() {
            if !slot.is_finite() {
                return None;
            }
            *slot = self.admit_one(motor, slot, state.q[motor], state.dq[motor]);
            // A huge target may be no number any more.
            if !slot.is_finite() {
                return None;
            }
        }
        Some(command)
    }

    fn admit_one(&self, motor: usize, wanted: &MotorCommand, q: f32, dq: f32) -> MotorCommand {
        let (speed, torque) = (self.speed[motor], self.torque[motor]);
        // Each number is bounded by itself first; then their sum, the torque, is.
        let mut command = MotorCommand {
            q: wanted.q.clamp(self.lower[motor], self.upper[motor]),
            dq: wanted.dq.clamp(-speed, speed),
            tau: wanted.tau.clamp(-torque, torque),
            kp: wanted.kp.clamp(0.0, self.kp),
            kd: wanted.kd.clamp(0.0, self.kd),
        };
        // At its greatest speed a joint may only be braked.
        let max = if dq >= speed { 0.0 } else { torque };
        let min = if dq <= -speed { 0.0 } else { -torque };
        // The torque that the motor board will make in this state.
        let commanded = command.torque(q, dq);
        if (min..=max).contains(&commanded) {
            return command;
        }
        // First the target gives way, towards the angle where the torque is at its limit.
        if command.kp > 0.0 {
            // The torque without its position term. `kp` times the way to the target makes the rest.
            let rest = commanded - command.kp * (command.q - q);
            let angle = q + (commanded.clamp(min, max) - rest) / command.kp;
            command.q = angle.clamp(self.lower[motor], self.upper[motor]);
        } else if command.kd > 0.0 && command.dq != 0.0 {
            // A wheel's target velocity changes until the torque is at its limit.
            let at_limit = dq + (commanded.clamp(min, max) - command.tau) / command.kd;
            command.dq = at_limit.clamp(-speed, speed);
        }
        // Where the target is at the end of its range, or there is none, the gains give way.
        let commanded = command.torque(q, dq);
        // One factor for all three, so that the torque keeps its sign and ends at the limit. If the limit is 0
        // the motor is free.
        let factor = if commanded > max {
            max / commanded
        } else if commanded < min {
            min / commanded
        } else {
            1.0
        };
        command.tau *= factor;
        command.kp *= factor;
        command.kd *= factor;
        command
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::approx_constant, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::Robot;
    use crate::state::tests::standing;

    fn go2() -> Limits {
        Robot::built_in("unitree-go2").unwrap().limits()
    }

    fn admitted(motor: usize, wanted: MotorCommand, q: f32, dq: f32) -> MotorCommand {
        let mut state = standing();
        (state.q[motor], state.dq[motor]) = (q, dq);
        let mut command = Command::new(12, MotorCommand::default());
        command[motor] = wanted;
        go2().admit(&command, &state).unwrap()[motor]
    }

    #[test]
    fn a_command_inside_the_limits_is_left_as_it_is() {
        let wanted = MotorCommand { q: 0.9, kp: 25.0, kd: 0.5, ..MotorCommand::default() };
        assert_eq!(admitted(1, wanted, 0.8, 2.0), wanted);
    }

    #[test]
    fn a_far_target_is_brought_to_where_the_torque_is_at_its_limit() {
        // 100 · (q* − 0.8) − 1 · 2 = 23.7.
        let wanted = MotorCommand { q: 3.0, kp: 100.0, kd: 1.0, ..MotorCommand::default() };
        let command = admitted(1, wanted, 0.8, 2.0);
        let same = (command.kp - 100.0).abs() < 1e-3 && (command.kd - 1.0).abs() < 1e-5;
        assert!((command.q - 1.057).abs() < 1e-5 && same, "{command:?}");
        let command = admitted(1, MotorCommand { q: -1.5, ..wanted }, 0.8, 2.0);
        assert!((command.q - 0.583).abs() < 1e-5, "{command:?}");
    }

    #[test]
    fn a_target_outside_the_range_is_brought_into_it() {
        let wanted = MotorCommand { q: -3.2, kp: 5.0, kd: 0.5, ..MotorCommand::default() };
        assert_eq!(admitted(2, wanted, -2.6, 0.0).q, -2.7227);
    }

    #[test]
    fn a_wheel_far_below_its_target_speed_gets_the_motors_largest_torque() {
        // 5 · (dq* − 2) = 23.7.
        let wanted = MotorCommand { dq: 20.0, kd: 5.0, ..MotorCommand::default() };
        let command = admitted(0, wanted, 100.0, 2.0);
        assert!((command.dq - 6.74).abs() < 1e-5 && command.kd == 5.0 && command.kp == 0.0, "{command:?}");
        assert_eq!(admitted(0, MotorCommand { dq: 6.0, ..wanted }, 100.0, 2.0).dq, 6.0);
        // The wheel turns backwards fast.
        let command = admitted(0, wanted, 100.0, -35.0);
        assert!((command.torque(100.0, -35.0) - 23.7).abs() < 1e-3, "{command:?}");
        assert!(admitted(0, wanted, 100.0, 30.2).torque(100.0, 30.2) <= 1e-4, "at its largest speed");
    }

    #[test]
    fn gains_give_way_where_the_target_cannot() {
        // Beyond its range by 0.3 rad: 100 · 0.3 = 30 N·m would pull it back.
        let wanted = MotorCommand { q: 1.0472, kp: 100.0, kd: 0.0, ..MotorCommand::default() };
        let command = admitted(0, wanted, 1.3472, 0.0);
        assert!(command.q == 1.0472 && (command.torque(1.3472, 0.0) + 23.7).abs() < 1e-3, "{command:?}");
        // Damping of a fast joint.
        let command = admitted(0, MotorCommand { kd: 5.0, ..MotorCommand::default() }, 0.0, 20.0);
        assert!((command.torque(0.0, 20.0) + 23.7).abs() < 1e-3 && command.kp == 0.0, "{command:?}");
    }

    #[test]
    fn a_joint_at_its_largest_speed_is_braked_and_not_driven() {
        let wanted = MotorCommand { q: -0.9, kp: 25.0, kd: 0.5, ..MotorCommand::default() };
        assert!(admitted(2, wanted, -1.5, 15.8).torque(-1.5, 15.8) <= 1e-4);
        assert!(admitted(2, wanted, -1.5, 15.0).torque(-1.5, 15.0) > 1.0);
        let down = MotorCommand { q: -2.7, ..wanted };
        assert!(admitted(2, down, -1.5, -15.8).torque(-1.5, -15.8) >= -1e-4);
    }

    #[test]
    fn what_is_not_finite_is_no_command() {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for field in 0..5 {
                let mut numbers = [0.5; 5];
                numbers[field] = bad;
                let [q, dq, tau, kp, kd] = numbers;
                let mut command = Command::new(12, MotorCommand::default());
                command[7] = MotorCommand { q, dq, tau, kp, kd };
                assert_eq!(go2().admit(&command, &standing()), None);
            }
        }
        // kp · (q* − q) is beyond single precision; a joint without a range.
        let mut command = Command::new(12, MotorCommand::default());
        command[7] = MotorCommand { q: 1e38, kp: 40.0, ..MotorCommand::default() };
        let mut limits = go2();
        limits.upper[7] = f32::INFINITY;
        assert_eq!(limits.admit(&command, &standing()), None);
    }

    #[test]
    fn ranges_are_those_of_the_built_in_robot() {
        let (model, limits) = (gaitfit_model::builtin::go2().unwrap(), go2());
        for (motor, name) in Robot::built_in("unitree-go2").unwrap().joints().iter().enumerate() {
            let joint = &model.joints[model.find_joint(name).unwrap()];
            let [low, high] = joint.range.unwrap();
            assert!((f64::from(limits.lower[motor]) - low).abs() < 1e-4, "{name}");
            assert!((f64::from(limits.upper[motor]) - high).abs() < 1e-4, "{name}");
        }
    }
}
