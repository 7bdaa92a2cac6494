//! What the two families of messages have in common: a state to be read, a command to be written, motors in slots.

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::{HEAD, LOW_LEVEL, LowCmd, LowState, MotorCmd, SERVO, hg};
use crate::command::{Command, MotorCommand};
use crate::per_motor::PerMotor;
use crate::remote::Remote;
use crate::state::{Battery, Reading, RobotState, Seal};

/// A state message.
pub trait StateMessage: DeserializeOwned + Send + 'static {
    /// Its type's name in DDS.
    const TYPE: &str;

    /// Returns the state of the motors in `slots`.
    fn reading(&self, slots: &PerMotor<usize>) -> Reading;

    /// Kind of the machine, which a command must repeat; 0 where the message has none.
    fn machine(&self) -> u8;
}

/// A command message.
pub trait CommandMessage: Serialize + DeserializeOwned + Send + 'static {
    /// Its type's name in DDS.
    const TYPE: &str;

    /// `command` for the motors in `slots` of a machine, with its checksum; slots without a motor stay as they are.
    fn for_motors(command: &Command, slots: &PerMotor<usize>, machine: u8) -> Self;
}

/// Whether a message with this checksum, in which `stated` stands, arrived as it was sent.
fn seal(stated: u32, checksum: u32) -> Seal {
    match stated {
        stated if stated == checksum => Seal::Right,
        0 => Seal::Absent,
        _ => Seal::Wrong,
    }
}

fn remote(bytes: &[[u8; 8]; 5]) -> Remote {
    let mut all = [0; 40];
    all.copy_from_slice(bytes.as_flattened());
    Remote::read(&all)
}

impl StateMessage for LowState {
    const TYPE: &str = "unitree_go::msg::dds_::LowState_";

    fn reading(&self, slots: &PerMotor<usize>) -> Reading {
        let motors = &self.motor_state;
        // A battery that reports neither charge nor voltage is none, as in a simulator.
        let reported = self.bms_state.soc != 0 || self.power_v != 0.0;
        let (charge, volts, amps) = (self.bms_state.soc, self.power_v, self.power_a);
        Reading {
            state: RobotState {
                q: slots.map(|slot| motors[slot].q),
                dq: slots.map(|slot| motors[slot].dq),
                torque: slots.map(|slot| motors[slot].tau_est),
                temperature: slots.map(|slot| motors[slot].temperature.into()),
                // These messages have no error numbers.
                error: slots.map(|_| 0),
                lost: slots.map(|slot| motors[slot].lost),
                quaternion: self.imu_state.quaternion,
                gyroscope: self.imu_state.gyroscope,
                accelerometer: self.imu_state.accelerometer,
                battery: reported.then_some(Battery { charge, volts, amps }),
                tick: self.tick,
                remote: remote(&self.wireless_remote),
            },
            seal: seal(self.crc, self.checksum()),
        }
    }

    fn machine(&self) -> u8 {
        0
    }
}

impl CommandMessage for LowCmd {
    const TYPE: &str = "unitree_go::msg::dds_::LowCmd_";

    fn for_motors(command: &Command, slots: &PerMotor<usize>, _: u8) -> Self {
        let mut message = Self { head: HEAD, level_flag: LOW_LEVEL, ..Self::default() };
        for (&slot, motor) in slots.iter().zip(command) {
            let MotorCommand { q, dq, tau, kp, kd } = *motor;
            message.motor_cmd[slot] = MotorCmd { mode: SERVO, q, dq, tau, kp, kd, ..MotorCmd::default() };
        }
        message.sealed()
    }
}

impl StateMessage for hg::LowState {
    const TYPE: &str = "unitree_hg::msg::dds_::LowState_";

    fn reading(&self, slots: &PerMotor<usize>) -> Reading {
        let motors = self.motor_state.as_flattened();
        Reading {
            state: RobotState {
                q: slots.map(|slot| motors[slot].q),
                dq: slots.map(|slot| motors[slot].dq),
                torque: slots.map(|slot| motors[slot].tau_est),
                // Two sensors a motor; the hotter one counts.
                temperature: slots.map(|slot| motors[slot].temperature[0].max(motors[slot].temperature[1])),
                error: slots.map(|slot| motors[slot].motorstate),
                // These messages do not count lost packets.
                lost: slots.map(|_| 0),
                quaternion: self.imu_state.quaternion,
                gyroscope: self.imu_state.gyroscope,
                accelerometer: self.imu_state.accelerometer,
                battery: None,
                tick: self.tick,
                remote: remote(&self.wireless_remote),
            },
            seal: seal(self.crc, self.checksum()),
        }
    }

    fn machine(&self) -> u8 {
        self.mode_machine
    }
}

impl CommandMessage for hg::LowCmd {
    const TYPE: &str = "unitree_hg::msg::dds_::LowCmd_";

    fn for_motors(command: &Command, slots: &PerMotor<usize>, machine: u8) -> Self {
        let mut message = Self { mode_pr: hg::PITCH_ROLL, mode_machine: machine, ..Self::default() };
        for (&slot, motor) in slots.iter().zip(command) {
            let MotorCommand { q, dq, tau, kp, kd } = *motor;
            message.motor_cmd.as_flattened_mut()[slot] =
                hg::MotorCmd { mode: hg::ENABLED, q, dq, tau, kp, kd, reserve: 0 };
        }
        message.sealed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seal_is_right_wrong_or_absent() {
        let slots = PerMotor::from_fn(12, |motor| motor);
        let mut message = LowState { tick: 7, ..LowState::default() };
        assert_eq!(message.reading(&slots).seal, Seal::Absent);
        message = message.sealed();
        assert_eq!(message.reading(&slots).seal, Seal::Right);
        message.motor_state[3].q += 0.1;
        assert_eq!(message.reading(&slots).seal, Seal::Wrong);
    }

    #[test]
    fn a_battery_of_zeros_is_none() {
        let slots = PerMotor::from_fn(12, |motor| motor);
        let mut message = LowState::default();
        assert_eq!(message.reading(&slots).state.battery, None);
        message.power_v = 28.5;
        let battery = message.reading(&slots).state.battery;
        assert_eq!(battery, Some(Battery { charge: 0, volts: 28.5, amps: 0.0 }));
    }

    #[test]
    fn motors_are_read_from_and_written_to_their_slots_and_the_machine_is_repeated() {
        let slots = PerMotor::from([0, 34, 7]);
        let mut state = hg::LowState { mode_machine: 5, ..hg::LowState::default() };
        state.motor_state[4][6].q = 1.5;
        state.motor_state[1][0].temperature = [40, 90];
        state.motor_state[1][0].motorstate = 6;
        let read = state.sealed().reading(&slots);
        assert_eq!(
            (read.seal, read.state.q, read.state.battery),
            (Seal::Right, [0.0, 1.5, 0.0].into(), None)
        );
        assert_eq!(read.state.temperature, [0, 0, 90].into());
        assert_eq!((read.state.error, read.state.lost), ([0, 0, 6].into(), [0; 3].into()));
        let command = PerMotor::from_fn(3, |k| MotorCommand { q: k as f32, ..MotorCommand::default() });
        let message = hg::LowCmd::for_motors(&command, &slots, 5);
        let motors = message.motor_cmd.as_flattened();
        let enabled: Vec<usize> = (0..hg::SLOTS).filter(|&slot| motors[slot].mode == hg::ENABLED).collect();
        assert_eq!((enabled, motors[34].q, motors[7].q), (vec![0, 7, 34], 1.0, 2.0));
        assert_eq!((message.mode_pr, message.mode_machine, message.crc), (0, 5, message.checksum()));
    }
}
