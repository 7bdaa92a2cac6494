//! A log of a walk as it was read, before anything is cut or counted.

use super::log_files::LogFile;
use gaitfit_log::{Finding, FindingKind, Trajectory};
use std::path::PathBuf;

/// The use of the logs that are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// A fit: it needs a minimum of data, and warns of commands without data.
    Fit,
    /// Validating a fit: any stretch that counts is enough.
    Validation,
}

/// A log as read, joints in the policy's order.
pub struct Read {
    /// The file that it was read from.
    pub file: LogFile,
    /// Files beside it that were read.
    pub sidecars: Vec<PathBuf>,
    /// The log's own names of the joints.
    pub joints: Vec<String>,
    /// Changes that reading the log made.
    pub noticed: Vec<Finding>,
    /// Findings that the log itself allows.
    pub(super) allowed: Vec<FindingKind>,
    /// Its samples as recorded.
    pub trajectory: Trajectory,
    /// Changes of its times on reading, in words.
    pub(super) even: Option<String>,
    /// The place in a motion that was assumed, in words.
    pub(super) motion: Option<String>,
    /// The turn of the inertial unit that the policy showed, see [`super::mounting`].
    pub(super) mounting: Option<[f64; 3]>,
}

#[cfg(test)]
impl Read {
    /// A log that no file holds.
    pub fn new(file: LogFile, trajectory: Trajectory) -> Self {
        let joints = trajectory.joints.clone();
        Self {
            file,
            sidecars: Vec::new(),
            joints,
            noticed: Vec::new(),
            allowed: Vec::new(),
            trajectory,
            even: None,
            motion: None,
            mounting: None,
        }
    }
}
