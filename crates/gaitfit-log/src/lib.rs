//! Robot logs: the trajectory type, the CSV reader and writer, and the checks.
//!
//! ```no_run
//! use gaitfit_log::{CheckSpec, ReadOptions, check, read_csv, summary};
//!
//! let log = read_csv("run_0.csv".as_ref(), &ReadOptions::default())?;
//! println!("{} samples at {} Hz", log.len(), summary(&log).rate_hz);
//! for finding in check(&log, &CheckSpec::default()) {
//!     println!("{finding}");
//! }
//! # Ok::<(), gaitfit_log::LogError>(())
//! ```

mod assemble;
mod check;
mod columns;
mod error;
mod lines;
mod metadata;
mod ops;
mod read;
mod summary;
mod trajectory;
mod write;

pub use check::{CheckSpec, Finding, FindingKind, Severity, Span, check};
pub use error::LogError;
pub use metadata::PerJoint;
pub use ops::Signal;
pub use read::{IgnoredColumn, ReadOptions, ReadReport, read_csv, read_csv_report};
pub use summary::{JointSummary, LogSummary, SignalSummary, summary, summary_with_report};
pub use trajectory::*;
pub use write::write_csv;
