//! The repetitions: a line each, and what each found.

use super::{LoopReport, Round};
use crate::fit::Fit;
use crate::fit::distributions::{self, DistributionGroup};
use crate::fit::held_out::{self, HeldOutView};
use crate::fit::log::{self, LogView};
use crate::fit::sections::{self, FitView};
use crate::format::{UNKNOWN, clean, duration, grouped, significant};
use crate::training::curves::{self, Card, LegendEntry, MAX_SEEDS};
use serde::Serialize;

/// Max number of rounds that are shown in full: the last ones.
const MAX_ROUNDS: usize = 6;
/// Max number of rounds in the table.
const MAX_LINES: usize = 100;

/// A line of the table of rounds.
#[derive(Serialize)]
pub(super) struct RoundLine {
    name: String,
    log: String,
    falls: String,
    nominal: String,
    fitted: String,
    generations: String,
    identified: String,
    wall: String,
}

/// A round in full.
#[derive(Serialize)]
pub(super) struct RoundSection {
    name: String,
    log: Option<LogView>,
    fits: Vec<FitView>,
    pub distributions: Vec<DistributionGroup>,
    pub held_out: Option<HeldOutView>,
    pub progress: Vec<Card>,
    details: Vec<Card>,
    legend: Vec<LegendEntry>,
}

/// Returns the name of the round.
fn title(round: &Round, index: usize) -> String {
    if round.name.is_empty() { format!("Round {}", index + 1) } else { clean(&round.name) }
}

pub(super) fn lines(report: &LoopReport) -> Vec<RoundLine> {
    report.rounds.iter().enumerate().take(MAX_LINES).map(|(i, round)| line(round, i)).collect()
}

fn line(round: &Round, index: usize) -> RoundLine {
    let fit = round.fits.first();
    let log = round.log.as_ref();
    let cost = |value: fn(&Fit) -> f64| significant(fit.map_or(f64::NAN, value), 4);
    let judged = || fit.iter().flat_map(|f| &f.parameters).filter_map(|p| p.identified);
    // Runs stop at different generations; the longest one shows what the search took.
    let generations = fit.iter().flat_map(|f| &f.runs).map(|r| r.best.len().max(r.mean.len())).max();
    RoundLine {
        name: title(round, index),
        log: log.map_or(UNKNOWN.into(), |l| {
            // The number of trajectories and their mean length.
            format!("{} × {}", grouped(l.trajectories), duration(l.seconds / l.trajectories.max(1) as f64))
        }),
        falls: log.map_or(UNKNOWN.into(), |l| l.falls.to_string()),
        nominal: cost(|f| f.nominal_cost),
        fitted: cost(|f| f.fitted_cost),
        generations: generations.map_or(UNKNOWN.into(), |g| grouped(g as u64)),
        identified: match judged().count() {
            0 => UNKNOWN.into(),
            count => format!("{} of {count}", judged().filter(|known| *known).count()),
        },
        wall: duration(round.wall_seconds),
    }
}

/// The last rounds in full, the newest first.
pub(super) fn sections(report: &LoopReport) -> Vec<RoundSection> {
    // Older rounds beyond the limit still have their lines in the table.
    let newest = report.rounds.iter().enumerate().rev().take(MAX_ROUNDS);
    newest.map(|(i, round)| section(round, i)).collect()
}

fn section(round: &Round, index: usize) -> RoundSection {
    let seeds = &round.fine_tuning[..round.fine_tuning.len().min(MAX_SEEDS)];
    let small = (300.0, 170.0);
    let rewards = curves::cards(seeds, |s| &s.rewards, small);
    RoundSection {
        name: title(round, index),
        log: round.log.as_ref().map(log::view),
        fits: sections::build(&round.fits),
        distributions: distributions::build(&round.distributions),
        held_out: round.held_out.as_ref().map(held_out::view),
        progress: curves::cards(seeds, |s| &s.progress, (420.0, 240.0)),
        details: rewards.into_iter().chain(curves::cards(seeds, |s| &s.diagnostics, small)).collect(),
        legend: curves::legend(seeds),
    }
}

impl RoundSection {
    /// Whether any fit has parameters to show.
    pub fn has_parameters(&self) -> bool {
        self.fits.iter().any(|f| f.parameters.is_some())
    }

    /// Whether any fit tells how it went.
    pub fn has_runs(&self) -> bool {
        self.fits.iter().any(|f| f.runs.is_some())
    }

    /// Whether the log is described.
    pub fn has_log(&self) -> bool {
        self.log.is_some()
    }
}
