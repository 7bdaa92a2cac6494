//! Python pickles, read without running anything.
//!
//! A pickle is a program for a stack machine ([`machine`]) that may call any Python function. This reader runs the machine
//! with values that are plain data. The few constructors that logs need (NumPy arrays and numbers, PyTorch tensors, ordered
//! dictionaries) are written here ([`construct`]); every other one is refused by name. Nothing is imported or called.

mod construct;
mod error;
mod machine;
mod node;
mod numbers;

pub use error::PickleError;
pub(crate) use machine::read;
pub(crate) use node::{Node, Pickle};
pub(crate) use numbers::arrays;
