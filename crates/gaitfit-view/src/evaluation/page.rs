//! The page as the template sees it: text and pictures, ready to be placed.

use super::drift::{self, DriftTable};
use super::histogram::histogram;
use super::{EvaluationReport, Ground, Measure};
use crate::Setting;
use crate::format::{
    UNKNOWN, clean, clean_prose, duration, fixed, grouped, round_number, significant, with_spread,
};
use crate::gait;
use crate::page::{self, Number, ShownDoubt, ShownLink};
use crate::replay::Motion;
use serde::Serialize;

/// Measures shown at most.
const MAX_MEASURES: usize = 40;
/// Levels of uneven ground shown at most, over all kinds.
const MAX_GROUND: usize = 400;

/// The whole page.
#[derive(Serialize)]
pub(super) struct Page {
    title: String,
    robot: String,
    created: String,
    doubts: Vec<ShownDoubt>,
    /// Whether a doubt leaves nothing to praise.
    doubted: bool,
    verdict: String,
    headline: Vec<Number>,
    trajectories: String,
    seconds: String,
    wall_time: String,
    measures: Vec<Row>,
    has_limits: bool,
    histograms: Vec<Card>,
    drift: Option<DriftTable>,
    ground: Vec<GroundRow>,
    /// Rows of ground that are not shown.
    ground_left_out: usize,
    motion: Motion,
    gait: String,
    gait_caption: String,
    links: Vec<ShownLink>,
    warnings: Vec<String>,
    settings: Vec<Setting>,
    versions: Vec<Setting>,
}

#[derive(Serialize)]
struct Row {
    name: String,
    mean: String,
    ci95: String,
    unit: String,
    limit: String,
    /// Whether the mean keeps its limit; none without one.
    kept: Option<bool>,
}

#[derive(Serialize)]
struct GroundRow {
    name: String,
    level: u32,
    difficulty: String,
    robots: u32,
    crossed: String,
    /// Width of the bar, 0 to 100.
    bar: String,
    falls: String,
    speed: String,
}

#[derive(Serialize)]
struct Card {
    name: String,
    mean: String,
    svg: String,
}

impl Page {
    pub fn new(report: &EvaluationReport) -> Page {
        let measures = &report.measures[..report.measures.len().min(MAX_MEASURES)];
        let rows: Vec<Row> = measures.iter().map(row).collect();
        // A replay that cannot be drawn becomes a warning of a page that is otherwise whole.
        let (motion, problem) = Motion::new(report.replay.as_ref());
        Page {
            title: clean(&report.title),
            robot: clean(&report.robot),
            created: clean(&report.created),
            doubts: page::doubts(&report.doubts),
            doubted: page::is_severe(&report.doubts),
            verdict: clean_prose(&report.verdict),
            headline: measures.iter().filter(|m| m.headline).map(number).collect(),
            trajectories: grouped(report.trajectories),
            seconds: round_number(report.seconds),
            wall_time: duration(report.wall_seconds),
            has_limits: rows.iter().any(|r| r.kept.is_some()),
            measures: rows,
            histograms: measures.iter().filter_map(card).collect(),
            drift: drift::build(&report.drift),
            ground: report.ground.iter().take(MAX_GROUND).map(ground).collect(),
            ground_left_out: report.ground.len().saturating_sub(MAX_GROUND),
            motion,
            gait: report.gait.as_ref().map(gait::inline).unwrap_or_default(),
            gait_caption: clean_prose(&report.gait_caption),
            links: page::links(&report.links),
            warnings: page::lines(&report.warnings).into_iter().chain(problem).collect(),
            settings: page::settings(&report.settings),
            versions: page::settings(&report.versions),
        }
    }
}

/// A measure's mean and the half-width of its interval.
fn written(measure: &Measure) -> (String, String) {
    match measure.decimals {
        Some(decimals) => (fixed(measure.mean, decimals), fixed(measure.ci95, decimals)),
        None => with_spread(measure.mean, measure.ci95),
    }
}

fn number(measure: &Measure) -> Number {
    let (mean, ci95) = written(measure);
    let interval = if ci95 == UNKNOWN { String::new() } else { format!(" ± {ci95}") };
    Number { value: mean, unit: clean(&measure.unit), what: format!("{}{interval}", clean(&measure.name)) }
}

fn row(measure: &Measure) -> Row {
    let (mean, ci95) = written(measure);
    let limit = measure.limit.filter(|l| l.is_finite());
    Row {
        name: clean(&measure.name),
        mean,
        ci95,
        unit: clean(&measure.unit),
        limit: limit.map_or(UNKNOWN.into(), round_number),
        // An unknown mean neither keeps nor breaks its limit.
        kept: limit.filter(|_| measure.mean.is_finite()).map(|l| measure.mean <= l),
    }
}

fn ground(row: &Ground) -> GroundRow {
    let percent = |share: f64| if share.is_finite() { fixed(100.0 * share, 0) } else { UNKNOWN.into() };
    GroundRow {
        name: clean(&row.name),
        level: row.level,
        difficulty: clean(&row.difficulty),
        robots: row.robots,
        crossed: percent(row.crossed),
        // The number goes into a style, so it must be one.
        bar: fixed(if row.crossed.is_finite() { (100.0 * row.crossed).clamp(0.0, 100.0) } else { 0.0 }, 0),
        falls: percent(row.falls),
        speed: fixed(row.speed, 2),
    }
}

fn card(measure: &Measure) -> Option<Card> {
    // Rates have no distribution over trajectories, so they get no card.
    let data = measure.histogram.as_ref()?;
    let name = clean(&measure.name);
    let unit = if measure.unit.is_empty() { String::new() } else { format!(" ({})", clean(&measure.unit)) };
    let title = format!("{name} over trajectories");
    let x_title = format!("{name}{unit}");
    let svg = histogram(&title, &x_title, &data.edges, &data.counts, measure.mean, measure.limit)?;
    Some(Card { name, mean: format!("{} {}", significant(measure.mean, 3), clean(&measure.unit)), svg })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_is_kept_by_the_mean() {
        let measure = |mean, limit| row(&Measure { mean, limit, ci95: 0.002, ..Measure::default() }).kept;
        assert_eq!(measure(0.15, Some(0.15)), Some(true));
        assert_eq!(measure(0.16, Some(0.15)), Some(false));
        assert_eq!(measure(f64::NAN, Some(0.15)), None);
        assert_eq!(measure(0.1, None), None);
    }
}
