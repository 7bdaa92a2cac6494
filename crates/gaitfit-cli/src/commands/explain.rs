//! `gaitfit explain`: what a robot has that its model lacks, by its walks.

use crate::cli::Explain;
use crate::commands::inspect::{log, swings as look};
use crate::exit::Failure;
use crate::watcher::watched;
use crate::{output, swings};
use gaitfit::robot;
use gaitfit::walk::explain::{Cause, causes};
use gaitfit::walk::swing::SwingFindings;
use gaitfit::watch::{Count, Watch};
use gaitfit_log::{
    CheckSpec, ReadOptions, Severity, Trajectory, csv_files, read_csv, read_csv_report, summarise_folder,
};
use gaitfit_model::{argument, counted};
use serde::Serialize;
use std::fmt::Write as _;
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
    /// Logs that were read, and those that were left out.
    read: usize,
    left_out: usize,
    causes: &'a [Cause],
    without_simulation: &'a SwingFindings,
}

/// What logs show, and how many of them.
struct Looked {
    found: SwingFindings,
    read: usize,
    seconds: f64,
    left_out: usize,
}

impl Looked {
    fn document<'a>(&'a self, robot: &Path, logs: &Path, causes: &'a [Cause]) -> Document<'a> {
        Document {
            logs: logs.display().to_string(),
            robot: robot.display().to_string(),
            read: self.read,
            left_out: self.left_out,
            causes,
            without_simulation: &self.found,
        }
    }

    /// The logs behind the result, in a line.
    fn line(&self, logs: &Path) -> String {
        let mut line = format!("From {} ({:.0} s)", counted(self.read, "log"), self.seconds);
        if self.left_out > 0 {
            let _ = write!(
                line,
                "; {} left out: they have errors, or are more than are looked at. `gaitfit inspect {}` prints errors",
                counted(self.left_out, "log"),
                argument(logs)
            );
        }
        line + ".\n"
    }
}

/// What logs show of a robot without a simulation, or why they show nothing.
fn findings(robot: &Path, logs: &Path, lenient: bool, watch: &Watch<'_>) -> Result<Looked, Failure> {
    let path = Some(robot);
    let model = robot::named(robot, lenient)?;
    let (all, used) = if logs.is_dir() {
        let spec = |log: &Trajectory| CheckSpec::of_robot(&model, &log.joints);
        let read = |count: &mut Count<'_>| summarise_folder(logs, &ReadOptions::default(), &spec, count);
        let summary = watch.counted("log", "logs", read).map_err(Failure::failed)?;
        (summary.logs.len(), look::usable(&summary))
    } else {
        let (log, report) = read_csv_report(logs, &ReadOptions::default()).map_err(Failure::failed)?;
        let findings = log::findings(&log, &report, Some(&model));
        if let Some(error) = findings.iter().find(|finding| finding.severity == Severity::Error) {
            return Err(Failure::failed(format!(
                "{}: {error}. `gaitfit inspect` shows the log",
                logs.display()
            )));
        }
        (1, vec![log])
    };
    let found = look::look(path, lenient, &used.iter().collect::<Vec<_>>(), watch)?;
    let found = found.ok_or_else(|| {
        Failure::failed(format!(
            "{}: none of the logs can be explained: {}",
            logs.display(),
            look::lacks(&model, first_log(logs).as_ref(), robot)
        ))
    })?;
    let seconds =
        |log: &Trajectory| log.time.last().zip(log.time.first()).map_or(0.0, |(last, first)| last - first);
    let looked = Looked {
        read: used.len(),
        seconds: used.iter().map(seconds).sum(),
        left_out: all.saturating_sub(used.len()),
        found,
    };
    match (&looked.found.swings, &looked.found.why_not) {
        (None, Some(why)) => {
            Err(Failure::failed(format!("{}: {why}. {}", logs.display(), looked.line(logs).trim_end())))
        }
        _ => Ok(looked),
    }
}

/// The document that `--json` prints.
///
/// # Errors
/// Files that cannot be used, in a sentence.
pub fn document(robot: &Path, logs: &Path, lenient: bool, watch: &Watch<'_>) -> Result<String, Failure> {
    let looked = findings(robot, logs, lenient, watch)?;
    serde_json::to_string(&looked.document(robot, logs, &causes(&looked.found))).map_err(Failure::failed)
}

/// Prints the causes that the logs show, the weightiest first. A log that must not be used is refused, and left out of a
/// folder.
pub fn run(args: &Explain) -> Result<(), Failure> {
    let looked = watched(look::LINES, |watch| findings(&args.robot, &args.logs, args.lenient, watch))?;
    let causes = causes(&looked.found);
    if args.json {
        return output::print_json(&looked.document(&args.robot, &args.logs, &causes));
    }
    output::print(&format!("{}{}", swings::causes(&causes), looked.line(&args.logs)))
}
