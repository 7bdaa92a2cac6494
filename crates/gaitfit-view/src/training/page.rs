//! The page as the template sees it: text and pictures, ready to be placed.

use super::curves::{self, Card, LegendEntry, MAX_SEEDS};
use super::{SeedResult, TrainingReport};
use crate::Setting;
use crate::format::{UNKNOWN, clean, clean_prose, duration, fixed, round_number, significant};
use crate::gait;
use crate::page::{self, Number, ShownDoubt, ShownLink};
use crate::replay::Motion;
use serde::Serialize;

/// Characters of the configuration shown at most.
const MAX_CONFIGURATION: usize = 200_000;

/// The whole page.
#[derive(Serialize)]
pub(super) struct Page {
    title: String,
    robot: String,
    created: String,
    measured_on: String,
    doubts: Vec<ShownDoubt>,
    headline: Vec<Number>,
    rows: Vec<Row>,
    total: Option<Row>,
    seeds_left_out: usize,
    facts: Vec<Setting>,
    warnings: Vec<String>,
    links: Vec<ShownLink>,
    legend: Vec<LegendEntry>,
    progress: Vec<Card>,
    rewards: Vec<Card>,
    diagnostics: Vec<Card>,
    motion: Motion,
    gait: String,
    gait_caption: String,
    configuration: String,
    versions: Vec<Setting>,
}

#[derive(Serialize)]
struct Row {
    seed: String,
    color: usize,
    reward: String,
    linear: String,
    angular: String,
    falls: String,
    iterations: String,
    wall: String,
    rate: String,
}

impl Page {
    pub fn new(report: &TrainingReport) -> Page {
        let seeds = &report.seeds[..report.seeds.len().min(MAX_SEEDS)];
        let rows = seeds.iter().enumerate().map(|(i, s)| row(s.seed.to_string(), i % 8, &s.result)).collect();
        // All seeds count in the means, also those that are not drawn.
        let results: Vec<&SeedResult> = report.seeds.iter().map(|s| &s.result).collect();
        // A replay that cannot be drawn becomes a warning of a page that is otherwise whole.
        let (motion, problem) = Motion::new(report.replay.as_ref());
        Page {
            title: clean(&report.title),
            robot: clean(&report.robot),
            created: clean(&report.created),
            measured_on: clean_prose(&report.measured_on),
            doubts: page::doubts(&report.doubts),
            headline: headline(&results),
            rows,
            // The mean of one seed would repeat its row.
            total: (results.len() > 1).then(|| mean_row(&results)),
            seeds_left_out: report.seeds.len() - seeds.len(),
            facts: page::facts(report.wall_seconds, &report.facts),
            warnings: page::lines(&report.warnings).into_iter().chain(problem).collect(),
            links: page::links(&report.links),
            legend: curves::legend(seeds),
            progress: curves::cards(&report.seeds, |s| &s.progress, (420.0, 240.0)),
            rewards: curves::cards(&report.seeds, |s| &s.rewards, (300.0, 170.0)),
            diagnostics: curves::cards(&report.seeds, |s| &s.diagnostics, (300.0, 170.0)),
            motion,
            gait: report.gait.as_ref().map(gait::inline).unwrap_or_default(),
            gait_caption: clean_prose(&report.gait_caption),
            configuration: configuration(&report.configuration),
            versions: page::settings(&report.versions),
        }
    }
}

fn row(seed: String, color: usize, result: &SeedResult) -> Row {
    Row {
        seed,
        color,
        reward: significant(result.reward, 4),
        linear: fixed(result.linear_velocity_error, 3),
        angular: fixed(result.angular_velocity_error, 3),
        falls: percent(result.fall_rate),
        iterations: if result.iterations == 0 { UNKNOWN.into() } else { result.iterations.to_string() },
        wall: duration(result.wall_seconds),
        rate: thousands(result.samples_per_second),
    }
}

fn mean_row(results: &[&SeedResult]) -> Row {
    let mean = SeedResult {
        reward: mean(results, |r| r.reward),
        linear_velocity_error: mean(results, |r| r.linear_velocity_error),
        angular_velocity_error: mean(results, |r| r.angular_velocity_error),
        fall_rate: mean(results, |r| r.fall_rate),
        iterations: mean(results, |r| f64::from(r.iterations)).round() as u32,
        wall_seconds: mean(results, |r| r.wall_seconds),
        samples_per_second: mean(results, |r| r.samples_per_second),
    };
    // Beyond the eight colours of the seeds: the style sheet has none for it.
    row("mean".into(), 8, &mean)
}

/// The mean of the numbers that are known; NaN if none is.
fn mean(results: &[&SeedResult], value: fn(&SeedResult) -> f64) -> f64 {
    let known: Vec<f64> = results.iter().map(|r| value(r)).filter(|x| x.is_finite()).collect();
    // Without a known value this is 0/0, NaN, which is shown as unknown.
    known.iter().sum::<f64>() / known.len() as f64
}

/// Means over seeds of what a reader asks first; unknown ones are left out.
fn headline(results: &[&SeedResult]) -> Vec<Number> {
    let linear = mean(results, |r| r.linear_velocity_error);
    let angular = mean(results, |r| r.angular_velocity_error);
    let falls = mean(results, |r| r.fall_rate);
    [
        Number { value: fixed(linear, 3), unit: "m/s".into(), what: "mean linear-velocity error".into() },
        Number { value: fixed(angular, 3), unit: "rad/s".into(), what: "mean angular-velocity error".into() },
        Number {
            // The unit stands apart in large print.
            value: percent(falls).replace("\u{a0}%", ""),
            unit: "%".into(),
            what: "of trajectories end in a fall".into(),
        },
    ]
    .into_iter()
    .filter(|h| h.value != UNKNOWN)
    .collect()
}

fn percent(share: f64) -> String {
    if !share.is_finite() {
        return UNKNOWN.into();
    }
    // Policies that rarely fall differ in the second decimal.
    let decimals = if share < 0.1 { 2 } else { 1 };
    format!("{}\u{a0}%", fixed(100.0 * share, decimals))
}

fn thousands(x: f64) -> String {
    // From 10,000 samples a second on, the digits below a thousand are noise.
    if x.is_finite() && (1e4..1e9).contains(&x) {
        format!("{}\u{a0}k", round_number((x / 1e3).round()))
    } else {
        significant(x, 3)
    }
}

/// The configuration line by line, without what hides or a page cannot hold.
fn configuration(text: &str) -> String {
    let kept: String = text.chars().take(MAX_CONFIGURATION).collect();
    // Line by line, because `clean_prose` turns line breaks into spaces.
    let mut lines: Vec<String> = kept.lines().map(clean_prose).collect();
    if kept.len() < text.len() {
        lines.push("…".into());
    }
    lines.join("\n")
}
