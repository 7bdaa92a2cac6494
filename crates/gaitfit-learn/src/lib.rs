//! Learning to walk: PPO, tasks, training and evaluation on the batched simulator.
//!
//! Everything is batched: arrays of rows, one row an environment (or an environment and step), row-major, never
//! an object an environment. Joints are in the order of [`gaitfit_policy::Interface::joints`] and matched to a model by name.

mod checkpoint;
pub mod collect;
mod curriculum;
pub mod evaluate;
mod exchange;
mod player;
pub mod ppo;
mod rollout;
mod subject;
pub mod task;
mod tiles;
mod training;

pub use checkpoint::{CheckpointError, Origin};
pub use curriculum::{Commands, Growth};
pub use player::Player;
pub use rollout::{Divergence, Runner, Tally};
pub use training::{
    Iteration, MEND_DIVERGENCE, Training, TrainingError, TrainingSettings, max_diverged, widths,
};
