//! Predictors that repeat a log's targets: what a fit of a clamped robot has to beat.

use crate::log::Log;
use gaitfit_adapt::fit::{Predicted, TargetSignal, best_delay, delayed};

/// Longest pure delay looked at, s.
const LONGEST_DELAY: f64 = 0.3;

/// Each log's targets, `delay` seconds late.
pub fn late(logs: &[Log], delay: f64) -> Vec<Predicted> {
    let of_log = |log: &Log| {
        let target = log.trajectory.target.as_deref().unwrap_or_default();
        let joints = log.trajectory.joints.len();
        delayed(TargetSignal { target, joints, dt: log.trajectory.dt() }, delay)
    };
    logs.iter().map(of_log).collect()
}

/// The delay, s, with the smallest `error`.
pub fn best(logs: &[Log], error: impl FnMut(f64) -> f64) -> f64 {
    let step = logs.iter().map(|log| log.trajectory.dt()).fold(LONGEST_DELAY, f64::min);
    best_delay(LONGEST_DELAY, step, error)
}
