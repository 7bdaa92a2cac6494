//! Pictures of what gaitfit measured: the self-contained adaptation report.
//!
//! The crate knows nothing of simulators or optimisers. Callers fill in plain data ([`report::AdaptReport`]) and
//! get text back; writing it to disk is theirs.

mod charts;
mod format;
pub mod report;

pub use report::{AdaptReport, ReportError, render};
