//! Policies as files: the project's own (safetensors), ONNX out and in, policies trained elsewhere, and what other programs
//! need to run a policy.
//!
//! The crate `gaitfit-policy` has the policies themselves and runs them. This crate computes little, so builds do not optimise it.
//!
//! Everything here reads untrusted files: sizes are bounded, nothing panics, and errors name the mismatch.

pub mod checksum;
pub mod deploy;
mod described;
mod description;
mod encoder;
mod file;
mod foreign;
mod layers;
mod messages;
mod motion;
mod normalised;
pub mod onnx;
mod read;
mod tensors;
mod torch;
pub mod weights;

pub use described::{Anchored, DescribedTerm, MemoryTensors, NormaliserTensors, PerJoint, ReferenceSource};
pub use description::Description;
pub use encoder::{EncoderTensors, Passes};
pub use read::{files_of, interface_of, read, unsealed};
