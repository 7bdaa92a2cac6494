//! Multilayer perceptrons and recurrent layers with hand-derived gradients, on flat parameters and rows.

mod activation;
mod cell;
pub(crate) mod erfc;
mod forward;
mod lanes;
mod layer_norm;
mod matmul;
#[allow(clippy::module_inception, reason = "the file is the network")]
mod network;
mod normaliser;
mod recurrent;
mod recurrent_shape;
mod scalar;
mod sequence;
mod shape;
mod tape;
mod weights;

pub use activation::{Activation, SELU};
pub use cell::Cell;
pub(crate) use lanes::activate_all;
pub use lanes::{add as add_slices, descend};
pub use layer_norm::LayerNorm;
pub(crate) use matmul::{Matrix, multiply};
pub use network::{Network, Scratch};
pub use normaliser::{Normaliser, normalise_row};
pub use recurrent::{Memory, Recurrent, RecurrentLayer};
pub use recurrent_shape::{Part, RecurrentShape, RecurrentSpan};
pub use scalar::Scalar;
pub use sequence::{RecurrentWeights, SequenceTape, Sequences};
pub use shape::{Layer, MAX_PARAMETERS, Shape, ShapeError};
pub use tape::Tape;
pub use weights::Weights;
