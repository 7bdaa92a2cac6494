//! Facts about the recording, and how a page says them.

use super::commands;
use crate::format::{clean, clean_prose, duration, grouped};
use serde::Serialize;

/// Parts of the command space listed at most.
const MAX_UNCOVERED: usize = 20;

/// Facts about the recording, and the part of it that was used.
#[derive(Clone, Debug, PartialEq)]
pub struct LogSummary {
    /// Where it is from, e.g. a file name.
    pub source: String,
    /// Trajectories recorded.
    pub trajectories: u64,
    /// Length of all of them together, s.
    pub seconds: f64,
    /// Falls found.
    pub falls: u64,
    /// Length of what was cut because of falls, margins included, s.
    pub cut_seconds: f64,
    /// Commands given: forward and left (m/s), yaw rate (rad/s), each as often as it is to count. The page thins them.
    pub commands: Vec<[f64; 3]>,
    /// Smallest and largest command the policy is to follow, same order and units.
    pub command_range: [[f64; 2]; 3],
    /// Parts of the command space without data, in words.
    pub uncovered: Vec<String>,
}

/// The logs as the template sees them.
#[derive(Serialize)]
pub(crate) struct LogView {
    source: String,
    trajectories: String,
    seconds: String,
    falls: u64,
    cut: String,
    commands: Option<String>,
    uncovered: Vec<String>,
}

pub(crate) fn view(log: &LogSummary) -> LogView {
    LogView {
        source: clean(&log.source),
        trajectories: grouped(log.trajectories),
        seconds: duration(log.seconds),
        falls: log.falls,
        cut: duration(log.cut_seconds),
        commands: commands::picture(log),
        uncovered: log.uncovered.iter().take(MAX_UNCOVERED).map(|part| clean_prose(part)).collect(),
    }
}

impl Default for LogSummary {
    fn default() -> Self {
        LogSummary {
            source: String::new(),
            trajectories: 0,
            seconds: f64::NAN,
            falls: 0,
            cut_seconds: f64::NAN,
            commands: Vec::new(),
            command_range: [[-1.0, 1.0]; 3],
            uncovered: Vec::new(),
        }
    }
}
