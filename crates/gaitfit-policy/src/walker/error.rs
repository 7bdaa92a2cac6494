//! Why a policy is not on a robot.

use gaitfit_physics::PhysicsError;
use gaitfit_sim::SimError;

use crate::InterfaceError;

/// Why a policy and a robot do not fit, or a simulation of both cannot run.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WalkerError {
    /// The robot's base is fixed.
    #[error("{robot} is clamped; a walking task needs a floating base")]
    Clamped {
        /// The robot.
        robot: String,
    },
    /// An option of the walker.
    #[error("{option} {what}")]
    Option {
        /// Which option.
        option: &'static str,
        /// What is wrong with it, and what to do.
        what: String,
    },
    /// A script without what resets need.
    #[error(
        "the cost resets the simulation to the log's state, and the log has no base position, orientation and \
         velocities or no actions; use `wass` or `matcho`"
    )]
    NoStates,
    /// The policy's interface.
    #[error(transparent)]
    Interface(#[from] InterfaceError),
    /// Resets of a policy whose memory no log holds.
    #[error(
        "the policy is recurrent, and a cost with resets (matchs) starts in midst of a log, where no log says what the \
         policy remembered: use wass or matcho"
    )]
    NoMemory,
    /// A policy that is a function of the caller's.
    #[error("the policy's function failed, or gave actions that are not finite")]
    Failed,
    /// The simulator.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// The robot's parameters.
    #[error(transparent)]
    Physics(#[from] PhysicsError),
}
