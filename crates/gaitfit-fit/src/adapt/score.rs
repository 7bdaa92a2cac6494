//! How well robots are predicted: costs and errors on the fitted logs and on others.

use super::log_set::LogSet;
use super::setup::Setup;
use crate::Error;
use crate::air::predictors;
use crate::log::Log;
use gaitfit_adapt::cost::{Cost, CostKind, PositionRmse, Recorded, position_rmse};
use gaitfit_adapt::fit::{FitError, Predicted, simulate_rollout};
use gaitfit_adapt::{Cancel, Resets, Rollout, Simulator, Theta, never};
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

/// Quality of a predictor's predictions.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Score {
    /// The predictor.
    pub name: String,
    /// Its cost on the fitted logs; absent if its simulation diverged.
    pub cost: Option<f64>,
    /// Free-running position RMSE on the fitted logs, rad: mean over logs. Absent where samples cannot be compared one by
    /// one, and if a simulated robot fell or diverged.
    pub rmse_fit_rad: Option<f64>,
    /// The same on the validation logs.
    pub rmse_validation_rad: Option<f64>,
    /// Its cost on the validation logs, in the scaling of these; mean over sets of logs.
    #[serde(default)]
    pub cost_validation: Option<f64>,
    /// The delay of a pure delay, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub delay_seconds: Option<f64>,
}

/// Free-running prediction of one log that was not fitted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// The log.
    pub file: String,
    /// The cost on this log alone, in the scaling of all validation logs that are compared together; absent if the
    /// simulation diverged, and of costs that reset it.
    pub cost: Option<f64>,
    /// The same of the robot before the fit.
    pub nominal_cost: Option<f64>,
    /// Position RMSE over all samples and joints, rad; absent where samples cannot be compared one by one, and if the
    /// simulated robot fell or diverged.
    pub rmse_rad: Option<f64>,
    /// The same of the robot before the fit.
    pub nominal_rmse_rad: Option<f64>,
    /// Position RMSE by joint (the log's names, the robot's order), rad.
    pub rmse_per_joint: IndexMap<String, f64>,
    /// Whether the simulated robot fell.
    #[serde(default)]
    pub fell: bool,
}

/// The unit of position errors of robots without slides. Results do not write it.
pub(super) fn rad() -> String {
    "rad".to_owned()
}

/// Whether it is that.
pub(super) fn is_rad(unit: &str) -> bool {
    unit == "rad"
}

/// A robot as a simulator is asked for it.
#[derive(Clone, Copy)]
pub(super) struct Robot<'a> {
    /// The parameters in which it differs from the simulator's own robot.
    pub theta: &'a Theta,
    /// Their values.
    pub values: &'a [f64],
}

impl Robot<'_> {
    /// Its signals, given what `resets` says.
    pub fn simulate(self, simulator: &dyn Simulator, resets: Resets) -> Result<Vec<Predicted>, Error> {
        self.simulate_until(simulator, resets, &never)
    }

    /// Does what [`Self::simulate`] does, until `cancel` asks to stop: then an error of the kind `Interrupted`.
    pub fn simulate_until(
        self,
        simulator: &dyn Simulator,
        resets: Resets,
        cancel: &Cancel<'_>,
    ) -> Result<Vec<Predicted>, Error> {
        self.simulate_drawn(simulator, resets, 0, cancel)
    }

    /// Does what [`Self::simulate_until`] does, with the random draws of number `draw`.
    pub fn simulate_drawn(
        self,
        simulator: &dyn Simulator,
        resets: Resets,
        draw: u64,
        cancel: &Cancel<'_>,
    ) -> Result<Vec<Predicted>, Error> {
        let rollout = Rollout { values: self.values.to_vec(), resets, draw };
        match simulate_rollout(simulator, self.theta, rollout, cancel) {
            Err(FitError::Cancelled) => {
                let message = "stopped before the end".to_owned();
                Err(gaitfit_run::Error::Interrupted { message, kept: None }.into())
            }
            result => result.map_err(Error::failed),
        }
    }
}

/// The mean; `None` when any value is missing or there are none.
pub(super) fn mean(values: impl IntoIterator<Item = Option<f64>>) -> Option<f64> {
    let values: Vec<f64> = values.into_iter().collect::<Option<_>>()?;
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// The `cost` of the predictions of all its recordings; `None` if one diverged.
fn cost_of(cost: &dyn Cost, predicted: &[Predicted]) -> Option<f64> {
    let mut accumulator = cost.begin();
    for (number, log) in predicted.iter().enumerate() {
        accumulator.add(number, log.signals()).ok()?;
    }
    accumulator.finish().ok().map(|breakdown| breakdown.total).filter(|cost| cost.is_finite())
}

/// Position RMSE of each log of a set, total and by joint.
fn rmse_of(set: &LogSet, predicted: &[Predicted]) -> Vec<Option<PositionRmse>> {
    let rmse = |(number, log): (usize, &Predicted)| {
        // Rows after a fall do not matter, so an error over all rows says nothing.
        let stands = log.fell_at.is_none();
        stands.then(|| position_rmse(&set.reference, number, &log.position).ok()).flatten()
    };
    predicted.iter().enumerate().map(rmse).collect()
}

/// Position errors of the joints whose angles are compared (by the log's names), rad RMS over the logs of a set that were simulated to
/// their ends.
pub(super) fn joint_errors(
    set: &LogSet,
    predict: impl Fn(&LogSet) -> Result<Vec<Predicted>, Error>,
) -> Result<Vec<(String, f64)>, Error> {
    let errors: Vec<PositionRmse> = rmse_of(set, &predict(set)?).into_iter().flatten().collect();
    let Some(log) = set.logs.first().filter(|_| !errors.is_empty()) else { return Ok(Vec::new()) };
    let over_logs = |joint: usize| {
        let squares = errors.iter().filter_map(|error| error.per_joint.get(joint)).map(|error| error * error);
        (squares.sum::<f64>() / errors.len() as f64).sqrt()
    };
    let joints = log.joints.iter().enumerate().map(|(joint, name)| (name.clone(), over_logs(joint)));
    Ok(joints.filter(|(_, error)| !error.is_nan()).collect())
}

/// Mean position RMSE over the logs of some sets; `None` if one diverged or there are none.
fn rmse<'a>(sets: impl IntoIterator<Item = &'a LogSet>, predicted: &[Vec<Predicted>]) -> Option<f64> {
    let of_set = |(set, predicted): (&'a LogSet, &Vec<Predicted>)| rmse_of(set, predicted);
    mean(sets.into_iter().zip(predicted).flat_map(of_set).map(|error| error.map(|error| error.total)))
}

/// The validation of a robot on sets of logs, log by log: by a cost, and by position errors where `aligned`.
pub(super) fn validation(
    kind: CostKind,
    sets: &[LogSet],
    aligned: bool,
    fitted: impl Fn(&LogSet) -> Result<Vec<Predicted>, Error>,
    nominal: impl Fn(&LogSet) -> Result<Vec<Predicted>, Error>,
) -> Result<Vec<Validation>, Error> {
    let mut validations = Vec::new();
    for set in sets {
        let cost = free_running(kind, set)?;
        let (fitted, plain) = (fitted(set)?, nominal(set)?);
        let (errors, nominal) = (rmse_of(set, &fitted), rmse_of(set, &plain));
        for (number, log) in set.logs.iter().enumerate() {
            // A subset keeps the scaling of the whole set, so costs of single logs can be compared with one
            // another.
            let alone = cost.as_ref().and_then(|cost| cost.subset(&[number]));
            let one = |predicted: &[Predicted]| {
                cost_of(alone.as_deref()?, std::slice::from_ref(predicted.get(number)?))
            };
            // Without aligned samples the error of a walk would be that of its phase.
            let error = errors.get(number).and_then(Option::as_ref).filter(|_| aligned);
            let joints = error.iter().flat_map(|error| error.per_joint.iter().copied());
            // NaN marks joints whose angles are not compared: wheels.
            let compared = log.joints.iter().cloned().zip(joints).filter(|(_, error)| !error.is_nan());
            let nominal = nominal.get(number).and_then(Option::as_ref).filter(|_| aligned);
            validations.push(Validation {
                file: log.name.clone(),
                cost: one(&fitted),
                nominal_cost: one(&plain),
                rmse_rad: error.map(|error| error.total),
                nominal_rmse_rad: nominal.map(|error| error.total),
                rmse_per_joint: compared.collect(),
                fell: fitted.get(number).is_some_and(|log| log.fell_at.is_some()),
            });
        }
    }
    Ok(validations)
}

/// A cost against a set; `None` if it resets the simulation, which validation lets run.
fn free_running(kind: CostKind, set: &LogSet) -> Result<Option<Box<dyn Cost>>, Error> {
    if kind.is_privileged() {
        return Ok(None);
    }
    let cost = kind.build(&set.reference, set.simulator.as_ref());
    cost.map(Some).map_err(|error| Error::failed(format!("the validation logs cannot be compared: {error}")))
}

/// Mean over sets of logs of a robot's cost.
pub(super) fn cost_of_sets(
    kind: CostKind,
    sets: &[LogSet],
    predict: impl Fn(&LogSet) -> Result<Vec<Predicted>, Error>,
) -> Result<Option<f64>, Error> {
    let mut values = Vec::with_capacity(sets.len());
    for set in sets {
        let predicted = predict(set)?;
        values.push(free_running(kind, set)?.and_then(|cost| cost_of(cost.as_ref(), &predicted)));
    }
    Ok(mean(values))
}

/// The score of a predictor; `cost`: its first cost on the fitted logs.
pub(super) fn score(
    name: &str,
    setup: &Setup,
    cost: Option<f64>,
    predict: impl Fn(&LogSet) -> Result<Vec<Predicted>, Error>,
) -> Result<Score, Error> {
    let mut score = Score {
        name: name.to_owned(),
        cost,
        rmse_fit_rad: None,
        rmse_validation_rad: None,
        cost_validation: cost_of_sets(setup.config.costs[0], &setup.validate, &predict)?,
        delay_seconds: None,
    };
    if setup.aligned() {
        score.rmse_fit_rad = rmse([&setup.fit], &[predict(&setup.fit)?]);
        let validate = setup.validate.iter().map(&predict).collect::<Result<Vec<_>, _>>()?;
        score.rmse_validation_rad = rmse(&setup.validate, &validate);
    }
    Ok(score)
}

/// Name of the predictor that takes the last reading for the next one.
const LAST_VALUE: &str = "last reading";

/// The last reading in place of every sample until the next one is given, every `horizon` samples.
fn last_value(log: &Log, joints: &[String], horizon: usize) -> Option<Predicted> {
    let read = Recorded::from_trajectory(&log.trajectory, joints, 0).ok()?;
    let width = joints.len().max(1);
    let held = |values: &[f64]| -> Vec<f32> {
        let row = |row: usize| {
            // The reading with which the prediction of this sample began.
            let from = row.saturating_sub(1) / horizon.max(1) * horizon.max(1);
            values[from * width..(from + 1) * width].iter().map(|value| *value as f32)
        };
        (0..values.len() / width).flat_map(row).collect()
    };
    Some(Predicted { position: held(&read.position), velocity: held(&read.velocity), ..Predicted::default() })
}

/// The predictors that a fit has to beat, the robot before the fit first. Those that need no simulator repeat the log's
/// targets, which means something where the simulator is given the targets too: in a replay; or the last reading, where it
/// is given readings.
pub(super) fn baselines(setup: &Setup, nominal_cost: Option<f64>) -> Result<Vec<Score>, Error> {
    let theta = Theta::default();
    let nominal = Robot { theta: &theta, values: &[] };
    let given = setup.config.costs[0].given();
    // An empty θ leaves the simulator's own robot.
    let mut scores = vec![score("nominal model", setup, nominal_cost, |set| {
        nominal.simulate(set.simulator.as_ref(), given)
    })?];
    if setup.method.walking().is_some() {
        // Readings are given at each reset, so holding the last one is the prediction to beat.
        if let Resets::Sensors(horizon) = given {
            let joints = setup.method.joints();
            let held = |set: &LogSet| -> Vec<Predicted> {
                set.logs.iter().filter_map(|log| last_value(log, &joints, horizon)).collect()
            };
            let cost = setup.costs.first().and_then(|cost| cost_of(cost.as_ref(), &held(&setup.fit)));
            scores.push(score(LAST_VALUE, setup, cost, |set| Ok(held(set)))?);
        }
        return Ok(scores);
    }
    let late = |set: &LogSet, delay: f64| predictors::late(&set.logs, delay);
    let error = |delay: f64| rmse([&setup.fit], &[late(&setup.fit, delay)]).unwrap_or(f64::INFINITY);
    // The delay is chosen on the fitted logs only; validation logs then test it.
    let best = predictors::best(&setup.fit.logs, error);
    let late_score = |name: &str, delay: f64| {
        let cost = setup.costs.first().and_then(|cost| cost_of(cost.as_ref(), &late(&setup.fit, delay)));
        score(name, setup, cost, |set| Ok(late(set, delay)))
    };
    scores.push(late_score("echo of the target", 0.0)?);
    let name = format!("best pure delay ({:.0} ms)", 1e3 * best);
    scores.push(Score { delay_seconds: Some(best), ..late_score(&name, best)? });
    Ok(scores)
}
