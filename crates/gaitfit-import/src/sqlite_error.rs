//! What can be wrong with a database.

use gaitfit_model::shown;

/// Fault of a database.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SqliteError {
    /// Pages, rows or cells that do not fit together.
    #[error("the database is damaged or cut short; `ros2 bag reindex` may mend it")]
    Damaged,
    /// Another encoding than bags have.
    #[error("its text is UTF-16; bags have UTF-8")]
    Utf16,
    /// A database of something else.
    #[error("no table `{}`: an SQLite file, but no ROS 2 bag", shown(.0))]
    NoTable(String),
    /// A table of something else.
    #[error("its table has no column `{0}`: no ROS 2 bag")]
    NoColumn(&'static str),
}
