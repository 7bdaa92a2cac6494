//! The folder of a run: how it begins, what it depends on, and how its files are written.

mod absent;
mod changes;
mod folder;
pub mod inputs;
pub mod manifest;
mod names;
mod owned;
pub mod protocol;

pub use changes::bound;
pub use folder::{RunFolder, latest_path};
pub use inputs::Inputs;
pub use owned::Owned;
pub use protocol::{Protocol, Whole};
