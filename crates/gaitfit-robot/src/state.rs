//! What a robot reports, in SI units and motor order.

use crate::unitree::{LowState, MOTORS, Remote};

/// State of a robot's motors and body at one moment; joints in motor order (see [`crate::unitree::MOTOR_NAMES`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RobotState {
    /// Joint angles, rad.
    pub q: [f32; MOTORS],
    /// Joint velocities, rad/s.
    pub dq: [f32; MOTORS],
    /// Joint torques as the motors estimate them, N·m.
    pub torque: [f32; MOTORS],
    /// Temperatures of the motors, °C.
    pub temperature: [u8; MOTORS],
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
}

/// A message of the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// What it says.
    pub state: RobotState,
    /// Whether it arrived as it was sent.
    pub seal: Seal,
}

impl From<&LowState> for Reading {
    fn from(message: &LowState) -> Self {
        let motors = &message.motor_state;
        let reported = message.bms_state.soc != 0 || message.power_v != 0.0;
        let seal = match message.crc {
            found if found == message.checksum() => Seal::Right,
            0 => Seal::Absent,
            _ => Seal::Wrong,
        };
        let mut remote = [0; 40];
        remote.copy_from_slice(message.wireless_remote.as_flattened());
        Self {
            state: RobotState {
                q: std::array::from_fn(|k| motors[k].q),
                dq: std::array::from_fn(|k| motors[k].dq),
                torque: std::array::from_fn(|k| motors[k].tau_est),
                temperature: std::array::from_fn(|k| motors[k].temperature),
                quaternion: message.imu_state.quaternion,
                gyroscope: message.imu_state.gyroscope,
                accelerometer: message.imu_state.accelerometer,
                battery: reported.then_some(Battery {
                    charge: message.bms_state.soc,
                    volts: message.power_v,
                    amps: message.power_a,
                }),
                tick: message.tick,
                remote: Remote::read(&remote),
            },
            seal,
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A robot that stands, in order in every respect.
    pub(crate) fn standing() -> RobotState {
        RobotState {
            q: std::array::from_fn(|motor| [0.0, 0.9, -1.6][motor % 3]),
            dq: [0.0; MOTORS],
            torque: [0.0; MOTORS],
            temperature: [35; MOTORS],
            quaternion: [1.0, 0.0, 0.0, 0.0],
            gyroscope: [0.0; 3],
            accelerometer: [0.0, 0.0, 9.81],
            battery: Some(Battery { charge: 80, volts: 29.0, amps: 2.0 }),
            tick: 1,
            remote: Remote::default(),
        }
    }

    #[test]
    fn a_seal_is_right_wrong_or_absent() {
        let mut message = LowState { tick: 7, ..LowState::default() };
        assert_eq!(Reading::from(&message).seal, Seal::Absent);
        message = message.sealed();
        assert_eq!(Reading::from(&message).seal, Seal::Right);
        message.motor_state[3].q += 0.1;
        assert_eq!(Reading::from(&message).seal, Seal::Wrong);
    }

    #[test]
    fn a_battery_of_zeros_is_none() {
        let mut message = LowState::default();
        assert_eq!(Reading::from(&message).state.battery, None);
        message.power_v = 28.5;
        let battery = Reading::from(&message).state.battery;
        assert_eq!(battery, Some(Battery { charge: 0, volts: 28.5, amps: 0.0 }));
    }
}
