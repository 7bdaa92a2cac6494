//! Checks of a log's content, each finding with a named reason, a place and a remedy.
//!
//! Thresholds are constants beside each check, with the reason for their value. They are set so that healthy
//! recordings of real robots pass: a robot standing under a zero command, legs swept in the air, a trot with
//! soft gains and noisy velocities.

mod copies;
mod falls;
mod following;
mod imu;
mod joints;
pub(crate) mod lag;
mod reading;
mod robot;
mod saturation;
pub(crate) mod stats;
mod time;
mod values;
mod velocity;
mod windows;

pub use copies::zero_rows;
pub use falls::{Fall, FallSign, falls};
pub use imu::{settle_angles, settle_imu};
pub use lag::VelocityLag;

use crate::Trajectory;
use crate::names::names;
use crate::scale::{self, scales};
use serde::de::IntoDeserializer;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

/// What the checks may know about the robot. Everything is optional and by joint name; joints that the maps
/// lack are not held to a limit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CheckSpec {
    /// The robot's joints in its own order.
    pub joints: Option<Vec<String>>,
    /// Joints that slide: their units are m, m/s and N.
    pub slides: BTreeSet<String>,
    /// Position limits, rad.
    pub position_limits: BTreeMap<String, [f64; 2]>,
    /// Speed limits, rad/s.
    pub velocity_limits: BTreeMap<String, f64>,
    /// Torque limits, N·m.
    pub effort_limits: BTreeMap<String, f64>,
    /// Pose the robot stands in, rad.
    pub default_pose: BTreeMap<String, f64>,
    /// Base height below which the robot lies, m, world frame, ground at 0.
    pub lying_height: Option<f64>,
    /// Direction of gravity in the base's frame when the robot stands as it should, unit; (0, 0, −1), level, when absent.
    pub posture: Option<[f64; 3]>,
}

impl CheckSpec {
    /// Cosine of the angle by which the base leans away from its posture, at the orientation `q` (w, x, y, z, base to
    /// world).
    fn upright(&self, q: &[f64]) -> f64 {
        let [w, x, y, z] = [q[0], q[1], q[2], q[3]];
        let gravity = [2.0 * (w * y - x * z), -2.0 * (y * z + w * x), 2.0 * (x * x + y * y) - 1.0];
        let posture = self.posture.unwrap_or([0.0, 0.0, -1.0]);
        gravity.iter().zip(posture).map(|(a, b)| a * b).sum()
    }
}

/// Severity of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Worth knowing; nothing to do.
    Note,
    /// Results may suffer.
    Warning,
    /// The log, or the part named, must not be used as it is.
    Error,
}

impl std::fmt::Display for Severity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Severity::Note => "note",
            Severity::Warning => "warning",
            Severity::Error => "error",
        })
    }
}

/// The reason of a finding. Its name in messages, JSON and `allow` is in kebab case, such as `time-gap`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum FindingKind {
    /// The arrays do not fit together ([`Trajectory::validate`] says no); nothing else was checked.
    Malformed,
    /// A joint of the robot is not in the log.
    MissingJoint,
    /// A joint of the log is not on the robot.
    ExtraJoint,
    /// The log's joint order is not the robot's.
    JointOrder,
    /// Fewer samples than anything can be said about.
    TooShort,
    /// Time stands still or runs backwards.
    NonMonotonicTime,
    /// Samples are missing.
    TimeGap,
    /// Sample intervals vary.
    IrregularTime,
    /// The stamps had lost their digits; rows were spaced evenly.
    CoarseTime,
    /// The time column was in another unit than seconds.
    TimeUnit,
    /// The stated sample rate is not the rate of the samples.
    RateMismatch,
    /// Many rows repeat the one before: the recorder ran faster than the robot reports.
    RepeatedRows,
    /// NaN or infinite values.
    NotFinite,
    /// Positions or targets beyond the joint's limits.
    BeyondPositionLimit,
    /// Velocities beyond the joint's limit.
    BeyondVelocityLimit,
    /// Values that look like another unit.
    SuspectUnit,
    /// A signal that never changes.
    ConstantSignal,
    /// No joint's target ever changes.
    FrozenTarget,
    /// The velocity is not the derivative of the position.
    VelocityMismatch,
    /// Velocities lag behind positions.
    VelocityLag,
    /// A signal or torque that is cut off at a bound.
    Saturated,
    /// One joint does not do what its target asks.
    JointNotFollowing,
    /// The robot's joints do not do what their targets or the command ask: it is stuck, held or lies.
    Stuck,
    /// The robot rests far from where its targets or its standing pose are, or its base is on the floor.
    Lying,
    /// The base is tilted far from upright: the robot fell.
    Fallen,
    /// The base does not move while the legs walk: the robot hangs or is held.
    Hanging,
    /// Targets are copies of the measured positions.
    TargetIsPosition,
    /// Positions jump to exactly 0 and back: a second publisher writes zeros.
    JumpsToZero,
    /// The gains change in the middle of the log.
    GainsChange,
    /// Desired velocities or feed-forward torques that are not in the targets.
    FeedForward,
    /// The quaternion's components are in another order than their names say.
    QuaternionOrder,
    /// The IMU's rates are in another frame than the base's.
    ImuFrame,
    /// The IMU's rates or angles are in another unit than rad.
    ImuUnit,
    /// The IMU's rates have the opposite sign.
    ImuSign,
    /// The IMU's axes are not the base's.
    ImuMounting,
    /// Orientation and rates do not belong together.
    ImuMismatch,
    /// The IMU's rates have a bias.
    GyroBias,
    /// The IMU's rates come later or earlier than its orientation.
    GyroLag,
    /// A joint's torques have the wrong sign for the robot's weight.
    JointSign,
}

/// A stretch of samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Span {
    /// First sample.
    pub start: usize,
    /// One past the last sample.
    pub end: usize,
    /// Time of the first sample, s.
    pub from_s: f64,
    /// Time of the last sample, s.
    pub to_s: f64,
}

/// One thing a check found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Reason.
    pub kind: FindingKind,
    /// Severity.
    pub severity: Severity,
    /// Joints concerned; empty: not a matter of joints.
    pub joints: Vec<String>,
    /// Samples concerned; absent: the whole log.
    pub span: Option<Span>,
    /// The problem, in numbers, and what to do.
    pub message: String,
}

impl FindingKind {
    /// The kind of that name.
    pub fn named(name: &str) -> Option<Self> {
        let text: serde::de::value::StrDeserializer<'_, serde::de::value::Error> = name.into_deserializer();
        Self::deserialize(text).ok()
    }

    /// The name in messages, JSON and `allow`.
    pub fn name(self) -> &'static str {
        match self {
            FindingKind::Malformed => "malformed",
            FindingKind::MissingJoint => "missing-joint",
            FindingKind::ExtraJoint => "extra-joint",
            FindingKind::JointOrder => "joint-order",
            FindingKind::TooShort => "too-short",
            FindingKind::NonMonotonicTime => "non-monotonic-time",
            FindingKind::TimeGap => "time-gap",
            FindingKind::IrregularTime => "irregular-time",
            FindingKind::CoarseTime => "coarse-time",
            FindingKind::TimeUnit => "time-unit",
            FindingKind::RateMismatch => "rate-mismatch",
            FindingKind::RepeatedRows => "repeated-rows",
            FindingKind::NotFinite => "not-finite",
            FindingKind::BeyondPositionLimit => "beyond-position-limit",
            FindingKind::BeyondVelocityLimit => "beyond-velocity-limit",
            FindingKind::SuspectUnit => "suspect-unit",
            FindingKind::ConstantSignal => "constant-signal",
            FindingKind::FrozenTarget => "frozen-target",
            FindingKind::VelocityMismatch => "velocity-mismatch",
            FindingKind::VelocityLag => "velocity-lag",
            FindingKind::Saturated => "saturated",
            FindingKind::JointNotFollowing => "joint-not-following",
            FindingKind::Stuck => "stuck",
            FindingKind::Lying => "lying",
            FindingKind::Fallen => "fallen",
            FindingKind::Hanging => "hanging",
            FindingKind::TargetIsPosition => "target-is-position",
            FindingKind::JumpsToZero => "jumps-to-zero",
            FindingKind::GainsChange => "gains-change",
            FindingKind::FeedForward => "feed-forward",
            FindingKind::QuaternionOrder => "quaternion-order",
            FindingKind::ImuFrame => "imu-frame",
            FindingKind::ImuUnit => "imu-unit",
            FindingKind::ImuSign => "imu-sign",
            FindingKind::ImuMounting => "imu-mounting",
            FindingKind::ImuMismatch => "imu-mismatch",
            FindingKind::GyroBias => "gyro-bias",
            FindingKind::GyroLag => "gyro-lag",
            FindingKind::JointSign => "joint-sign",
        }
    }
}

impl std::fmt::Display for FindingKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl std::fmt::Display for Finding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}: {}", self.severity, self.kind, self.message)
    }
}

/// Makes warnings of errors whose kinds are `allowed`: someone has looked at them and wants the log used.
pub fn allow(findings: &mut [Finding], allowed: &[FindingKind]) {
    for finding in findings {
        if finding.severity == Severity::Error && allowed.contains(&finding.kind) {
            finding.severity = Severity::Warning;
            finding.message.push_str(" (allowed)");
        }
    }
}

/// All findings, the worst first. An empty list: nothing suspicious.
pub fn check(log: &Trajectory, spec: &CheckSpec) -> Vec<Finding> {
    let mut findings = Findings { log, list: Vec::new() };
    if let Err(error) = log.validate() {
        findings.add(FindingKind::Malformed, Severity::Error, &[], None, error.to_string());
        return findings.list;
    }
    let mut unwrapped = Cow::Borrowed(log);
    if !log.velocity_joints.is_empty() {
        // A wheel's angle that wraps at a full turn would look like a jump.
        unwrapped.to_mut().unwrap_wheels();
    }
    let log = &*unwrapped;
    // Messages and spans are made from the unwrapped log too.
    findings.log = log;
    joints::check(&mut findings, spec);
    if log.len() < 2 {
        let message = format!("{} sample(s); record at least a second", log.len());
        findings.add(FindingKind::TooShort, Severity::Error, &[], None, message);
        return findings.list;
    }
    let scales = scales(&log.time, &log.position, &log.velocity, log.joints.len());
    // A wrong clock makes all velocities wrong by one factor; it is reported once.
    let rate_is_said = time::check(&mut findings, scales.shared);
    values::check(&mut findings, spec);
    copies::check(&mut findings);
    imu::check(&mut findings, scales.shared.is_none_or(|shared| scale::equal(shared, 1.0)));
    velocity::check(&mut findings, &scales, rate_is_said);
    lag::check(&mut findings, &scales);
    saturation::check(&mut findings, spec);
    following::check(&mut findings, spec);
    // A stable sort: findings of one severity stay in the order of the checks.
    findings.list.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    findings.list
}

/// Whether a log is that of a clamped robot, whose fit replays the targets and compares sample by sample: it has nothing that
/// logs of walks have.
fn replayed(log: &Trajectory) -> bool {
    log.base.is_none() && log.command.is_none() && log.action.is_none()
}

/// The growing list, and the log it is about.
struct Findings<'a> {
    log: &'a Trajectory,
    list: Vec<Finding>,
}

impl Findings<'_> {
    /// Adds a finding about joints given by column number and, if not the whole log, samples `span`.
    fn add(
        &mut self,
        kind: FindingKind,
        severity: Severity,
        joints: &[usize],
        span: Option<std::ops::Range<usize>>,
        message: String,
    ) {
        let time = &self.log.time;
        let span = span.filter(|span| span.start < span.end && span.end <= time.len()).map(|span| Span {
            start: span.start,
            end: span.end,
            from_s: time[span.start],
            to_s: time[span.end - 1],
        });
        let joints = joints.iter().map(|&joint| self.log.joints[joint].clone()).collect();
        self.list.push(Finding { kind, severity, joints, span, message });
    }

    /// Joint names for a message: all of them, or how many.
    fn names(&self, joints: &[usize]) -> String {
        if joints.len() == self.log.joints.len() && joints.len() > 1 {
            return format!("all {} joints", joints.len());
        }
        names(joints.iter().map(|&joint| self.log.joints[joint].as_str()))
    }
}
