//! The messages `unitree_go` `LowCmd_` and `LowState_`, field by field as the vendor's IDL has them (unitree_sdk2_python,
//! `idl/unitree_go/msg/dds_`): all `@final`, without keys.
//!
//! Serialised by serde in this order they are the messages' plain CDR. CDR arrays carry no length, so a nested array of
//! 5 × 8 bytes is the vendor's array of 40; serde knows arrays of up to 32.

use serde::{Deserialize, Serialize};

/// Motor slots of a message; a Go2 uses the first twelve.
pub const SLOTS: usize = 20;

/// Bytes 0 and 1 of a command.
pub const HEAD: [u8; 2] = [0xFE, 0xEF];
/// A command for single motors, not for the robot's own walking.
pub const LOW_LEVEL: u8 = 0xFF;
/// Mode of a motor that follows its command.
pub const SERVO: u8 = 1;

/// Readings of the inertial unit. `C`: the number that a family of messages has for temperatures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ImuState<C> {
    /// Orientation of the base in the world, wxyz, unit.
    pub quaternion: [f32; 4],
    /// Angular velocity, rad/s, body frame.
    pub gyroscope: [f32; 3],
    /// Proper acceleration, m/s², body frame.
    pub accelerometer: [f32; 3],
    /// Roll, pitch, yaw, rad.
    pub rpy: [f32; 3],
    /// °C.
    pub temperature: C,
}

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
    /// Raw angle, rad.
    pub q_raw: f32,
    /// Raw velocity, rad/s.
    pub dq_raw: f32,
    /// Raw acceleration, rad/s².
    pub ddq_raw: f32,
    /// °C.
    pub temperature: u8,
    /// Packets lost between main board and motor.
    pub lost: u32,
    /// Unused here.
    pub reserve: [u32; 2],
}

/// State of the battery.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BmsState {
    /// Version.
    pub version_high: u8,
    /// Version.
    pub version_low: u8,
    /// State.
    pub status: u8,
    /// Charge, %.
    pub soc: u8,
    /// Current, mA.
    pub current: i32,
    /// Charging cycles.
    pub cycle: u16,
    /// Cell temperatures, °C.
    pub bq_ntc: [u8; 2],
    /// Board temperatures, °C.
    pub mcu_ntc: [u8; 2],
    /// Cell voltages, mV.
    pub cell_vol: [u16; 15],
}

/// The state that a robot publishes on `rt/lowstate`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LowState {
    /// Message head.
    pub head: [u8; 2],
    /// Level of control in force.
    pub level_flag: u8,
    /// Unused here.
    pub frame_reserve: u8,
    /// Serial number.
    pub sn: [u32; 2],
    /// Version.
    pub version: [u32; 2],
    /// Unused here.
    pub bandwidth: u16,
    /// The inertial unit.
    pub imu_state: ImuState<u8>,
    /// The motors.
    pub motor_state: [MotorState; SLOTS],
    /// The battery.
    pub bms_state: BmsState,
    /// Foot forces, raw: FR, FL, RR, RL.
    pub foot_force: [i16; 4],
    /// Estimated foot forces.
    pub foot_force_est: [i16; 4],
    /// Counter of the main board, ms.
    pub tick: u32,
    /// The remote control's 40 bytes.
    pub wireless_remote: [[u8; 8]; 5],
    /// Flags.
    pub bit_flag: u8,
    /// Voltage of the motors' converter.
    pub adc_reel: f32,
    /// °C.
    pub temperature_ntc1: u8,
    /// °C.
    pub temperature_ntc2: u8,
    /// Supply voltage, V.
    pub power_v: f32,
    /// Supply current, A.
    pub power_a: f32,
    /// Fan speeds.
    pub fan_frequency: [u16; 4],
    /// Unused here.
    pub reserve: u32,
    /// [`LowState::checksum`] as the sender found it.
    pub crc: u32,
}

/// Command to one motor: torque = kp (q − angle) + kd (dq − velocity) + tau, on the motor's own board.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MotorCmd {
    /// [`SERVO`] for a motor that follows.
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
    pub reserve: [u32; 3],
}

/// Command to the battery.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BmsCmd {
    /// Switches off.
    pub off: u8,
    /// Unused here.
    pub reserve: [u8; 3],
}

/// The command that a robot takes on `rt/lowcmd`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LowCmd {
    /// [`HEAD`].
    pub head: [u8; 2],
    /// [`LOW_LEVEL`].
    pub level_flag: u8,
    /// Unused here.
    pub frame_reserve: u8,
    /// Serial number.
    pub sn: [u32; 2],
    /// Version.
    pub version: [u32; 2],
    /// Unused here.
    pub bandwidth: u16,
    /// The motors.
    pub motor_cmd: [MotorCmd; SLOTS],
    /// The battery.
    pub bms_cmd: BmsCmd,
    /// Unused here.
    pub wireless_remote: [[u8; 8]; 5],
    /// Lights.
    pub led: [u8; 12],
    /// Fans.
    pub fan: [u8; 2],
    /// Unused here.
    pub gpio: u8,
    /// Unused here.
    pub reserve: u32,
    /// [`LowCmd::checksum`]; a robot drops commands whose checksum is another.
    pub crc: u32,
}
