//! Many robots at once: blocks of lanes, threads, PD control, and candidates whose parameters differ.

mod error;
mod pool;
mod replay;
mod robot;

pub mod bench;

pub use error::SimError;
pub use replay::{JointSignals, Recording, Replay, ReplayOptions};
pub use robot::RobotParams;
