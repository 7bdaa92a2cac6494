//! What can be wrong with a file's content.

use crate::archive_error::ArchiveError;
use crate::budget_error::{BudgetError, UnpackError};
use crate::columnar_error::ColumnarError;
use crate::mcap_error::McapError;
use crate::pickle::PickleError;
use crate::ros::MessageError;
use crate::sqlite_error::SqliteError;
use crate::table_error::TableError;

/// What is wrong with a file's content, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Problem {
    /// It needs more than [`crate::Options`] allow.
    #[error(transparent)]
    Budget(#[from] BudgetError),
    /// A packed part of it cannot be unpacked.
    #[error(transparent)]
    Unpack(#[from] UnpackError),
    /// A file of NumPy or PyTorch is damaged, or holds no numbers.
    #[error(transparent)]
    Archive(#[from] ArchiveError),
    /// Columns or arrays make no log.
    #[error(transparent)]
    Table(#[from] TableError),
    /// A pickle is damaged, or is no plain data.
    #[error(transparent)]
    Pickle(#[from] PickleError),
    /// An MCAP file is damaged.
    #[error(transparent)]
    Mcap(#[from] McapError),
    /// A message's definition, or a message, cannot be read.
    #[error(transparent)]
    Message(#[from] MessageError),
    /// A database is damaged, or is no bag.
    #[error(transparent)]
    Sqlite(#[from] SqliteError),
    /// A Parquet, Arrow or HDF5 file is damaged, or holds what is not read.
    #[error(transparent)]
    Columnar(#[from] ColumnarError),
    /// A file that is packed again inside.
    #[error("packed twice")]
    PackedTwice,
}
