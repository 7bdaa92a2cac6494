//! From results to the report's plain data.

use super::results::{OtherFit, Results};
use super::setup::{LogSet, Setup};
use crate::Error;
use crate::machine::now;
use crate::pieces;
use crate::settings::AdaptConfig;
use gaitfit_adapt::Theta;
use gaitfit_adapt::fit::{Predicted, simulate_one};
use gaitfit_log::Signal;
use gaitfit_view::fit::{
    Comparison, ComparisonEntry, Fit, JointTrace, Parameter, PublishedRange, Score, Signal as Shown,
    SignalDistribution, Validation,
};
use gaitfit_view::{FitReport, fit_html};

/// The page of a finished run.
pub fn page(config: &AdaptConfig, setup: &Setup, results: &Results, metrics: &str) -> Result<String, Error> {
    let values: Vec<f64> = results.parameters.iter().map(|parameter| parameter.found.value).collect();
    let shown = setup.validate.first().unwrap_or(&setup.fit);
    let fitted = simulate_one(&shown.simulator, &setup.theta, &values).map_err(Error::failed)?;
    let nominal = simulate_one(&shown.simulator, &Theta::default(), &[]).map_err(Error::failed)?;
    let report = FitReport {
        title: results.name.clone(),
        robot: format!("{} ({})", results.robot, config.robot),
        created: now(),
        wall_seconds: results.wall_seconds,
        fit_logs: config.logs.clone(),
        fits: vec![Fit {
            cost_name: results.cost_name.clone(),
            nominal_cost: results.baselines.first().and_then(|nominal| nominal.cost).unwrap_or(f64::NAN),
            fitted_cost: results.cost,
            parameters: parameters(results),
            runs: pieces::runs(&results.cost_name, &results.runs, metrics),
            ..Fit::default()
        }],
        fitted: score(&results.fitted),
        nominal: results.baselines.first().map(score).unwrap_or_default(),
        baselines: results.baselines.iter().skip(1).map(score).collect(),
        validation: validation(results),
        comparisons: results.other_fits.iter().map(|other| comparison(&results.cost_name, other)).collect(),
        traces: traces(shown, &fitted, &nominal),
        distributions: distributions(shown, &fitted, &nominal),
        warnings: warnings(results),
        settings: pieces::settings(config)?,
        versions: pieces::versions(),
        ..FitReport::default()
    };
    fit_html(&report).map_err(Error::failed)
}

fn unknown(value: Option<f64>) -> f64 {
    value.unwrap_or(f64::NAN)
}

fn score(score: &super::results::Score) -> Score {
    Score {
        name: score.name.clone(),
        cost: unknown(score.cost),
        rmse_fit_rad: unknown(score.rmse_fit_rad),
        rmse_validation_rad: unknown(score.rmse_validation_rad),
    }
}

fn parameters(results: &Results) -> Vec<Parameter> {
    let published = |range: [f64; 2]| PublishedRange {
        lower: range[0],
        upper: range[1],
        source: "[published]".to_owned(),
    };
    results
        .parameters
        .iter()
        .map(|parameter| Parameter {
            published: parameter.published.map(published),
            truth: parameter.truth,
            ..pieces::parameter(&parameter.found)
        })
        .collect()
}

fn validation(results: &Results) -> Vec<Validation> {
    let log = |log: &super::results::Validation| Validation {
        file: log.file.clone(),
        rmse_rad: unknown(log.rmse_rad),
        nominal_rmse_rad: unknown(log.nominal_rmse_rad),
        rmse_per_joint: log.rmse_per_joint.iter().map(|(joint, error)| (joint.clone(), *error)).collect(),
    };
    results.validation.iter().map(log).collect()
}

fn comparison(first: &str, other: &OtherFit) -> Comparison {
    Comparison {
        first: first.to_owned(),
        second: other.outcome.cost.clone(),
        entries: other
            .comparison
            .iter()
            .map(|one| ComparisonEntry {
                name: one.name.clone(),
                unit: one.unit.clone(),
                first: one.first,
                first_spread: unknown(one.first_spread),
                second: one.second,
                second_spread: unknown(one.second_spread),
                agrees: one.agrees,
            })
            .collect(),
        reasons: other.comparison.iter().filter_map(|one| one.reason.clone()).collect(),
    }
}

/// One column of a `samples × joints` matrix.
fn column(matrix: &[f32], joint: usize, joints: usize) -> Vec<f64> {
    matrix.iter().skip(joint).step_by(joints).map(|value| f64::from(*value)).collect()
}

/// The first log of a set, joint by joint.
fn traces(set: &LogSet, fitted: &[Predicted], nominal: &[Predicted]) -> Vec<JointTrace> {
    let log = &set.logs[0];
    let joints = &log.joints;
    let trace = |joint: usize| JointTrace {
        joint: joints[joint].clone(),
        file: log.name.clone(),
        time_s: log.trajectory.time.clone(),
        measured: log.trajectory.column_at(Signal::Position, joint).unwrap_or_default(),
        fitted: column(&fitted[0].position, joint, joints.len()),
        nominal: column(&nominal[0].position, joint, joints.len()),
        target: log.trajectory.column_at(Signal::Target, joint).unwrap_or_default(),
    };
    (0..joints.len()).map(trace).collect()
}

fn distributions(set: &LogSet, fitted: &[Predicted], nominal: &[Predicted]) -> Vec<SignalDistribution> {
    let log = &set.logs[0];
    let joints = &log.joints;
    let mut found = Vec::with_capacity(2 * joints.len());
    for (joint, name) in joints.iter().enumerate() {
        for (signal, shown) in [(Signal::Position, Shown::Position), (Signal::Velocity, Shown::Velocity)] {
            let of = |predicted: &Predicted| {
                let matrix =
                    if signal == Signal::Position { &predicted.position } else { &predicted.velocity };
                column(matrix, joint, joints.len())
            };
            let measured = log.trajectory.column_at(signal, joint).unwrap_or_default();
            let (nominal, fitted) = (of(&nominal[0]), of(&fitted[0]));
            found.push(SignalDistribution {
                distance_nominal: pieces::distance(&nominal, &measured),
                distance_fitted: pieces::distance(&fitted, &measured),
                ..SignalDistribution::from_samples(name, shown, &measured, &nominal, &fitted)
            });
        }
    }
    found
}

fn warnings(results: &Results) -> Vec<String> {
    let failed = results.checks.iter().filter(|check| !check.passed);
    let failed = failed.map(|check| format!("a check failed: {}", check.text()));
    failed.chain(results.warnings.iter().cloned()).collect()
}
