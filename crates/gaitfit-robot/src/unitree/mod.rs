//! Unitree's messages for single motors: `unitree_go` as quadrupeds speak it, [`hg`] as humanoids do.

mod family;
pub mod hg;
mod layout;
mod message;
pub mod rpc;

pub use crate::remote::Remote;
pub use family::{CommandMessage, StateMessage};
pub use layout::{CMD_BYTES, STATE_BYTES};
pub use message::{
    BmsCmd, BmsState, HEAD, ImuState, LOW_LEVEL, LowCmd, LowState, MotorCmd, MotorState, SERVO, SLOTS,
};
