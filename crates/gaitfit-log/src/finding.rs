//! What reading and checks find in a log: a named reason, a place and a remedy.

use serde::de::IntoDeserializer;
use serde::{Deserialize, Serialize};

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
    /// The arrays do not fit together ([`crate::Trajectory::validate`] says no); nothing else was checked.
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
    /// A position jumps further than its velocity explains.
    PositionJump,
    /// A position stands still while the joint moves.
    FrozenPosition,
    /// A single velocity far from those beside it.
    VelocitySpike,
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
            FindingKind::PositionJump => "position-jump",
            FindingKind::FrozenPosition => "frozen-position",
            FindingKind::VelocitySpike => "velocity-spike",
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
