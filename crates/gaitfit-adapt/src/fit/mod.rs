//! The fit: independent runs of CMA-ES or least squares over costs and seeds.
//!
//! [`Fit`] does no input or output. Its caller steps it, looks at each [`Generation`], saves
//! [`Fit::checkpoint`] when it likes, and resumes later with [`Fit::resume`] to the same result, bit for bit.

mod baseline;
mod compare;
mod convergence;
mod driver;
mod error;
mod evaluate;
mod fall_risk;
mod falls;
mod finalists;
mod generation;
mod identification;
mod identify;
mod joint;
mod least_squares;
mod options;
mod origin;
mod outcome;
mod predicted;
mod regression;
mod run;
mod stop;
mod valley;
mod views;

pub use baseline::{TargetSignal, best_delay, delayed};
pub use compare::{Agreement, compare};
pub use convergence::unsettled;
pub use driver::Fit;
pub use error::FitError;
pub use evaluate::{Evaluation, Job, accumulate, evaluate, simulate_one, simulate_rollout};
pub use falls::{FallPenalty, max_falls_by_chance};
pub use finalists::FinalComparison;
pub use generation::{Generation, RunGeneration};
pub use identification::{Identification, MAX_IDENTIFIED_SHARE, NoiseSource};
pub use identify::{MAX_SCANNED, cost_error, identify};
pub use least_squares::{
    Alternative, Comparison, Correction, Failure, GaussNewton, Problem, Question, Replicate, Round,
    Sensitivity, Shift, Slope, Uncertainty, Unexplained, World, answers, correct, descend, off_bounds,
    sensitivity, sets, uncertainty, unexplained,
};
pub use options::{FitOptions, Method, RandomNumbers};
pub use origin::{Against, Origin, Searched};
pub use outcome::{CostOutcome, ParameterOutcome, Redrawn, RunOutcome};
pub use predicted::Predicted;
pub use regression::{
    Distributions, Drawn, Likeness, Logs, MAX_REGRESSED, MAX_TAKEN, Regression, Walks, regress,
};
pub use run::{Checkpoint, SavedRun, SavedSearch};
pub use stop::Stop;
pub use views::{Costs, Views, measure};
