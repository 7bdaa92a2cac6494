//! Exit codes, and the one error type every command ends with.

use std::fmt;

/// How the program ends; the numbers are part of its interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// It ran and failed, or an input is broken.
    Failed = 1,
    /// Wrong usage or configuration.
    Usage = 2,
    /// It ran, but a check the configuration states did not hold.
    Check = 3,
    /// Hardware or a library is missing.
    Missing = 4,
    /// Interrupted; a checkpoint was written.
    Interrupted = 130,
}

/// Why a command stopped: one paragraph that says what, where and what to do.
#[derive(Debug)]
pub struct Failure {
    /// The exit code.
    pub exit: Exit,
    /// The paragraph, without a trailing newline.
    pub message: String,
}

impl Failure {
    /// Something went wrong with an input or the machine.
    pub fn failed(message: impl fmt::Display) -> Self {
        Self { exit: Exit::Failed, message: message.to_string() }
    }

    /// The command line or the configuration asks for something wrong.
    pub fn usage(message: impl fmt::Display) -> Self {
        Self { exit: Exit::Usage, message: message.to_string() }
    }
}

impl From<gaitfit::Error> for Failure {
    fn from(error: gaitfit::Error) -> Self {
        use gaitfit::ErrorKind;
        let exit = match error.kind() {
            ErrorKind::Failed => Exit::Failed,
            ErrorKind::Settings => Exit::Usage,
            ErrorKind::Interrupted => Exit::Interrupted,
            ErrorKind::Missing => Exit::Missing,
        };
        Self { exit, message: error.to_string() }
    }
}

impl From<gaitfit::RunError> for Failure {
    fn from(error: gaitfit::RunError) -> Self {
        gaitfit::Error::from(error).into()
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Failure {}
