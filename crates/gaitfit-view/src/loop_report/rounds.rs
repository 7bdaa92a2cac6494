//! The repetitions: a line each, and what each found.

use super::distributions::{self, DistributionGroup};
use super::{Adaptation, LogSummary, LoopReport, Round, commands};
use crate::format::{UNKNOWN, clean, clean_prose, duration, grouped, significant};
use crate::report::parameters::{self, Known, ParameterTable};
use crate::report::runs::{self, Level, Runs};
use crate::training::curves::{self, Card, MOST_SEEDS};
use serde::Serialize;

/// Rounds shown in full at most, the last ones; and in the table.
const MOST_ROUNDS: usize = 6;
const MOST_LINES: usize = 100;
/// Fits of a round at most.
const MOST_FITS: usize = 6;
const MOST_UNCOVERED: usize = 20;

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
    fits: Vec<Fit>,
    pub distributions: Vec<DistributionGroup>,
    pub progress: Vec<Card>,
    details: Vec<Card>,
    legend: Vec<LegendEntry>,
}

#[derive(Serialize)]
struct LogView {
    source: String,
    trajectories: String,
    seconds: String,
    falls: u64,
    cut: String,
    commands: Option<String>,
    uncovered: Vec<String>,
}

#[derive(Serialize)]
struct Fit {
    name: String,
    parameters: Option<ParameterTable>,
    runs: Option<Runs>,
}

#[derive(Serialize)]
struct LegendEntry {
    class: String,
    text: String,
}

/// What the round is called.
fn title(round: &Round, index: usize) -> String {
    if round.name.is_empty() { format!("Round {}", index + 1) } else { clean(&round.name) }
}

pub(super) fn lines(report: &LoopReport) -> Vec<RoundLine> {
    report.rounds.iter().enumerate().take(MOST_LINES).map(|(i, round)| line(round, i)).collect()
}

fn line(round: &Round, index: usize) -> RoundLine {
    let fit = round.adaptations.first();
    let log = round.log.as_ref();
    let cost = |of: fn(&Adaptation) -> f64| significant(fit.map_or(f64::NAN, of), 4);
    let judged = || fit.iter().flat_map(|f| &f.parameters).filter_map(|p| p.parameter.identified);
    let generations = fit.iter().flat_map(|f| &f.runs).map(|r| r.best.len().max(r.mean.len())).max();
    RoundLine {
        name: title(round, index),
        log: log.map_or(UNKNOWN.into(), |l| {
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
    let newest = report.rounds.iter().enumerate().rev().take(MOST_ROUNDS);
    newest.map(|(i, round)| section(round, i)).collect()
}

fn section(round: &Round, index: usize) -> RoundSection {
    let seeds = &round.fine_tuning[..round.fine_tuning.len().min(MOST_SEEDS)];
    let mut legend: Vec<LegendEntry> = seeds
        .iter()
        .enumerate()
        .map(|(i, s)| LegendEntry { class: format!("c{}", i % 8), text: format!("seed {}", s.seed) })
        .collect();
    if seeds.len() > 1 {
        legend.push(LegendEntry { class: "mean".into(), text: "mean".into() });
    }
    let small = (300.0, 170.0);
    let rewards = curves::cards(seeds, |s| &s.rewards, small);
    RoundSection {
        name: title(round, index),
        log: round.log.as_ref().map(log_view),
        fits: round.adaptations.iter().take(MOST_FITS).map(fit).collect(),
        distributions: distributions::build(&round.distributions),
        progress: curves::cards(seeds, |s| &s.progress, (420.0, 240.0)),
        details: rewards.into_iter().chain(curves::cards(seeds, |s| &s.diagnostics, small)).collect(),
        legend,
    }
}

fn log_view(log: &LogSummary) -> LogView {
    LogView {
        source: clean(&log.source),
        trajectories: grouped(log.trajectories),
        seconds: duration(log.seconds),
        falls: log.falls,
        cut: duration(log.cut_seconds),
        commands: commands::picture(log),
        uncovered: log.uncovered.iter().take(MOST_UNCOVERED).map(|part| clean_prose(part)).collect(),
    }
}

fn fit(adaptation: &Adaptation) -> Fit {
    let known: Vec<Known> = adaptation
        .parameters
        .iter()
        .map(|p| Known {
            parameter: &p.parameter,
            profile: p.profile.filter(|ends| ends.iter().all(|x| x.is_finite())).map(|[a, b]| (a, b)),
            truth: p.truth.filter(|x| x.is_finite()),
        })
        .collect();
    let levels = [
        Level { text: "nominal simulator", class: "nominal", cost: adaptation.nominal_cost },
        Level { text: "as low as it gets", class: "over mean", cost: adaptation.floor_cost },
    ];
    Fit {
        name: match (adaptation.name.is_empty(), adaptation.cost_name.is_empty()) {
            (false, _) => clean(&adaptation.name),
            (true, false) => format!("Cost {}", clean(&adaptation.cost_name)),
            (true, true) => String::new(),
        },
        parameters: parameters::build(&known),
        runs: runs::build(&adaptation.runs, "", &levels),
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
