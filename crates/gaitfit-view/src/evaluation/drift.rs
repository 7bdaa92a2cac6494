//! Constant commands: where the robot went, seen from above, and how far it ended from where it should.

use super::Drift;
use crate::chart::Look;
use crate::chart::plan::{Track, plan};
use crate::format::{UNKNOWN, clean, fixed, with_spread};
use serde::Serialize;

/// Trials shown at most.
pub(crate) const MOST_TRIALS: usize = 64;

/// Table and picture.
#[derive(Serialize)]
pub(crate) struct DriftTable {
    rows: Vec<Row>,
    /// Paths from above; none without any.
    svg: Option<String>,
    has_spread: bool,
    left_out: usize,
}

#[derive(Serialize)]
struct Row {
    name: String,
    color: usize,
    trials: u32,
    falls: u32,
    /// x and y in m, yaw in rad, each with its spread.
    errors: Vec<String>,
    yaw_degrees: String,
}

pub(crate) fn build(drift: &[Drift]) -> Option<DriftTable> {
    let shown = &drift[..drift.len().min(MOST_TRIALS)];
    let rows = shown.iter().enumerate().map(|(i, d)| Row {
        name: clean(&d.name),
        color: i % 8,
        trials: d.trials,
        falls: d.falls,
        errors: d.error.iter().zip(&d.spread).map(|(e, s)| error(*e, *s)).collect(),
        yaw_degrees: fixed(d.error[2].to_degrees(), 1),
    });
    (!shown.is_empty()).then(|| DriftTable {
        rows: rows.collect(),
        svg: picture(shown),
        has_spread: shown.iter().any(|d| d.spread.iter().any(|s| s.is_finite())),
        left_out: drift.len() - shown.len(),
    })
}

/// An error with its spread, where known.
pub(crate) fn error(value: f64, spread: f64) -> String {
    if !value.is_finite() {
        return UNKNOWN.into();
    }
    if !spread.is_finite() {
        return fixed(value, 3);
    }
    let (value, spread) = with_spread(value, spread);
    format!("{value} ± {spread}")
}

/// All paths from above, solid; what the commands ask for, dashed.
fn picture(drift: &[Drift]) -> Option<String> {
    let tracks: Vec<Track> = drift
        .iter()
        .enumerate()
        .flat_map(|(i, trial)| {
            let look = Look::color(i);
            [
                Track { points: &trial.intended, look: look.dashed(), radius: 5.0, ring: true },
                Track { points: &trial.path, look, radius: 4.0, ring: false },
            ]
        })
        .collect();
    plan("Paths under constant commands, from above", 420.0, &tracks)
}
