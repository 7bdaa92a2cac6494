//! State of a robot, in SI units and motor order.

use crate::per_motor::PerMotor;
use crate::remote::Remote;

/// State of a robot's motors and body at one moment; joints in motor order (see [`crate::Robot`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RobotState {
    /// Joint angles, rad.
    pub q: PerMotor<f32>,
    /// Joint velocities, rad/s.
    pub dq: PerMotor<f32>,
    /// Joint torques as the motors estimate them, N·m.
    pub torque: PerMotor<f32>,
    /// Temperatures of the motors, °C.
    pub temperature: PerMotor<i16>,
    /// Error numbers of the motors; 0 is none, and what messages without them have.
    pub error: PerMotor<u32>,
    /// Packets between motor and main board that were lost so far; 0 where messages do not count them.
    pub lost: PerMotor<u32>,
    /// Orientation of the base, wxyz, unit.
    pub quaternion: [f32; 4],
    /// Angular velocity of the base, rad/s, body frame.
    pub gyroscope: [f32; 3],
    /// Proper acceleration, m/s², body frame.
    pub accelerometer: [f32; 3],
    /// The battery; `None` where nothing of it is reported, as simulators do.
    pub battery: Option<Battery>,
    /// Counter of the main board, ms; 0 throughout where it does not count, as simulators do.
    pub tick: u32,
    /// Its remote.
    pub remote: Remote,
}

/// State of a robot's battery.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Battery {
    /// Charge, %.
    pub charge: u8,
    /// Supply voltage, V.
    pub volts: f32,
    /// Supply current, A.
    pub amps: f32,
}

/// Whether a message's checksum is right.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seal {
    /// It is.
    Right,
    /// It is not.
    Wrong,
    /// The sender wrote 0 in its place and the checksum is another: simulators do not fill it in.
    Absent,
    /// Messages of this kind have none: ROS 2's.
    Unused,
}

/// A message of the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// The state in it.
    pub state: RobotState,
    /// Whether it arrived as it was sent.
    pub seal: Seal,
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A Go2 that stands, in order in every respect.
    pub(crate) fn standing() -> RobotState {
        RobotState {
            q: PerMotor::from_fn(12, |motor| [0.0, 0.9, -1.6][motor % 3]),
            dq: PerMotor::new(12, 0.0),
            torque: PerMotor::new(12, 0.0),
            temperature: PerMotor::new(12, 35),
            error: PerMotor::new(12, 0),
            lost: PerMotor::new(12, 0),
            quaternion: [1.0, 0.0, 0.0, 0.0],
            gyroscope: [0.0; 3],
            accelerometer: [0.0, 0.0, 9.81],
            battery: Some(Battery { charge: 80, volts: 29.0, amps: 2.0 }),
            tick: 1,
            remote: Remote::default(),
        }
    }
}
