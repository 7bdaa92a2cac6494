//! Multilayer perceptrons with hand-derived gradients, on flat parameters and rows.

mod activation;
mod forward;
mod lanes;
mod layer_norm;
mod matmul;
#[allow(clippy::module_inception, reason = "the file is the network")]
mod network;
mod normaliser;
mod recurrent;
mod scalar;
mod shape;
mod tape;
mod weights;

pub use activation::Activation;
pub(crate) use activation::SELU;
pub(crate) use lanes::activate_all;
pub use lanes::{add as add_slices, descend};
pub use layer_norm::LayerNorm;
pub(crate) use matmul::{Matrix, multiply};
pub use network::{Network, Scratch};
pub use normaliser::{Normaliser, normalise_row};
pub use recurrent::{Cell, Memory, Recurrent, RecurrentLayer};
pub use scalar::Scalar;
pub use shape::{Layer, MAX_PARAMETERS, Shape, ShapeError};
pub use tape::Tape;
pub use weights::Weights;
