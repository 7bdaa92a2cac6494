//! What reading a log left out, changed or noticed.

use crate::{ConvertedTime, EvenRows, Finding, FindingKind};
use serde::Serialize;
use std::path::PathBuf;

/// A column that the reader left out.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct IgnoredColumn {
    /// Its number in the file, from 1.
    pub column: usize,
    /// Its name.
    pub name: String,
    /// Why.
    pub reason: String,
}

/// Columns and rows that reading left out or changed, and sources of what is stated.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ReadReport {
    /// Columns left out, in file order.
    pub ignored: Vec<IgnoredColumn>,
    /// Keys of header comments that mean nothing here.
    pub unknown_keys: Vec<String>,
    /// Sidecar files used.
    pub sidecars: Vec<PathBuf>,
    /// Where the gains were stated.
    pub gains_from: Option<String>,
    /// Where the sample rate was stated; absent: measured from `time`.
    pub rate_from: Option<String>,
    /// The time column's unit, where it was not seconds. The trajectory has seconds.
    pub converted_time: Option<ConvertedTime>,
    /// Rows that were spaced evenly, because the time column had lost its digits. The trajectory has the even times.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub even_rows: Option<EvenRows>,
    /// Findings of the reader: columns that it changed or could not use.
    #[serde(skip)]
    pub noticed: Vec<Finding>,
    /// Whether roll, pitch and yaw were in degrees. The trajectory's orientation is made of them as such.
    pub angles_in_degrees: bool,
    /// Findings that the log's own settings allow.
    pub allowed: Vec<FindingKind>,
    /// The first cell without a number among those of an inertial unit that has numbers elsewhere.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub imu_hole: Option<Hole>,
}

/// A cell without a number.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Hole {
    /// The row's line, from 1.
    pub line: u64,
    /// The cell's column, from 1.
    pub column: usize,
    /// The column's name.
    pub name: String,
}
