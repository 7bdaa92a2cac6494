//! Run folders, the files that commands read and write, and progress.
//!
//! [`run::RunFolder`] is a folder that one process works in; [`run::Protocol`] is what every stage does there, from its
//! settings to its result. [`watch::Watch`] is the one callback for progress and cancelling. The crate knows nothing of fits,
//! trainings or devices.

mod brief;
mod error;
pub mod files;
pub mod machine;
pub mod policy_file;
pub mod run;
pub mod tensorboard;
pub mod watch;

pub use brief::{brief, short_numbers};
pub use error::{Access, Error, ErrorKind};
