//! Batches of environments that a GPU advances, a control period at a launch.
//!
//! A [`Period`] is the program of one robot under given settings; it needs no GPU. A [`Batch`] has the numbers of many
//! environments in a GPU's memory and runs the program on them.

mod batch;
pub mod bench;
mod networks;
mod period;

pub use batch::Batch;
pub use networks::Shared;
pub(crate) use networks::weights;
pub use period::{Period, PeriodOptions};

use crate::emit::EmitError;
use crate::runtime::CudaError;
use gaitfit_physics::trace::TraceError;
use gaitfit_physics::{PhysicsError, Slot};

/// Why environments cannot be simulated on a GPU.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// The GPU, its driver or its compiler.
    #[error(transparent)]
    Cuda(#[from] CudaError),
    /// The robot.
    #[error(transparent)]
    Physics(#[from] PhysicsError),
    /// The robot's step as text.
    #[error("this robot's step cannot be written for a GPU: {0}")]
    Emit(#[from] EmitError),
    /// The recording of the step.
    #[error("this robot's step cannot be recorded: {0}")]
    Trace(#[from] TraceError),
    /// A robot for which the program is not.
    #[error(
        "{slot} is {constant} in this program, and {number} in a robot; make the program without it among `fixed`"
    )]
    Constant {
        /// The parameter.
        slot: Slot,
        /// Value of the parameter in the program.
        constant: f64,
        /// Value of the parameter in the robot.
        number: f64,
    },
    /// A batch's numbers.
    #[error("{what} must be {must}; there are {found}")]
    Count {
        /// The quantity that was given.
        what: &'static str,
        /// The number that it must have.
        must: String,
        /// The number that there is.
        found: usize,
    },
}
