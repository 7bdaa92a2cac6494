//! Multilayer perceptrons with hand-derived gradients, on flat parameters and rows.

mod activation;
mod aligned;
mod dense;
mod dispatch;
mod lanes;
#[allow(clippy::module_inception, reason = "the file is the network")]
mod network;
mod normaliser;
mod panels;
mod scalar;
mod shape;
mod tape;

pub(crate) use aligned::Aligned;
pub(crate) use dispatch::stride;
pub(crate) use lanes::{add as add_slices, descend};
pub(crate) use normaliser::normalise_row;
pub(crate) use panels::Weights;
pub(crate) use scalar::Scalar;
pub(crate) use tape::Tape;

pub use activation::Activation;
pub use network::{Network, Prepared, Scratch};
pub use normaliser::Normaliser;
pub use shape::{Layer, Shape, ShapeError};
