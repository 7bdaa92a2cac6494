//! Measured and simulated signals as pages show them.

use super::log_set::LogSet;
use gaitfit_adapt::fit::Predicted;
use gaitfit_log::Signal;
use gaitfit_model::Model;
use gaitfit_view::fit::{JointTrace, Signal as Shown, SignalDistribution};

/// One column of a `samples × joints` matrix.
fn column(matrix: &[f32], joint: usize, joints: usize) -> impl Iterator<Item = f64> + '_ {
    matrix.iter().skip(joint).step_by(joints.max(1)).map(|value| f64::from(*value))
}

/// The positions of the first log of a set over time, joint by joint, without wheels.
pub fn traces(set: &LogSet, model: &Model, fitted: &[Predicted], nominal: &[Predicted]) -> Vec<JointTrace> {
    let (Some(log), Some(fitted), Some(nominal)) = (set.logs.first(), fitted.first(), nominal.first()) else {
        return Vec::new();
    };
    let joints = log.joints.len();
    let trace = |(joint, name): (usize, &String)| JointTrace {
        joint: name.clone(),
        file: log.name.clone(),
        time_s: log.trajectory.time.clone(),
        measured: log.trajectory.column_at(Signal::Position, joint).unwrap_or_default(),
        fitted: column(&fitted.position, joint, joints).collect(),
        nominal: column(&nominal.position, joint, joints).collect(),
        target: log.trajectory.column_at(Signal::Target, joint).unwrap_or_default(),
        slides: model.slides(name),
    };
    let compared =
        log.joints.iter().enumerate().filter(|(joint, _)| !log.trajectory.has_velocity_target(*joint));
    compared.map(trace).collect()
}

/// How the signals of a set's joints are distributed over all of its logs; actions where both sides have them.
pub fn distributions(
    set: &LogSet,
    model: &Model,
    fitted: &[Predicted],
    nominal: &[Predicted],
) -> Vec<SignalDistribution> {
    let Some(joints) = set.logs.first().map(|log| &log.joints) else { return Vec::new() };
    let signals = [
        (Signal::Position, Shown::Position),
        (Signal::Velocity, Shown::Velocity),
        (Signal::Action, Shown::Action),
    ];
    let mut found = Vec::with_capacity(signals.len() * joints.len());
    for (joint, name) in joints.iter().enumerate() {
        let is_wheel = set.logs.iter().any(|log| log.trajectory.has_velocity_target(joint));
        for (signal, shown) in signals {
            if is_wheel && signal == Signal::Position {
                continue;
            }
            let measured = set.logs.iter().filter_map(|log| log.trajectory.column_at(signal, joint));
            let measured: Vec<f64> = measured.flatten().collect();
            let samples = |simulated: &[Predicted]| -> Vec<f64> {
                let matrix = |one: &'_ Predicted| match signal {
                    Signal::Position => one.position.clone(),
                    Signal::Velocity => one.velocity.clone(),
                    _ => one.action.clone().unwrap_or_default(),
                };
                let of_log = |one: &Predicted| column(&matrix(one), joint, joints.len()).collect::<Vec<_>>();
                simulated.iter().flat_map(of_log).collect()
            };
            let (nominal, fitted) = (samples(nominal), samples(fitted));
            if measured.is_empty() || fitted.is_empty() {
                continue;
            }
            found.push(SignalDistribution {
                distance_nominal: distance(&nominal, &measured),
                distance_fitted: distance(&fitted, &measured),
                slides: model.slides(name),
                ..SignalDistribution::from_samples(name, shown, &measured, &nominal, &fitted)
            });
        }
    }
    found
}

/// Wasserstein-1 distance of simulated and measured samples; NaN where one is not finite.
fn distance(simulated: &[f64], measured: &[f64]) -> f64 {
    if simulated.iter().chain(measured).any(|value| !value.is_finite()) {
        return f64::NAN;
    }
    let mut simulated: Vec<f32> = simulated.iter().map(|value| *value as f32).collect();
    let mut measured = measured.to_vec();
    simulated.sort_by(f32::total_cmp);
    measured.sort_by(f64::total_cmp);
    gaitfit_adapt::cost::wasserstein1(&simulated, &measured)
}
