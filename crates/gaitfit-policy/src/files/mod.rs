//! Policies as files: the project's own (safetensors), ONNX out and in, and policies trained elsewhere.
//!
//! Everything here reads untrusted files: sizes are bounded, nothing panics, and errors name the mismatch.

mod description;
mod foreign;
mod layers;
pub mod onnx;
mod read;
mod tensors;
mod torch;
pub mod weights;

pub use description::{
    DescribedTerm, Description, EncoderTensors, MemoryTensors, NormaliserTensors, Passes, PerJoint,
};
pub use read::{files_of, read};
