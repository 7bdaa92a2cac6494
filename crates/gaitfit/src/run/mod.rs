//! The folder of a run: how it begins, what it depends on, and how its files are written.

mod folder;
pub mod inputs;
pub mod manifest;

pub use folder::{RunFolder, readable};
pub use inputs::Inputs;
