//! What can go wrong when a robot file is read.

use std::path::{Path, PathBuf};

use crate::shown::shown_path;

/// A position in a robot file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// File as it was opened (or the name given with a text).
    pub file: String,
    /// Line, from 1.
    pub line: u32,
    /// Column in characters, from 1.
    pub column: u32,
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}:{}:{}", shown_path(Path::new(&self.file)), self.line, self.column)
    }
}

/// Why a robot file was not read. Every message says where, what, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// The file could not be opened or read.
    #[error("{}: {source}; check the path and the permissions", shown_path(path))]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Not well-formed XML, or XML with a document type declaration.
    #[error("{place}: {message}; {remedy}")]
    Syntax {
        /// Where.
        place: Place,
        /// What.
        message: String,
        /// What to do.
        remedy: String,
    },
    /// Valid in the format, but not honoured here; lenient reading drops it.
    #[error("{place}: {message}; {remedy}")]
    Unsupported {
        /// Where.
        place: Place,
        /// What.
        message: String,
        /// What to do.
        remedy: String,
    },
    /// A value or structure that makes no valid robot.
    #[error("{place}: {message}; {remedy}")]
    Invalid {
        /// Where.
        place: Place,
        /// What.
        message: String,
        /// What to do.
        remedy: String,
    },
    /// Larger or deeper than a robot file can sensibly be.
    #[error("{place}: {message}; {remedy}")]
    TooLarge {
        /// Where.
        place: Place,
        /// What.
        message: String,
        /// What to do.
        remedy: String,
    },
}

impl ModelError {
    /// Where the file is at fault; `None` when it could not be read at all.
    pub fn place(&self) -> Option<&Place> {
        match self {
            ModelError::Io { .. } => None,
            ModelError::Syntax { place, .. }
            | ModelError::Unsupported { place, .. }
            | ModelError::Invalid { place, .. }
            | ModelError::TooLarge { place, .. } => Some(place),
        }
    }
}
