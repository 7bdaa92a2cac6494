//! Uneven ground in an evaluation: which, and how robots cross it.

use super::Plan;
use crate::Error;
use crate::device;
use crate::files::read_text;
use crate::robot_file;
use crate::watch::{Amount, Watch};
use crate::world::{self, World, WorldSettings};
use gaitfit_learn::evaluate::{CrossingSummary, Subject, crossing_size, crossings, summarise_crossings};
use gaitfit_learn::task::{Cell, Kinds, TerrainKind, TerrainSettings};
use gaitfit_model::shown;
use gaitfit_policy::Policy;
use gaitfit_view::Estimate;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Uneven ground that a policy is measured on.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum GroundChoice {
    /// The task's ground, if it has some.
    #[default]
    Own,
    /// None.
    Flat,
    /// Other ground.
    Of {
        /// Its settings.
        settings: Box<TerrainSettings>,
        /// The file that they are from, for messages.
        file: Option<String>,
    },
}

/// Columns of each kind where kinds are named: as many pits as pyramids.
const COLUMNS: usize = 2;
/// Largest file of ground, bytes.
const MAX_BYTES: u64 = 1 << 20;

impl GroundChoice {
    /// Reads the command line's value: `own`, `none`, kinds such as `stairs,rough`, or a TOML file whose
    /// `[terrain]` or `[task.terrain]` counts, or else the whole of it.
    ///
    /// # Errors
    /// An unknown kind, a file that cannot be read.
    pub fn read(text: &str) -> Result<Self, Error> {
        match text {
            "own" => return Ok(Self::Own),
            "none" => return Ok(Self::Flat),
            _ => {}
        }
        if text.ends_with(".toml") {
            let settings = Self::file(Path::new(text))?;
            return Ok(Self::Of { settings: Box::new(settings), file: Some(text.to_owned()) });
        }
        let mut shares = IndexMap::new();
        for kind in text.split(',') {
            let kind: TerrainKind = kind.trim().parse().map_err(|wrong| {
                Error::settings(format!(
                    "--terrain: {wrong}; give kinds with commas between, a .toml file, `own` or `none`"
                ))
            })?;
            shares.insert(kind, 1.0);
        }
        // As many columns for each kind, whatever their number.
        let columns = COLUMNS * shares.len();
        let settings = TerrainSettings { columns, ..TerrainSettings::with_kind(Kinds::Shares(shares)) };
        Ok(Self::Of { settings: Box::new(settings), file: None })
    }

    /// An error about the task's terrain, with the file that the terrain is from.
    fn named(&self, error: Error) -> Error {
        match self {
            Self::Of { file: Some(file), .. } if error.to_string().contains("terrain.") => {
                // The message names the setting as the file of --terrain does.
                let what = error.to_string().replace("task.terrain.", "terrain.");
                Error::settings(format!("--terrain {}: {what}", shown(file)))
            }
            _ => error,
        }
    }

    fn file(path: &Path) -> Result<TerrainSettings, Error> {
        let wrong = |error: &dyn std::fmt::Display| {
            Error::settings(format!("--terrain {}: {error}", shown(&path.display().to_string())))
        };
        let text = read_text(path, MAX_BYTES).map_err(|error| wrong(&error))?;
        let mut table: toml::Table = toml::from_str(&text).map_err(|error| wrong(&error))?;
        // The file may be a training's configuration or a task, which have the terrain in a table.
        if let Some(toml::Value::Table(task)) = table.remove("task") {
            table = task;
        }
        if let Some(toml::Value::Table(terrain)) = table.remove("terrain") {
            table = terrain;
        }
        table.try_into().map_err(|error| wrong(&error))
    }

    /// The ground, for a task that has `own`.
    fn settings(&self, own: Option<TerrainSettings>) -> Option<TerrainSettings> {
        match self {
            Self::Own => own,
            Self::Flat => None,
            Self::Of { settings, .. } => Some((**settings).clone()),
        }
    }
}

/// Robots on one kind and level of ground; see [`CrossingSummary`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroundResult {
    /// Kind of ground, and for slopes and stairs whether they lead up or down from the start.
    pub ground: String,
    /// Level, from 0.
    pub level: usize,
    /// Height of a step (m), slope (rise over run) or roughness (m).
    pub difficulty: f64,
    /// Robots.
    pub robots: usize,
    /// Share that left their cell without a fall.
    pub crossed: Estimate,
    /// Share that fell.
    pub fall_rate: Estimate,
    /// Mean distance from the start over the time it took, m/s.
    pub speed: Estimate,
}

impl GroundResult {
    fn new(summary: CrossingSummary) -> Self {
        let estimate = |estimate: Option<gaitfit_sim::stats::Estimate>| {
            estimate.map_or_else(Estimate::default, |one| Estimate {
                mean: one.mean,
                ci95: one.ci95.unwrap_or(f64::NAN),
            })
        };
        Self {
            ground: format!("{} {}", summary.kind.name(), summary.direction).trim_end().to_owned(),
            level: summary.level,
            difficulty: summary.difficulty,
            robots: summary.robots,
            crossed: estimate(summary.crossed),
            fall_rate: estimate(summary.fell),
            speed: estimate(summary.speed),
        }
    }

    /// Its difficulty, in words.
    pub fn difficulty_text(&self) -> String {
        let centimetres = 100.0 * self.difficulty;
        match self.ground.split(' ').next() {
            Some("stairs") => format!("steps of {centimetres:.1} cm"),
            Some("slopes") => format!("slope of {:.0} %", centimetres),
            Some("rough") => format!("± {centimetres:.1} cm"),
            _ => "level".to_owned(),
        }
    }
}

/// A policy on uneven ground.
pub struct OnGround {
    /// Policy and simulator.
    pub world: World,
    /// Kind by kind, level by level.
    pub results: Vec<GroundResult>,
    /// Speed that was commanded, m/s.
    pub speed: f64,
}

/// The world of uneven ground that is asked for; `None` if there is no such ground.
///
/// # Errors
/// Settings out of range, or a robot that cannot be on it.
pub(super) fn open(
    args: &WorldSettings,
    choice: &GroundChoice,
    policy: &Policy,
) -> Result<Option<World>, Error> {
    let (args, _) = robot_file::settled(args, policy)?;
    let args = &args;
    let mut settings = world::task(args, policy)?;
    let Some(terrain) = choice.settings(settings.terrain.take()) else { return Ok(None) };
    settings = args.of_robots(settings);
    settings.terrain = Some(terrain);
    World::with_task(args, policy.clone(), settings).map(Some).map_err(|error| choice.named(error))
}

/// Sends `robots` robots a cell ahead, at half the task's greatest speed.
///
/// # Errors
/// A task without a command ahead, a robot that cannot be, or an interruption.
pub(super) fn measure(
    world: World,
    robots: usize,
    plan: &Plan,
    watch: &Watch<'_>,
) -> Result<OnGround, Error> {
    let speed = 0.5 * world.scene.settings.command.x[1];
    if speed.is_nan() || speed <= 0.0 {
        return Err(Error::settings(
            "uneven ground is crossed at half of the largest command.x, and the task has no command.x above 0; give \
             --terrain none",
        ));
    }
    let cancel = || watch.stop();
    let subject = Subject { cancel: Some(&cancel), ..world.subject(plan.seed) };
    let (count, steps) = crossing_size(&world.scene, robots, speed);
    let periods = count * steps as usize;
    // Progress is counted in control periods and shown in simulated seconds.
    let period = world.scene.walker.interface.control_dt;
    let crossings =
        watch.shared(Amount::simulated("uneven ground: simulated second", periods, period), |moved| {
            let subject = Subject { moved: Some(moved), ..subject };
            plan.device.for_trajectories(count).run(
                watch,
                |gpu| device::crossings(gpu, &subject, robots, speed, &cancel),
                || Ok(crossings(&subject, robots, speed, plan.threads)?),
            )
        });
    // First of all: after an interruption the measurement is an error whose text would mislead.
    super::go_on(watch)?;
    let crossings = crossings?;
    let results = match &world.scene.course {
        Some(course) => summarise_crossings(course, &crossings).into_iter().map(GroundResult::new).collect(),
        None => Vec::new(),
    };
    Ok(OnGround { world, results, speed })
}

impl OnGround {
    /// The cell to show: of the first kind, on the last level that at least half of the robots cross, or the first.
    pub fn cell(&self) -> Cell {
        let Some(first) = self.results.first() else { return Cell::default() };
        // Level 0 is shown even if most robots fail there.
        let mut level = 0;
        for result in self.results.iter().take_while(|result| result.ground == first.ground) {
            // Levels grow harder, so the first that fails ends the search.
            if result.crossed.mean < 0.5 {
                break;
            }
            level = result.level;
        }
        Cell { level, column: 0 }
    }
}
