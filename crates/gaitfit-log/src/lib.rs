//! Robot logs: the trajectory type, the CSV reader and writer, and the checks.

mod columns;
mod error;
mod metadata;
mod ops;
mod read;
mod trajectory;
mod write;

pub use error::LogError;
pub use metadata::PerJoint;
pub use ops::Signal;
pub use read::{IgnoredColumn, ReadOptions, ReadReport, read_csv, read_csv_report};
pub use trajectory::*;
pub use write::write_csv;
