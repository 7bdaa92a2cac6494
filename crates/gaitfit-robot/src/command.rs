//! Commands to a robot's motors.

use crate::per_motor::PerMotor;

/// Command to one motor: torque = kp (q − angle) + kd (dq − velocity) + tau.
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

/// Commands to all motors, motor order.
pub type Command = PerMotor<MotorCommand>;

/// Damping with these velocity gains, N·m·s/rad: the motors resist motion and hold nothing. A Go2 sinks to the ground in about
/// a second.
pub fn damping(kd: &PerMotor<f32>) -> Command {
    kd.map(|kd| MotorCommand { kd, ..MotorCommand::default() })
}
