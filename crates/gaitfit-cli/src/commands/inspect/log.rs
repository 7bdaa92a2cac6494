//! A log at a glance, its findings, and a picture.

use super::{number, plot, swings};
use crate::cli::Inspect;
use crate::exit::{Exit, Failure};
use crate::table::table;
use crate::watcher::watched;
use crate::{output, viewer};
use gaitfit::arrangement::{LogMatch, match_log};
use gaitfit::files::{self, Output};
use gaitfit::walk::swing::SwingFindings;
use gaitfit::{policy_file, robot, robot_file, weight};
use gaitfit_log::{
    CheckSpec, Finding, LogSummary, ReadOptions, ReadReport, Severity, Signal, Trajectory, allow, check,
    read_csv_report, summary_with_report,
};
use gaitfit_model::{Model, argument, counted, shown};
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

#[derive(Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    summary: &'a LogSummary,
    findings: &'a [Finding],
    #[serde(skip_serializing_if = "Option::is_none")]
    without_simulation: Option<SwingFindings>,
    #[serde(skip_serializing_if = "Option::is_none")]
    policy: Option<LogMatch>,
}

/// The faults of a log, the worst first, alone or as a log of this robot. Findings that its settings allow are no
/// errors.
pub fn findings(log: &Trajectory, report: &ReadReport, robot: Option<&Model>) -> Vec<Finding> {
    let mut findings = report.findings();
    match robot {
        None => findings.extend(check(log, &CheckSpec::default())),
        Some(model) => {
            findings.extend(check(log, &CheckSpec::of_robot(model, &log.joints)));
            // Only the robot's masses show which sign of a joint is wrong.
            findings.extend(weight::signs(log, model));
        }
    }
    // Before sorting, because it changes severities.
    allow(&mut findings, &report.allowed);
    findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    findings
}

/// Prints what the log holds and what is wrong with it; a log that must not be used ends with exit code 3.
pub fn run(args: &Inspect) -> Result<(), Failure> {
    // The picture's name is checked before the log is read.
    args.plot.as_deref().map(plot::check).transpose()?;
    // Both `.svg` and `.html` are taken, so no ending is asked for here.
    let plot = args.plot.as_deref().map(|path| Output { path, option: "--plot", ending: None });
    files::check(
        plot.as_slice(),
        [Some(&args.file), args.robot.as_ref(), args.policy.as_ref()]
            .into_iter()
            .flatten()
            .map(PathBuf::as_path),
    )?;
    let (log, report) = read_csv_report(&args.file, &ReadOptions::default()).map_err(Failure::failed)?;
    let model = args.robot.as_ref().map(|path| robot::named(path, args.lenient)).transpose()?;
    let findings = findings(&log, &report, model.as_ref());
    let summary = summary_with_report(&log, report);
    if let Some(path) = &args.plot {
        plot::write(&log, &findings, model.as_ref(), path)?;
    }
    // Needs a robot and an inertial unit's signals; otherwise there is no result and nothing is printed.
    let swings =
        watched(swings::LINES, |watch| swings::look(args.robot.as_deref(), args.lenient, &[&log], watch))?;
    let policy = args.policy.as_deref().map(|path| walked(args, path)).transpose()?;
    let other = policy.as_ref().is_some_and(|comparison| comparison.is_other);
    if args.json {
        let without_simulation = swings;
        output::print_json(&Document { summary: &summary, findings: &findings, without_simulation, policy })?;
    } else {
        output::print(&text(&log, &summary, &findings, model.as_ref()))?;
        swings::print(swings.as_ref())?;
        if let Some(comparison) = &policy {
            output::print(&policy_text(comparison))?;
        }
        // A log with errors has no next step but its repair.
        if !other && findings.iter().all(|finding| finding.severity != Severity::Error) {
            output::next(&[next(args, &log)])?;
        }
    }
    if let Some(path) = &args.plot {
        viewer::show(args.open, path);
    }
    let errors = findings.iter().filter(|finding| finding.severity == Severity::Error).count();
    if errors > 0 {
        let message = format!("{}: {errors} finding(s) forbid using this log", args.file.display());
        return Err(Failure { exit: Exit::Check, message });
    }
    if other {
        let message = format!("{}: its actions do not follow from the policy", args.file.display());
        return Err(Failure { exit: Exit::Check, message });
    }
    Ok(())
}

/// The command after this one, for a log or its folder. For a log with commands it asks for the policy that followed them.
pub fn next(args: &Inspect, log: &Trajectory) -> String {
    // A log of legs in the air may have columns of commands that are all 0.
    let walked = log.command.as_ref().is_some_and(|all| all.iter().any(|part| *part != 0.0));
    let given = |option: &str, path: Option<&PathBuf>, word: &str| match path {
        Some(path) => format!(" {option} {}", argument(path)),
        None if word.is_empty() => String::new(),
        None => format!(" {option} {word}"),
    };
    let robot = given("--robot", args.robot.as_ref(), "ROBOT");
    let policy = given("--policy", args.policy.as_ref(), if walked { "POLICY" } else { "" });
    format!("gaitfit new{robot}{policy} --logs {} --out my-robot.toml", argument(&args.file))
}

/// The log beside a policy, on the robot that was named, or that of the policy's training.
fn walked(args: &Inspect, path: &Path) -> Result<LogMatch, Failure> {
    let path = policy_file::find(path)?.path;
    let policy = gaitfit_policy_files::read(&path).map_err(Failure::failed)?;
    let model = robot_file::model(&policy, &path, args.robot.as_deref(), args.lenient)?;
    Ok(match_log(&policy, &path.display().to_string(), &model, &args.file)?)
}

fn policy_text(comparison: &LogMatch) -> String {
    // What a log lacks of the base's motion is chosen so that the actions fit best.
    let chosen =
        if comparison.policy_match.exact { "" } else { ", unmeasured base motion chosen in its favour" };
    let mut text = match comparison.policy_match.is_enough() {
        true => format!(
            "\npolicy: its actions differ from the logged ones by {:.3} of their spread over {} samples{chosen}\n",
            comparison.policy_match.mismatch, comparison.policy_match.samples
        ),
        false => "\npolicy: its actions cannot be compared with the logged ones\n".to_owned(),
    };
    for doubt in comparison.doubts.iter().chain(&comparison.notes) {
        let _ = writeln!(text, "  {doubt}");
    }
    if let Some(diagnosis) = &comparison.diagnosis {
        let _ = writeln!(text, "  {}.", diagnosis.text());
    }
    text
}

fn text(log: &Trajectory, summary: &LogSummary, findings: &[Finding], model: Option<&Model>) -> String {
    // A robot with slides has joints in m; the header then names both units.
    let units = |unit: &str| model.map_or_else(|| unit.to_owned(), |model| model.units(unit));
    let mut text = format!(
        "{}: {}, {} in {} s at {} Hz{}\nchannels: {}\n",
        summary.robot.as_deref().map_or("robot not named".to_owned(), shown),
        counted(summary.joints.len(), "joint"),
        counted(summary.samples, "sample"),
        number(Some(summary.duration_s)),
        number(Some(summary.rate_hz)),
        summary.jitter_s.map_or(String::new(), |jitter| format!(
            " (intervals vary by {} ms, longest {} ms)",
            number(Some(1e3 * jitter)),
            number(summary.longest_interval_s.map(|seconds| 1e3 * seconds))
        )),
        summary.channels.join(", ")
    );
    if let Some(lead) = &summary.lead {
        let _ = writeln!(
            text,
            "targets: stamped {} ms after their rows (±{} ms)",
            number(Some(1e3 * lead.seconds)),
            number(Some(1e3 * lead.spread))
        );
    }
    let header = [
        "joint".to_owned(),
        "position over time".to_owned(),
        units("rad"),
        format!("speed rms {}", units("rad/s")),
        format!("from target rms {}", units("rad")),
        format!("kp {}", units("N·m/rad")),
        format!("kd {}", units("N·m·s/rad")),
    ];
    let mut joints = table(&header.each_ref().map(String::as_str), &[3, 4, 5, 6]);
    for (index, joint) in summary.joints.iter().enumerate() {
        let position = log.column_at(Signal::Position, index).unwrap_or_default();
        joints.add_row([
            shown(&joint.name),
            spark(&position, 32),
            super::interval(joint.position.map(|position| [position.min, position.max])),
            number(joint.velocity.map(|velocity| velocity.rms)),
            number(joint.tracking_rms_rad),
            number(joint.kp),
            number(joint.kd),
        ]);
    }
    let _ = writeln!(text, "\n{joints}");
    if let Some(place) = &summary.reading.gains_from {
        let _ = writeln!(text, "\ngains from {place}");
    }
    if !summary.reading.ignored.is_empty() {
        let names: Vec<String> = summary.reading.ignored.iter().map(|column| shown(&column.name)).collect();
        let _ = writeln!(text, "\ncolumns not used: {}", names.join(", "));
    }
    text.push('\n');
    if findings.iter().all(|finding| finding.severity == Severity::Note) {
        text.push_str("nothing suspicious\n");
    }
    for finding in findings {
        let _ = writeln!(text, "{finding}");
    }
    text
}

/// Values as a row of block characters, `width` wide: each the mean of its stretch.
fn spark(values: &[f64], width: usize) -> String {
    const BLOCKS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let finite = || values.iter().copied().filter(|value| value.is_finite());
    let (low, high) = (finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max));
    // A stretch of no values has no mean.
    let width = width.min(values.len());
    let cell = |number: usize| {
        let stretch = &values[number * values.len() / width..(number + 1) * values.len() / width];
        // A gap anywhere in the stretch makes the mean NaN, so gaps stay visible.
        let mean = stretch.iter().sum::<f64>() / stretch.len() as f64;
        if !mean.is_finite() {
            return ' ';
        }
        // A constant signal has no range to divide by.
        let level = if high > low { (mean - low) / (high - low) * 7.0 } else { 0.0 };
        BLOCKS[(level.round() as usize).min(7)]
    };
    (0..width).map(cell).collect()
}

#[cfg(test)]
mod tests {
    use super::spark;

    #[test]
    fn a_ramp_rises_and_gaps_stay_blank() {
        let ramp: Vec<f64> = (0..64).map(f64::from).collect();
        assert_eq!(spark(&ramp, 8), "▁▂▃▄▅▆▇█");
        assert_eq!(spark(&[1.0, f64::NAN, 2.0], 3), "▁ █");
        assert_eq!(spark(&[1.0, 1.0], 8), "▁▁");
        assert_eq!(spark(&[], 8), "");
    }
}
