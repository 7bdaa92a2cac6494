//! Logs of a clamped robot, whose legs are in the air: reading them, and replaying their targets in the simulator.

pub mod choices;
mod clamped;
pub mod logs;
pub mod predictors;

pub use clamped::Clamped;
