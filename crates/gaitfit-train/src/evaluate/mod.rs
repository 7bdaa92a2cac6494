//! Measurement of how well a policy walks in a simulator.

mod compare;
mod ground;
mod measure;
mod motion;
mod verdict;

pub use compare::{Better, Comparison, compare, of_few};
pub use ground::{GroundChoice, GroundResult, OnGround};
pub use measure::{DriftResult, Evaluation, Measured, Plan, TrajectoryErrors, measure};
pub use verdict::{MANY_FALLS, Verdict, goes_nowhere, verdict};

use crate::Error;
use crate::arrangement::{self, Diagnosis};
use crate::device::Device;
use crate::settings::MAX_DRIFT;
use crate::watch::Watch;
use crate::world::{World, WorldSettings};
use gaitfit_model::shown_number;
use std::time::Instant;

/// Length of a trajectory by default, s.
const SECONDS: f64 = 4.0;
/// Longest trajectory, s, and most control steps of one call.
const LONGEST: f64 = 3600.0;
const MAX_STEPS: f64 = 2e9;
/// Max number of robots on a cell of uneven ground.
const MAX_GROUND_ROBOTS: usize = 1000;

/// Settings of an evaluation.
#[derive(Clone, Debug)]
pub struct EvaluateSettings {
    /// The policy and its simulator, with seed and threads.
    pub world: WorldSettings,
    /// Trajectories with random commands.
    pub trajectories: usize,
    /// Length of each, s; without one 4, or as long as the motion that the policy follows.
    pub seconds: Option<f64>,
    /// Robots in each constant-command trial; 0 leaves them out.
    pub drift: usize,
    /// Speeds of these, m/s, m/s and rad/s; half of the task's greatest commands without them.
    pub drift_speeds: Option<[f64; 3]>,
    /// Uneven ground that is crossed besides.
    pub ground: GroundChoice,
    /// Robots on each of its cells.
    pub ground_robots: usize,
    /// What simulates; the CPU records the gait of one robot.
    pub device: Device,
    /// Whether other orders, signs and scales of joints are tried if the policy does not walk. It takes some seconds.
    pub diagnose: bool,
}

/// Results of an evaluation.
pub struct Evaluated {
    /// Measurements.
    pub measured: Measured,
    /// Whether it walks, where that can be said.
    pub verdict: Option<Verdict>,
    /// The policy and its simulator.
    pub world: World,
    /// Uneven ground, if there was any.
    pub ground: Option<OnGround>,
    /// An arrangement of joints, signs and scales with which it walks, where most robots fall.
    pub diagnosis: Option<Diagnosis>,
    /// Wall time, s.
    pub wall_seconds: f64,
}

/// Measures a policy in a simulator: trajectories with random commands, constant commands, the gait ahead, and crossings
/// of uneven ground. What to know before trusting the result is told to `watch`.
///
/// # Errors
/// Files that cannot be read or do not fit each other, settings out of range, or an interruption, which keeps nothing.
pub fn evaluate(settings: &EvaluateSettings, watch: &Watch<'_>) -> Result<Evaluated, Error> {
    evaluate_in(World::open(&settings.world)?, settings, watch)
}

/// As [`evaluate`], in a world that is open already.
///
/// # Errors
/// As there.
pub fn evaluate_in(world: World, settings: &EvaluateSettings, watch: &Watch<'_>) -> Result<Evaluated, Error> {
    world.warnings.iter().for_each(|warning| watch.note(warning));
    let EvaluateSettings { trajectories, drift, .. } = *settings;
    let interface = &world.scene.walker.interface;
    let period = interface.control_dt;
    // A motion is followed to its end once, unless a length is given.
    // A motion of one sample lasts 0 s, and a trajectory needs at least one control period.
    let whole = || motion::seconds(interface).map(|seconds| seconds.clamp(period, LONGEST));
    let seconds = settings.seconds.or_else(whole).unwrap_or(SECONDS);
    check_length("`seconds` (--seconds)", trajectories, seconds, period)?;
    if drift > MAX_DRIFT {
        return Err(Error::settings(format!(
            "`drift` (--drift) is {drift}: give at most {MAX_DRIFT} robots"
        )));
    }
    check_speeds("`drift_speeds` (--drift-speeds)", settings.drift_speeds)?;
    if !(1..=MAX_GROUND_ROBOTS).contains(&settings.ground_robots) {
        return Err(Error::settings(format!(
            "`ground_robots` (--terrain-robots) is {}: give 1 to {MAX_GROUND_ROBOTS} robots a cell",
            settings.ground_robots
        )));
    }
    // Opened before anything is measured, so that wrong settings are told at once.
    let uneven = ground::open(&settings.world, &settings.ground, &world.policy)?;
    let begun = Instant::now();
    // A GPU stays open from one measurement to the next.
    let _gpu = settings.device.for_trajectories(trajectories.max(drift)).open()?;
    let plan = Plan {
        trajectories,
        seconds,
        drift,
        drift_speeds: settings.drift_speeds,
        seed: settings.world.seed,
        threads: settings.world.threads(),
        device: settings.device,
    };
    let mut measured = measure(&world, &settings.world.policy.display().to_string(), &plan, watch)?;
    let robots = settings.ground_robots;
    let ground = uneven.map(|uneven| ground::measure(uneven, robots, &plan, watch)).transpose()?;
    if let Some(ground) = &ground {
        measured.evaluation.ground.clone_from(&ground.results);
    }
    // The verdict is about walks under random commands; uneven ground does not count.
    let verdict = verdict(&measured.evaluation, &world.scene.settings.command);
    // Robots that stand on legs in a wrong order need not fall.
    let fails = verdict.as_ref().is_some_and(|one| !one.walks);
    let fails = fails || measured.evaluation.fall_rate.mean > MANY_FALLS;
    let diagnosis = match settings.diagnose && fails {
        true => arrangement::of_walk(&world, plan.seed, plan.threads, watch),
        false => None,
    };
    go_on(watch)?;
    let wall_seconds = begun.elapsed().as_secs_f64();
    Ok(Evaluated { measured, verdict, world, ground, diagnosis, wall_seconds })
}

/// An error once the caller has asked to stop.
fn go_on(watch: &Watch<'_>) -> Result<(), Error> {
    match watch.stop() {
        true => Err(Error::interrupted_with_nothing("interrupted; this evaluation is not kept")),
        false => Ok(()),
    }
}

/// Fastest command of a drift trial, m/s and rad/s.
const FASTEST: f64 = 100.0;

/// Refuses commands of drift trials that cannot be. `key`: the setting.
///
/// # Errors
/// Settings out of range.
pub fn check_speeds(key: &str, speeds: Option<[f64; 3]>) -> Result<(), Error> {
    match speeds.into_iter().flatten().find(|speed| !(0.0..=FASTEST).contains(speed)) {
        Some(speed) => Err(Error::settings(format!(
            "{key} has {}: give three speeds from 0 to {FASTEST}: ahead and to the side, m/s, and turning, rad/s",
            shown_number(speed)
        ))),
        None => Ok(()),
    }
}

/// Refuses trajectories that nothing can be measured of, or that would never end. `key`: the setting; `period`: of
/// control, s.
///
/// # Errors
/// Settings out of range.
pub fn check_length(key: &str, trajectories: usize, seconds: f64, period: f64) -> Result<(), Error> {
    // In floating point, because the product of large settings would overflow a whole number.
    let steps = trajectories as f64 * seconds / period;
    // NaN fails every comparison, so it is refused too.
    if trajectories > 0 && seconds >= period && seconds <= LONGEST && steps <= MAX_STEPS {
        return Ok(());
    }
    Err(Error::settings(format!(
        "{key} is {} for {trajectories} trajectories: give a time from {period} s, one control period, to {LONGEST} s, at \
         least one trajectory, and at most {MAX_STEPS:.0e} control steps in all",
        shown_number(seconds)
    )))
}
