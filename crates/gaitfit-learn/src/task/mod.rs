//! Tasks: what the robot is asked to do and what it is paid for.
//!
//! A task is data ([`TaskSettings`]) and a table of small reward functions ([`reward::TERMS`]). A [`Scene`] is a
//! task on a robot; an [`Environment`] is one tile of its robots, stepped as a batch.

mod command;
mod environment;
mod fall;
mod feet;
mod moment;
mod noise;
mod observation;
mod presets;
mod randomise;
pub mod reward;
mod scene;
mod settings;
mod start;

pub use environment::{Ended, Environment, Saved};
pub(crate) use fall::fallen;
pub use feet::Foot;
pub use moment::{Moment, heading_velocity};
pub(crate) use noise::Noise;
pub(crate) use observation::{Context, observe};
pub use presets::preset;
pub use scene::{Scene, SceneError};
pub use settings::*;
pub use start::start_from_joints;
