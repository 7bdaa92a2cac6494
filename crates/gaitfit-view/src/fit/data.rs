//! Content of a page of a fit: plain numbers and names, filled in by whoever ran the fit.

use super::held_out::HeldOut;
use super::log::LogSummary;
use super::signals::{JointTrace, SignalDistribution};
use crate::{Doubt, Setting};

/// Everything `report.html` shows of one fit, of logs with a clamped base or of walking logs. What does not apply
/// stays empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FitReport {
    /// Heading, e.g. the name of the run folder.
    pub title: String,
    /// Robot name and the model file it was read from.
    pub robot: String,
    /// Time at which the fit ended, as it is to be printed (ISO 8601 by preference).
    pub created: String,
    /// Wall-clock time of the fit, s; zero or NaN when unknown.
    pub wall_seconds: f64,
    /// Why the result must not be taken as it stands. The page adds that a fit is worse than the nominal robot where
    /// its numbers say so.
    pub doubts: Vec<Doubt>,
    /// Whether the first fit's search converged; none: unknown.
    pub converged: Option<bool>,
    /// Names of the logs the fit used.
    pub fit_logs: Vec<String>,
    /// Content of walking logs.
    pub log: Option<LogSummary>,
    /// One a cost; the first is the result.
    pub fits: Vec<Fit>,
    /// Scores of the fitted simulator.
    pub fitted: Score,
    /// Scores of the simulator before the fit.
    pub nominal: Score,
    /// Scores of the other things to beat: echo of the target, best pure delay, published fits.
    pub baselines: Vec<Score>,
    /// Logs that the fit did not see.
    pub validation: Vec<Validation>,
    /// Errors on walking logs, by distributions.
    pub held_out: Option<HeldOut>,
    /// Other fits of the same parameters beside the first one.
    pub comparisons: Vec<Comparison>,
    /// Measured and simulated positions over time, one a joint.
    pub traces: Vec<JointTrace>,
    /// Distributions of the joints' signals, one a joint and signal.
    pub distributions: Vec<SignalDistribution>,
    /// Warnings that the reader must know before trusting the numbers.
    pub warnings: Vec<String>,
    /// Resolved settings, in the order to print them.
    pub settings: Vec<Setting>,
    /// Versions, hashes, hardware.
    pub versions: Vec<Setting>,
}

/// Result of a fit with one cost.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// Name of the cost, e.g. `Wass`.
    pub cost_name: String,
    /// Cost of the nominal simulator on the logs.
    pub nominal_cost: f64,
    /// Cost of the fitted simulator.
    pub fitted_cost: f64,
    /// One optimiser run a restart or seed.
    pub runs: Vec<OptimizerRun>,
    /// θ, in its own order.
    pub parameters: Vec<Parameter>,
}

/// Errors of one predictor on the logs.
#[derive(Clone, Debug, PartialEq)]
pub struct Score {
    /// Name of the predictor, e.g. `best pure delay (70 ms)`.
    pub name: String,
    /// Cost on the fit logs; unknown: that of the first of [`FitReport::fits`].
    pub cost: f64,
    /// Free-running position RMSE over all joints of the fit logs, rad.
    pub rmse_fit_rad: f64,
    /// Error on the validation logs, rad; the headline uses it when the fitted and nominal scores have it.
    pub rmse_validation_rad: f64,
}

/// One entry of θ after the fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Name in θ.
    pub name: String,
    /// Unit of every number below; empty for ratios.
    pub unit: String,
    /// Fitted value.
    pub value: f64,
    /// Lower bound of the search.
    pub lower: f64,
    /// Upper bound of the search.
    pub upper: f64,
    /// Where the search began.
    pub start: f64,
    /// Standard deviation of `per_run`; NaN with fewer than two runs.
    pub spread: f64,
    /// Best value of each run, in the order of [`Fit::runs`].
    pub per_run: Vec<f64>,
    /// The bound that the value rests on.
    pub at_bound: Option<Bound>,
    /// Plausible or published values, to judge the fit by.
    pub published: Option<PublishedRange>,
    /// Whether the logs determine the value; `None` when nobody asked.
    pub identified: Option<bool>,
    /// Ends of the interval within which the cost cannot tell values apart.
    pub interval: Option<[f64; 2]>,
    /// The robot's value where it is known, because the robot is simulated.
    pub truth: Option<f64>,
}

/// End of a search interval.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bound {
    /// The lower bound.
    Lower,
    /// The upper bound.
    Upper,
}

/// An interval from the literature, in the parameter's unit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PublishedRange {
    /// Smallest published value.
    pub lower: f64,
    /// Largest published value.
    pub upper: f64,
    /// Where it stands.
    pub source: String,
}

/// One optimiser run; all lists are one a generation and may be empty when not recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct OptimizerRun {
    /// Name of the run, e.g. `seed 3`.
    pub label: String,
    /// Best cost of the whole run.
    pub best_cost: f64,
    /// Best cost within the generation.
    pub best: Vec<f64>,
    /// Mean cost of the generation.
    pub mean: Vec<f64>,
    /// CMA-ES step size σ (no unit: it multiplies the per-coordinate initial deviations).
    pub sigma: Vec<f64>,
}

/// Free-running prediction of one log that the fit did not see.
#[derive(Clone, Debug, PartialEq)]
pub struct Validation {
    /// The log.
    pub file: String,
    /// Cost of the fitted simulator on this log alone.
    pub cost: f64,
    /// Cost of the nominal simulator.
    pub nominal_cost: f64,
    /// Position RMSE of the fitted simulator over all joints, rad.
    pub rmse_rad: f64,
    /// Position RMSE of the nominal simulator over all joints, rad.
    pub nominal_rmse_rad: f64,
    /// Joint name and position RMSE of the fitted simulator, rad. (In JSON an unknown number is `null`.)
    pub rmse_per_joint: Vec<(String, f64)>,
}

/// Two fits of one θ side by side.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Comparison {
    /// Name of the first fit, e.g. `MatchO (time-aligned)`.
    pub first: String,
    /// Name of the second fit, e.g. `Wass (no time axis)`.
    pub second: String,
    /// One a parameter.
    pub entries: Vec<ComparisonEntry>,
    /// Reasons why entries disagree, a sentence or paragraph each.
    pub reasons: Vec<String>,
}

/// One parameter as two fits see it.
#[derive(Clone, Debug, PartialEq)]
pub struct ComparisonEntry {
    /// Name in θ.
    pub name: String,
    /// Unit of the numbers below.
    pub unit: String,
    /// Value of the first fit.
    pub first: f64,
    /// The longer side of the first fit's interval.
    pub first_half: f64,
    /// Value of the second fit.
    pub second: f64,
    /// The longer side of the second fit's interval.
    pub second_half: f64,
    /// Whether they agree by the caller's criterion; `None` when it cannot be said.
    pub agrees: Option<bool>,
}

impl Default for Fit {
    fn default() -> Self {
        Fit {
            cost_name: String::new(),
            nominal_cost: f64::NAN,
            fitted_cost: f64::NAN,
            runs: Vec::new(),
            parameters: Vec::new(),
        }
    }
}

impl Default for Score {
    fn default() -> Self {
        Score { name: String::new(), cost: f64::NAN, rmse_fit_rad: f64::NAN, rmse_validation_rad: f64::NAN }
    }
}

impl Default for Parameter {
    fn default() -> Self {
        Parameter {
            name: String::new(),
            unit: String::new(),
            value: f64::NAN,
            lower: f64::NAN,
            upper: f64::NAN,
            start: f64::NAN,
            spread: f64::NAN,
            per_run: Vec::new(),
            at_bound: None,
            published: None,
            identified: None,
            interval: None,
            truth: None,
        }
    }
}

impl Default for OptimizerRun {
    fn default() -> Self {
        OptimizerRun {
            label: String::new(),
            best_cost: f64::NAN,
            best: Vec::new(),
            mean: Vec::new(),
            sigma: Vec::new(),
        }
    }
}

impl Default for Validation {
    fn default() -> Self {
        Validation {
            file: String::new(),
            cost: f64::NAN,
            nominal_cost: f64::NAN,
            rmse_rad: f64::NAN,
            nominal_rmse_rad: f64::NAN,
            rmse_per_joint: Vec::new(),
        }
    }
}

impl Default for ComparisonEntry {
    fn default() -> Self {
        ComparisonEntry {
            name: String::new(),
            unit: String::new(),
            first: f64::NAN,
            first_half: f64::NAN,
            second: f64::NAN,
            second_half: f64::NAN,
            agrees: None,
        }
    }
}
