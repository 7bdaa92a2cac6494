//! Learning to walk: networks, PPO, tasks and policy files on the batched simulator.
//!
//! Everything is batched: arrays of rows, one row an environment (or an environment and step), row-major, never
//! an object an environment. Joints are in the order of [`Interface::joints`] and matched to a model by name.

mod checkpoint;
pub mod collect;
pub mod evaluate;
pub mod follow;
mod interface;
pub mod network;
mod player;
pub mod policy;
pub mod ppo;
mod rollout;
pub mod task;
mod tiles;
mod training;

pub use checkpoint::{CheckpointError, Origin};
pub use interface::{Interface, InterfaceError, Quantity, Term};
pub use player::Player;
pub use rollout::{Divergence, Runner, Tally};
pub use training::{Iteration, Training, TrainingError, TrainingSettings, widths};
