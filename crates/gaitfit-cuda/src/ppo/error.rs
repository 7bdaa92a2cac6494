//! Why the GPU's learner stops.

use gaitfit_learn::ppo::{StateError, UpdateError};

use super::layout::TooWide;
use crate::runtime::CudaError;

/// Why the GPU cannot learn, or could not.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PpoError {
    /// The GPU or its driver.
    #[error(transparent)]
    Cuda(#[from] CudaError),
    /// Networks that do not fit.
    #[error(transparent)]
    TooWide(#[from] TooWide),
    /// Samples or arithmetic that is not finite, as the CPU's learner has it.
    #[error(transparent)]
    Update(#[from] UpdateError),
    /// The CPU's learner does not take the state back.
    #[error(transparent)]
    State(#[from] StateError),
    /// A GPU without the matrix units' TF32.
    #[error("{name} has compute capability {}.{}, learning needs {}.{}: use the CPU", .found.0, .found.1, .min.0, .min.1)]
    TooOld {
        /// The GPU.
        name: String,
        /// Its compute capability.
        found: (i32, i32),
        /// Needed.
        min: (i32, i32),
    },
    /// More than the kernels count.
    #[error("{what} are {found}, the GPU's learner takes up to {max}: use the CPU")]
    TooMany {
        /// The numbers.
        what: &'static str,
        /// How many.
        found: usize,
        /// At most.
        max: usize,
    },
    /// Samples of another size than the learner was made for.
    #[error("the samples are of {found} tiles, steps and environments, the learner was made for {expected}")]
    Batch {
        /// The learner's.
        expected: String,
        /// The samples'.
        found: String,
    },
}
