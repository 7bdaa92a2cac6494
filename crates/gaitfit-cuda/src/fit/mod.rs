//! The candidates of a fit on all its logs, on a GPU: what `gaitfit_policy::follow` and the replay of `gaitfit-sim` do.
//!
//! A control step of all candidates on all recordings is two kernels: one records the signals, notices falls, resets, and
//! chooses actions and targets; the other is the physics ([`crate::physics`]). All steps are one CUDA graph. The signals
//! stay in the GPU's memory, where [`crate::costs`] compares them with the robot's. Torque noise has the CPU's draws.
//!
//! [`Candidates`] simulates; [`Plan`] is what it runs, as data, which a test also runs on the CPU. [`MultiGpu`] shares
//! candidates among several GPUs of one host.

mod candidates;
mod error;
mod follow;
mod multi_gpu;
mod numbers;
mod plan;
mod predictions;
mod scene;
mod session;
mod shares;
mod tables;
mod text;
mod tracks;

pub use candidates::{Candidates, Compared, Measured, Parts};
pub use error::FitError;
pub use follow::follow;
pub use multi_gpu::MultiGpu;
pub use numbers::{Begin, Numbers, PredictionInput};
pub use plan::{Plan, Sizes};
pub use predictions::Predictions;
pub use scene::{Scene, Structure, Subject};
pub use tables::Tables;
pub use tracks::Tracks;
