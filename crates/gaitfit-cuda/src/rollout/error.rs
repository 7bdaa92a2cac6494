//! Why a GPU cannot train, or could not.

use gaitfit_learn::TrainingError;
use gaitfit_learn::task::TaskError;

use crate::physics::DeviceError;
use crate::ppo::PpoError;
use crate::runtime::{CudaError, Device};

/// Why a GPU cannot train, or could not.
#[derive(Debug, thiserror::Error)]
pub enum RolloutError {
    /// The GPU or its driver.
    #[error(transparent)]
    Cuda(#[from] CudaError),
    /// The physics.
    #[error(transparent)]
    Physics(#[from] DeviceError),
    /// The learner.
    #[error(transparent)]
    Ppo(#[from] PpoError),
    /// The task or its robots.
    #[error(transparent)]
    Task(#[from] TaskError),
    /// An error that the CPU's training would have reported too.
    #[error(transparent)]
    Training(#[from] TrainingError),
    /// Trajectories that only the CPU simulates.
    #[error("trajectories with {0} are not simulated on a GPU yet; use the CPU (--device cpu)")]
    Trials(String),
    /// Robots that only the CPU steps.
    #[error("robots with {0} are not stepped on a GPU yet; use the CPU (device \"cpu\")")]
    Steps(String),
    /// An action from outside.
    #[error("the action of environment {environment} for {joint} is not finite")]
    Action {
        /// Whose it is, from 0.
        environment: usize,
        /// Its joint.
        joint: String,
    },
    /// Something that only the CPU does.
    #[error("a training with {0} does not run on a GPU yet; use the CPU (--device cpu)")]
    Unsupported(String),
    /// Robots that several GPUs cannot share.
    #[error(
        "{environments} robots cannot be shared evenly among {gpus} GPUs: take {} or {}, or another number of GPUs",
        .environments / .gpus.max(&1) * .gpus, (.environments / .gpus.max(&1) + 1) * .gpus
    )]
    Uneven {
        /// Robots of the training.
        environments: usize,
        /// GPUs.
        gpus: usize,
    },
    /// GPUs that were to learn the same and did not.
    #[error(
        "cuda:{ordinal} has other weights than the first GPU: are the GPUs of one kind? Train on one GPU, or on GPUs of \
         one kind"
    )]
    Apart {
        /// The GPU's number.
        ordinal: usize,
    },
    /// A failure of one GPU of several.
    #[error("cuda:{ordinal}: {error}")]
    On {
        /// The GPU's number.
        ordinal: usize,
        /// The failure of that GPU.
        error: Box<Self>,
    },
}

impl RolloutError {
    /// The failure itself, without the number of the GPU.
    pub fn cause(&self) -> &Self {
        match self {
            Self::On { error, .. } => error.cause(),
            cause => cause,
        }
    }

    /// Names the GPU, one of `gpus`, if it is the GPU's failure and there are several.
    pub(super) fn on(self, device: &Device, gpus: usize) -> Self {
        let ordinal = device.info().ordinal;
        match self {
            Self::Cuda(_) | Self::Physics(_) | Self::Ppo(_) if gpus > 1 => {
                Self::On { ordinal, error: Box::new(self) }
            }
            error => error,
        }
    }
}
