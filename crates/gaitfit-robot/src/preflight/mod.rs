//! Checks of a robot that hangs, before its first walk.
//!
//! 1. [`listen`] records its states and sends nothing; [`Listened`] examines them.
//! 2. [`Tilting`] follows a person who tilts the robot by hand: axes and signs of the inertial unit.
//! 3. [`Flight`] moves each joint alone, then all together, through the guard of a run; [`Moved`] is the result.
//!
//! Each fault is a [`Finding`]. Only [`Beat`] reads a clock; all other code gets the time from its caller.

mod delays;
mod finding;
mod flight;
mod gain;
mod gravity;
mod imu;
mod joints;
mod live;
mod log;
mod motion;
mod network;
mod plan;
mod response;
mod statistics;
mod stopped;
mod tilt;
mod tilting;
mod turned;

use std::time::Duration;

use crate::state::{RobotState, Seal};

pub use finding::{Check, Finding, Severity, passed};
pub use flight::{Flight, Flown, Sent};
pub use imu::ImuReport;
pub use joints::JointReport;
pub use live::{Beat, Listened, Turns, fly, listen, tilt};
pub use log::{SampledStates, listening_csv, motion_csv, sampled};
pub use motion::{JointMotion, Moved, moved};
pub use network::{ClockReport, NetworkReport};
pub use plan::{Plan, Stage};
pub use statistics::Measured;
pub use tilt::{Motion as TiltMotion, TiltReport, Tilted, tilted};
pub use tilting::{Asked, Tilting};

/// A message of the robot, with the time at which it came.
#[derive(Clone, Copy, Debug)]
pub struct Heard {
    /// Since the recording began.
    pub came: Duration,
    /// The state in it.
    pub state: RobotState,
    /// Whether it arrived as it was sent.
    pub seal: Seal,
}
