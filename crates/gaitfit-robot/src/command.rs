//! What a robot's motors are told.

use crate::unitree::{HEAD, LOW_LEVEL, LowCmd, MOTORS, MotorCmd, SERVO};

/// What one motor is told: torque = kp (q − angle) + kd (dq − velocity) + tau.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotorCommand {
    /// Angle wanted, rad.
    pub q: f32,
    /// Velocity wanted, rad/s.
    pub dq: f32,
    /// Torque added, N·m.
    pub tau: f32,
    /// Position gain, N·m/rad.
    pub kp: f32,
    /// Velocity gain, N·m·s/rad.
    pub kd: f32,
}

impl MotorCommand {
    /// Torque of a motor at angle `q` and velocity `dq`, N·m.
    pub fn torque(&self, q: f32, dq: f32) -> f32 {
        self.kp * (self.q - q) + self.kd * (self.dq - dq) + self.tau
    }

    /// Whether all its numbers are finite.
    pub fn is_finite(&self) -> bool {
        [self.q, self.dq, self.tau, self.kp, self.kd].iter().all(|x| x.is_finite())
    }
}

/// What all motors are told, motor order.
pub type Command = [MotorCommand; MOTORS];

/// Velocity gain of damping, N·m·s/rad: the robot sinks to the ground in about a second.
pub const DAMPING_KD: f32 = 2.0;

/// Damping: the motors resist motion and hold nothing.
pub fn damping() -> Command {
    [MotorCommand { kd: DAMPING_KD, ..MotorCommand::default() }; MOTORS]
}

impl From<&Command> for LowCmd {
    /// The message for a Go2, with its checksum; the slots without a motor stay as they are.
    fn from(command: &Command) -> Self {
        let mut message = Self { head: HEAD, level_flag: LOW_LEVEL, ..Self::default() };
        for (slot, motor) in message.motor_cmd.iter_mut().zip(command) {
            let MotorCommand { q, dq, tau, kp, kd } = *motor;
            *slot = MotorCmd { mode: SERVO, q, dq, tau, kp, kd, ..MotorCmd::default() };
        }
        message.sealed()
    }
}
