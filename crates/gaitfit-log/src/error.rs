//! What can go wrong with a log file or a trajectory, each with its place and remedy.

use gaitfit_model::{shown, shown_path, shown_sentence};
use std::path::PathBuf;

/// Failure to read, write or transform a log. Lines and columns count from 1; a column is a CSV cell, not a
/// character.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// The operating system refused.
    #[error("{path}: cannot {action}: {source}; {remedy}", path = shown_path(.path))]
    Io {
        /// The file.
        path: PathBuf,
        /// What was attempted.
        action: &'static str,
        /// The system's reason.
        source: std::io::Error,
        /// What to do.
        remedy: &'static str,
    },
    /// A folder, pipe or device where a file is needed.
    #[error("{}: not a regular file but a folder, pipe or device; name a CSV file", shown_path(.path))]
    NotAFile {
        /// The path given.
        path: PathBuf,
    },
    /// No header line.
    #[error("{}: empty file; a log starts with a header line such as `time,q_FL_hip,dq_FL_hip`", shown_path(.path))]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// A header and no sample.
    #[error("{}: a header but no samples; was the recorder stopped before its first sample?", shown_path(.path))]
    NoSamples {
        /// The file.
        path: PathBuf,
    },
    /// The file is larger than the reader will take into memory.
    #[error(
        "{}: larger than {limit} bytes; split the log, take one row of many (`gaitfit import LOG.csv --every 10 --out \
         LESS.csv`), or raise `max_bytes` if there is memory for it", shown_path(.path)
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// `ReadOptions::max_bytes`.
        limit: u64,
    },
    /// More rows than are taken into memory.
    #[error(
        "{}: more than {limit} rows of {columns} columns, which is what is taken into memory; cut it into shorter logs, or, \
         where it is faster than the policy, take one row of many: `gaitfit import LOG.csv --every 10 --out LESS.csv`",
        shown_path(.path)
    )]
    TooManyRows {
        /// The file.
        path: PathBuf,
        /// How many rows of so many columns are taken.
        limit: usize,
        /// Columns that are read.
        columns: usize,
    },
    /// A line longer than any log's line: not a CSV file.
    #[error("{}:{line}: line longer than {limit} bytes; is this a CSV file?", shown_path(.path))]
    LineTooLong {
        /// The file.
        path: PathBuf,
        /// The line.
        line: u64,
        /// Longest line read, bytes.
        limit: usize,
    },
    /// More columns than the reader takes.
    #[error(
        "{}:{line}: {columns} columns, more than {limit}; drop unused columns, or raise `max_columns`", shown_path(.path)
    )]
    TooManyColumns {
        /// The file.
        path: PathBuf,
        /// The header's line.
        line: u64,
        /// Columns found.
        columns: usize,
        /// `ReadOptions::max_columns`.
        limit: usize,
    },
    /// The bytes are not text.
    #[error("{}:{line}: not UTF-8 text; {hint}", shown_path(.path))]
    NotUtf8 {
        /// The file.
        path: PathBuf,
        /// The line.
        line: u64,
        /// What it looks like and what to do.
        hint: &'static str,
    },
    /// A link that leads to no file.
    #[error("{}: a link to {}, {problem}; {remedy}", shown_path(.path), shown_path(.target))]
    Link {
        /// The link.
        path: PathBuf,
        /// Where it leads, as the link says it.
        target: PathBuf,
        /// What is wrong with it.
        problem: &'static str,
        /// What to do.
        remedy: &'static str,
    },
    /// A folder without logs.
    #[error("{}: the folder has no *.csv files; name the folder with the robot's logs", shown_path(.path))]
    NoLogs {
        /// The folder.
        path: PathBuf,
    },
    /// A folder with more entries than are looked at.
    #[error("{}: more than {limit} files; name a folder that has only logs", shown_path(.path))]
    TooManyFiles {
        /// The folder.
        path: PathBuf,
        /// Max number of entries.
        limit: usize,
    },
    /// The caller asked to stop.
    #[error("stopped before all logs were read; start again to read them")]
    Stopped,
    /// The header lacks a column.
    #[error("{}:{line}: no column `{}`; {}", shown_path(.path), shown(name), shown_sentence(remedy))]
    MissingColumn {
        /// The file.
        path: PathBuf,
        /// The header's line.
        line: u64,
        /// The missing column.
        name: String,
        /// What to do.
        remedy: String,
    },
    /// The header names one quantity twice.
    #[error(
        "{}:{line}: column {column} `{}` repeats column {first}; remove or rename one of them",
        shown_path(.path),
        shown(name)
    )]
    DuplicateColumn {
        /// The file.
        path: PathBuf,
        /// The header's line.
        line: u64,
        /// The later column.
        column: usize,
        /// The earlier column.
        first: usize,
        /// The name both carry.
        name: String,
    },
    /// A row with fewer or more cells than the header.
    #[error("{}:{line}: {found} cells where the header names {expected}; {remedy}", shown_path(.path))]
    RowLength {
        /// The file.
        path: PathBuf,
        /// The row's line.
        line: u64,
        /// Cells in the row.
        found: usize,
        /// Columns in the header.
        expected: usize,
        /// What to do.
        remedy: &'static str,
    },
    /// A cell that is not what its column needs.
    #[error("{}:{line}: column {column} `{}`: {text:?} is {problem}", shown_path(.path), shown(name))]
    Cell {
        /// The file.
        path: PathBuf,
        /// The row's line.
        line: u64,
        /// The cell's column.
        column: usize,
        /// The column's name.
        name: String,
        /// The cell's text, shortened.
        text: String,
        /// Why it is refused, and what to do.
        problem: &'static str,
    },
    /// Gains, rate or robot name as stated in the header comments, the sidecar or the options.
    #[error("{}: {}", shown_sentence(place), shown_sentence(problem))]
    Metadata {
        /// File and line, or `read options`.
        place: String,
        /// Why it is refused, and what to do.
        problem: String,
    },
    /// A trajectory whose arrays do not fit together.
    #[error("{}: {}", shown(what), shown_sentence(problem))]
    Shape {
        /// The field.
        what: String,
        /// How it disagrees, and what to do.
        problem: String,
    },
    /// A joint that the log does not have.
    #[error("the log has no joint `{}`; its joints are {}", shown(name), shown_sentence(available))]
    NoSuchJoint {
        /// The name asked for.
        name: String,
        /// The log's joints.
        available: String,
    },
    /// A slice, rate or order that the trajectory cannot give.
    #[error("{what}: {}", shown_sentence(problem))]
    Range {
        /// The argument.
        what: &'static str,
        /// Why it is refused, and what to do.
        problem: String,
    },
}
