//! Errors of a policy file.

use crate::InterfaceError;
use crate::network::ShapeError;
use std::path::PathBuf;

/// Why a policy cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum PolicyError {
    /// The file cannot be opened or read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The interface contradicts itself.
    #[error("{0}")]
    Interface(#[from] InterfaceError),
    /// The network cannot be.
    #[error("{0}")]
    Shape(#[from] ShapeError),
    /// A part that is broken, missing, or does not fit; the message names it and the remedy.
    #[error("{0}")]
    Invalid(String),
    /// Any of these, in a file.
    #[error("{}: {source}", path.display())]
    In {
        /// The file.
        path: PathBuf,
        /// What is wrong in it.
        source: Box<PolicyError>,
    },
}

/// A [`PolicyError::Invalid`] from anything that can be shown.
pub fn invalid(message: impl Into<String>) -> PolicyError {
    PolicyError::Invalid(message.into())
}
