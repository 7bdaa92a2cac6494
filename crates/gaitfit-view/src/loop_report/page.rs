//! The page as the template sees it: text and pictures, ready to be placed.

use super::LoopReport;
use super::drift::{self, DriftSection};
use super::headline::{self, Headline};
use super::policies::Cast;
use super::rounds::{self, RoundLine, RoundSection};
use super::tracking::{self, TrackingSection};
use crate::Setting;
use crate::fit::held_out;
use crate::format::{clean, clean_prose};
use crate::page::{self, ShownDoubt, ShownLink};
use crate::replay::Motion;
use serde::Serialize;

/// The whole page.
#[derive(Serialize)]
pub(super) struct Page {
    title: String,
    robot: String,
    created: String,
    doubts: Vec<ShownDoubt>,
    headline: Option<Headline>,
    bought: String,
    /// How much better the fit in which the policy was trained predicts than the robot file; empty if it does not.
    predicts: String,
    facts: Vec<Setting>,
    links: Vec<ShownLink>,
    warnings: Vec<String>,
    lines: Vec<RoundLine>,
    rounds: Vec<RoundSection>,
    has: Has,
    tracking: Option<TrackingSection>,
    drift: Vec<DriftSection>,
    motion: Motion,
    settings: Vec<Setting>,
    versions: Vec<Setting>,
}

/// Sections about rounds that have any content.
#[derive(Serialize)]
struct Has {
    parameters: bool,
    runs: bool,
    distributions: bool,
    held_out: bool,
    log: bool,
    learning: bool,
}

impl Page {
    pub fn new(report: &LoopReport) -> Page {
        let cast = Cast::new(report);
        let rounds = rounds::sections(report);
        let any = |has: fn(&RoundSection) -> bool| rounds.iter().any(has);
        let has = Has {
            parameters: any(RoundSection::has_parameters),
            runs: any(RoundSection::has_runs),
            distributions: any(|r| !r.distributions.is_empty()),
            held_out: any(|r| r.held_out.is_some()),
            log: any(RoundSection::has_log),
            learning: any(|r| !r.progress.is_empty()),
        };
        // A replay that cannot be drawn becomes a warning of a page that is otherwise whole.
        let (motion, problem) = Motion::new(report.replay.as_ref());
        let mut warnings = page::lines(&report.warnings);
        warnings.extend(problem);
        Page {
            title: clean(&report.title),
            robot: clean(&report.robot),
            created: clean(&report.created),
            doubts: page::doubts(&report.doubts),
            headline: headline::build(report, &cast),
            bought: clean_prose(&report.bought),
            predicts: predicts(report),
            facts: page::facts(report.wall_seconds, &report.facts),
            links: page::links(&report.links),
            warnings,
            lines: rounds::lines(report),
            rounds,
            has,
            tracking: tracking::build(report, &cast),
            drift: drift::build(report, &cast),
            motion,
            settings: page::settings(&report.settings),
            versions: page::settings(&report.versions),
        }
    }
}

/// Returns the gain on walks that it did not see of the fit in which the policy was trained; empty beside a doubt.
fn predicts(report: &LoopReport) -> String {
    // Without a choice among the rounds the last one counts.
    let round = report.best.map_or(report.rounds.last(), |best| report.rounds.get(best));
    let held = round.and_then(|round| round.held_out.as_ref());
    let gain = held.and_then(held_out::gain).filter(|_| !page::is_severe(&report.doubts));
    gain.map_or(String::new(), |gain| held_out::gain_text(gain, "walks"))
}
