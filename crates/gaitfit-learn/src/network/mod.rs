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

pub use activation::Activation;
pub use network::{Network, Scratch};
pub use normaliser::Normaliser;
pub use shape::{Layer, Shape, ShapeError};
