//! A folder of logs at a glance, and what is wrong with how many of them.

use super::{log, number, swings};
use crate::cli::Inspect;
use crate::exit::{Exit, Failure};
use crate::output;
use crate::table::table;
use gaitfit::robot;
use gaitfit::walk::swing::SwingFindings;
use gaitfit_log::{CheckSpec, FolderSummary, LogContent, ReadOptions, Severity, read_csv, summarise_folder};
use gaitfit_model::{counted, shown, shown_path};
use serde::Serialize;
use std::fmt::Write;
use std::ops::ControlFlow;
use std::path::Path;

#[derive(Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    summary: &'a FolderSummary,
    #[serde(skip_serializing_if = "Option::is_none")]
    without_simulation: Option<SwingFindings>,
}

/// Logs whose names a finding lists.
const NAMED: usize = 3;

/// Prints what the logs of a folder share and what is wrong with them. A log that must not be used, or cannot be read,
/// ends with exit code 3.
pub fn run(args: &Inspect) -> Result<(), Failure> {
    let robot = match &args.robot {
        None => None,
        Some(path) => Some(robot::named(path, args.lenient)?),
    };
    let spec = |log: &gaitfit_log::Trajectory| {
        robot.as_ref().map_or_else(CheckSpec::default, |robot| CheckSpec::of_robot(robot, &log.joints))
    };
    // Ctrl-C ends this command at once, so nothing must be asked here.
    let mut progress = |_, _| ControlFlow::Continue(());
    let summary = summarise_folder(&args.file, &ReadOptions::default(), &spec, &mut progress)
        .map_err(Failure::failed)?;
    let swings = swings::of_folder(args.robot.as_deref(), args.lenient, &summary)?;
    if args.json {
        output::print_json(&Document { summary: &summary, without_simulation: swings })?
    } else {
        output::print(&text(&summary))?;
        swings::print(swings.as_ref())?
    };
    // Counted after printing: the table names the logs, and the exit code follows.
    let bad = summary
        .logs
        .iter()
        .filter(|log| {
            matches!(
                log.content,
                LogContent::Unreadable(_) | LogContent::Log { worst: Some(Severity::Error), .. }
            )
        })
        .count();
    if bad > 0 {
        let message = format!(
            "{}: {bad} of {} must not be used as they are",
            shown_path(&args.file),
            counted(summary.logs.len(), "log")
        );
        return Err(Failure { exit: Exit::Check, message });
    }
    // No log is bad here, so the first one can stand for all.
    let first = summary.logs.first().and_then(|log| read_csv(&log.path, &ReadOptions::default()).ok());
    match first.filter(|_| !args.json) {
        Some(first) => output::next(&[log::next(args, &first)]),
        None => Ok(()),
    }
}

fn text(summary: &FolderSummary) -> String {
    let joined = |names: &mut dyn Iterator<Item = &String>| -> String {
        names.map(|name| shown(name)).collect::<Vec<_>>().join(", ")
    };
    let rates: Vec<String> = summary
        .rates
        .iter()
        .map(|rate| format!("{} Hz ({})", number(Some(rate.rate_hz)), counted(rate.logs, "log")))
        .collect();
    let mut text = format!(
        "{}: {}, {} in {} s\n",
        shown_path(&summary.folder),
        counted(summary.logs.len(), "log"),
        counted(summary.samples, "sample"),
        number(Some(summary.duration_s))
    );
    for (what, names) in [
        ("robot", joined(&mut summary.robots.iter())),
        ("rate", rates.join(", ")),
        ("joints of every log", joined(&mut summary.common_joints.iter())),
        ("joints of some logs", joined(&mut summary.other_joints.iter())),
    ] {
        // Logs may state no robot, and all may have the same joints.
        if !names.is_empty() {
            let _ = writeln!(text, "{what}: {names}");
        }
    }
    let mut logs = table(&["log", "samples", "s", "Hz", "joints", "worst finding"], &[1, 2, 3, 4]);
    for log in &summary.logs {
        match &log.content {
            LogContent::Log { samples, duration_s, rate_hz, joints, worst } => logs.add_row([
                name(&log.path),
                samples.to_string(),
                number(Some(*duration_s)),
                number(Some(*rate_hz)),
                joints.to_string(),
                worst.map_or("–".to_owned(), |worst| worst.to_string()),
            ]),
            LogContent::Unreadable(_) => logs.add_row([
                name(&log.path),
                "–".into(),
                "–".into(),
                "–".into(),
                "–".into(),
                "cannot be read".into(),
            ]),
        };
    }
    let _ = writeln!(text, "\n{logs}\n");
    if let Some(lag) = &summary.velocity_lag {
        let _ = writeln!(text, "warning: all logs together: {lag}");
    } else if summary.findings.iter().all(|group| group.severity == Severity::Note)
        && !summary.logs.iter().any(|log| matches!(log.content, LogContent::Unreadable(_)))
    {
        text.push_str("nothing suspicious\n");
    }
    for group in &summary.findings {
        // A folder can have thousands of logs, and a few names are enough to look at one.
        let mut names: Vec<String> =
            group.logs.iter().take(NAMED).map(|&log| name(&summary.logs[log].path)).collect();
        if group.logs.len() > NAMED {
            names.push("…".to_owned());
        }
        let _ = writeln!(
            text,
            "{}: {} in {} of {} logs ({}); for example: {}",
            group.severity,
            group.kind,
            group.logs.len(),
            summary.logs.len(),
            names.join(", "),
            group.example
        );
    }
    for log in &summary.logs {
        if let LogContent::Unreadable(why) = &log.content {
            let _ = writeln!(text, "error: {why}");
        }
    }
    text
}

fn name(path: &Path) -> String {
    shown(&path.file_name().unwrap_or(path.as_os_str()).to_string_lossy())
}
