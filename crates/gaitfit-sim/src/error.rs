//! Errors of a batch of simulations.

use gaitfit_physics::{IsaError, PhysicsError};

/// Why a batch cannot be simulated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimError {
    /// The robot or a candidate's parameters.
    #[error(transparent)]
    Physics(#[from] PhysicsError),
    /// A recording that does not fit the robot.
    #[error("recording {index}: {what}")]
    Recording {
        /// Position in the list of recordings.
        index: usize,
        /// What is wrong, and what to do.
        what: String,
    },
    /// An option outside its range.
    #[error("{option} is {value}; it must be {must}")]
    Option {
        /// Which option.
        option: &'static str,
        /// Value found.
        value: String,
        /// What it must be.
        must: &'static str,
    },
    /// The instruction set asked for cannot be used.
    #[error(transparent)]
    Isa(#[from] IsaError),
}
