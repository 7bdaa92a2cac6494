//! Why a stage stopped.

use crate::spring::SpringError;
use gaitfit_adapt::cost::CostError;
use gaitfit_adapt::fit::FitError;
use gaitfit_adapt::{ThetaError, ThetaFileError};
use gaitfit_learn::task::TaskError;
use gaitfit_learn::{CheckpointError, TrainingError};
use gaitfit_log::LogError;
use gaitfit_model::ModelError;
use gaitfit_policy::walker::WalkerError;
use gaitfit_policy::{InterfaceError, PolicyError};
use gaitfit_run::ErrorKind;
use gaitfit_view::{ReplayError, ReportError};
use std::fmt;
use std::path::Path;

/// Why a stage of the method stopped: the text is one paragraph that names the object and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file, a setting or a run folder; or the caller asked to stop.
    #[error(transparent)]
    Run(#[from] gaitfit_run::Error),
    /// A robot, or a program that runs it, is not there.
    #[error("{0}")]
    Missing(String),
    /// A program of a target failed.
    #[error("{setting}, `{command}`: {problem}")]
    Program {
        /// The setting that names it, such as `target.collect`.
        setting: &'static str,
        /// Its words.
        command: String,
        /// How it failed.
        problem: String,
    },
    /// A GPU does not do what is asked.
    #[error("{0}")]
    Refused(String),
    /// An error in a part of the settings, or in one of several inputs.
    #[error("{place} {source}")]
    In {
        /// Where, as a reader would name it, with a colon if it needs one.
        place: String,
        /// What is wrong there.
        source: Box<Error>,
    },
    /// An error that has a remedy of its own.
    #[error("{source} {advice}")]
    Advised {
        /// What is wrong.
        source: Box<Error>,
        /// What to do.
        advice: String,
    },
    /// A spring that is none, or is on no joint of the robot.
    #[error(transparent)]
    Spring(#[from] SpringError),
    /// A robot's file.
    #[error(transparent)]
    Robot(#[from] ModelError),
    /// A log.
    #[error(transparent)]
    Log(#[from] LogError),
    /// A policy's file.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// A policy that does not fit the robot.
    #[error(transparent)]
    Interface(#[from] InterfaceError),
    /// A policy on a robot.
    #[error(transparent)]
    Walker(#[from] WalkerError),
    /// A task that does not fit the robot.
    #[error(transparent)]
    Task(TaskError),
    /// A training.
    #[error(transparent)]
    Training(#[from] TrainingError),
    /// A checkpoint of a training.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// What is fitted.
    #[error(transparent)]
    Theta(#[from] ThetaError),
    /// A file of fitted parameters.
    #[error(transparent)]
    ThetaFile(#[from] ThetaFileError),
    /// A cost.
    #[error(transparent)]
    Cost(#[from] CostError),
    /// A fit.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// A page.
    #[error(transparent)]
    Report(#[from] ReportError),
    /// A 3-D replay.
    #[error(transparent)]
    Replay(#[from] ReplayError),
}

impl From<TaskError> for Error {
    fn from(error: TaskError) -> Self {
        match error {
            TaskError::Interrupted => Self::interrupted_with_nothing(error),
            other => Self::Task(other),
        }
    }
}

impl Error {
    /// An input is broken, or the work failed.
    pub fn failed(message: impl fmt::Display) -> Self {
        gaitfit_run::Error::failed(message).into()
    }

    /// A setting is wrong. Its key is the first that the message has in backquotes.
    pub fn settings(message: impl fmt::Display) -> Self {
        gaitfit_run::Error::settings(message).into()
    }

    /// The caller asked to stop; `kept` has what was done.
    pub fn interrupted(message: impl fmt::Display, kept: &Path) -> Self {
        gaitfit_run::Error::Interrupted { message: message.to_string(), kept: Some(kept.to_owned()) }.into()
    }

    /// The caller asked to stop, and nothing was kept.
    pub fn interrupted_with_nothing(message: impl fmt::Display) -> Self {
        gaitfit_run::Error::Interrupted { message: message.to_string(), kept: None }.into()
    }

    /// A file or folder that cannot be read.
    pub fn unreadable(path: &Path, source: std::io::Error) -> Self {
        gaitfit_run::Error::unreadable(path, source).into()
    }

    /// A file or folder that cannot be written.
    pub fn unwritable(path: &Path, source: std::io::Error) -> Self {
        gaitfit_run::Error::unwritable(path, source).into()
    }

    /// A file that holds something else than it should.
    pub fn content(path: &Path, problem: impl fmt::Display) -> Self {
        gaitfit_run::Error::content(path, problem).into()
    }

    /// Adds the place that the error is about.
    #[must_use]
    pub fn within(self, place: impl fmt::Display) -> Self {
        Self::In { place: place.to_string(), source: Box::new(self) }
    }

    /// Adds a remedy.
    #[must_use]
    pub fn advised(self, advice: impl fmt::Display) -> Self {
        Self::Advised { source: Box::new(self), advice: advice.to_string() }
    }

    /// Kind of the error.
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Run(error) => error.kind(),
            // What a GPU refuses another device may do, so the choice of the device is wrong.
            Self::Refused(_) | Self::Spring(_) => ErrorKind::Settings,
            // Other errors of a task are failures of the work.
            Self::Task(_) if self.is_of_task() => ErrorKind::Settings,
            Self::Missing(_) => ErrorKind::Missing,
            Self::In { source, .. } | Self::Advised { source, .. } => source.kind(),
            _ => ErrorKind::Failed,
        }
    }

    /// Names what a GPU does not do, if that is the error.
    pub fn refusal(&self) -> Option<&str> {
        match self {
            Self::Refused(reason) => Some(reason),
            Self::In { source, .. } | Self::Advised { source, .. } => source.refusal(),
            _ => None,
        }
    }

    /// Whether a setting of a task is wrong, without the place that it is from.
    pub fn is_of_task(&self) -> bool {
        matches!(
            self,
            Self::Task(
                TaskError::Setting { .. }
                    | TaskError::Expression { .. }
                    | TaskError::SelfContact(_)
                    | TaskError::Policy(_)
            )
        )
    }

    /// The setting that is wrong, such as `optimizer.seeds`, where one can be named.
    pub fn key(&self) -> Option<&str> {
        match self {
            Self::Run(error) => error.key(),
            Self::Spring(_) => Some("spring"),
            Self::In { source, .. } | Self::Advised { source, .. } => source.key(),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_setting_has_its_key_wherever_it_is_said() {
        let error = Error::settings("`optimizer.seeds` must be 1 to 1000").within("x.toml: [adapt]");
        assert_eq!((error.key(), error.kind()), (Some("optimizer.seeds"), ErrorKind::Settings));
        assert_eq!(error.to_string(), "x.toml: [adapt] `optimizer.seeds` must be 1 to 1000");
        assert_eq!(Error::settings("`My Robot` is none").key(), None);
        assert_eq!(Error::settings("no backquotes").key(), None);
    }

    #[test]
    fn a_remedy_does_not_change_what_kind_an_error_is() {
        let error = Error::interrupted("interrupted.", Path::new("runs/a")).advised("Go on.");
        assert_eq!(
            (error.kind(), error.to_string().as_str()),
            (ErrorKind::Interrupted, "interrupted. Go on.")
        );
    }
}
