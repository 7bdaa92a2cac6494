//! gaitfit's computations on NVIDIA GPUs.
//!
//! Nothing of CUDA is needed to build this crate. [`runtime`] finds the driver and the compiler when the program runs,
//! and holds all of this crate's `unsafe`. [`emit`] writes the physics step as CUDA text, [`physics`] runs it on batches
//! of environments. [`rollout`] is the rest of a training's step, and whole trainings; [`ppo`] the update of the policy, [`costs`] what the
//! costs of a fit are made of, [`fit`] the candidates of a fit on all its logs. [`networks`] runs policies of all kinds.

pub mod costs;
pub mod emit;
pub mod fit;
pub mod networks;
pub mod physics;
pub mod ppo;
mod reference;
pub mod rollout;
pub mod runtime;
mod spots;
mod traced;
mod walker;
mod words;
