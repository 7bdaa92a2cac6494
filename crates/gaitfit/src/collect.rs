//! Logs of a policy in a simulator.

use crate::Error;
use crate::device::{self, Device, Gpu};
use crate::excite::playlist::{self, Sequence};
use crate::log_folder::LogWriter;
use crate::run::Owned;
use crate::walk::recorder::Recorded;
use crate::walk::simulator::script;
use crate::watch::{Amount, Watch};
use crate::world::{World, WorldSettings};
use gaitfit_learn::collect::{CollectOptions, Collected as Recording};
use gaitfit_learn::evaluate::Subject;
use gaitfit_learn::task::TaskError;
use gaitfit_log::{Gains, Trajectory, csv_files};
use gaitfit_model::shown_number;
use gaitfit_policy::follow;
use gaitfit_random::{Purpose, Stream};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Max number of rows of one call: a robot's take about a kilobyte each.
const MAX_ROWS: f64 = 2e7;
/// Max number of logs in a folder. Readers of folders stop there.
const MAX_LOGS: usize = 100_000;
/// Latest start of a log, s.
const LATEST: f64 = 10.0;

/// What a collection of logs records.
#[derive(Clone, Debug)]
pub struct CollectSettings {
    /// The policy and its simulator, with seed and threads.
    pub world: WorldSettings,
    /// Trajectories, one log each.
    pub trajectories: usize,
    /// Length of each, s.
    pub seconds: f64,
    /// Each log begins this long after the robot, drawn between the two, s.
    pub log_shift: [f64; 2],
    /// Whether logs have the base's position and velocity too, which a robot does not measure.
    pub privileged: bool,
    /// A file of commands to play, one sequence a trajectory, instead of drawing them.
    pub commands: Option<PathBuf>,
    /// What simulates.
    pub device: Device,
}

/// Logs that were recorded.
#[derive(Clone, Debug)]
pub struct Collected {
    /// The simulator in a few words.
    pub simulator: String,
    /// The logs, one a trajectory.
    pub files: Vec<PathBuf>,
    /// Robots that fell.
    pub falls: usize,
}

/// Runs a policy in a simulator and writes one log a trajectory into `folder`, which is made if it is not there.
///
/// # Errors
/// Files that cannot be read or do not fit each other, settings out of range, a folder that holds logs already or cannot
/// be written, or an interruption.
pub fn collect(settings: &CollectSettings, folder: &Path, watch: &Watch<'_>) -> Result<Collected, Error> {
    collect_in(World::open(&settings.world)?, settings, folder, watch)
}

/// As [`collect`], in a world that is open already.
///
/// # Errors
/// As there.
pub fn collect_in(
    world: World,
    settings: &CollectSettings,
    folder: &Path,
    watch: &Watch<'_>,
) -> Result<Collected, Error> {
    let world = plain_starts(world);
    world.warnings.iter().for_each(|warning| watch.note(warning));
    let CollectSettings { trajectories: count, seconds, log_shift: [low, high], privileged, .. } = *settings;
    // Written as a chain of `<=`, so that NaN is refused too.
    if !(0.0 <= low && low <= high && high <= LATEST) {
        return Err(Error::settings(format!(
            "`log_shift` (--log-shift) is {} {}: give two times from 0 to {LATEST} s, the shorter first",
            shown_number(low),
            shown_number(high)
        )));
    }
    // Settings and files are checked before the folder is touched.
    let played = settings.commands.as_deref().map(playlist::read).transpose()?;
    if settings.commands.is_some() && settings.world.randomised {
        return Err(Error::settings(
            "`commands` (--commands) are played by the robot as it is; leave `randomised` (--randomised) out",
        ));
    }
    // A file of commands has as many walks as sequences.
    let count = played.as_ref().map_or(count, Vec::len);
    check_length("`seconds` (--seconds)", count, seconds, world.scene.walker.interface.control_dt)?;
    settings.device.check()?;
    // A refusal leaves no lock in a folder with logs that no process has owned.
    if folder.is_dir() && !Owned::was_taken(folder) {
        check_no_logs(folder)?;
    }
    // Until the logs are written.
    let _owned = Owned::for_logs(folder)?;
    // Another process may have ended since the first check, and left logs.
    check_no_logs(folder)?;
    let options = CollectOptions { count, seconds, shift: [low, high], privileged };
    let threads = settings.world.threads();
    // Logs of the CPU go to the disk while others are simulated, so memory holds a few.
    let writer = LogWriter::new(folder, count)?;
    let recorded = match &played {
        Some(sequences) => {
            // Decided here: the number of sequences was not known when the device was chosen.
            let device = settings.device.for_trajectories(count);
            play(&world, &options, sequences, settings.world.seed, threads, device, watch)
                .and_then(|logs| writer.put_all(&logs))
        }
        None => {
            let subject = world.subject(settings.world.seed);
            write_walks(&subject, &options, threads, settings.device, watch, &writer)
        }
    };
    // Before the outcome is looked at: an interrupted simulation may end in any error.
    if watch.stop() {
        return Err(Error::interrupted_with_nothing("interrupted; no log was written"));
    }
    recorded?;
    let written = writer.finish()?;
    for number in &written.without {
        watch.note(&format!("trajectory {number} fell before its log began; it has no file"));
    }
    Ok(Collected { simulator: world.description(), files: written.files, falls: written.falls })
}

/// Refuses a folder that holds CSV files.
fn check_no_logs(folder: &Path) -> Result<(), Error> {
    if csv_files(folder)?.is_empty() {
        return Ok(());
    }
    Err(Error::settings(format!(
        "--out {}: holds CSV files already, and logs of two runs would be mixed; give another folder, or empty it",
        folder.display()
    )))
}

/// The world with robots that begin where a fit of their logs lets them begin. The logs of a policy that follows a motion and no
/// command would then all be one: its joints begin about the pose as the task says. A fit begins at a log's first angles.
fn plain_starts(world: World) -> World {
    let joints = world.scene.settings.start.joint_position;
    // Without commands and with equal starts, all walks would be the same walk.
    let alike = {
        let interface = &world.scene.walker.interface;
        interface.reference.is_some() && !interface.observes_command()
    };
    let mut world = world.with_plain_starts();
    if alike {
        world.scene.settings.start.joint_position = joints;
    }
    world
}

/// Logs of walks under random commands, simulated on `device`, or on the CPU if `auto` found a GPU that does not simulate
/// them.
///
/// # Errors
/// A robot that cannot be; a GPU that was asked for and does not simulate them, or fails; an interruption.
pub(crate) fn walks(
    subject: &Subject<'_>,
    options: &CollectOptions,
    threads: usize,
    device: Device,
    watch: &Watch<'_>,
) -> Result<Vec<Recording>, Error> {
    let cancel = || watch.stop();
    watch.shared(amount(subject, options), |moved| {
        let subject = Subject { cancel: Some(&cancel), moved: Some(moved), ..*subject };
        device.run(
            watch,
            |gpu| on_gpu(gpu, &subject, options, &cancel),
            || Ok(gaitfit_learn::collect::collect(&subject, options, threads)?),
        )
    })
}

/// Amount that there is to simulate, for progress.
fn amount(subject: &Subject<'_>, options: &CollectOptions) -> Amount<'static> {
    let period = subject.task.walker.interface.control_dt;
    Amount::simulated("logs: simulated second", options.periods(period), period)
}

/// As [`walks`], with each log written as soon as its tile is simulated, so that memory holds a few tiles.
fn write_walks(
    subject: &Subject<'_>,
    options: &CollectOptions,
    threads: usize,
    device: Device,
    watch: &Watch<'_>,
    writer: &LogWriter,
) -> Result<(), Error> {
    let cancel = || watch.stop();
    watch.shared(amount(subject, options), |moved| {
        let subject = Subject { cancel: Some(&cancel), moved: Some(moved), ..*subject };
        let put = |number, log| writer.put(number, &log);
        // A GPU records all logs at once, so they are written after it; the CPU writes tile by tile.
        device.run(
            watch,
            |gpu| writer.put_all(&on_gpu(gpu, &subject, options, &cancel)?),
            || gaitfit_learn::collect::collect_each(&subject, options, threads, put),
        )
    })
}

/// Logs from a GPU. One that was stopped has none.
fn on_gpu(
    gpu: &Gpu,
    subject: &Subject<'_>,
    options: &CollectOptions,
    cancel: &dyn Fn() -> bool,
) -> Result<Vec<Recording>, Error> {
    let logs = device::collect(gpu, subject, options, cancel)?;
    if cancel() { Err(TaskError::Interrupted.into()) } else { Ok(logs) }
}

/// Lets the policy walk under `sequences` and records it as `gaitfit_learn::collect` does.
fn play(
    world: &World,
    options: &CollectOptions,
    sequences: &[Sequence],
    seed: u64,
    threads: usize,
    device: Device,
    watch: &Watch<'_>,
) -> Result<Vec<Recording>, Error> {
    let walker = &world.scene.walker;
    let interface = &walker.interface;
    let dt = interface.control_dt;
    // Rounded, because 4.0 / 0.02 is not exactly 200 in f64.
    let period = |seconds: f64| (seconds / dt).round() as usize;
    let [low, high] = options.shift;
    // The log begins late by a random time, so that logs do not all begin with the same standing robot.
    let shift = |number: usize| {
        let draw = Stream::new(seed, Purpose::LOG_SHIFT).environment(number as u32).uniform(0);
        period(low + (high - low) * draw)
    };
    let samples = period(options.seconds).max(1);
    // A template lasts from the walk's start, and its first rows are cut off at the end.
    let template = |(number, sequence): (usize, &Sequence)| {
        let rows = shift(number) + samples;
        Trajectory {
            source: None,
            robot: Some(walker.model().name.clone()),
            joints: interface.joints.clone(),
            velocity_joints: interface.velocity_joints.clone(),
            time: (0..rows).map(|sample| sample as f64 * dt).collect(),
            rate_hz: 1.0 / dt,
            // Only times, commands and gains count. The walk that is simulated replaces the joints' signals.
            position: interface.default_pose.repeat(rows),
            velocity: vec![0.0; rows * interface.joints.len()],
            target: None,
            action: None,
            command: Some((0..rows).flat_map(|sample| sequence.at(sample as f64 * dt)).collect()),
            motion: None,
            base: None,
            gains: Some(Gains { kp: interface.kp.clone(), kd: interface.kd.clone() }),
            lead: None,
            simulated_step: Some(walker.physics_step()),
            fell: false,
        }
    };
    let templates: Vec<Trajectory> = sequences.iter().enumerate().map(template).collect();
    let scripts: Vec<_> = templates.iter().map(|one| script(walker, one)).collect();
    // Free walks: the robot is never set back to a logged state.
    let job = follow::Job { candidate: world.candidate.clone(), reset_every: None, seed };
    // Walks end on several threads and in any order; each has its place.
    let logs = Mutex::new(vec![None; scripts.len()]);
    let keep = |number: usize, track: &follow::Track| {
        let wide = |values: &[f32]| values.iter().map(|&value| f64::from(value)).collect::<Vec<f64>>();
        let made = Recorded::new(walker, &scripts[number], track);
        let fell_at = made.fell_at;
        let mut log = made.instead_of(&templates[number]);
        // A robot does not measure these, so a log has them only if that was asked for.
        if let Some(base) = log.base.as_mut().filter(|_| options.privileged) {
            base.position = Some(wide(&track.base_position));
            base.linear_velocity = Some(wide(&track.base_velocity));
        }
        logs.lock().unwrap_or_else(PoisonError::into_inner)[number] = Some((log, fell_at));
    };
    let amount = Amount { what: "log", parts: "logs", total: scripts.len(), pieces: scripts.len() };
    watch.shared(amount, |done| {
        let keep = |number: usize, track: &follow::Track| {
            keep(number, track);
            done(1);
        };
        let cancel = || watch.stop();
        device.run(
            watch,
            |gpu| device::follow(gpu, (walker, &world.policy), &scripts, &job, threads, &keep, &cancel),
            || {
                let keep = |_: usize, number: usize, track: &follow::Track| keep(number, track);
                let jobs = std::slice::from_ref(&job);
                Ok(follow::follow(walker, &world.policy, &scripts, jobs, threads, &keep, &cancel)?)
            },
        )
    })?;
    let logs = logs.into_inner().unwrap_or_else(PoisonError::into_inner);
    let cut = |(number, one): (usize, Option<(Trajectory, Option<usize>)>)| {
        // What is missing was not simulated: the watch stopped it.
        let (log, fell_at) = one?;
        // A robot that fell before its log began leaves an empty one.
        let end = fell_at.unwrap_or(log.len()).max(shift(number));
        let trajectory = log.slice(shift(number)..end).ok()?;
        // A slice keeps its times, and a log begins at 0.
        let time = (0..trajectory.len()).map(|sample| sample as f64 * dt).collect();
        let fell = fell_at.is_some();
        Some(Recording { trajectory: Trajectory { time, fell, ..trajectory }, fell })
    };
    Ok(logs.into_iter().enumerate().filter_map(cut).collect())
}

/// Refuses logs without a row, or of more rows than memory holds. `key`: the setting; `period`: of control, s.
///
/// # Errors
/// As it says.
pub fn check_length(key: &str, count: usize, seconds: f64, period: f64) -> Result<(), Error> {
    if count > MAX_LOGS {
        return Err(Error::settings(format!(
            "`trajectories` (--trajectories) is {count}: a folder of logs has at most {MAX_LOGS}; take fewer and longer ones"
        )));
    }
    let rows = count as f64 * seconds / period;
    // At least one row in each log. A comparison with NaN is false, so NaN is refused.
    if seconds > 0.0 && count > 0 && rows >= count as f64 && rows <= MAX_ROWS {
        return Ok(());
    }
    Err(Error::settings(format!(
        "{key} is {}: {count} trajectories of it are {} rows; give at least one a trajectory, at most {MAX_ROWS:.0}",
        shown_number(seconds),
        shown_number(rows.round())
    )))
}
