//! Why candidates cannot be simulated on a GPU, or could not.

use gaitfit_physics::PhysicsError;
use gaitfit_policy::walker::WalkerError;
use gaitfit_sim::SimError;

use crate::costs::CostsError;
use crate::physics::DeviceError;
use crate::runtime::CudaError;

/// Why candidates cannot be simulated on a GPU, or could not.
#[derive(Debug, thiserror::Error)]
pub enum FitError {
    /// The GPU or its driver.
    #[error(transparent)]
    Cuda(#[from] CudaError),
    /// The physics.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The costs.
    #[error(transparent)]
    Costs(#[from] CostsError),
    /// A candidate that is no robot.
    #[error(transparent)]
    Physics(#[from] PhysicsError),
    /// A candidate that the simulator does not take.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// The policy on its robot.
    #[error(transparent)]
    Walker(#[from] WalkerError),
    /// A policy whose network is too wide.
    #[error(
        "the policy's network needs {needed} bytes of a multiprocessor's memory for {rows} robots, this GPU has \
         {available}: use the CPU (--device cpu)"
    )]
    TooWide {
        /// Bytes needed.
        needed: usize,
        /// Robots that are worked on together.
        rows: usize,
        /// Bytes there are.
        available: usize,
    },
    /// Something that only the CPU does.
    #[error("a GPU does not simulate {0} yet; use the CPU (--device cpu)")]
    Unsupported(String),
    /// Numbers of another problem.
    #[error("{what} has {found} numbers, the recordings need {expected}")]
    Length {
        /// Which.
        what: &'static str,
        /// Needed.
        expected: usize,
        /// There.
        found: usize,
    },
    /// A failure of one GPU of several.
    #[error("cuda:{ordinal}: {error}")]
    On {
        /// The GPU's number.
        ordinal: usize,
        /// The failure of that GPU.
        error: Box<Self>,
    },
    /// It was asked to give up.
    #[error("cancelled")]
    Cancelled,
}

impl FitError {
    /// The failure itself, without the number of the GPU.
    pub fn cause(&self) -> &Self {
        match self {
            Self::On { error, .. } => error.cause(),
            cause => cause,
        }
    }

    /// Whether the GPU's memory was too small.
    pub(super) fn is_memory(&self) -> bool {
        match self {
            Self::Cuda(error) | Self::Device(DeviceError::Cuda(error)) => error.is_memory(),
            _ => false,
        }
    }

    /// Names the GPU, if it is the GPU's failure and not the candidates'.
    pub(super) fn on(self, ordinal: usize) -> Self {
        match self {
            Self::Cuda(_) | Self::Device(_) | Self::Costs(_) | Self::TooWide { .. } => {
                Self::On { ordinal, error: Box::new(self) }
            }
            error => error,
        }
    }
}
