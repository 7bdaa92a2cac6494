//! Multilayer perceptrons with hand-derived gradients, on flat parameters and rows.

mod activation;
mod forward;
mod lanes;
mod matmul;
#[allow(clippy::module_inception, reason = "the file is the network")]
mod network;
mod normaliser;
mod scalar;
mod shape;
mod tape;
mod weights;

pub(crate) use lanes::{add as add_slices, descend};
pub(crate) use normaliser::normalise_row;
pub(crate) use scalar::Scalar;
pub(crate) use shape::MOST_PARAMETERS;
pub(crate) use tape::Tape;
pub(crate) use weights::Weights;

pub use activation::Activation;
pub use network::{Network, Scratch};
pub use normaliser::Normaliser;
pub use shape::{Layer, Shape, ShapeError};
