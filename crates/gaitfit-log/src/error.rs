//! What can go wrong with a log file or a trajectory, each with its place and remedy.

use std::path::PathBuf;

/// Failure to read, write or transform a log. Lines and columns count from 1; a column is a CSV cell, not a
/// character.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// The operating system refused.
    #[error("{path}: cannot {action}: {source}; {remedy}", path = .path.display())]
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
    #[error("{}: not a regular file; name one CSV file", .path.display())]
    NotAFile {
        /// The path given.
        path: PathBuf,
    },
    /// No header line.
    #[error("{}: empty file; a log starts with a header line such as `time,q_FL_hip,dq_FL_hip`", .path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// A header and no sample.
    #[error("{}: a header but no samples; was the recorder stopped before its first sample?", .path.display())]
    NoSamples {
        /// The file.
        path: PathBuf,
    },
    /// The file is larger than the reader will take into memory.
    #[error(
        "{}: larger than {limit} bytes; split the log, or raise `max_bytes` if there is memory for it", .path.display()
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// `ReadOptions::max_bytes`.
        limit: u64,
    },
    /// A line longer than any log's line: not a CSV file.
    #[error("{}:{line}: line longer than {limit} bytes; is this a CSV file?", .path.display())]
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
        "{}:{line}: {columns} columns, more than {limit}; drop unused columns, or raise `max_columns`", .path.display()
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
    #[error("{}:{line}: not UTF-8 text; {hint}", .path.display())]
    NotUtf8 {
        /// The file.
        path: PathBuf,
        /// The line.
        line: u64,
        /// What it looks like and what to do.
        hint: &'static str,
    },
    /// The header lacks a column.
    #[error("{}:{line}: no column `{name}`; {remedy}", .path.display())]
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
        "{}:{line}: column {column} `{name}` repeats column {first}; remove or rename one of them", .path.display()
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
    #[error("{}:{line}: {found} cells where the header names {expected}; {remedy}", .path.display())]
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
    #[error("{}:{line}: column {column} `{name}`: {text:?} is {problem}", .path.display())]
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
    #[error("{place}: {problem}")]
    Metadata {
        /// File and line, or `read options`.
        place: String,
        /// Why it is refused, and what to do.
        problem: String,
    },
    /// A trajectory whose arrays do not fit together.
    #[error("{what}: {problem}")]
    Shape {
        /// The field.
        what: String,
        /// How it disagrees, and what to do.
        problem: String,
    },
    /// A joint that the log does not have.
    #[error("the log has no joint `{name}`; its joints are {available}")]
    NoSuchJoint {
        /// The name asked for.
        name: String,
        /// The log's joints.
        available: String,
    },
    /// A slice, rate or order that the trajectory cannot give.
    #[error("{what}: {problem}")]
    Range {
        /// The argument.
        what: &'static str,
        /// Why it is refused, and what to do.
        problem: String,
    },
}
