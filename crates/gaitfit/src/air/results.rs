//! What a fit found, as the one document that `--json` prints, `result.json` keeps, and tables and report show.

use super::setup::{LogSet, Setup};
use crate::Error;
use crate::settings::AdaptConfig;
use gaitfit_adapt::cost::position_rmse;
use gaitfit_adapt::fit::{
    Agreement, CostOutcome, Job, ParameterOutcome, Predicted, RunOutcome, TargetSignal, best_delay, compare,
    delayed, evaluate, simulate_one,
};
use gaitfit_adapt::{Simulator, Theta};
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

/// The result of one adaptation.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Results {
    /// Name of the run.
    pub name: String,
    /// Robot name.
    pub robot: String,
    /// Name of the first cost; `cost`, `parameters` and `validation` are its fit's.
    pub cost_name: String,
    /// Its smallest value on the fitted logs.
    pub cost: f64,
    /// θ as found.
    pub parameters: Vec<Parameter>,
    /// How well the fitted simulator predicts.
    pub fitted: Score,
    /// How well the naive predictors do.
    pub baselines: Vec<Score>,
    /// Free-running errors on logs that were not fitted.
    pub validation: Vec<Validation>,
    /// The runs of the first cost.
    pub runs: Vec<RunOutcome>,
    /// The fits by the other costs.
    #[serde(default)]
    pub other_fits: Vec<OtherFit>,
    /// Checks the configuration states.
    pub checks: Vec<Check>,
    /// What to know before trusting the numbers.
    pub warnings: Vec<String>,
    /// Where the files are.
    pub run_folder: String,
    /// Wall time of the fit, over all its sessions, s.
    pub wall_seconds: f64,
}

/// One entry of θ as found, with its true value where it is known.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Parameter {
    /// Value, unit, spread, bounds.
    #[serde(flatten)]
    pub found: ParameterOutcome,
    /// True value, from the configuration's `[truth]`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<f64>,
    /// Published values, [smallest, largest], from the configuration's `[published]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub published: Option<[f64; 2]>,
}

/// How well a predictor does.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Score {
    /// The predictor.
    pub name: String,
    /// Its cost on the fitted logs; absent if its simulation diverged.
    pub cost: Option<f64>,
    /// Free-running position RMSE on the fitted logs, rad: mean over logs.
    pub rmse_fit_rad: Option<f64>,
    /// The same on the validation logs.
    pub rmse_validation_rad: Option<f64>,
    /// The delay of a pure delay, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub delay_seconds: Option<f64>,
}

/// Free-running prediction of one log that was not fitted.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Validation {
    /// The log.
    pub file: String,
    /// Position RMSE over all samples and joints, rad; absent if the simulation diverged.
    pub rmse_rad: Option<f64>,
    /// The same of the robot as its file says.
    pub nominal_rmse_rad: Option<f64>,
    /// Position RMSE by joint (the log's names, the robot's order), rad.
    pub rmse_per_joint: IndexMap<String, f64>,
}

/// The fit by a further cost, and how it compares with the first.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct OtherFit {
    /// What it found.
    #[serde(flatten)]
    pub outcome: CostOutcome,
    /// Its free-running errors on logs that were not fitted.
    pub validation: Vec<Validation>,
    /// Each parameter beside the first cost's.
    pub comparison: Vec<Agreement>,
}

/// A check the configuration states.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Check {
    /// What is checked.
    pub name: String,
    /// The limit.
    pub limit: f64,
    /// What was found; absent if the simulation diverged.
    pub value: Option<f64>,
    /// Whether it holds.
    pub passed: bool,
}

impl Check {
    /// The check in words.
    pub fn text(&self) -> String {
        let value = self.value.map_or_else(|| "diverged".to_owned(), |value| format!("{value:.5}"));
        format!("{} is {value}, limit {}", self.name, self.limit)
    }
}

/// Scores the outcomes of a finished fit.
pub fn results(
    config: &AdaptConfig,
    setup: &Setup,
    outcomes: &[CostOutcome],
    run: &crate::run::RunFolder,
    wall_seconds: f64,
) -> Result<Results, Error> {
    let (first, others) = outcomes.split_first().ok_or_else(|| {
        Error::failed(
            "no candidate of the fit could be simulated to the end: narrow the bounds, lower the deviations or \
             take a smaller simulation.timestep",
        )
    })?;
    let nominal = Theta::default();
    let validation_of = |values: &[f64]| validation(setup, &setup.theta, values, &nominal);
    let validation = validation_of(&first.values())?;

    let mut other_fits = Vec::new();
    for (offset, other) in others.iter().enumerate() {
        let cost_of = |cost: usize| move |candidates: &[Vec<f64>]| costs_of(setup, cost, candidates);
        other_fits.push(OtherFit {
            outcome: other.clone(),
            validation: validation_of(&other.values())?,
            comparison: compare(first, other, cost_of(0), cost_of(offset + 1)).map_err(Error::failed)?,
        });
    }

    let fitted = Score {
        cost: Some(first.best_cost),
        ..simulated_score("fitted simulator", setup, &setup.theta, &first.values())?
    };
    let mut warnings = setup.warnings.clone();
    let parameters: Vec<Parameter> = first
        .parameters
        .iter()
        .map(|found| Parameter {
            found: found.clone(),
            truth: config.truth.get(&found.name).copied(),
            published: config.published.get(&found.name).copied(),
        })
        .collect();
    for name in config.truth.keys().chain(config.published.keys()) {
        if parameters.iter().all(|known| known.found.name != *name) {
            warnings.push(format!("[truth] or [published] names `{name}`, which is not fitted"));
        }
    }
    for parameter in parameters.iter().filter(|parameter| parameter.found.at_bound) {
        let found = &parameter.found;
        if found.value - found.lower >= found.upper - found.value || found.lower != 0.0 {
            warnings.push(format!("{} rests on a bound of its search: widen it, or distrust it", found.name));
        }
    }
    let diverged: usize = outcomes.iter().flat_map(|outcome| &outcome.runs).map(|run| run.diverged).sum();
    if diverged > 0 {
        warnings.push(format!("{diverged} candidates diverged and were ranked last"));
    }
    let mut checks = Vec::new();
    if let Some(limit) = config.check.rmse_rad {
        let value = mean(validation.iter().map(|log| log.rmse_rad));
        let passed = value.is_some_and(|value| value <= limit);
        checks.push(Check { name: "rmse_rad (mean over validation logs)".into(), limit, value, passed });
    }
    Ok(Results {
        name: run.name(),
        robot: setup.model.name.clone(),
        cost_name: first.cost.clone(),
        cost: first.best_cost,
        parameters,
        fitted,
        baselines: baselines(setup)?,
        validation,
        runs: first.runs.clone(),
        other_fits,
        checks,
        warnings,
        run_folder: run.path().display().to_string(),
        wall_seconds,
    })
}

fn costs_of(
    setup: &Setup,
    cost: usize,
    candidates: &[Vec<f64>],
) -> Result<Vec<Option<f64>>, gaitfit_adapt::fit::FitError> {
    let jobs: Vec<Job> =
        candidates.iter().map(|values| Job { cost, values: values.clone(), draw: 0 }).collect();
    let falls = &setup.options.falls;
    let found = evaluate(&setup.fit.simulator, &setup.theta, &setup.costs, falls, &jobs)?;
    Ok(found.into_iter().map(|found| found.cost).collect())
}

/// The mean; `None` when any value is missing or there are none.
fn mean(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let values: Vec<f64> = values.collect::<Option<_>>()?;
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

fn validation(
    setup: &Setup,
    theta: &Theta,
    values: &[f64],
    nominal: &Theta,
) -> Result<Vec<Validation>, Error> {
    let mut found = Vec::new();
    for set in &setup.validate {
        let fitted = simulate_one(&set.simulator, theta, values).map_err(Error::failed)?;
        let plain = simulate_one(&set.simulator, nominal, &[]).map_err(Error::failed)?;
        for (number, log) in set.logs.iter().enumerate() {
            let error = position_rmse(&set.target, number, &fitted[number].position).ok();
            let nominal = position_rmse(&set.target, number, &plain[number].position).ok();
            let errors = error.iter().flat_map(|error| error.per_joint.iter().copied());
            found.push(Validation {
                file: log.name.clone(),
                rmse_rad: error.as_ref().map(|error| error.total),
                nominal_rmse_rad: nominal.map(|error| error.total),
                rmse_per_joint: log.joints.iter().cloned().zip(errors).collect(),
            });
        }
    }
    Ok(found)
}

/// Predictions of the logs of each set.
type Predictions = Vec<Vec<Predicted>>;

/// Mean position RMSE of predictions over all logs of some sets; `None` if one diverged or there are none.
fn rmse<'a>(sets: impl IntoIterator<Item = &'a LogSet>, predicted: &Predictions) -> Option<f64> {
    let mut errors = Vec::new();
    for (set, predicted) in sets.into_iter().zip(predicted) {
        for (number, log) in predicted.iter().enumerate() {
            errors.push(position_rmse(&set.target, number, &log.position).ok().map(|error| error.total));
        }
    }
    mean(errors.into_iter())
}

fn simulated_score(name: &str, setup: &Setup, theta: &Theta, values: &[f64]) -> Result<Score, Error> {
    score(name, setup, |set| simulate_one(&set.simulator, theta, values).map_err(Error::failed))
}

fn score(
    name: &str,
    setup: &Setup,
    predict: impl Fn(&LogSet) -> Result<Vec<Predicted>, Error>,
) -> Result<Score, Error> {
    let fit = vec![predict(&setup.fit)?];
    let validate: Predictions = setup.validate.iter().map(predict).collect::<Result<_, _>>()?;
    let cost = || {
        let mut accumulator = setup.costs[0].begin();
        for (number, log) in fit[0].iter().enumerate() {
            accumulator.add(number, log.signals()).ok()?;
        }
        accumulator.finish().ok().map(|breakdown| breakdown.total).filter(|cost| cost.is_finite())
    };
    Ok(Score {
        name: name.to_owned(),
        cost: cost(),
        rmse_fit_rad: rmse([&setup.fit], &fit),
        rmse_validation_rad: rmse(&setup.validate, &validate),
        delay_seconds: None,
    })
}

/// Longest pure delay looked at, s.
const LONGEST_DELAY: f64 = 0.3;

fn baselines(setup: &Setup) -> Result<Vec<Score>, Error> {
    let late = |set: &LogSet, delay: f64| -> Vec<Predicted> {
        let joints = set.simulator.joints().len();
        let of_log = |log: &super::logs::Log| {
            delayed(TargetSignal { target: log.target(), joints, dt: log.recording.dt }, delay)
        };
        set.logs.iter().map(of_log).collect()
    };
    let score_late = |name: &str, delay: f64| score(name, setup, |set| Ok(late(set, delay)));
    let step = setup.fit.logs.iter().map(|log| log.recording.dt).fold(LONGEST_DELAY, f64::min);
    let error = |delay: f64| rmse([&setup.fit], &vec![late(&setup.fit, delay)]).unwrap_or(f64::INFINITY);
    let delay = best_delay(LONGEST_DELAY, step, error);
    let name = format!("best pure delay ({:.0} ms)", 1e3 * delay);
    Ok(vec![
        simulated_score("nominal model", setup, &Theta::default(), &[])?,
        score_late("echo of the target", 0.0)?,
        Score { delay_seconds: Some(delay), ..score_late(&name, delay)? },
    ])
}
