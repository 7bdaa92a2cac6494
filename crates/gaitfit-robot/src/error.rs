//! Errors that keep a robot from being run.

use crate::guard::Reason;

/// The reason why a robot is not run.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RobotError {
    /// A joint of the policy that the robot lacks, or one named twice.
    #[error("joint `{joint}` is no joint of a {robot}, or is named twice; they are {joints}")]
    Joint {
        /// Its name.
        joint: String,
        /// The robot.
        robot: String,
        /// The robot's joints.
        joints: String,
    },
    /// A motor that the policy must move has no joint.
    #[error(
        "the policy moves {count} joints, without `{joint}`; the {robot} has {motors} motors, and a policy for it must move \
         all that its file does not hold"
    )]
    Joints {
        /// Joints of the policy.
        count: usize,
        /// The robot.
        robot: String,
        /// Its motors.
        motors: usize,
        /// A joint that is missing.
        joint: String,
    },
    /// Topics that cannot be listened to.
    #[error("topics: {0}")]
    Topics(String),
    /// A robot's file that cannot be used.
    #[error("{file}{}{problem}", if problem.starts_with(':') { "" } else { " " })]
    File {
        /// The file, or a built-in robot's name.
        file: String,
        /// What is wrong with it.
        problem: String,
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
    /// The link broke.
    #[error("the link to the robot broke: {0}")]
    Broken(String),
    /// A turn by hand that nobody made.
    #[error(
        "nobody made the turn within 30 s ({0}, by 20 degrees or more, held still); repeat, or leave --tilt out; if the robot was \
         turned, its orientation stands still: switch it off and on"
    )]
    NotTilted(&'static str),
    /// The simulated robot cannot be.
    #[error("the simulated robot: {0}")]
    Simulation(String),
    /// A policy that cannot run on a robot.
    #[error("{0}")]
    Policy(#[from] gaitfit_policy::InterfaceError),
    /// A policy that the robot may not be given.
    #[error("the policy {problem}; {remedy}")]
    Unfit {
        /// What is the matter with it.
        problem: String,
        /// What to do.
        remedy: String,
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
