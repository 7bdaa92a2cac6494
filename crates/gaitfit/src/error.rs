//! Why a stage stopped.

use std::fmt;

/// Why a stage of the method stopped: one paragraph that names the object and what to do.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// An input is broken, or the work failed.
    #[error("{0}")]
    Failed(String),
    /// A setting is wrong, or does not fit the inputs.
    #[error("{0}")]
    Settings(String),
    /// The caller asked to stop. The text says what was kept.
    #[error("{0}")]
    Interrupted(String),
    /// Hardware or a program that the settings ask for is missing.
    #[error("{0}")]
    Missing(String),
}

impl Error {
    /// An input is broken, or the work failed.
    pub fn failed(message: impl fmt::Display) -> Self {
        Self::Failed(message.to_string())
    }

    /// A setting is wrong.
    pub fn settings(message: impl fmt::Display) -> Self {
        Self::Settings(message.to_string())
    }

    /// The same error with another text.
    #[must_use]
    pub fn map(self, change: impl FnOnce(String) -> String) -> Self {
        match self {
            Self::Failed(text) => Self::Failed(change(text)),
            Self::Settings(text) => Self::Settings(change(text)),
            Self::Interrupted(text) => Self::Interrupted(change(text)),
            Self::Missing(text) => Self::Missing(change(text)),
        }
    }
}
