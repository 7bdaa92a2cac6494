//! Proximal policy optimisation: samples of a rollout in, better networks out.

mod adam;
pub mod bench;
mod diagnostics;
mod exploration;
mod gae;
mod learner;
mod loss;
mod minibatch;
mod recorder;
mod samples;
mod sequence;
mod settings;
mod shuffle;
mod state;
mod update;
mod worker;

#[cfg(test)]
mod gradient_test;
#[cfg(test)]
mod sequence_test;

pub use diagnostics::{Culprit, Diagnostics, UpdateError};
pub use exploration::Exploration;
pub use learner::{Learner, LearnerError};
pub use recorder::{End, Recorder};
pub use samples::{Samples, SamplesError, Widths};
pub use settings::{MemorySettings, Precision, Schedule, Settings, SettingsError};
pub use state::{Scalars, StateError};
