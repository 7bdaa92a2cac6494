//! Constant commands: where the robot went, seen from above, and how far it ended from where it should.

use crate::Drift;
use crate::chart::Look;
use crate::chart::plan::{Track, plan};
use crate::format::{UNKNOWN, clean, fixed, with_spread};
use serde::Serialize;

/// Trials shown at most.
pub(crate) const MAX_TRIALS: usize = 64;

/// Table and picture.
#[derive(Serialize)]
pub(crate) struct DriftTable {
    rows: Vec<Row>,
    /// Paths from above; none without any.
    svg: Option<String>,
    has_ci95: bool,
    left_out: usize,
}

#[derive(Serialize)]
struct Row {
    name: String,
    color: usize,
    trials: u32,
    falls: u32,
    /// x and y in m, yaw in rad, each with half its 95 % interval.
    errors: Vec<String>,
    yaw_degrees: String,
}

pub(crate) fn build(drift: &[Drift]) -> Option<DriftTable> {
    let shown = &drift[..drift.len().min(MAX_TRIALS)];
    let rows = shown.iter().enumerate().map(|(i, d)| Row {
        name: clean(&d.name),
        // As many as there are colours (`Look::color`); the table and the picture agree.
        color: i % 8,
        trials: d.trials,
        falls: d.falls,
        errors: d.error.iter().zip(&d.ci95).map(|(e, s)| error(*e, *s)).collect(),
        yaw_degrees: fixed(d.error[2].to_degrees(), 1),
    });
    (!shown.is_empty()).then(|| DriftTable {
        rows: rows.collect(),
        svg: picture(shown),
        has_ci95: shown.iter().any(|d| d.ci95.iter().any(|s| s.is_finite())),
        left_out: drift.len() - shown.len(),
    })
}

/// A mean error with half its 95 % interval, where known.
pub(crate) fn error(value: f64, ci95: f64) -> String {
    if !value.is_finite() {
        return UNKNOWN.into();
    }
    if !ci95.is_finite() {
        return fixed(value, 3);
    }
    let (value, ci95) = with_spread(value, ci95);
    format!("{value} ± {ci95}")
}

/// All paths from above, solid; what the commands ask for, dashed.
fn picture(drift: &[Drift]) -> Option<String> {
    let tracks: Vec<Track> = drift
        .iter()
        .enumerate()
        .flat_map(|(i, trial)| {
            let look = Look::color(i);
            [
                // The ring is larger than the disc, so that a robot that arrives shows both.
                Track { points: &trial.intended, look: look.dashed(), radius: 5.0, ring: true },
                Track { points: &trial.path, look, radius: 4.0, ring: false },
            ]
        })
        .collect();
    plan("Paths under constant commands, from above", 420.0, &tracks)
}
