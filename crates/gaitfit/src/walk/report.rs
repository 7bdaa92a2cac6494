//! From a ground fit to the page's plain data.

use super::results::{GroundFit, GroundResults, MOST_SHOWN};
use super::setup::Ground;
use super::simulator::GroundSimulator;
use crate::Error;
use crate::machine::now;
use crate::pieces;
use crate::settings::AdaptConfig;
use gaitfit_adapt::Theta;
use gaitfit_adapt::fit::{Predicted, simulate_one};
use gaitfit_log::Signal;
use gaitfit_view::fit::{Fit, LogSummary, Parameter, Signal as Shown, SignalDistribution};
use gaitfit_view::loop_report::Round;
use gaitfit_view::{FitReport, fit_html};

/// Most commands of the logs that are drawn.
const MOST_COMMANDS: usize = 5000;

/// The page of a finished fit.
pub fn page(
    config: &AdaptConfig,
    ground: &Ground,
    simulator: &GroundSimulator<'_>,
    results: &GroundResults,
    metrics: &str,
) -> Result<String, Error> {
    let round = round(ground, simulator, results, metrics)?;
    let report = FitReport {
        title: results.name.clone(),
        robot: results.robot.clone(),
        created: now(),
        wall_seconds: results.wall_seconds,
        fit_logs: config.logs.clone(),
        log: round.log,
        fits: round.fits,
        distributions: round.distributions,
        warnings: results.warnings.clone(),
        settings: pieces::settings(config)?,
        versions: pieces::versions(),
        ..FitReport::default()
    };
    fit_html(&report).map_err(Error::failed)
}

/// The fit as a round of a loop, without its training.
pub fn round(
    ground: &Ground,
    simulator: &GroundSimulator<'_>,
    results: &GroundResults,
    metrics: &str,
) -> Result<Round, Error> {
    let mut round = Round {
        wall_seconds: results.wall_seconds,
        log: Some(log(ground, results)),
        fits: results.fits.iter().map(|one| fit(one, metrics)).collect(),
        ..Round::default()
    };
    if let Some(first) = results.fits.first() {
        let fitted = simulate_one(simulator, &ground.theta, &first.values()).map_err(Error::failed)?;
        let nominal = simulate_one(simulator, &Theta::default(), &[]).map_err(Error::failed)?;
        round.distributions = distributions(ground, &nominal, &fitted);
    }
    Ok(round)
}

fn log(ground: &Ground, results: &GroundResults) -> LogSummary {
    let range = &ground.scene.settings.command;
    let commands: Vec<[f64; 3]> = ground
        .notes
        .logs
        .iter()
        .flat_map(|log| log.trajectory.command.iter().flatten().copied().collect::<Vec<_>>())
        .collect::<Vec<f64>>()
        .chunks_exact(3)
        .map(|row| [row[0], row[1], row[2]])
        .collect();
    let step = commands.len().div_ceil(MOST_COMMANDS).max(1);
    LogSummary {
        source: format!("{} logs", results.trajectories),
        trajectories: results.trajectories as u64,
        seconds: results.seconds,
        falls: results.falls as u64,
        cut_seconds: ground.notes.cut_seconds(),
        commands: commands.into_iter().step_by(step).collect(),
        command_range: [range.x, range.y, range.yaw],
        uncovered: results.uncovered.clone(),
    }
}

fn fit(found: &GroundFit, metrics: &str) -> Fit {
    let parameters = found
        .parameters
        .iter()
        .map(|parameter| Parameter { truth: parameter.truth, ..pieces::parameter(&parameter.found) });
    Fit {
        cost_name: found.cost_name.clone(),
        nominal_cost: found.nominal_cost.unwrap_or(f64::NAN),
        fitted_cost: found.cost,
        runs: pieces::runs(&found.cost_name, &found.runs, metrics),
        parameters: if found.parameters.len() <= MOST_SHOWN { parameters.collect() } else { Vec::new() },
        ..Fit::default()
    }
}

fn distributions(ground: &Ground, nominal: &[Predicted], fitted: &[Predicted]) -> Vec<SignalDistribution> {
    let joints = ground.scene.walker.joints.len();
    let mut found = Vec::with_capacity(3 * joints);
    for (column, name) in ground.scene.walker.interface.joints.iter().enumerate() {
        let pairs = [
            (Signal::Position, Shown::Position),
            (Signal::Velocity, Shown::Velocity),
            (Signal::Action, Shown::Action),
        ];
        for (signal, shown) in pairs {
            let measured: Vec<f64> = ground
                .notes
                .logs
                .iter()
                .flat_map(|log| log.trajectory.column_at(signal, column).unwrap_or_default())
                .collect();
            let of = |simulated: &[Predicted]| -> Vec<f64> {
                let matrix = |one: &Predicted| -> Vec<f32> {
                    match shown {
                        Shown::Position => one.position.clone(),
                        Shown::Velocity => one.velocity.clone(),
                        Shown::Action => one.action.clone().unwrap_or_default(),
                    }
                };
                let column_of = |one: &Predicted| {
                    matrix(one).into_iter().skip(column).step_by(joints).map(f64::from).collect::<Vec<_>>()
                };
                simulated.iter().flat_map(column_of).collect()
            };
            let (nominal, fitted) = (of(nominal), of(fitted));
            if measured.is_empty() {
                continue;
            }
            found.push(SignalDistribution {
                distance_nominal: pieces::distance(&nominal, &measured),
                distance_fitted: pieces::distance(&fitted, &measured),
                ..SignalDistribution::from_samples(name, shown, &measured, &nominal, &fitted)
            });
        }
    }
    found
}
