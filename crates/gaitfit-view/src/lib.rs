//! Pictures of what gaitfit measured: the self-contained adaptation report.
//!
//! The crate knows nothing of simulators or optimisers. Callers fill in plain data ([`report::AdaptReport`]) and
//! get text back; writing it to disk is theirs.

mod charts;
mod format;
mod log_picture;
pub mod report;

pub use log_picture::{log_picture_svg, log_picture_text};
pub use report::{AdaptReport, ReportError, render};
