//! Logs of robots from other programs' files, and as such a file ([`mcap_bytes`]).
//!
//! [`import`] reads what a robot's recorders write and gives a [`Trajectory`]. Files are recognised by their content:
//!
//! | kind | what is read |
//! | --- | --- |
//! | MCAP; ROS 2 bags (`.mcap`, `.db3`, folders of them) | `sensor_msgs/JointState`, `Imu`; Unitree `LowState`, `LowCmd`; `control_msgs` controller and joint states; `trajectory_msgs`; `geometry_msgs/Twist` as commands. Messages are decoded by the definitions in the file; types of one's own with the same fields are read too |
//! | npz, npy | named arrays, one row a sample |
//! | Parquet, Arrow (Feather, IPC files and streams); with the feature `all-formats` | columns of numbers, as of a CSV file; columns of lists as arrays |
//! | HDF5; with the feature `all-formats` | datasets of numbers as arrays, named by their paths |
//! | PyTorch (`.pt`) | dictionaries of tensors, such as PACE's recordings |
//! | pickle (`.pkl`) | dictionaries of arrays, lists of dictionaries; walk-these-ways' deployment logs. Nothing in a pickle is run |
//! | CSV | PlotJuggler's and any other, by known names or a [`Mapping`] |
//!
//! Streams at different rates are joined by time. What was assumed is in the [`ImportReport`].
//!
//! Files are not trusted: sizes are bounded by [`Options`], and no input makes the readers panic.
//!
//! ```no_run
//! use gaitfit_import::{Options, import};
//!
//! let imported = import(&["recording.mcap"], &Options::default())?;
//! println!("{} samples at {} Hz", imported.trajectory.len(), imported.trajectory.rate_hz);
//! for line in &imported.report.assumed {
//!     println!("assumed: {line}");
//! }
//! # Ok::<(), gaitfit_import::ImportError>(())
//! ```

mod archive_error;
mod arrays;
#[cfg(feature = "all-formats")]
mod arrow;
mod assemble;
mod bag;
mod budget;
mod budget_error;
mod clock;
#[cfg(feature = "all-formats")]
mod columnar;
mod columnar_error;
mod db3;
mod dtype;
mod error;
#[cfg(feature = "all-formats")]
mod hdf5;
mod join;
mod kind;
mod known;
mod lead;
mod mapping;
mod mcap;
mod mcap_error;
mod mcap_write;
mod npz;
mod observation;
mod open;
#[cfg(feature = "all-formats")]
mod parquet;
mod pickle;
mod problem;
mod resolve;
mod ros;
mod sqlite;
mod sqlite_error;
mod table;
mod table_error;
mod text;
mod torch;
mod used;
mod walk_these_ways;
mod zeros;

pub use archive_error::{ArchiveError, ArrayProblem};
pub use bag::Bag;
pub use budget_error::{BudgetError, UnpackError};
pub use clock::{ClockFinding, StreamReport};
pub use columnar_error::ColumnarError;
pub use error::ImportError;
pub use mapping::{
    AngleUnit, ColumnNames, MAX_MAPPING_BYTES, Mapping, Names, ObservedNumber, StreamNames, TimeColumn,
    UnitName,
};
pub use mcap_error::McapError;
pub use mcap_write::{LiveMcap, McapHead, McapLog, McapRow, McapState, mcap_bytes};
pub use pickle::PickleError;
pub use problem::Problem;
pub use ros::{MessageError, is_known, known_types};
pub use sqlite_error::SqliteError;
pub use table_error::TableError;

use gaitfit_log::{Finding, Lead, Trajectory};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// What the caller knows, and how much an import may take.
#[derive(Clone, Debug)]
pub struct Options {
    /// Statements about the files that they lack themselves.
    pub mapping: Mapping,
    /// Largest file, bytes; packed data may become four times as large.
    pub max_bytes: u64,
    /// Max count of numbers kept, of 8 bytes.
    pub max_values: usize,
}

impl Default for Options {
    fn default() -> Self {
        Options { mapping: Mapping::default(), max_bytes: 1 << 30, max_values: 100_000_000 }
    }
}

/// A log and how it came to be.
#[derive(Clone, Debug, PartialEq)]
pub struct Imported {
    /// The log. Its time begins at 0.
    pub trajectory: Trajectory,
    /// Report of what was read, assumed and left out.
    pub report: ImportReport,
}

/// Report of what was read, assumed and left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ImportReport {
    /// The files and their kinds.
    pub files: Vec<(PathBuf, &'static str)>,
    /// The streams that were joined.
    pub streams: Vec<StreamReport>,
    /// Assumptions, in sentences.
    pub assumed: Vec<String>,
    /// What was left out, with the reason.
    pub left_out: Vec<String>,
    /// How long after the row that it answers a target, or an action, was stamped.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lead: Option<Lead>,
    /// What the recording shows and the log does not, as the log's checks would put it.
    #[serde(skip)]
    pub noticed: Vec<Finding>,
    /// Samples of the joints left out before the first and after the last of the other streams.
    pub dropped: [usize; 2],
}

/// Reads one recording: a file, a ROS 2 bag's folder, or several files that were recorded together by one clock.
///
/// # Errors
/// [`ImportError`]: files that cannot be read or are of no known kind, joints without positions or names, clocks that
/// cannot be joined.
pub fn import<P: AsRef<Path>>(paths: &[P], options: &Options) -> Result<Imported, ImportError> {
    let mapping = &options.mapping;
    let mut report = ImportReport::default();
    let mut sources = Vec::new();
    for path in paths {
        let path = path.as_ref();
        let mut source = open::source(path, options)?;
        report.files.push((path.to_owned(), source.kind));
        // Names, joints and units are settled file by file; only then can files be compared.
        resolve::rename(&mut source, mapping)?;
        resolve::name_joints(&mut source, mapping)?;
        resolve::convert(&mut source, mapping)?;
        sources.push(source);
    }
    used::all_taken(&sources, mapping)?;
    report.left_out.extend(used::all_used(&sources, mapping)?);
    // A slide in degrees would be wrong by a factor of 57.
    if mapping.unit == AngleUnit::Degrees {
        report.assumed.extend(match mapping.slides.as_deref() {
            None => Some("all joints are hinges, in degrees; with --robot its slides stay in m".to_owned()),
            Some([]) => None,
            Some(slides) => Some(format!("slides are in m, not in degrees: {}", slides.join(", "))),
        });
    }
    // The rate is stated for all rows, and its reader took some of a log of gaitfit's own.
    let thinned = sources.iter().all(|source| source.thinned);
    let every = mapping.every.filter(|_| thinned).unwrap_or(1) as f64;
    let mapping = &Mapping { rate_hz: mapping.rate_hz.map(|rate| rate / every), ..mapping.clone() };
    // Files that say when they were recorded are put on one axis of time.
    let first = sources.first().map_or(0, |source| source.origin_ns);
    let mut tables = Vec::new();
    let mut shifted = 0;
    for source in &mut sources {
        let rate_hz = mapping.rate_hz.or(source.stated.rate_hz.map(|rate| rate / every));
        let later = source.origin_ns.saturating_sub(first) as f64 / 1e9;
        for mut table in std::mem::take(&mut source.tables) {
            // Without a date on both sides the times stay as they are.
            if source.origin_ns != 0 && first != 0 && later != 0.0 {
                table.time.iter_mut().for_each(|time| *time += later);
            }
            // The positions' clock is the log's, so an asked offset moves all others.
            let is_state = table.columns.keys().any(|name| name.starts_with("q_"));
            if let Some(offset) = mapping.clock_offset_s.filter(|_| !is_state) {
                table.time.iter_mut().for_each(|time| *time += offset);
                shifted += 1;
                report.assumed.push(format!("{}: its times are {offset} s later, as asked", table.name));
            }
            zeros::of_second_publisher(&mut table, mapping, &mut report.assumed)?;
            report.streams.push(clock::clean(&mut table, rate_hz)?);
            tables.push(table);
        }
        report.assumed.append(&mut source.assumed);
        report.left_out.append(&mut source.left_out);
        report.noticed.append(&mut source.noticed);
    }
    let has_positions = |table: &table::Table| table.columns.keys().any(|name| name.starts_with("q_"));
    // An offset without a stream to move would be taken for applied.
    if mapping.clock_offset_s.is_some() && shifted == 0 && tables.iter().any(has_positions) {
        return Err(ImportError::NothingToShift);
    }
    // An observation that nobody unpacked may hold the missing positions.
    let observed = report.left_out.iter().find(|line| line.contains(observation::UNPACK));
    let mut joined = join::join(tables).map_err(|error| match (error, observed) {
        (ImportError::NoPositions { found }, Some(observed)) => {
            ImportError::NoPositions { found: format!("{found}; {observed}") }
        }
        (error, _) => error,
    })?;
    report.assumed.append(&mut joined.assumed);
    report.dropped = joined.dropped;
    // Files that state a lead have their targets in the right rows already.
    joined.lead = joined.lead.or_else(|| sources.iter().find_map(|source| source.lead));
    report.lead = joined.lead;
    let (assumed, left_out) = (&mut report.assumed, &mut report.left_out);
    let noticed = &mut report.noticed;
    let mut trajectory = assemble::trajectory(joined, &sources, mapping, assumed, left_out, noticed)?;
    gaitfit_log::allow(noticed, &mapping.allow);
    // Thinned last: leads and clocks are measured on all rows.
    if let Some(every) = mapping.every.filter(|_| !thinned) {
        trajectory = trajectory.thinned(every);
    }
    trajectory.source = paths.first().map(|path| path.as_ref().to_owned());
    Ok(Imported { trajectory, report })
}
