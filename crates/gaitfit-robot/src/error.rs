//! What keeps a robot from being run.

use crate::guard::Reason;
use crate::unitree::MOTORS;

/// Why a robot is not run.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RobotError {
    /// A joint of the policy that the robot lacks, or one named twice.
    #[error(
        "joint `{joint}` is no joint of a Go2, or is named twice; they are FL, FR, RL, RR × hip, thigh, calf"
    )]
    Joint {
        /// Its name.
        joint: String,
    },
    /// Some motors have no joint.
    #[error("the policy moves {count} joints, the Go2 has {MOTORS}; a policy for it must move them all")]
    Joints {
        /// Joints of the policy.
        count: usize,
    },
    /// It may not be armed as it is.
    #[error("not armed: {0}")]
    NotArmed(Reason),
    /// A network interface that cannot be used.
    #[error(
        "network interface `{interface}` {}; those with an address are {}",
        if *there { "has no IPv4 address" } else { "is not there" },
        names.join(", ")
    )]
    Interface {
        /// Its name.
        interface: String,
        /// Whether it is there.
        there: bool,
        /// Interfaces that can be used.
        names: Vec<String>,
    },
    /// A domain that DDS does not have.
    #[error("domain {domain} is beyond 232, the last that DDS has; robots are in domain 0, simulators in 1")]
    Domain {
        /// Its number.
        domain: u16,
    },
    /// DDS refuses.
    #[error("DDS cannot {what}: {problem}")]
    Dds {
        /// What was tried.
        what: &'static str,
        /// What it says.
        problem: String,
    },
    /// The simulated robot cannot be.
    #[error("the simulated robot: {0}")]
    Simulation(String),
    /// A policy that cannot run on a robot.
    #[error("{0}")]
    Policy(#[from] gaitfit_policy::InterfaceError),
    /// A policy that a Go2 may not be given.
    #[error("the policy {problem}; {remedy}")]
    Unfit {
        /// What is the matter with it.
        problem: String,
        /// What to do.
        remedy: &'static str,
    },
    /// Commands over time that are none.
    #[error("commands: {0}")]
    Script(String),
    /// A file of the run cannot be written.
    #[error("cannot write {}: {problem}", path.display())]
    Write {
        /// The file.
        path: std::path::PathBuf,
        /// What the system says.
        problem: String,
    },
    /// The system gives no thread.
    #[error("cannot start a thread: {0}")]
    Thread(String),
}
