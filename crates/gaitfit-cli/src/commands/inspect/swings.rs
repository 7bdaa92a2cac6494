//! What walking logs show of joints and sensors without a simulation.

use crate::exit::Failure;
use crate::progress::Lines;
use crate::watcher::watched;
use crate::{output, swings};
use gaitfit::walk::explain::causes;
use gaitfit::walk::swing::{SwingFindings, SwingSettings};
use gaitfit::watch::Watch;
use gaitfit::{machine, robot};
use gaitfit_log::{FolderSummary, LogContent, ReadOptions, Severity, Trajectory, read_csv};
use gaitfit_model::{Model, Root, shown};
use std::path::Path;

/// Logs of a folder that are looked at, the first ones: enough for small errors in little time.
const LOGS: usize = 64;
/// How often a line reports the progress where there is no terminal.
pub const LINES: Lines = Lines::Seconds(5);

/// The findings from logs of the named robot, if its base floats and the logs have an inertial unit's signals.
pub fn look(
    robot: Option<&Path>,
    lenient: bool,
    logs: &[&Trajectory],
    watch: &Watch<'_>,
) -> Result<Option<SwingFindings>, Failure> {
    let Some(path) = robot else { return Ok(None) };
    let model = robot::named(path, lenient)?;
    let walks: Vec<&Trajectory> = logs
        .iter()
        .copied()
        .filter(|log| {
            let base = log.base.as_ref();
            // Inverse dynamics of a leg need the base's orientation and rates, and a joint of the robot for each
            // column.
            base.is_some_and(|base| base.quaternion.is_some() && base.angular_velocity.is_some())
                && log.joints.iter().all(|joint| model.find_joint(joint).is_some())
        })
        .collect();
    if model.root != Root::Floating || walks.is_empty() {
        return Ok(None);
    }
    let settings = SwingSettings { threads: machine::threads(), ..SwingSettings::default() };
    Ok(Some(SwingFindings::new(&model, &walks, &settings, watch)))
}

/// Why no log was used, and what to do. `log`: the first that could be read; `robot`: the file of `model`.
pub fn lacks(model: &Model, log: Option<&Trajectory>, robot: &Path) -> String {
    let Some(log) = log else { return "no CSV log can be read; `gaitfit inspect` prints why".to_owned() };
    if model.root != Root::Floating {
        return format!(
            "the base of {} is fixed, and `gaitfit explain` needs walks; for legs in the air, `gaitfit fit` names what the \
             model lacks",
            robot.display()
        );
    }
    if let Some(joint) = log.joints.iter().find(|joint| model.find_joint(joint).is_none()) {
        return format!(
            "{} has no joint `{}`; name the robot file that the log was made with",
            robot.display(),
            shown(joint)
        );
    }
    let base = log.base.as_ref();
    let [turned, rates] = [
        base.is_some_and(|base| base.quaternion.is_some()),
        base.is_some_and(|base| base.angular_velocity.is_some()),
    ];
    let mut missing = Vec::new();
    if !turned {
        missing.push(
            "orientation (columns base_quat_w, base_quat_x, base_quat_y, base_quat_z, or roll, pitch, yaw)",
        );
    }
    if !rates {
        missing.push("body rates (columns wx, wy, wz)");
    }
    if missing.is_empty() {
        return "no log is free of errors; `gaitfit inspect` names them".to_owned();
    }
    format!(
        "the logs lack the {} of the inertial unit: record them, or join them from another recording (`gaitfit import`). \
         `gaitfit fit` needs neither, but is less certain what the model lacks",
        missing.join(" and the ")
    )
}

/// The findings from the usable logs of a folder.
pub fn of_folder(
    robot: Option<&Path>,
    lenient: bool,
    summary: &FolderSummary,
) -> Result<Option<SwingFindings>, Failure> {
    if robot.is_none() {
        return Ok(None);
    }
    let logs = usable(summary);
    watched(LINES, |watch| look(robot, lenient, &logs.iter().collect::<Vec<_>>(), watch))
}

/// The first logs of a folder that have no error.
pub fn usable(summary: &FolderSummary) -> Vec<Trajectory> {
    let sound = |content: &LogContent| matches!(content, LogContent::Log { worst, .. } if *worst != Some(Severity::Error));
    let sound = summary.logs.iter().filter(|log| sound(&log.content)).take(LOGS);
    // Read a second time: a summary does not keep the signals of all logs in memory.
    sound.filter_map(|log| read_csv(&log.path, &ReadOptions::default()).ok()).collect()
}

/// Prints the tables.
pub fn print(findings: Option<&SwingFindings>) -> Result<(), Failure> {
    match findings {
        Some(findings) => output::print(&format!("\n{}\n", swings::text(findings, &causes(findings), &[]))),
        None => Ok(()),
    }
}
