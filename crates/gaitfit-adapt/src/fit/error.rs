//! Why a fit cannot continue.

use crate::SimulatorError;
use crate::cmaes::CmaError;
use crate::cost::CostError;

/// Why a fit cannot continue.
#[derive(Debug, thiserror::Error)]
pub enum FitError {
    /// The simulator failed as a whole.
    #[error("the simulation failed: {0}")]
    Simulator(#[source] SimulatorError),
    /// It was asked to give up.
    #[error("cancelled")]
    Cancelled,
    /// A cost could not be computed, through no fault of a candidate.
    #[error("the cost cannot be computed: {0}")]
    Cost(#[source] CostError),
    /// The optimiser refused its settings or a generation.
    #[error("the optimiser stopped: {0}")]
    Optimizer(#[source] CmaError),
    /// The simulator did not deliver every recording of every candidate.
    #[error("the simulator left out recordings of a candidate; it must report each once")]
    Incomplete,
    /// A generation without a single finite cost.
    #[error(
        "every candidate of generation {generation} ({cost}, seed {seed}) diverged: narrow the bounds, lower the \
         deviations or take a smaller simulation timestep"
    )]
    AllDiverged {
        /// Cost.
        cost: String,
        /// Seed.
        seed: u64,
        /// Generation, from 1.
        generation: usize,
    },
    /// The values of a step of least squares, or their neighbours.
    #[error(
        "the simulation of step {generation} of least squares diverged ({cost}, seed {seed}), or that of its neighbours \
         half a deviation away: lower the deviations, take a smaller simulation timestep or optimizer.method = \
         \"cma-es\", and look for impossible numbers in the logs"
    )]
    StepDiverged {
        /// Cost.
        cost: String,
        /// Seed.
        seed: u64,
        /// Step, from 1.
        generation: usize,
    },
    /// Least squares of a cost that compares distributions.
    #[error(
        "least squares needs a cost that compares sample by sample, which `{0}` does not; take CMA-ES for it"
    )]
    Distributions(String),
    /// Least squares over values that cost something by themselves.
    #[error("least squares does not take the regularisation of networks; take CMA-ES, or set it to 0")]
    Regularised,
    /// Least squares over too much.
    #[error("least squares takes up to {max} parameters, and there are {count}; take CMA-ES")]
    TooManyEntries {
        /// Entries of θ.
        count: usize,
        /// How many it takes.
        max: usize,
    },
    /// The differences of all candidates of a step do not fit into memory.
    #[error(
        "a step of least squares would need {needed} bytes, and {max} are allowed; take CMA-ES, or fewer logs"
    )]
    TooMany {
        /// Bytes.
        needed: usize,
        /// Bytes allowed.
        max: usize,
    },
    /// The cost cannot be scanned around the values found.
    #[error("the cost cannot be scanned: {0}")]
    Scan(String),
    /// A checkpoint does not belong to this fit.
    #[error("the checkpoint does not belong to this fit: {0}; start afresh without resuming")]
    Checkpoint(String),
}

impl From<SimulatorError> for FitError {
    fn from(error: SimulatorError) -> Self {
        match error {
            SimulatorError::Cancelled => Self::Cancelled,
            failed @ SimulatorError::Failed(_) => Self::Simulator(failed),
        }
    }
}
