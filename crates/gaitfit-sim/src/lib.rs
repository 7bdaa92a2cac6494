//! Many robots at once: blocks of lanes, threads, PD control, and candidates whose parameters differ.

mod batch;
mod candidate;
mod error;
mod motion;
mod replay;
mod robots;

pub mod bench;
pub mod pool;
pub mod stats;

pub use batch::{Batch, BatchOptions, Tile};
pub use candidate::{Candidate, JointNetworks, NetworkKind};
pub use error::SimError;
pub use motion::{Motion, Start};
pub use replay::{JointSignals, Recording, Replay, ReplayOptions};
