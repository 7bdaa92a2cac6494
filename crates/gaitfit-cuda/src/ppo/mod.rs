//! The update of PPO on a GPU, with the semantics of `gaitfit_learn::ppo`.
//!
//! [`Learner`] holds networks, optimiser and samples in the GPU's memory. Its update is one CUDA graph: checks,
//! advantages, the deal of the samples (the CPU's draws, so the same minibatches), all gradient steps, statistics of
//! observations. Only a few scalars cross the bus. A learner of the CPU goes in ([`Learner::new`]) and out
//! ([`Learner::store`]) without loss, so a training can continue on the other side.
//!
//! The same update on the same GPU gives the same bits every time. It differs from the CPU's by rounding.

mod error;
mod flat;
mod foresee;
mod launch;
mod layout;
mod learner;
mod plan;
mod prepared;
mod report;
mod storage;
mod text;
mod together;

pub use error::PpoError;
pub use flat::Flat;
pub use gaitfit_learn::ppo::Precision;
pub use launch::{Array, Batch, Exchange, Id, Kind, Launch, Share, Value};
pub use layout::TooWide;
pub use learner::Learner;
pub(crate) use learner::NO_EXPLORATION;
pub use plan::Plan;
pub use prepared::{Limits, Prepared};
pub(crate) use storage::{Storage, Stored};
pub use together::{run_together, update_together};
