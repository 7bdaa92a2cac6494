//! Validation of a finished fit on other logs, without fitting again.

use super::check::{Check, validation_checks};
use super::files::CONFIG;
use super::held_out::{HeldOut, Verdict, held_out, simulations};
use super::inputs::{Robot, ValidationLogs, method, validation as read_logs};
use super::log_set::LogSet;
use super::score::{Robot as Predictor, Validation, cost_of_sets, mean, validation};
use super::setup::aligned;
use crate::log::Log;
use crate::settings::{self, AdaptConfig, check};
use crate::watch::{Amount, Watch};
use crate::{Error, log, theta};
use gaitfit_adapt::Theta;
use gaitfit_adapt::cost::CostKind;
use gaitfit_policy::Policy;
use gaitfit_sim::Candidate;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The request of a validation.
#[derive(Clone, Debug, Default)]
pub struct ValidateRequest {
    /// The fitted parameters: the theta.toml of a fit.
    pub theta: PathBuf,
    /// Logs to validate on; as in a configuration's `validate`.
    pub logs: Vec<String>,
    /// The fit's configuration; `config.toml` beside the parameters without one.
    pub config: Option<PathBuf>,
    /// Changes of its settings, `key=value`.
    pub set: Vec<String>,
    /// Threads; one for each core without a number.
    pub threads: Option<usize>,
    /// The policy that walked, instead of the configuration's file.
    pub policy: Option<Policy>,
}

/// Quality of a finished fit's predictions of other logs.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ValidateResults {
    /// The fitted parameters.
    pub theta: PathBuf,
    /// Robot name.
    pub robot: String,
    /// The result in a sentence, a doubt first.
    pub headline: String,
    /// Whether the fitted robot is closer to these logs than the robot before the fit: by its cost, or where there is
    /// none by its position errors.
    pub better_than_nominal: bool,
    /// Name of the cost: the fit's first.
    pub cost_name: String,
    /// The cost on these logs, in their own scaling, mean over sets of logs; absent if a simulation diverged.
    pub cost: Option<f64>,
    /// The same of the robot before the fit.
    pub nominal_cost: Option<f64>,
    /// Mean position RMSE over logs, rad; absent where samples cannot be compared one by one.
    pub rmse_rad: Option<f64>,
    /// The same of the robot before the fit.
    pub nominal_rmse_rad: Option<f64>,
    /// Log by log.
    pub validation: Vec<Validation>,
    /// Unit of the position errors over all joints: `rad`, of robots with slides also m.
    #[serde(default = "super::score::rad", skip_serializing_if = "super::score::is_rad")]
    pub position_unit: String,
    /// Walking logs: their distributions beside those of simulated walks, and a floor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub held_out: Option<HeldOut>,
    /// The verdict of these walks on the fit; absent for a clamped robot's logs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// Checks the configuration states.
    pub checks: Vec<Check>,
    /// Facts to know before trusting the numbers.
    pub warnings: Vec<String>,
}

impl ValidateResults {
    /// The checks that failed, in words; `None` if all hold.
    pub fn failed_check(&self) -> Option<String> {
        super::check::failed(&self.checks)
    }

    /// Why the fit must not be used for such logs, in words; absent of fits that explain them.
    pub fn refusal(&self) -> Option<String> {
        let why = match self.verdict {
            _ if !self.better_than_nominal => "the robot before the fit is nearer to these logs",
            Some(Verdict::Misfit) => "misfit",
            Some(Verdict::WorseThanNominal) => {
                "whole walks are farther off than those of the robot before the fit"
            }
            Some(Verdict::Falls) => "it falls where the robot walks",
            _ => return None,
        };
        Some(format!("do not use this fit: {why}"))
    }
}

/// Simulates logs with the robot of a finished fit and with the robot before it.
///
/// # Errors
/// A configuration or files that are not there or not usable, each by name; `Interrupted` soon after `watch` asks to
/// stop.
pub fn validate(request: &ValidateRequest, watch: &Watch<'_>) -> Result<ValidateResults, Error> {
    let theta = theta::find(&request.theta);
    if !theta.exists() {
        return Err(Error::settings(format!("{}: there is no such file or folder", theta.display())));
    }
    // From here on the request names the file itself, not its folder.
    let request = &ValidateRequest { theta, ..request.clone() };
    let path = config_path(request)?;
    let mut config: AdaptConfig = settings::load(Some(&path), &request.set)?;
    // The fitted parameters and logs do not matter here. They are named only to pass the other checks.
    config.validate.clone_from(&request.logs);
    if config.logs.is_empty() {
        config.logs.clone_from(&request.logs);
    }
    check::check(&config, &path)?;
    let Robot { model, policy, base, .. } = Robot::read(&config, &path, request.policy.as_ref())?;
    let file = theta::read(&request.theta)?;
    let fitted = theta::on(base.clone(), &file, &request.theta, &model)?;
    let nothing = Theta::default();
    // Both robots share the method, which keeps as many past targets as the longer delay needs.
    let longest = if largest_delay(&fitted) > largest_delay(&base) { &fitted } else { &base };
    let method = method(&config, policy, model, &nothing, longest, request.threads)?;
    // Logs named on the command line are seen from the current directory.
    let ValidationLogs { sets, doubts: mut warnings, falling } =
        read_logs(&request.logs, &config, Path::new("validate"), &method)?;
    // Only errors count here: the note is about logs that are fitted.
    for logs in &sets {
        log::lead_note(logs, method.walking().is_some())?;
    }
    warnings.extend(theta::doubts(&file, &request.theta, method.model(), method.physics_step()));
    // Fitted and unfitted robot each have their own sets, because a set owns its simulator.
    let simulated = |robot: &Candidate| -> Result<Vec<LogSet>, Error> {
        let set = |logs: &Vec<Log>| LogSet::new(&config, &method, robot, logs.clone());
        sets.iter().map(|logs| Ok(set(logs)?.of_robot(falling))).collect()
    };
    let (after, before) = (simulated(&fitted)?, simulated(&base)?);
    // Both robots are candidates already, so θ is empty.
    let itself = Predictor { theta: &nothing, values: &[] };
    let kind = config.costs[0];
    let stop = || watch.stop();
    // For each set one simulation for the cost and one for the errors, each with the robot after and before the fit.
    let total = 4 * after.len() + if after.is_empty() { 0 } else { 2 * simulations(&method) };
    let amount = Amount { what: "simulation of the logs", parts: "simulations", total, pieces: total };
    let (cost, nominal_cost, validations, held_out) = watch.shared(amount, |done| {
        let predict = |set: &LogSet| {
            let predicted = itself.simulate_until(set.simulator.as_ref(), kind.given(), &stop)?;
            done(1);
            Ok::<_, Error>(predicted)
        };
        // `validation` passes the sets of `after`; the robot before the fit has its own.
        let nominal = |set: &LogSet| {
            let number = after.iter().position(|other| std::ptr::eq(other, set)).unwrap_or_default();
            predict(&before[number])
        };
        let cost = cost_of_sets(kind, &after, predict)?;
        let nominal_cost = cost_of_sets(kind, &before, predict)?;
        let validations = validation(kind, &after, aligned(&config), predict, nominal)?;
        let held_out = match (after.first(), before.first()) {
            (Some(fitted), Some(nominal)) => {
                held_out(&config, &method, [(fitted, itself), (nominal, itself)], &[], (&stop, done))?
            }
            _ => None,
        };
        Ok::<_, Error>((cost, nominal_cost, validations, held_out))
    })?;
    let rmse_rad = mean(validations.iter().map(|log| log.rmse_rad));
    let nominal_rmse_rad = mean(validations.iter().map(|log| log.nominal_rmse_rad));
    // Chance decides much of one simulation's cost. The held-out comparison has several.
    let several = held_out.as_ref().filter(|_| kind == CostKind::Wass && after.len() == 1);
    let (cost, nominal_cost) =
        several.map_or((cost, nominal_cost), |held_out| (held_out.cost, held_out.nominal_cost));
    // The headline depends on the other results, so it is filled in below.
    let mut results = ValidateResults {
        theta: request.theta.clone(),
        robot: method.model().name.clone(),
        headline: String::new(),
        better_than_nominal: better([cost, nominal_cost])
            .or(better([rmse_rad, nominal_rmse_rad]))
            .unwrap_or(false),
        cost_name: kind.to_string(),
        cost,
        nominal_cost,
        rmse_rad,
        nominal_rmse_rad,
        checks: validation_checks(&config.check, &validations, cost),
        validation: validations,
        position_unit: method.model().units("rad"),
        verdict: held_out.as_ref().map(HeldOut::verdict),
        held_out,
        warnings,
    };
    let numbers = numbers(&results);
    results.headline = headline(&results, &numbers);
    if config.check.better_than_nominal {
        let check = Check::holds("better than the nominal robot", results.better_than_nominal, &numbers);
        results.checks.insert(0, check);
    }
    Ok(results)
}

fn config_path(request: &ValidateRequest) -> Result<PathBuf, Error> {
    if let Some(path) = &request.config {
        return Ok(path.clone());
    }
    let beside = request.theta.with_file_name(CONFIG);
    if beside.is_file() {
        return Ok(beside);
    }
    Err(Error::settings(format!(
        "{}: there is no {CONFIG} beside it with the settings of the simulation; give the fit's configuration with \
         --config",
        request.theta.display()
    )))
}

fn largest_delay(robot: &Candidate) -> f64 {
    robot.robot.delay.iter().fold(0.0, |max, &delay| f64::max(max, delay))
}

/// Whether `fitted` is below `nominal`; true if there is no `nominal`, `None` if there is no `fitted`.
fn better([fitted, nominal]: [Option<f64>; 2]) -> Option<bool> {
    let fitted = fitted?;
    Some(nominal.is_none_or(|nominal| fitted < nominal))
}

/// Error after and before the fit, in words.
fn numbers(results: &ValidateResults) -> String {
    let shown = |value: Option<f64>| value.map_or_else(|| "none".to_owned(), |value| format!("{value:.5}"));
    let (name, fitted, nominal) = match results.cost {
        None => {
            let name = format!("position error, {},", results.position_unit);
            (name, results.rmse_rad, results.nominal_rmse_rad)
        }
        cost => (results.cost_name.clone(), cost, results.nominal_cost),
    };
    format!("{name} {} fitted, {} of the robot before the fit", shown(fitted), shown(nominal))
}

fn headline(results: &ValidateResults, numbers: &str) -> String {
    if !results.better_than_nominal {
        return format!("Worse than the nominal robot: {numbers}. On these logs the fit does not help.");
    }
    match &results.held_out {
        None => format!("{numbers}."),
        Some(held_out) if held_out.verdict() == Verdict::Misfit => {
            format!("Misfit: {}. {numbers}.", held_out.sentence())
        }
        Some(held_out) if held_out.verdict() == Verdict::WorseThanNominal => {
            format!("Whole walks worse than the nominal robot's: {}. {numbers}.", held_out.sentence())
        }
        Some(held_out) if held_out.verdict() == Verdict::Falls => {
            format!("Falls where the robot walks: {}. {numbers}.", held_out.sentence())
        }
        Some(held_out) => format!("{numbers}. On whole walks {}.", held_out.sentence()),
    }
}
