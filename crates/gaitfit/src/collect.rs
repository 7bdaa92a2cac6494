//! Logs of a policy in a simulator.

use crate::log_folder::write_logs;
use crate::watch::Watch;
use crate::world::{World, WorldSettings};
use crate::{Access, Error};
use gaitfit_learn::collect::CollectOptions;
use gaitfit_log::csv_files;
use gaitfit_model::shown_number;
use std::path::{Path, PathBuf};

/// Most rows of one call: a robot's take about a kilobyte each.
const MOST_ROWS: f64 = 2e7;
/// Latest start of a log, s.
const LATEST: f64 = 10.0;

/// What is recorded.
#[derive(Clone, Debug)]
pub struct CollectSettings {
    /// The policy and its simulator, with seed and threads.
    pub world: WorldSettings,
    /// Trajectories.
    pub trajectories: usize,
    /// Length of each, s.
    pub seconds: f64,
    /// Each log begins this long after the robot, drawn between the two, s.
    pub log_shift: [f64; 2],
    /// Whether logs have the base's pose and velocity too, which a robot does not measure.
    pub privileged: bool,
}

/// What was recorded.
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
    let world = World::open(&settings.world)?.with_plain_starts();
    world.warnings.iter().for_each(|warning| watch.note(warning));
    let CollectSettings { trajectories: count, seconds, log_shift: [low, high], privileged, .. } = *settings;
    if !(0.0 <= low && low <= high && high <= LATEST) {
        return Err(Error::settings(format!(
            "`log_shift` (--log-shift) is {} {}: give two times from 0 to {LATEST} s, the shorter first",
            shown_number(low),
            shown_number(high)
        )));
    }
    check_length("`seconds` (--seconds)", count, seconds, world.scene.walker.interface.control_dt)?;
    if folder.is_dir() && !csv_files(folder)?.is_empty() {
        return Err(Error::settings(format!(
            "--out {}: holds CSV files already, and logs of two runs would be mixed; give another folder, or empty it",
            folder.display()
        )));
    }
    std::fs::create_dir_all(folder).map_err(|source| Error::File {
        access: Access::Make,
        path: folder.to_owned(),
        source,
        remedy: String::new(),
    })?;
    let options = CollectOptions { count, seconds, shift: [low, high], privileged };
    let threads = settings.world.threads();
    let logs = gaitfit_learn::collect::collect(&world.subject(settings.world.seed), &options, threads)?;
    if watch.stop() {
        return Err(Error::Interrupted { message: "interrupted; no log was written".to_owned(), kept: None });
    }
    let written = write_logs(folder, &logs)?;
    for number in &written.without {
        watch.note(&format!("trajectory {number} fell before its log began; it has no file"));
    }
    Ok(Collected { simulator: world.description(), files: written.files, falls: written.falls })
}

/// Refuses logs without a row, or of more rows than memory holds. `key`: the setting; `period`: of control, s.
///
/// # Errors
/// As it says.
pub fn check_length(key: &str, count: usize, seconds: f64, period: f64) -> Result<(), Error> {
    let rows = count as f64 * seconds / period;
    if seconds > 0.0 && count > 0 && rows >= count as f64 && rows <= MOST_ROWS {
        return Ok(());
    }
    Err(Error::settings(format!(
        "{key} is {}: {count} trajectories of it are {} rows; give at least one a trajectory, at most {MOST_ROWS:.0}",
        shown_number(seconds),
        shown_number(rows.round())
    )))
}
