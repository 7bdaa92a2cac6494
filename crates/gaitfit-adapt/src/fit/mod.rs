//! The fit: independent CMA-ES runs over costs and seeds, each generation one batch of the simulator.
//!
//! [`Fit`] does no input or output. Its caller steps it, looks at each [`Generation`], saves
//! [`Fit::checkpoint`] when it likes, and goes on later from [`Fit::resume`] to the same result, bit for bit.

mod baseline;
mod compare;
mod driver;
mod error;
mod evaluate;
mod outcome;
mod run;

pub use baseline::{Predicted, TargetSignal, best_delay, delayed};
pub use compare::{Agreement, compare};
pub use driver::{Fit, FitOptions, Generation, RunGeneration};
pub use error::FitError;
pub use evaluate::{Job, evaluate, simulate_one};
pub use outcome::{CostOutcome, ParameterOutcome, RunOutcome};
pub use run::{Checkpoint, SavedRun, Stop};
