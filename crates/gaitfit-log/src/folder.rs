//! A folder of logs at a glance: which logs, which joints and rates they share, and what is wrong with how many.

use crate::check::lag::LagSums;
use crate::files::entries;
use crate::scale::scales;
use crate::{
    CheckSpec, Finding, FindingKind, LogError, ReadOptions, Severity, Trajectory, VelocityLag, allow, check,
    read_csv_report,
};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// Rates this close, relative, are the same: the measured rate of a log moves by its jitter.
const SAME_RATE: f64 = 0.02;

/// Summary of a folder of logs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FolderSummary {
    /// The folder.
    pub folder: PathBuf,
    /// One entry a `*.csv` file, by name.
    pub logs: Vec<LogEntry>,
    /// Robots that the logs name.
    pub robots: BTreeSet<String>,
    /// Joints that every readable log has, in the first log's order.
    pub common_joints: Vec<String>,
    /// Joints that only some logs have.
    pub other_joints: BTreeSet<String>,
    /// Sample rates, rising, and how many logs have each.
    pub rates: Vec<RateCount>,
    /// Samples of all logs.
    pub samples: usize,
    /// Length of all logs together, s.
    pub duration_s: f64,
    /// How far velocities are behind positions in all logs together, where that is known and matters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity_lag: Option<VelocityLag>,
    /// Findings by kind, the worst first.
    pub findings: Vec<FindingGroup>,
}

/// One log of a folder.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LogEntry {
    /// The file.
    pub path: PathBuf,
    /// Its content, or why it could not be read.
    #[serde(flatten)]
    pub content: LogContent,
}

/// Content of a log.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LogContent {
    /// It was read.
    Log {
        /// Number of samples.
        samples: usize,
        /// From the first to the last sample, s.
        duration_s: f64,
        /// Nominal sample rate, Hz.
        rate_hz: f64,
        /// Number of joints.
        joints: usize,
        /// The worst finding's severity; absent: nothing suspicious.
        worst: Option<Severity>,
    },
    /// It could not be read, for this reason.
    Unreadable(String),
}

/// A sample rate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RateCount {
    /// Hz.
    pub rate_hz: f64,
    /// Logs that have it.
    pub logs: usize,
}

/// The findings of one kind.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FindingGroup {
    /// The kind.
    pub kind: FindingKind,
    /// The worst severity among them.
    pub severity: Severity,
    /// Places in [`FolderSummary::logs`] of the logs that have one, rising.
    pub logs: Vec<usize>,
    /// Joints concerned, over all logs.
    pub joints: BTreeSet<String>,
    /// The message of the first one of that severity.
    pub example: String,
}

/// Reads and checks the logs of a folder, one at a time; `spec` says what a log is checked against. Before each log and
/// after the last, `progress` gets how many are done and how many there are, and can stop the work.
///
/// # Errors
/// A folder that cannot be read or holds no `*.csv`; [`LogError::Stopped`]. A log that cannot be read is an entry of the
/// summary.
pub fn summarise_folder(
    folder: &Path,
    options: &ReadOptions,
    spec: &dyn Fn(&Trajectory) -> CheckSpec,
    progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<FolderSummary, LogError> {
    let files = entries(folder)?;
    if files.is_empty() {
        return Err(LogError::NoLogs { path: folder.to_owned() });
    }
    let count = files.len();
    let mut summary = FolderSummary {
        folder: folder.to_owned(),
        logs: Vec::with_capacity(count),
        robots: BTreeSet::new(),
        common_joints: Vec::new(),
        other_joints: BTreeSet::new(),
        rates: Vec::new(),
        samples: 0,
        duration_s: 0.0,
        velocity_lag: None,
        findings: Vec::new(),
    };
    let mut joints = SharedJoints::default();
    let mut rates = Vec::new();
    let mut groups = BTreeMap::new();
    let mut lag = LagSums::default();
    for (number, (path, wrong)) in files.into_iter().enumerate() {
        // Asked before each log, because reading one may take long.
        if progress(number, count).is_break() {
            return Err(LogError::Stopped);
        }
        // A log that cannot be read is an entry, so that one bad file does not hide the others.
        let content = match wrong.map_or_else(|| read_csv_report(&path, options), Err) {
            Err(error) => LogContent::Unreadable(error.to_string()),
            Ok((log, report)) => {
                let mut findings = report.findings();
                findings.extend(check(&log, &spec(&log)));
                // A log whose arrays do not fit has no velocities to compare.
                if log.validate().is_ok() {
                    lag.add(&log, &scales(&log.time, &log.position, &log.velocity, log.joints.len()));
                }
                // Errors that the log allows count as warnings.
                allow(&mut findings, &report.allowed);
                summary.samples += log.len();
                summary.duration_s += log.duration();
                summary.robots.extend(log.robot.clone());
                joints.add(&log.joints);
                rates.push(log.rate_hz);
                let content = LogContent::Log {
                    samples: log.len(),
                    duration_s: log.duration(),
                    rate_hz: log.rate_hz,
                    joints: log.joints.len(),
                    worst: findings.iter().map(|finding| finding.severity).max(),
                };
                findings.into_iter().for_each(|finding| group(&mut groups, number, finding));
                content
            }
        };
        summary.logs.push(LogEntry { path, content });
    }
    // The last step, at which all logs are done.
    if progress(count, count).is_break() {
        return Err(LogError::Stopped);
    }
    (summary.common_joints, summary.other_joints) = joints.split();
    summary.velocity_lag = lag.lag().filter(VelocityLag::matters);
    summary.rates = count_rates(rates);
    summary.findings = groups.into_values().collect();
    // The worst first, then those that concern most logs.
    summary.findings.sort_by_key(|group| std::cmp::Reverse((group.severity, group.logs.len())));
    Ok(summary)
}

/// Adds a finding of log `number` to its kind's group.
fn group(groups: &mut BTreeMap<FindingKind, FindingGroup>, number: usize, finding: Finding) {
    let Finding { kind, severity, joints, message, .. } = finding;
    let group = groups.entry(kind).or_insert_with(|| FindingGroup {
        kind,
        severity,
        logs: Vec::new(),
        joints: BTreeSet::new(),
        example: message.clone(),
    });
    if severity > group.severity {
        (group.severity, group.example) = (severity, message);
    }
    // All findings of a log come before those of the next, so a known number is the last.
    if group.logs.last() != Some(&number) {
        group.logs.push(number);
    }
    group.joints.extend(joints);
}

/// Joints seen so far.
#[derive(Default)]
struct SharedJoints {
    /// The first log's joints, in its order.
    first: Option<Vec<String>>,
    /// In how many logs each joint is.
    counts: BTreeMap<String, usize>,
    logs: usize,
}

impl SharedJoints {
    fn add(&mut self, joints: &[String]) {
        self.logs += 1;
        self.first.get_or_insert_with(|| joints.to_vec());
        for joint in joints {
            *self.counts.entry(joint.clone()).or_default() += 1;
        }
    }

    /// Joints of every log, and the others.
    fn split(mut self) -> (Vec<String>, BTreeSet<String>) {
        let mut common = self.first.unwrap_or_default();
        common.retain(|joint| self.counts.get(joint) == Some(&self.logs));
        for joint in &common {
            self.counts.remove(joint);
        }
        (common, self.counts.into_keys().collect())
    }
}

/// How often each rate occurs; rates that are nearly the same count as one, shown by its lowest.
fn count_rates(mut rates: Vec<f64>) -> Vec<RateCount> {
    rates.sort_by(f64::total_cmp);
    let mut counts: Vec<RateCount> = Vec::new();
    for rate_hz in rates {
        match counts.last_mut() {
            // Compared with the group's lowest rate, so that a chain of near rates does not become one group.
            Some(last) if rate_hz <= last.rate_hz * (1.0 + SAME_RATE) => last.logs += 1,
            _ => counts.push(RateCount { rate_hz, logs: 1 }),
        }
    }
    counts
}
