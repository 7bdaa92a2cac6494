//! `gaitfit explain`: what a robot has that its model lacks, by its walks.

use crate::cli::Explain;
use crate::commands::inspect::{log, swings as look};
use crate::exit::Failure;
use crate::{output, swings};
use gaitfit::robot;
use gaitfit::walk::explain::{Cause, causes};
use gaitfit::walk::swing::SwingFindings;
use gaitfit_log::{
    CheckSpec, ReadOptions, Severity, Trajectory, csv_files, read_csv, read_csv_report, summarise_folder,
};
use serde::Serialize;
use std::ops::ControlFlow;
use std::path::Path;

/// The log, or the first log of a folder that can be read.
fn first_log(path: &Path) -> Option<Trajectory> {
    let files = if path.is_dir() { csv_files(path).unwrap_or_default() } else { vec![path.to_owned()] };
    files.iter().find_map(|file| read_csv(file, &ReadOptions::default()).ok())
}

#[derive(Serialize)]
struct Document<'a> {
    logs: String,
    robot: String,
    causes: &'a [Cause],
    without_simulation: &'a SwingFindings,
}

/// What logs show of a robot without a simulation, or why they show nothing.
fn findings(robot: &Path, logs: &Path, lenient: bool) -> Result<SwingFindings, Failure> {
    let path = Some(robot);
    let model = robot::named(robot, lenient)?;
    let found = if logs.is_dir() {
        let spec = |log: &Trajectory| CheckSpec::of_robot(&model, &log.joints);
        let mut progress = |_, _| ControlFlow::Continue(());
        let summary =
            summarise_folder(logs, &ReadOptions::default(), &spec, &mut progress).map_err(Failure::failed)?;
        look::of_folder(path, lenient, &summary)?
    } else {
        let (log, report) = read_csv_report(logs, &ReadOptions::default()).map_err(Failure::failed)?;
        let findings = log::findings(&log, &report, Some(&model));
        if let Some(error) = findings.iter().find(|finding| finding.severity == Severity::Error) {
            return Err(Failure::failed(format!(
                "{}: {error}. `gaitfit inspect` shows the log",
                logs.display()
            )));
        }
        look::look(path, lenient, &[&log])?
    };
    let found = found.ok_or_else(|| {
        Failure::failed(format!(
            "{}: none of the logs can be explained: {}",
            logs.display(),
            look::lacks(&model, first_log(logs).as_ref(), robot)
        ))
    })?;
    match (&found.swings, &found.why_not) {
        (None, Some(why)) => Err(Failure::failed(format!("{}: {why}", logs.display()))),
        _ => Ok(found),
    }
}

/// The document that `--json` prints.
///
/// # Errors
/// Files that cannot be used, in a sentence.
pub fn document(robot: &Path, logs: &Path, lenient: bool) -> Result<String, Failure> {
    let found = findings(robot, logs, lenient)?;
    serde_json::to_string(&Document {
        logs: logs.display().to_string(),
        robot: robot.display().to_string(),
        causes: &causes(&found),
        without_simulation: &found,
    })
    .map_err(Failure::failed)
}

/// Prints the causes that the logs show, the weightiest first. A log that must not be used is refused, and left out of a
/// folder.
pub fn run(args: &Explain) -> Result<(), Failure> {
    let found = findings(&args.robot, &args.logs, args.lenient)?;
    let causes = causes(&found);
    if args.json {
        return output::print_json(&Document {
            logs: args.logs.display().to_string(),
            robot: args.robot.display().to_string(),
            causes: &causes,
            without_simulation: &found,
        });
    }
    output::print(&swings::causes(&causes))
}
