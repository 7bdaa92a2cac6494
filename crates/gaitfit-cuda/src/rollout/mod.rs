//! Rollouts and whole trainings on a GPU.
//!
//! A control step of all environments is five kernels: observations with noise, the networks
//! ([`crate::ppo::Learner::foresee`]), exploration with targets and pushes, the physics ([`crate::physics`]), and the rest:
//! feet, rewards, ends of episodes, new commands, new episodes. The kernels' text is written for one task on one robot.
//! All draws are those of the CPU's environment, by seed, environment and step: the same seed gives the same commands,
//! starts and robots. Reward terms that are expressions are written into the text. A rollout is one CUDA graph, and its samples lie where the update reads them.
//!
//! [`Stepper`] steps environments one control period at a time, under actions from outside. [`Trainer`] takes over a training of the CPU ([`gaitfit_learn::Training`]) and gives it back, at any iteration.

mod collect;
mod error;
mod expression;
mod ground;
mod packed;
mod plan;
mod play;
mod run;
mod scene;
mod shared;
mod stepper;
mod sums;
mod text;
mod trainer;
mod trials;

pub use collect::collect;
pub use error::RolloutError;
pub(crate) use ground::GROUND_HEIGHTS;
pub use packed::{Packed, imu_rows};
pub use plan::{Home, Plan, control};
pub use run::Rollout;
pub use scene::{Mode, Scene, Sizes, check};
pub use shared::Shared;
pub use stepper::{Moved, Shown, Stepped, Stepper, before_rows};
pub use trainer::{Breakdown, Trainer};
pub use trials::{crossings, drift, run_trials};
