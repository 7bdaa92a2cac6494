//! Why settings do not give a task.

use gaitfit_physics::PhysicsError;
use gaitfit_policy::InterfaceError;
use gaitfit_policy::walker::WalkerError;
use gaitfit_sim::SimError;

use super::expression::ExpressionError;

/// Why a task does not fit a robot or contradicts itself.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TaskError {
    /// A setting.
    #[error("task.{setting} {what}")]
    Setting {
        /// Name of the setting.
        setting: String,
        /// What is wrong with it, and what to do.
        what: String,
    },
    /// An expression among the reward terms.
    #[error("task.terms.{term}: {error}")]
    Expression {
        /// Name of the term.
        term: String,
        /// What is wrong with it, and where.
        error: Box<ExpressionError>,
    },
    /// A joint whose leader puts it beyond its range.
    #[error(
        "joint {joint} follows another joint, which puts it at {at} in the task's pose; its range is {range}. Correct the coupling or \
         the range in the robot file, or the pose of the other joint in task.policy.default_pose"
    )]
    Coupling {
        /// The joint that follows.
        joint: String,
        /// Where it is, with the unit.
        at: String,
        /// Its range, with the unit.
        range: String,
    },
    /// The robot's gravity.
    #[error(
        "the robot {robot} has the gravity `{gravity}` (m/s²), and a walking task needs it along -z; mend it in the \
         robot's file (in MJCF <option gravity=\"0 0 -9.81\"/>)"
    )]
    Gravity {
        /// The robot.
        robot: String,
        /// Its gravity.
        gravity: String,
    },
    /// Own parts of the robot that cannot touch each other as asked for.
    #[error("task.{0}")]
    SelfContact(#[from] gaitfit_model::SelfContactError),
    /// The interface that the settings give a new policy.
    #[error("task.policy: {0}")]
    Policy(InterfaceError),
    /// The policy on the robot.
    #[error(transparent)]
    Walker(WalkerError),
    /// The simulator.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// The robot's parameters.
    #[error(transparent)]
    Physics(#[from] PhysicsError),
    /// The caller asked to stop.
    #[error("interrupted; nothing of it is kept")]
    Interrupted,
}

impl From<WalkerError> for TaskError {
    fn from(error: WalkerError) -> Self {
        match error {
            // The walker's options are settings of the task.
            WalkerError::Option { option, what } => Self::Setting { setting: option.to_owned(), what },
            other => Self::Walker(other),
        }
    }
}

/// A [`TaskError::Setting`].
pub(super) fn refuse<T>(setting: &str, what: String) -> Result<T, TaskError> {
    Err(TaskError::Setting { setting: setting.to_owned(), what })
}
