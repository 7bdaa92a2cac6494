//! Unitree's messages for single motors, as a Go2 speaks them.

mod layout;
mod message;
mod motors;
mod remote;
pub mod rpc;

pub use layout::{CMD_BYTES, STATE_BYTES};
pub use message::{
    BmsCmd, BmsState, HEAD, ImuState, LOW_LEVEL, LowCmd, LowState, MotorCmd, MotorState, SERVO, SLOTS,
};
pub use motors::{MOTOR_NAMES, MOTORS, motors_of};
pub use remote::Remote;
pub(crate) use remote::scaled;
