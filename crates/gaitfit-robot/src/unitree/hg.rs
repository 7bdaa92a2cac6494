//! The messages `unitree_hg` `LowCmd_` and `LowState_` of the vendor's humanoids, field by field as the vendor's IDL has them
//! (unitree_sdk2_python, `idl/unitree_hg/msg/dds_`): all `@final`, without keys. The checksum is over the padded C struct, as
//! that of `unitree_go`.
//!
//! CDR arrays carry no length, so five rows of seven motors are the vendor's array of 35; serde knows arrays of up to 32.

use serde::{Deserialize, Serialize};

use super::ImuState;
use super::layout::{Memory, crc};

/// Motor slots of a message.
pub const SLOTS: usize = 35;
/// Bytes of a command as a C struct.
pub const CMD_BYTES: usize = 1004;
/// Bytes of a state as a C struct.
pub const STATE_BYTES: usize = 2092;
/// Ankles and waist are commanded as pitch and roll, not as the two motors that move them.
pub const PITCH_ROLL: u8 = 0;
/// Mode of a motor that follows its command.
pub const ENABLED: u8 = 1;

/// State of one motor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MotorState {
    /// Mode in force.
    pub mode: u8,
    /// Angle of the joint, rad.
    pub q: f32,
    /// Velocity of the joint, rad/s.
    pub dq: f32,
    /// Acceleration of the joint, rad/s².
    pub ddq: f32,
    /// Torque on the joint as the motor estimates it, N·m.
    pub tau_est: f32,
    /// Temperatures of shell and winding, °C.
    pub temperature: [i16; 2],
    /// Voltage, V.
    pub vol: f32,
    /// Sensors.
    pub sensor: [u32; 2],
    /// State.
    pub motorstate: u32,
    /// Unused here.
    pub reserve: [u32; 4],
}

/// The state that a robot publishes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LowState {
    /// Version.
    pub version: [u32; 2],
    /// Whether ankles and waist are commanded as pitch and roll or by motor; see [`PITCH_ROLL`].
    pub mode_pr: u8,
    /// Kind of the machine; a command must repeat it.
    pub mode_machine: u8,
    /// Counter of the main board, ms.
    pub tick: u32,
    /// The inertial unit.
    pub imu_state: ImuState<i16>,
    /// The motors.
    pub motor_state: [[MotorState; 7]; 5],
    /// The remote control's 40 bytes.
    pub wireless_remote: [[u8; 8]; 5],
    /// Unused here.
    pub reserve: [u32; 4],
    /// [`LowState::checksum`] as the sender found it.
    pub crc: u32,
}

/// Command to one motor: torque = kp (q − angle) + kd (dq − velocity) + tau, on the motor's own board.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MotorCmd {
    /// [`ENABLED`] for a motor that follows.
    pub mode: u8,
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
    /// Unused here.
    pub reserve: u32,
}

/// The command that a robot takes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LowCmd {
    /// [`PITCH_ROLL`].
    pub mode_pr: u8,
    /// [`LowState::mode_machine`].
    pub mode_machine: u8,
    /// The motors.
    pub motor_cmd: [[MotorCmd; 7]; 5],
    /// Unused here.
    pub reserve: [u32; 4],
    /// [`LowCmd::checksum`]; a robot drops commands whose checksum is another.
    pub crc: u32,
}

impl LowCmd {
    /// The vendor's C struct of this command, little-endian.
    pub fn layout(&self) -> [u8; CMD_BYTES] {
        let mut memory = Memory::new();
        memory.bytes(&[self.mode_pr, self.mode_machine]).align();
        for motor in self.motor_cmd.as_flattened() {
            // In C a float lies at a multiple of 4 bytes.
            memory.bytes(&[motor.mode]).align();
            memory.floats([motor.q, motor.dq, motor.tau, motor.kp, motor.kd]).words([motor.reserve]);
        }
        memory.words(self.reserve).words([self.crc]);
        memory.into_bytes()
    }

    /// Checksum over all of the layout but its last word, which is the checksum.
    pub fn checksum(&self) -> u32 {
        crc(&self.layout()[..CMD_BYTES - 4])
    }

    /// Returns the command with its checksum filled in.
    #[must_use]
    pub fn sealed(mut self) -> Self {
        self.crc = self.checksum();
        self
    }
}

impl LowState {
    /// The vendor's C struct of this state, little-endian.
    pub fn layout(&self) -> [u8; STATE_BYTES] {
        let mut memory = Memory::new();
        memory.words(self.version).bytes(&[self.mode_pr, self.mode_machine]).align().words([self.tick]);
        let imu = &self.imu_state;
        memory.floats(imu.quaternion).floats(imu.gyroscope).floats(imu.accelerometer).floats(imu.rpy);
        memory.bytes(&imu.temperature.to_le_bytes()).align();
        for motor in self.motor_state.as_flattened() {
            memory.bytes(&[motor.mode]).align();
            memory.floats([motor.q, motor.dq, motor.ddq, motor.tau_est]);
            // Two shorts fill a word, so no gap follows them.
            memory.shorts(motor.temperature.map(i16::cast_unsigned)).floats([motor.vol]);
            memory.words(motor.sensor).words([motor.motorstate]).words(motor.reserve);
        }
        memory.bytes(self.wireless_remote.as_flattened()).words(self.reserve).words([self.crc]);
        memory.into_bytes()
    }

    /// Checksum over all of the layout but its last word, which is the checksum.
    pub fn checksum(&self) -> u32 {
        crc(&self.layout()[..STATE_BYTES - 4])
    }

    /// Returns the state with its checksum filled in.
    #[must_use]
    pub fn sealed(mut self) -> Self {
        self.crc = self.checksum();
        self
    }
}
