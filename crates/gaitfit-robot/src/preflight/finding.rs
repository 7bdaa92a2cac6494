//! Faults and warnings of a robot, in words for the person beside it.

use std::fmt;

use serde::Serialize;

/// Subject of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Check {
    /// States come, often enough, with a right checksum.
    Messages,
    /// No state is lost or comes twice, and there is no long gap.
    Gaps,
    /// The robot's counter runs as fast as this computer's clock.
    Clock,
    /// Another program commands the motors.
    SecondController,
    /// All numbers are finite.
    Numbers,
    /// A motor answers for each joint.
    Present,
    /// Joints are inside their ranges.
    Range,
    /// Joints are still while nothing is sent.
    Still,
    /// Temperatures of motors.
    Temperature,
    /// Error numbers of motors, and packets that they lost.
    MotorError,
    /// The battery.
    Battery,
    /// The accelerometer measures gravity.
    Gravity,
    /// The gyro reads 0 at rest.
    GyroBias,
    /// Orientation and accelerometer agree.
    Attitude,
    /// Order of the quaternion's components.
    QuaternionOrder,
    /// The inertial unit is mounted as the base's axes are.
    Mounting,
    /// The gyro's rates agree with how the orientation turns.
    GyroAttitude,
    /// A joint moves if it is commanded.
    Moves,
    /// The joint that moves is the commanded one.
    Order,
    /// It moves in the commanded direction.
    Sign,
    /// It moves by the commanded amount.
    Amount,
    /// The motors take their gains.
    Gains,
    /// The joint's angle is 0 where the robot's file has it.
    Zero,
    /// Time from a target to the motion.
    Delay,
    /// The motion was stopped.
    Stopped,
}

/// Severity of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// Do not let the robot walk until it is repaired.
    Fault,
    /// Worth a look; the check passes.
    Warning,
}

/// A problem of the robot, and its remedy.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Its severity.
    pub severity: Severity,
    /// Its subject.
    pub check: Check,
    /// The joint, if it is about one.
    pub joint: Option<String>,
    /// The problem.
    pub problem: String,
    /// The remedy.
    pub remedy: String,
}

impl Finding {
    /// A fault.
    pub(super) fn fault(check: Check, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        let (problem, remedy) = (problem.into(), remedy.into());
        Self { severity: Severity::Fault, check, joint: None, problem, remedy }
    }

    /// Something to look at.
    pub(super) fn warning(check: Check, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { severity: Severity::Warning, ..Self::fault(check, problem, remedy) }
    }

    /// Returns the same finding, about this joint.
    #[must_use]
    pub(super) fn at_joint(mut self, joint: &str) -> Self {
        self.joint = Some(joint.to_owned());
        self
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.severity == Severity::Warning {
            f.write_str("look at: ")?;
        }
        if let Some(joint) = &self.joint {
            write!(f, "{joint}: ")?;
        }
        write!(f, "{}. {}.", self.problem, self.remedy)
    }
}

/// Whether no finding is a fault.
pub fn passed(findings: &[Finding]) -> bool {
    findings.iter().all(|finding| finding.severity != Severity::Fault)
}
