//! `gaitfit explain`: what a robot has that its model lacks, by its walks.

use crate::cli::Explain;
use crate::commands::inspect::{log, swings as look};
use crate::exit::Failure;
use crate::watcher::watched;
use crate::{output, swings};
use gaitfit::adapt::Opening;
use gaitfit::walk::explain::{Cause, causes};
use gaitfit::walk::swing::SwingFindings;
use gaitfit::watch::{Count, Watch};
use gaitfit::{robot, settings};
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
    /// What to know of robot, policy and logs.
    warnings: &'a [String],
    without_simulation: &'a SwingFindings,
}

/// What logs show, and how many of them.
struct Looked {
    findings: SwingFindings,
    read: usize,
    seconds: f64,
    left_out: usize,
    /// What to know of robot, policy and logs.
    warnings: Vec<String>,
}

impl Looked {
    fn document<'a>(&'a self, input: ExplainInput<'_>, causes: &'a [Cause]) -> Document<'a> {
        Document {
            logs: input.logs.display().to_string(),
            robot: input.robot.display().to_string(),
            read: self.read,
            left_out: self.left_out,
            causes,
            warnings: &self.warnings,
            without_simulation: &self.findings,
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

    /// Whether the effects were compared with simulated robots, in a line.
    fn comparison(&self, input: ExplainInput<'_>) -> String {
        let compared = self.findings.effects.iter().any(|effect| effect.without.is_some());
        match (input.policy, &self.findings.not_corrected) {
            (Some(_), _) if compared => {
                "Logs of simulated robots without such effects show a part of them too; this part is subtracted from the effects of joints.\n"
                    .to_owned()
            }
            (Some(_), Some(why)) => format!("The effects are not compared with simulated robots: {why}.\n"),
            (Some(_), None) => "The effects are not compared with simulated robots.\n".to_owned(),
            (None, _) => {
                "Nothing was compared with simulated robots, so sizes of effects are rough, and play is never named. With \
                 --policy, the policy that walked, gaitfit simulates the walks without effects and subtracts what they show.\n"
                    .to_owned()
            }
        }
    }
}

/// The logs, and what belongs to them.
#[derive(Clone, Copy)]
pub struct ExplainInput<'a> {
    /// A log of a walk, or a folder of logs.
    pub logs: &'a Path,
    /// The robot's file.
    pub robot: &'a Path,
    /// The policy that walked, which simulated robots for comparison need.
    pub policy: Option<&'a Path>,
    /// Leave out what the engine cannot simulate in the robot's file.
    pub lenient: bool,
}

impl<'a> From<&'a Explain> for ExplainInput<'a> {
    fn from(args: &'a Explain) -> Self {
        Self { logs: &args.logs, robot: &args.robot, policy: args.policy.as_deref(), lenient: args.lenient }
    }
}

/// What logs show of a robot, or why they show nothing.
fn findings(input: ExplainInput<'_>, watch: &Watch<'_>) -> Result<Looked, Failure> {
    let looked = match input.policy {
        // Simulated robots need the policy that walked. Without it only the logs speak.
        Some(policy) => compared(input, policy, watch)?,
        None => without_simulation(input, watch)?,
    };
    match (&looked.findings.swings, &looked.findings.why_not) {
        // No log was usable, so there is nothing to print but the reason.
        (None, Some(why)) => {
            let logs = input.logs;
            Err(Failure::failed(format!("{}: {why}. {}", logs.display(), looked.line(logs).trim_end())))
        }
        _ => Ok(looked),
    }
}

/// What logs show, compared with simulated robots on which `policy` walks. A fit finds the same before its search. As in a fit,
/// a log that must not be used is refused.
fn compared(input: ExplainInput<'_>, policy: &Path, watch: &Watch<'_>) -> Result<Looked, Failure> {
    let ExplainInput { logs, robot, lenient, .. } = input;
    // A fit names the built-in robot by no name.
    let robot = if robot::is_built_in(robot) { Path::new("") } else { robot };
    let text = |path: &Path| toml::Value::from(path.display().to_string());
    // A fit's settings made up from the command line: `explain` needs no file of its own.
    let changes = [
        "base=\"free\"".to_owned(),
        format!("lenient={lenient}"),
        format!("robot={}", text(robot)),
        format!("policy={}", text(policy)),
        format!("logs=[{}]", text(logs)),
    ];
    let config = settings::load(None, &changes)?;
    let setup = Opening::new(&config, logs).watch(watch).open()?;
    let fitted = &setup.fit.logs;
    Ok(Looked {
        read: fitted.len(),
        seconds: fitted.iter().map(|log| log.trajectory.duration()).sum(),
        left_out: 0,
        warnings: setup.warnings,
        findings: setup.swings.unwrap_or_default(),
    })
}

/// What logs show without a simulation.
fn without_simulation(input: ExplainInput<'_>, watch: &Watch<'_>) -> Result<Looked, Failure> {
    let ExplainInput { logs, robot, lenient, .. } = input;
    let path = Some(robot);
    let model = robot::named(robot, lenient)?;
    // A folder may have some logs that cannot be used; a single log that cannot is an error.
    let (count, used) = if logs.is_dir() {
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
    let findings = look::look(path, lenient, &used.iter().collect::<Vec<_>>(), watch)?;
    let findings = findings.ok_or_else(|| {
        Failure::failed(format!(
            "{}: none of the logs can be explained: {}",
            logs.display(),
            look::lacks(&model, first_log(logs).as_ref(), robot)
        ))
    })?;
    // By the times themselves: a log with gaps is longer than its samples.
    let seconds =
        |log: &Trajectory| log.time.last().zip(log.time.first()).map_or(0.0, |(last, first)| last - first);
    Ok(Looked {
        read: used.len(),
        seconds: used.iter().map(seconds).sum(),
        left_out: count.saturating_sub(used.len()),
        warnings: Vec::new(),
        findings,
    })
}

/// The document that `--json` prints.
///
/// # Errors
/// Files that cannot be used, in a sentence.
pub fn document(input: ExplainInput<'_>, watch: &Watch<'_>) -> Result<String, Failure> {
    let looked = findings(input, watch)?;
    serde_json::to_string(&looked.document(input, &causes(&looked.findings))).map_err(Failure::failed)
}

/// Prints the causes that the logs show, the weightiest first. A log that must not be used is refused. In a folder it is left out,
/// unless a policy is given.
pub fn run(args: &Explain) -> Result<(), Failure> {
    let input = ExplainInput::from(args);
    let looked = watched(look::LINES, |watch| findings(input, watch))?;
    looked.warnings.iter().for_each(|warning| output::note(&format!("note: {warning}")));
    let causes = causes(&looked.findings);
    if args.json {
        return output::print_json(&looked.document(input, &causes));
    }
    output::print(&format!(
        "{}{}{}{}",
        swings::causes(&causes),
        swings::left_out(&looked.findings),
        looked.line(&args.logs),
        looked.comparison(input)
    ))
}
