//! A log at a glance.

use crate::stats::{median, range, rms};
use crate::{Lead, ReadReport, Signal, Trajectory};
use serde::Serialize;
use std::path::PathBuf;

/// Numbers about a log, for tables and JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LogSummary {
    /// The file.
    pub source: Option<PathBuf>,
    /// Robot name.
    pub robot: Option<String>,
    /// Number of samples.
    pub samples: usize,
    /// From the first to the last sample, s.
    pub duration_s: f64,
    /// Nominal sample rate, Hz.
    pub rate_hz: f64,
    /// 1 / median sample interval, Hz; absent with fewer than two samples or standing time.
    pub measured_rate_hz: Option<f64>,
    /// RMS deviation of the sample intervals from their median, s.
    pub jitter_s: Option<f64>,
    /// Longest sample interval, s.
    pub longest_interval_s: Option<f64>,
    /// How long after its row each target was stamped; absent where the log does not say it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lead: Option<Lead>,
    /// Channels present, such as `position`, `target`, `base orientation`.
    pub channels: Vec<&'static str>,
    /// Joints, in the log's order.
    pub joints: Vec<JointSummary>,
    /// RMS of position minus target over all joints and samples, rad.
    pub tracking_rms_rad: Option<f64>,
    /// What reading left out; empty when the log was not read from a file with
    /// [`read_csv_report`](crate::read_csv_report).
    pub reading: ReadReport,
}

/// Numbers about one joint.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JointSummary {
    /// Name.
    pub name: String,
    /// Position gain while recording, N·m/rad.
    pub kp: Option<f64>,
    /// Velocity gain while recording, N·m·s/rad.
    pub kd: Option<f64>,
    /// Position, rad.
    pub position: Option<SignalSummary>,
    /// Velocity, rad/s.
    pub velocity: Option<SignalSummary>,
    /// Position target, rad.
    pub target: Option<SignalSummary>,
    /// Policy action.
    pub action: Option<SignalSummary>,
    /// RMS of position minus target at the same sample, rad.
    pub tracking_rms_rad: Option<f64>,
}

/// Numbers about one column, over its finite values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SignalSummary {
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// Mean.
    pub mean: f64,
    /// Root mean square.
    pub rms: f64,
    /// Values that are NaN or infinite.
    pub missing: usize,
}

/// Summarises a log.
pub fn summary(log: &Trajectory) -> LogSummary {
    summary_with_report(log, ReadReport::default())
}

/// Summarises a log together with what reading it left out. The trajectory must be well formed
/// ([`Trajectory::validate`]), as every log that was read is; missing values are skipped.
pub fn summary_with_report(log: &Trajectory, reading: ReadReport) -> LogSummary {
    let mut steps: Vec<f64> = log.time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    // The median: gaps and jitter do not move it.
    let typical = median(&mut steps).filter(|step| *step > 0.0);
    let deviations = typical.map(|typical| steps.iter().map(|step| step - typical).collect::<Vec<f64>>());
    let base = log.base.clone().unwrap_or_default();
    let channels = [
        ("position", true),
        ("velocity", true),
        ("target", log.target.is_some()),
        ("action", log.action.is_some()),
        ("command", log.command.is_some()),
        ("motion", log.motion.is_some()),
        ("base position", base.position.is_some()),
        ("base orientation", base.quaternion.is_some()),
        ("base velocity", base.linear_velocity.is_some()),
        ("body rates", base.angular_velocity.is_some()),
    ];
    LogSummary {
        source: log.source.clone(),
        robot: log.robot.clone(),
        samples: log.len(),
        duration_s: log.duration(),
        rate_hz: log.rate_hz,
        measured_rate_hz: typical.map(|typical| 1.0 / typical),
        jitter_s: deviations.map(|deviations| rms(&deviations)),
        // The median has changed the order of the steps, which the range does not mind.
        longest_interval_s: range(&steps).map(|(_, longest)| longest),
        lead: log.lead,
        channels: channels.into_iter().filter_map(|(name, present)| present.then_some(name)).collect(),
        joints: (0..log.joints.len()).map(|joint| joint_summary(log, joint)).collect(),
        tracking_rms_rad: log.target.as_deref().and_then(|target| tracking(&log.position, target)),
        reading,
    }
}

fn joint_summary(log: &Trajectory, joint: usize) -> JointSummary {
    let summary = |signal| log.column_at(signal, joint).and_then(|column| signal_summary(&column));
    let position = log.column_at(Signal::Position, joint).unwrap_or_default();
    JointSummary {
        name: log.joints[joint].clone(),
        kp: log.gains.as_ref().and_then(|gains| gains.kp.get(joint).copied()),
        kd: log.gains.as_ref().and_then(|gains| gains.kd.get(joint).copied()),
        position: summary(Signal::Position),
        velocity: summary(Signal::Velocity),
        target: summary(Signal::Target),
        action: summary(Signal::Action),
        tracking_rms_rad: log
            .column_at(Signal::Target, joint)
            .and_then(|target| tracking(&position, &target)),
    }
}

fn signal_summary(column: &[f64]) -> Option<SignalSummary> {
    let (min, max) = range(column)?;
    let finite: Vec<f64> = column.iter().copied().filter(|value| value.is_finite()).collect();
    Some(SignalSummary {
        min,
        max,
        mean: crate::stats::mean(&finite),
        rms: rms(&finite),
        missing: column.len() - finite.len(),
    })
}

fn tracking(position: &[f64], target: &[f64]) -> Option<f64> {
    let errors: Vec<f64> =
        position.iter().zip(target).map(|(q, target)| q - target).filter(|error| error.is_finite()).collect();
    (!errors.is_empty()).then(|| rms(&errors))
}
