//! Many robots at once: blocks of lanes, threads, PD control, and candidates whose parameters differ.

mod batch;
mod candidate;
mod error;
mod motion;
mod replay;
mod sensors;
mod tile;

pub mod bench;
pub mod engine;
pub mod stats;

pub use batch::{Batch, BatchOptions, MAX_SUBSTEPS};
pub use candidate::{Candidate, JointNetworks, NetworkKind, modifications};
pub use engine::{Cpu, Engine};
pub use error::SimError;
pub use gaitfit_pool as pool;
pub use motion::{Motion, Start};
pub use replay::{Direction, JointSignals, Recording, Replay, ReplayOptions};
pub use sensors::{IMU_NUMBERS, Imu, Sensors};
pub use tile::{RobotState, Robots, Tile};
