//! A policy's networks at work on a GPU, without learning: in the fits' walks, and as [`Actor`] in evaluations.
//!
//! The kernels know perceptrons with all activations, layer norms and functions of the output, GRU and LSTM layers, and the
//! encoders of two-part policies. Sums and functions are rounded as the CPU does it.

mod actor;
mod blocks;
#[allow(clippy::module_inception, reason = "it holds the type of that name")]
mod networks;

pub use actor::{Actor, ActorError, ActorPlan};
pub(crate) use blocks::Blocks;
pub(crate) use networks::{Networks, unknown_policy};
