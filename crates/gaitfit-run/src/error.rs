//! Errors of work on files or in a run folder.

use std::fmt;
use std::path::{Path, PathBuf};

/// The reason why work on files or in a run folder stopped: one paragraph that names the object and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file or folder cannot be read or written.
    #[error("cannot {access} {}: {source}{remedy}", path.display())]
    File {
        /// Access that was tried.
        access: Access,
        /// The file or folder.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
        /// Remedy, with the punctuation before it; may be empty.
        remedy: String,
    },
    /// A file holds something else than it should.
    #[error("{}: {problem}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// The problem, and what to do.
        problem: String,
    },
    /// A setting is wrong, or does not fit the inputs.
    #[error("{message}")]
    Settings {
        /// The setting, such as `optimizer.seeds`, where one can be named.
        key: Option<String>,
        /// The problem, and what to do.
        message: String,
    },
    /// A run cannot continue: it was begun with other settings or inputs.
    #[error(
        "{} cannot be continued: {difference}. Give the run's own settings and files (--resume with {}), or start \
         afresh without --resume.",
        folder.display(),
        folder.join("config.toml").display()
    )]
    Changed {
        /// The run's folder.
        folder: PathBuf,
        /// The difference, in words.
        difference: String,
    },
    /// A run is finished, and its inputs have changed since.
    #[error("{} is finished, and {difference} since. Start afresh without --resume.", folder.display())]
    Outdated {
        /// The run's folder.
        folder: PathBuf,
        /// The difference, in words.
        difference: String,
    },
    /// The caller asked to stop.
    #[error("{message}")]
    Interrupted {
        /// Results that were kept, and how to continue.
        message: String,
        /// The folder that keeps what was done; `None` if nothing was.
        kept: Option<PathBuf>,
    },
    /// Anything else that failed.
    #[error("{0}")]
    Failed(String),
}

/// Access to a file that was tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Reading it.
    Read,
    /// Writing it.
    Write,
    /// Making it.
    Make,
}

/// Kind of an error: programs end with another code for each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorKind {
    /// An input is broken, or the work failed.
    Failed,
    /// A setting is wrong, or does not fit the inputs.
    Settings,
    /// The caller asked to stop.
    Interrupted,
    /// Hardware or a program that the settings ask for is missing.
    Missing,
}

impl Error {
    /// An input is broken, or the work failed.
    pub fn failed(message: impl fmt::Display) -> Self {
        Self::Failed(message.to_string())
    }

    /// A setting is wrong. Its key is the first that the message has in backquotes.
    pub fn settings(message: impl fmt::Display) -> Self {
        let message = message.to_string();
        Self::Settings { key: named_key(&message), message }
    }

    /// A file or folder that cannot be read.
    pub fn unreadable(path: &Path, source: std::io::Error) -> Self {
        Self::File { access: Access::Read, path: path.to_owned(), source, remedy: String::new() }
    }

    /// A file or folder that cannot be written.
    pub fn unwritable(path: &Path, source: std::io::Error) -> Self {
        Self::File { access: Access::Write, path: path.to_owned(), source, remedy: String::new() }
    }

    /// A file that holds something else than it should.
    pub fn content(path: &Path, problem: impl fmt::Display) -> Self {
        Self::Content { path: path.to_owned(), problem: problem.to_string() }
    }

    /// Returns the kind of the error.
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Settings { .. } | Self::Changed { .. } | Self::Outdated { .. } => ErrorKind::Settings,
            Self::Interrupted { .. } => ErrorKind::Interrupted,
            Self::File { .. } | Self::Content { .. } | Self::Failed(_) => ErrorKind::Failed,
        }
    }

    /// The setting that is wrong, such as `optimizer.seeds`, where one can be named.
    pub fn key(&self) -> Option<&str> {
        match self {
            Self::Settings { key, .. } => key.as_deref(),
            _ => None,
        }
    }
}

impl fmt::Display for Access {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Read => "read",
            Self::Write => "write",
            Self::Make => "make",
        })
    }
}

/// The first text in backquotes, if it is a setting's name.
fn named_key(message: &str) -> Option<String> {
    let key = message.split('`').nth(1)?;
    // Names of robots and files stand in backquotes too. A key has only these letters.
    let of_key =
        |letter: char| letter.is_ascii_lowercase() || letter.is_ascii_digit() || "_.".contains(letter);
    (!key.is_empty() && key.chars().all(of_key)).then(|| key.to_owned())
}
