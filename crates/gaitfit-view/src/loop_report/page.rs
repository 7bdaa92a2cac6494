//! The page as the template sees it: text and pictures, ready to be placed.

use super::LoopReport;
use super::drift::{self, DriftSection};
use super::headline::{self, Headline};
use super::policies::Cast;
use super::rounds::{self, RoundLine, RoundSection};
use super::tracking::{self, TrackingSection};
use crate::format::{clean, clean_prose};
use crate::page::{self, Setting, ShownDoubt, ShownLink};
use crate::replay::{Player, Replay, ReplayError};
use serde::Serialize;

/// Robots and frames of the replay at most: two minutes at 50 Hz.
const MOST_ROBOTS: usize = 4;
const MOST_FRAMES: usize = 6000;

/// The whole page.
#[derive(Serialize)]
pub(super) struct Page {
    title: String,
    robot: String,
    created: String,
    doubts: Vec<ShownDoubt>,
    headline: Option<Headline>,
    bought: String,
    facts: Vec<Setting>,
    links: Vec<ShownLink>,
    warnings: Vec<String>,
    lines: Vec<RoundLine>,
    rounds: Vec<RoundSection>,
    has: Has,
    tracking: Option<TrackingSection>,
    drift: Vec<DriftSection>,
    player: Option<Player>,
    motion_note: String,
    settings: Vec<Setting>,
    versions: Vec<Setting>,
}

/// Which sections that speak of rounds have anything to say.
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
        let (player, problem) = match report.replay.as_ref().map(player) {
            None => (None, None),
            Some(Ok(player)) => (Some(player), None),
            Some(Err(why)) => (None, Some(why.to_string())),
        };
        let mut warnings = page::lines(&report.warnings);
        warnings.extend(problem.map(|why: String| format!("The page has no replay: {}.", clean_prose(&why))));
        Page {
            title: clean(&report.title),
            robot: clean(&report.robot),
            created: clean(&report.created),
            doubts: page::doubts(&report.doubts),
            headline: headline::build(report, &cast),
            bought: clean_prose(&report.bought),
            facts: page::facts(report.wall_seconds, &report.facts),
            links: page::links(&report.links),
            warnings,
            lines: rounds::lines(report),
            rounds,
            has,
            tracking: tracking::build(report, &cast),
            drift: drift::build(report, &cast),
            motion_note: report.replay.as_ref().map_or(String::new(), |r| clean_prose(&r.note)),
            player,
            settings: page::settings(&report.settings),
            versions: page::settings(&report.versions),
        }
    }
}

/// The replay cut to what a report holds.
fn player(replay: &Replay) -> Result<Player, ReplayError> {
    let robots = replay.robots.iter().take(MOST_ROBOTS).map(|robot| {
        let frames = robot.frames.iter().take(MOST_FRAMES).cloned().collect();
        crate::replay::ReplayRobot {
            name: robot.name.clone(),
            bodies: robot.bodies.clone(),
            geoms: robot.geoms.clone(),
            feet: robot.feet.clone(),
            ground: robot.ground.clone(),
            frames,
        }
    });
    Player::new(&Replay { dt: replay.dt, robots: robots.collect(), ..Replay::default() }, true)
}
