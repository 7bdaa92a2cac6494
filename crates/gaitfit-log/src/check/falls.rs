//! Where the robot fell, for cutting: from the base's state where the log has it, and from the joints alone.
//!
//! Unlike the findings of [`super::check`], which name stretches that are bad for sure, a fall begins where
//! something first goes wrong.

use super::CheckSpec;
use super::following::{TILTED, is_stuck};
use super::windows::{Window, runs, windows};
use crate::Trajectory;
use serde::Serialize;
use std::ops::Range;

/// The sign that shows a fall.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FallSign {
    /// The base leans by more than 60°.
    Tilt,
    /// The base is lower than [`CheckSpec::lying_height`].
    Height,
    /// Most joints that are asked to move do not.
    Stuck,
    /// At rest far from the targets.
    Lying,
    /// The base stands still while the legs walk: the robot hangs.
    Hanging,
    /// The log says that it ends in a fall.
    Stated,
}

impl std::fmt::Display for FallSign {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Tilt => "the base leans by more than 60°",
            Self::Height => "the base is on the ground",
            Self::Stuck => "most joints do not do what they are asked",
            Self::Lying => "the robot rests far from its targets",
            Self::Hanging => "the base does not move while the legs walk: the robot hangs or is held",
            Self::Stated => "the log says so",
        })
    }
}

/// One fall.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Fall {
    /// Samples from the first that shows it to one past the last.
    pub samples: Range<usize>,
    /// The first sign of it.
    pub sign: FallSign,
}

/// Tilt or low height that lasts less than this, s, and ends, is a stumble.
const STUMBLE_S: f64 = 0.1;
/// Falls closer together than this, s, are one: whoever stands up this briefly does not stand.
const BETWEEN_S: f64 = 1.0;

/// The falls of a log, in order. Of a log whose arrays do not fit together: none.
pub fn falls(log: &Trajectory, spec: &CheckSpec) -> Vec<Fall> {
    if log.validate().is_err() || log.is_empty() {
        return Vec::new();
    }
    let mut signs = of_base(log, spec);
    signs.extend(of_joints(log));
    // It is stated for the end of the log, so the last sample is marked.
    if log.fell {
        signs.push(Fall { samples: log.len() - 1..log.len(), sign: FallSign::Stated });
    }
    // Signs that overlap or nearly do become one fall; the earliest sign names it.
    signs.sort_by_key(|fall| (fall.samples.start, fall.sign));
    let apart = (BETWEEN_S * log.rate_hz).round() as usize;
    let mut falls: Vec<Fall> = Vec::new();
    for sign in signs {
        match falls.last_mut() {
            Some(last) if sign.samples.start <= last.samples.end + apart => {
                last.samples.end = last.samples.end.max(sign.samples.end);
            }
            _ => falls.push(sign),
        }
    }
    falls
}

fn of_base(log: &Trajectory, spec: &CheckSpec) -> Vec<Fall> {
    let Some(base) = &log.base else { return Vec::new() };
    let mut falls = Vec::new();
    let mut add = |down: Vec<bool>, sign| {
        let min = (STUMBLE_S * log.rate_hz).ceil() as usize;
        for samples in stretches(&down) {
            // What goes down at the end of the log may go on after it: it counts however short it is.
            if samples.len() >= min || samples.end == down.len() {
                falls.push(Fall { samples, sign });
            }
        }
    };
    if let Some(quaternion) = &base.quaternion {
        add(quaternion.chunks_exact(4).map(|q| spec.upright(q) < TILTED).collect(), FallSign::Tilt);
    }
    if let (Some(position), Some(limit)) = (&base.position, spec.lying_height) {
        add(position.chunks_exact(3).map(|p| p[2] < limit).collect(), FallSign::Height);
    }
    falls
}

fn of_joints(log: &Trajectory) -> Vec<Fall> {
    let windows = windows(log);
    let mut falls = Vec::new();
    let mut add = |flags: Vec<bool>, sign| {
        for run in runs(&flags) {
            let (first, last) = (&windows[run.start], &windows[run.end - 1]);
            falls.push(Fall { samples: first.start..last.end, sign });
        }
    };
    add(windows.iter().map(|window| super::imu::hangs(log, window)).collect(), FallSign::Hanging);
    add(windows.iter().map(is_stuck).collect(), FallSign::Stuck);
    add(windows.iter().map(Window::collapsed).collect(), FallSign::Lying);
    falls
}

/// Stretches of true.
pub(super) fn stretches(flags: &[bool]) -> Vec<Range<usize>> {
    let mut stretches = Vec::new();
    let mut start = None;
    // One more false ends a stretch that reaches the end.
    for (i, flag) in flags.iter().chain([&false]).enumerate() {
        match (flag, start) {
            (true, None) => start = Some(i),
            (false, Some(from)) => {
                stretches.push(from..i);
                start = None;
            }
            _ => {}
        }
    }
    stretches
}
