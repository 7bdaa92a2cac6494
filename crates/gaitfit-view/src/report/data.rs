//! What a report shows: plain numbers and names, filled in by whoever ran the fit.
//!
//! Conventions: an unknown number is NaN (shown as "–", written to JSON as `null`); an empty list leaves its
//! section out. Names are untrusted: the page escapes them. Joint order is the order given, and every list that
//! speaks of joints carries their names.

use crate::nullable;
use serde::{Deserialize, Serialize};

/// Everything `report.html` shows of one adaptation.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct AdaptReport {
    /// Heading, e.g. the name of the run folder.
    pub title: String,
    /// Robot name and the model file it was read from.
    pub robot: String,
    /// When the fit ended, as it is to be printed (ISO 8601 by preference).
    pub created: String,
    /// Wall-clock time of the fit, s; zero or NaN when unknown.
    #[serde(with = "nullable::scalar")]
    pub wall_seconds: f64,
    /// Logs the fit used.
    pub fit_logs: Vec<String>,
    /// Name of the cost minimised, e.g. `MatchO`.
    pub cost_name: String,
    /// Unit of the cost; empty when it has none.
    pub cost_unit: String,
    /// Scores of the fitted simulator.
    pub fitted: Score,
    /// Scores of the simulator before the fit.
    pub nominal: Score,
    /// Scores of the other things to beat: echo of the target, best pure delay, published fits.
    pub baselines: Vec<Score>,
    /// RMS difference between repeated recordings of one command, rad: no simulator can do better.
    pub noise_floor_rad: Option<f64>,
    /// θ, in its own order.
    pub parameters: Vec<Parameter>,
    /// One optimiser run a restart or seed.
    pub runs: Vec<OptimizerRun>,
    /// Logs that the fit did not see.
    pub validation: Vec<Validation>,
    /// A second fit of the same θ to set beside this one.
    pub comparison: Option<Comparison>,
    /// Measured and simulated positions over time, one a joint.
    pub traces: Vec<JointTrace>,
    /// Measured and simulated distributions, one a joint and quantity.
    pub distributions: Vec<JointDistribution>,
    /// What the reader must know before trusting the numbers.
    pub warnings: Vec<String>,
    /// Resolved settings, in the order to print them.
    pub settings: Vec<Setting>,
    /// Versions, hashes, hardware.
    pub versions: Vec<Setting>,
}

/// How well one predictor reproduces the logs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Score {
    /// What predicted, e.g. `best pure delay (70 ms)`.
    pub name: String,
    /// Cost on the fit logs, in [`AdaptReport::cost_unit`].
    #[serde(with = "nullable::scalar")]
    pub cost: f64,
    /// Free-running position RMSE over all joints of the fit logs, rad.
    #[serde(with = "nullable::scalar")]
    pub rmse_fit_rad: f64,
    /// The same on the validation logs, rad; the headline uses it when the fitted and nominal scores have it.
    #[serde(with = "nullable::scalar")]
    pub rmse_validation_rad: f64,
}

/// One entry of θ after the fit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Parameter {
    /// Name in θ.
    pub name: String,
    /// Unit of every number below; empty for ratios.
    pub unit: String,
    /// Fitted value.
    #[serde(with = "nullable::scalar")]
    pub value: f64,
    /// Lower bound of the search.
    #[serde(with = "nullable::scalar")]
    pub lower: f64,
    /// Upper bound of the search.
    #[serde(with = "nullable::scalar")]
    pub upper: f64,
    /// Where the search began.
    #[serde(with = "nullable::scalar")]
    pub start: f64,
    /// Standard deviation of `per_run`; NaN with fewer than two runs.
    #[serde(with = "nullable::scalar")]
    pub spread: f64,
    /// Best value of each run, in the order of [`AdaptReport::runs`].
    #[serde(with = "nullable::list")]
    pub per_run: Vec<f64>,
    /// The bound that the value rests on.
    pub at_bound: Option<Bound>,
    /// Plausible or published values, to judge the fit by.
    pub published: Option<PublishedRange>,
    /// Whether the logs determine the value; `None` when nobody asked.
    pub identified: Option<bool>,
}

/// Which end of the search interval.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Bound {
    /// The lower bound.
    Lower,
    /// The upper bound.
    Upper,
}

/// An interval from the literature, in the parameter's unit.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PublishedRange {
    /// Smallest published value.
    pub lower: f64,
    /// Largest published value.
    pub upper: f64,
    /// Where it stands.
    pub source: String,
}

/// One optimiser run; all lists are one a generation and may be empty when not recorded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct OptimizerRun {
    /// How the run is called, e.g. `seed 3`.
    pub label: String,
    /// Best cost of the whole run.
    #[serde(with = "nullable::scalar")]
    pub best_cost: f64,
    /// Best cost within the generation.
    #[serde(with = "nullable::list")]
    pub best: Vec<f64>,
    /// Mean cost of the generation.
    #[serde(with = "nullable::list")]
    pub mean: Vec<f64>,
    /// CMA-ES step size σ (no unit: it multiplies the per-coordinate initial deviations).
    #[serde(with = "nullable::list")]
    pub sigma: Vec<f64>,
}

/// Free-running prediction of one log that the fit did not see.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Validation {
    /// The log.
    pub file: String,
    /// Position RMSE of the fitted simulator over all joints, rad.
    #[serde(with = "nullable::scalar")]
    pub rmse_rad: f64,
    /// Position RMSE of the nominal simulator over all joints, rad.
    #[serde(with = "nullable::scalar")]
    pub nominal_rmse_rad: f64,
    /// Joint name and position RMSE of the fitted simulator, rad. (In JSON an unknown number is `null`.)
    #[serde(with = "nullable::named")]
    pub rmse_per_joint: Vec<(String, f64)>,
}

/// Two fits of one θ side by side.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Comparison {
    /// Name of the first fit, e.g. `MatchO (time-aligned)`.
    pub first: String,
    /// Name of the second fit, e.g. `Wass (no time axis)`.
    pub second: String,
    /// One a parameter.
    pub entries: Vec<ComparisonEntry>,
    /// Why entries disagree, a sentence or paragraph each.
    pub reasons: Vec<String>,
}

/// One parameter as two fits see it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ComparisonEntry {
    /// Name in θ.
    pub name: String,
    /// Unit of the numbers below.
    pub unit: String,
    /// Value of the first fit.
    #[serde(with = "nullable::scalar")]
    pub first: f64,
    /// Spread of the first fit over its runs.
    #[serde(with = "nullable::scalar")]
    pub first_spread: f64,
    /// Value of the second fit.
    #[serde(with = "nullable::scalar")]
    pub second: f64,
    /// Spread of the second fit over its runs.
    #[serde(with = "nullable::scalar")]
    pub second_spread: f64,
    /// Whether they agree by the caller's criterion (two spreads); `None` when it cannot be said.
    pub agrees: Option<bool>,
}

/// Positions of one joint over one log, rad. The series share `time_s`; an empty series is not drawn. The page
/// thins them out by itself.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct JointTrace {
    /// Joint name.
    pub joint: String,
    /// The log shown.
    pub file: String,
    /// Sample times, s, ascending.
    #[serde(with = "nullable::list")]
    pub time_s: Vec<f64>,
    /// The robot's encoder.
    #[serde(with = "nullable::list")]
    pub measured: Vec<f64>,
    /// The fitted simulator.
    #[serde(with = "nullable::list")]
    pub fitted: Vec<f64>,
    /// The simulator before the fit.
    #[serde(with = "nullable::list")]
    pub nominal: Vec<f64>,
    /// The position target sent, held until the next sample.
    #[serde(with = "nullable::list")]
    pub target: Vec<f64>,
}

/// Histograms of one joint quantity on common bins, as probability densities (1/unit).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct JointDistribution {
    /// Joint name.
    pub joint: String,
    /// What is distributed.
    pub quantity: Quantity,
    /// Bin edges in the quantity's unit, ascending; one more than the bins.
    #[serde(with = "nullable::list")]
    pub edges: Vec<f64>,
    /// Density of the robot's samples; one a bin.
    #[serde(with = "nullable::list")]
    pub measured: Vec<f64>,
    /// Density of the nominal simulator; one a bin, or empty.
    #[serde(with = "nullable::list")]
    pub nominal: Vec<f64>,
    /// Density of the fitted simulator; one a bin, or empty.
    #[serde(with = "nullable::list")]
    pub fitted: Vec<f64>,
    /// Wasserstein-1 distance from nominal to measured in the quantity's unit, when known.
    #[serde(with = "nullable::scalar")]
    pub distance_nominal: f64,
    /// Wasserstein-1 distance from fitted to measured in the quantity's unit, when known.
    #[serde(with = "nullable::scalar")]
    pub distance_fitted: f64,
}

/// A joint quantity whose distribution is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Joint position, rad.
    #[default]
    Position,
    /// Joint velocity, rad/s.
    Velocity,
}

impl Quantity {
    /// The unit of its samples.
    pub fn unit(self) -> &'static str {
        match self {
            Quantity::Position => "rad",
            Quantity::Velocity => "rad/s",
        }
    }
}

/// A name and what it was set to.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Setting {
    /// Name, dotted as in the configuration file.
    pub name: String,
    /// Value as text.
    pub value: String,
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
            first_spread: f64::NAN,
            second: f64::NAN,
            second_spread: f64::NAN,
            agrees: None,
        }
    }
}

impl Default for JointDistribution {
    fn default() -> Self {
        JointDistribution {
            joint: String::new(),
            quantity: Quantity::Position,
            edges: Vec::new(),
            measured: Vec::new(),
            nominal: Vec::new(),
            fitted: Vec::new(),
            distance_nominal: f64::NAN,
            distance_fitted: f64::NAN,
        }
    }
}

impl JointDistribution {
    /// Bins samples (in the quantity's unit, any counts, non-finite ones left out) into `bins` equal bins that
    /// span all three sides. The densities integrate to one.
    pub fn from_samples(
        joint: &str,
        quantity: Quantity,
        measured: &[f64],
        nominal: &[f64],
        fitted: &[f64],
        bins: usize,
    ) -> Self {
        let bins = bins.clamp(1, 1000);
        let finite = || measured.iter().chain(nominal).chain(fitted).copied().filter(|x| x.is_finite());
        let low = finite().fold(f64::INFINITY, f64::min);
        let high = finite().fold(f64::NEG_INFINITY, f64::max);
        let mut distribution =
            JointDistribution { joint: joint.to_string(), quantity, ..JointDistribution::default() };
        if low > high {
            return distribution;
        }
        // A constant signal still gets a bin of some width.
        let pad = if high - low > 1e-9 * (1.0 + low.abs()) { 0.0 } else { 0.5e-3 * (1.0 + low.abs()) };
        let (low, high) = (low - pad, high + pad);
        let width = (high - low) / bins as f64;
        let density = |samples: &[f64]| -> Vec<f64> {
            let mut counts = vec![0_u64; bins];
            for x in samples.iter().filter(|x| x.is_finite()) {
                counts[(((x - low) / width) as usize).min(bins - 1)] += 1;
            }
            let total: u64 = counts.iter().sum();
            if total == 0 {
                return Vec::new();
            }
            counts.iter().map(|c| *c as f64 / (total as f64 * width)).collect()
        };
        distribution.edges = (0..=bins).map(|i| low + width * i as f64).collect();
        distribution.measured = density(measured);
        distribution.nominal = density(nominal);
        distribution.fitted = density(fitted);
        distribution
    }
}
