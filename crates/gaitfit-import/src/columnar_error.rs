//! What can be wrong with Parquet, Arrow and HDF5 files.

use crate::problem::Problem;
use gaitfit_model::shown;

/// What is wrong with a file of columns or datasets. Builds without the feature `all-formats` do not read such files.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ColumnarError {
    /// A Parquet file without its end.
    #[error("its end is missing; the file was cut off, and Parquet files are read from their end")]
    NoEnd,
    /// Parts that do not fit together.
    #[error("{0}; the file is damaged")]
    Damaged(String),
    /// Content that is not read, and what to do.
    #[error("{0}")]
    NotRead(&'static str),
    /// The message of the library that reads a file.
    #[error("{0}")]
    Library(String),
    /// A column's lists or values do not fit its rows: what it has, and what to do.
    #[error("`{}` {problem}", shown(column))]
    Values {
        /// The column.
        column: String,
        /// The fault, and what to do.
        problem: &'static str,
    },
    /// A packed page.
    #[error("{packer}: {problem}")]
    Packed {
        /// Name of the packing.
        packer: &'static str,
        /// Fault that the unpacker names.
        problem: String,
    },
    /// A column that cannot be read.
    #[error("column `{}`: {problem}", shown(column))]
    Column {
        /// Its name.
        column: String,
        /// The fault.
        problem: Box<Problem>,
    },
    /// A dataset or a group that cannot be read.
    #[error("`{}`: {problem}", shown(path))]
    Object {
        /// Its path.
        path: String,
        /// The fault.
        problem: Box<Problem>,
    },
    /// A group whose content cannot be listed.
    #[error("group `{}`: {problem}", shown(path))]
    Group {
        /// Its path.
        path: String,
        /// Fault that the library names.
        problem: String,
    },
}

/// Parts that do not fit together, in words.
#[cfg(feature = "all-formats")]
pub(crate) fn damaged(words: impl std::fmt::Display) -> ColumnarError {
    ColumnarError::Damaged(words.to_string())
}
