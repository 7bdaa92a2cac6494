//! From results to the page's plain data.

use super::cost_result::CostFit;
use super::held_out::{Distance, HeldOut, Verdict};
use super::parameter::Parameter;
use super::results::{AdaptResults, MAX_SHOWN};
use super::score::{self, Robot};
use super::setup::Setup;
use super::signals;
use crate::Error;
use crate::machine::now;
use crate::pieces;
use gaitfit_adapt::cost::Signal;
use gaitfit_adapt::fit::{Predicted, RunGeneration, RunOutcome};
use gaitfit_adapt::{Resets, Theta};
use gaitfit_model::Model;
use gaitfit_view::fit::{
    Bound, Comparison, ComparisonEntry, Fit, LogSummary, OptimizerRun, Parameter as Shown, PublishedRange,
    Score, Signal as ShownSignal, Validation,
};
use gaitfit_view::loop_report::{HeldOut as ShownHeldOut, JointDistance, Round};
use gaitfit_view::{FitReport, fit_html};

/// Most commands of the logs that are drawn.
const MAX_COMMANDS: usize = 5000;

/// The page of a finished fit; `course`: the generations of its runs.
pub(super) fn page(setup: &Setup, results: &AdaptResults, course: &[RunGeneration]) -> Result<String, Error> {
    // Logs that were not fitted show more; without any the fitted ones are shown.
    let shown = setup.validate.first().unwrap_or(&setup.fit);
    let (nominal, fitted) = predicted(setup, results, shown.simulator.as_ref())?;
    let robot = match setup.config.robot.as_str() {
        "" => results.robot.clone(),
        file => format!("{} ({file})", results.robot),
    };
    let report = FitReport {
        title: results.name.clone(),
        robot,
        created: now(),
        wall_seconds: results.wall_seconds,
        doubts: results.doubts.clone(),
        converged: Some(results.converged),
        held_out: results.held_out.as_ref().map(|held| held_out_shown(held, setup.method.model())),
        fit_logs: setup.config.logs.clone(),
        log: log(setup, results),
        fits: fits(results, course),
        fitted: score(&results.fitted),
        nominal: results.baselines.first().map(score).unwrap_or_default(),
        baselines: results.baselines.iter().skip(1).map(score).collect(),
        validation: results.validation.iter().map(validation).collect(),
        comparisons: results
            .fits
            .iter()
            .filter(|fit| !fit.comparison.is_empty())
            .map(|fit| comparison(&results.cost_name, fit))
            .collect(),
        traces: if setup.aligned() {
            // Without aligned samples two curves over time would only show different phases.
            signals::traces(shown, setup.method.model(), &fitted, &nominal)
        } else {
            Vec::new()
        },
        distributions: signals::distributions(&shown.logs, setup.method.model(), &fitted, &nominal),
        warnings: warnings(setup, results),
        settings: pieces::settings(&setup.config)?,
        versions: pieces::versions(),
    };
    fit_html(&report).map_err(Error::failed)
}

/// The fit as a round of a loop, without its training.
///
/// # Errors
/// A simulation that fails.
pub fn round(setup: &Setup, results: &AdaptResults, course: &[RunGeneration]) -> Result<Round, Error> {
    let (nominal, fitted) = predicted(setup, results, setup.fit.simulator.as_ref())?;
    Ok(Round {
        wall_seconds: results.wall_seconds,
        log: log(setup, results),
        fits: fits(results, course),
        distributions: signals::distributions(&setup.fit.logs, setup.method.model(), &fitted, &nominal),
        ..Round::default()
    })
}

/// The signals of the robot before and after the fit.
fn predicted(
    setup: &Setup,
    results: &AdaptResults,
    simulator: &dyn gaitfit_adapt::Simulator,
) -> Result<(Vec<Predicted>, Vec<Predicted>), Error> {
    let values: Vec<f64> = results.parameters.iter().map(|parameter| parameter.found.value).collect();
    let nominal = Robot { theta: &Theta::default(), values: &[] }.simulate(simulator, Resets::Never)?;
    let fitted = Robot { theta: &setup.theta, values: &values }.simulate(simulator, Resets::Never)?;
    Ok((nominal, fitted))
}

/// Held-out logs of a robot as the page shows them.
pub fn held_out_shown(held_out: &HeldOut, model: &Model) -> ShownHeldOut {
    let number = |value: Option<f64>| value.unwrap_or(f64::NAN);
    let row = |one: &Distance| {
        let signal = match one.signal {
            Signal::Velocity => ShownSignal::Velocity,
            Signal::Action => ShownSignal::Action,
            _ => ShownSignal::Position,
        };
        let (nominal, fitted, floor) = (number(one.nominal), number(one.fitted), number(one.floor));
        let slides = model.slides(&one.joint);
        JointDistance { joint: one.joint.clone(), slides, signal, nominal, fitted, floor }
    };
    let explained =
        (held_out.verdict() != Verdict::Unknown).then(|| held_out.verdict() == Verdict::Explained);
    let distances = held_out.distances.iter().map(row).collect();
    let gain = held_out.nominal_cost.zip(held_out.cost).map(|(nominal, fitted)| nominal / fitted);
    ShownHeldOut { sentence: sentence(&held_out.sentence()), explained, gain, distances }
}

/// The text with a capital letter and a full stop.
fn sentence(text: &str) -> String {
    let mut letters = text.chars();
    let first = letters.next().map(|letter| letter.to_uppercase().to_string()).unwrap_or_default();
    format!("{first}{}.", letters.as_str().trim_end_matches('.'))
}

fn unknown(value: Option<f64>) -> f64 {
    value.unwrap_or(f64::NAN)
}

/// The content of walking logs.
fn log(setup: &Setup, results: &AdaptResults) -> Option<LogSummary> {
    let (walking, notes) = (setup.method.walking()?, setup.notes.as_ref()?);
    let range = &walking.task.settings.command;
    let rows = setup.fit.logs.iter().filter_map(|log| log.trajectory.command.as_ref());
    let commands: Vec<[f64; 3]> =
        rows.flat_map(|rows| rows.chunks_exact(3)).map(|row| [row[0], row[1], row[2]]).collect();
    // At least 1: logs without commands would ask for a step of 0, with which `step_by` panics.
    let step = commands.len().div_ceil(MAX_COMMANDS).max(1);
    Some(LogSummary {
        source: format!("{} logs", results.trajectories),
        trajectories: results.trajectories as u64,
        seconds: results.seconds,
        falls: results.falls as u64,
        cut_seconds: notes.cut_seconds(),
        commands: commands.into_iter().step_by(step).collect(),
        command_range: [range.x, range.y, range.yaw],
        uncovered: results.uncovered.clone(),
    })
}

fn fits(results: &AdaptResults, course: &[RunGeneration]) -> Vec<Fit> {
    let fit = |fit: &CostFit| {
        let shown = if fit.parameters.len() <= MAX_SHOWN { fit.parameters.as_slice() } else { &[] };
        Fit {
            cost_name: fit.cost_name.clone(),
            nominal_cost: unknown(fit.nominal_cost),
            fitted_cost: fit.cost,
            runs: runs(&fit.cost_name, &fit.runs, course),
            parameters: shown.iter().map(parameter).collect(),
        }
    };
    results.fits.iter().map(fit).collect()
}

/// The courses of a cost's runs.
fn runs(cost: &str, runs: &[RunOutcome], course: &[RunGeneration]) -> Vec<OptimizerRun> {
    let run = |run: &RunOutcome| {
        let generations: Vec<&RunGeneration> =
            course.iter().filter(|one| one.cost == cost && one.seed == run.seed).collect();
        OptimizerRun {
            label: format!("seed {}", run.seed),
            best_cost: run.best_cost,
            best: generations.iter().map(|one| one.best).collect(),
            mean: generations.iter().map(|one| one.mean).collect(),
            sigma: generations.iter().map(|one| one.sigma).collect(),
        }
    };
    runs.iter().map(run).collect()
}

fn parameter(parameter: &Parameter) -> Shown {
    let estimate = &parameter.found;
    // A value at a bound is at the nearer one.
    let bound = if estimate.value - estimate.lower < estimate.upper - estimate.value {
        Bound::Lower
    } else {
        Bound::Upper
    };
    let published =
        |[lower, upper]: [f64; 2]| PublishedRange { lower, upper, source: "[published]".to_owned() };
    Shown {
        name: estimate.name.clone(),
        unit: if estimate.unit == "-" { String::new() } else { estimate.unit.clone() },
        value: estimate.value,
        lower: estimate.lower,
        upper: estimate.upper,
        start: estimate.start,
        spread: unknown(estimate.spread),
        per_run: estimate.per_run.clone(),
        at_bound: estimate.at_bound.then_some(bound),
        published: parameter.published.map(published),
        identified: parameter.identified,
        interval: parameter.interval,
        truth: parameter.truth,
    }
}

fn score(score: &score::Score) -> Score {
    Score {
        name: score.name.clone(),
        cost: unknown(score.cost),
        rmse_fit_rad: unknown(score.rmse_fit_rad),
        rmse_validation_rad: unknown(score.rmse_validation_rad),
    }
}

fn validation(log: &score::Validation) -> Validation {
    Validation {
        file: log.file.clone(),
        cost: unknown(log.cost),
        nominal_cost: unknown(log.nominal_cost),
        rmse_rad: unknown(log.rmse_rad),
        nominal_rmse_rad: unknown(log.nominal_rmse_rad),
        rmse_per_joint: log.rmse_per_joint.iter().map(|(joint, error)| (joint.clone(), *error)).collect(),
    }
}

fn comparison(first: &str, other: &CostFit) -> Comparison {
    let entry = |one: &gaitfit_adapt::fit::Agreement| ComparisonEntry {
        name: one.name.clone(),
        unit: one.unit.clone(),
        first: one.first,
        first_half: unknown(one.first_half),
        second: one.second,
        second_half: unknown(one.second_half),
        agrees: one.agrees,
    };
    Comparison {
        first: first.to_owned(),
        second: other.cost_name.clone(),
        entries: other.comparison.iter().map(entry).collect(),
        reasons: other.comparison.iter().filter_map(|one| one.reason.clone()).collect(),
    }
}

/// Failed checks, the doubts of further costs, what to know of the fit, then of its inputs, and what it found besides.
fn warnings(setup: &Setup, results: &AdaptResults) -> Vec<String> {
    let failed = results.checks.iter().filter(|check| !check.passed);
    let mut warnings: Vec<String> = failed.map(|check| format!("a check failed: {}", check.text())).collect();
    for fit in results.fits.iter().skip(1) {
        let doubts = fit.doubts.iter();
        warnings.extend(
            doubts.map(|doubt| format!("{}: {}: {}", fit.cost_name, doubt.kind.headline(), doubt.text)),
        );
    }
    // Warnings of the setup are about inputs. They come after those about the fit itself.
    for of_inputs in [false, true] {
        let about = results.warnings.iter().filter(|one| setup.warnings.contains(one) == of_inputs);
        warnings.extend(about.cloned());
    }
    warnings.extend(results.springs_in_words());
    warnings
}
