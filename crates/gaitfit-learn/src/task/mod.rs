//! Tasks: what the robot is asked to do and what it is paid for.
//!
//! A task is data ([`TaskSettings`]), a table of reward terms ([`reward::TERMS`]) and the user's own, which are expressions
//! ([`expression`]). A [`Task`] is
//! both on a robot; an [`Environment`] is one tile of its robots, stepped as a batch.

mod bounds;
mod check;
mod command;
mod environment;
mod error;
pub mod expression;
mod feet;
mod joint_number;
mod judge;
mod moment;
mod observe;
mod presets;
mod randomise;
pub mod reward;
mod saved;
mod sensor_noise;
mod settings;
mod snapshot;
mod start;
#[allow(clippy::module_inception, reason = "the file is the task")]
mod task;
mod terrain;
mod user_terms;

pub use command::commands;
pub use environment::Environment;
pub use error::TaskError;
pub use feet::{Foot, advanced as advanced_foot};
pub use joint_number::JointNumber;
pub use judge::{Ended, FASTEST_BASE, FASTEST_JOINT};
pub use moment::{BaseMoment, Moment};
pub use presets::preset;
pub use saved::Saved;
pub use settings::*;
pub use snapshot::Snapshot;
pub use task::Task;
pub use terrain::{Cell, Course, Kinds, TerrainKind, TerrainSettings};
pub use user_terms::UserTerms;
