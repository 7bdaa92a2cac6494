//! What can be wrong with columns and arrays, whatever file they are from.

use crate::table::MAX_COLUMNS;
use gaitfit_model::shown;

/// Fault of a file's columns or arrays.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TableError {
    /// A text in another encoding.
    #[error("not UTF-8 text; save the file as UTF-8")]
    NotUtf8,
    /// A text without a line.
    #[error("empty; a log has a header line")]
    Empty,
    /// A text that is no table.
    #[error("lines longer than a megabyte; is this a CSV file?")]
    LongLines,
    /// Fault that the CSV reader names.
    #[error("{0}")]
    Csv(String),
    /// Too many columns in a CSV file.
    #[error("{count} columns, more than {MAX_COLUMNS}; drop unused ones")]
    ManyColumns {
        /// Number of columns.
        count: usize,
    },
    /// Too many columns in a file of columns or arrays.
    #[error("more than {MAX_COLUMNS} columns; save only the joints' {what}")]
    MoreColumns {
        /// `columns` or `arrays`.
        what: &'static str,
    },
    /// A CSV file without names.
    #[error("the first line holds numbers; put a header line with the columns' names before it")]
    NoHeader,
    /// Two columns of one name.
    #[error("column `{}` is there twice; rename one", shown(.0))]
    Twice(String),
    /// A row that is shorter or longer than the header.
    #[error("line {line}: {cells} cells where the header names {names}")]
    Cells {
        /// The row's line, from 1.
        line: u64,
        /// Its cells.
        cells: usize,
        /// The header's names.
        names: usize,
    },
    /// More rows than can be counted.
    #[error("too many rows; cut the log")]
    ManyRows,
    /// A cell of a column that is needed.
    #[error(
        "line {line}, column `{}`: `{}` is not a number; correct it, or leave the cell empty",
        shown(column),
        shown(cell)
    )]
    Number {
        /// The row's line, from 1.
        line: u64,
        /// The column's name.
        column: String,
        /// The cell.
        cell: String,
    },
    /// A cell of the time column.
    #[error("line {line}: `{}` is no sample time", shown(cell))]
    Time {
        /// The row's line, from 1.
        line: u64,
        /// The cell.
        cell: String,
    },
    /// A time column with empty cells.
    #[error("`{}` has rows without a time; leave them out", shown(.0))]
    NoTime(String),
    /// A header alone.
    #[error("a header but no numbers")]
    NoNumbers,
    /// Columns that hold no numbers.
    #[error("no columns of numbers; is this a log?")]
    NoColumns,
    /// Arrays that hold no numbers.
    #[error("no arrays of numbers; is this a log?")]
    NoArrays,
    /// The mapping names a time column that is not there.
    #[error("no column `{}`, which `[time] column` of the mapping names", shown(.0))]
    NoTimeColumn(String),
    /// The mapping names an array of times that is not there.
    #[error("no array `{}`, which `[time] column` of the mapping names; it has {arrays}", shown(wanted))]
    NoTimeArray {
        /// The name in the mapping.
        wanted: String,
        /// Names of arrays that are there.
        arrays: String,
    },
    /// Nothing says when samples were taken.
    #[error("no time column; name it as `[time] column = ...`, or give `rate_hz`, in a mapping file")]
    NoTimes,
    /// Two arrays of one quantity, such as those of several recordings in one file.
    #[error(
        "`{}` and `{}` hold the same quantity; name what to read by `--take`, such as the beginning of a path",
        shown(.0),
        shown(.1)
    )]
    SameQuantity(String, String),
    /// Arrays of different lengths.
    #[error(
        "`{}` has {rows} rows and `{}` {position_rows}; save both with one row a sample",
        shown(time),
        shown(position)
    )]
    Rows {
        /// The array of times.
        time: String,
        /// Its rows.
        rows: usize,
        /// The array of positions.
        position: String,
        /// Its rows.
        position_rows: usize,
    },
}
