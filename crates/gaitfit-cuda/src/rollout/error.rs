//! Why a GPU cannot train, or could not.

use gaitfit_learn::TrainingError;
use gaitfit_learn::task::TaskError;

use crate::physics::DeviceError;
use crate::ppo::PpoError;
use crate::runtime::CudaError;

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
    /// What the CPU's training would have said too.
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
}
