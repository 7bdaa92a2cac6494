//! Measured and simulated signals as pages show them.

use super::log_set::LogSet;
use crate::log::Log;
use crate::machine;
use gaitfit_adapt::fit::Predicted;
use gaitfit_log::Signal;
use gaitfit_model::Model;
use gaitfit_sim::pool;
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

/// How the signals of the joints are distributed over all logs; actions where both sides have them.
pub fn distributions(
    logs: &[Log],
    model: &Model,
    fitted: &[Predicted],
    nominal: &[Predicted],
) -> Vec<SignalDistribution> {
    let Some(joints) = logs.first().map(|log| &log.joints) else { return Vec::new() };
    let signals = [
        (Signal::Position, Shown::Position),
        (Signal::Velocity, Shown::Velocity),
        (Signal::Action, Shown::Action),
    ];
    // The angle of a wheel grows without end, so its distribution means nothing.
    let is_wheel = |joint: usize| logs.iter().any(|log| log.trajectory.has_velocity_target(joint));
    let shown: Vec<(usize, (Signal, Shown))> = (0..joints.len())
        .flat_map(|joint| signals.map(|signal| (joint, signal)))
        .filter(|(joint, (signal, _))| *signal != Signal::Position || !is_wheel(*joint))
        .collect();
    let distribution = |number: usize| {
        let (joint, (signal, shown)) = shown[number];
        // All logs are pooled: a distribution needs no order in time.
        let measured = logs.iter().filter_map(|log| log.trajectory.column_at(signal, joint));
        let measured: Vec<f64> = measured.flatten().collect();
        let samples = |simulated: &[Predicted]| -> Vec<f64> {
            let matrix = |one: &Predicted| -> Vec<f64> {
                let matrix = match signal {
                    Signal::Position => &one.position,
                    Signal::Velocity => &one.velocity,
                    _ => one.action.as_deref().unwrap_or_default(),
                };
                column(matrix, joint, joints.len()).collect()
            };
            simulated.iter().flat_map(matrix).collect()
        };
        let (nominal, fitted) = (samples(nominal), samples(fitted));
        // A signal that one side lacks cannot be compared.
        if measured.is_empty() || fitted.is_empty() || nominal.is_empty() {
            return None;
        }
        Some(SignalDistribution {
            distance_nominal: distance(&nominal, &measured),
            distance_fitted: distance(&fitted, &measured),
            slides: model.slides(&joints[joint]),
            ..SignalDistribution::from_samples(&joints[joint], shown, &measured, &nominal, &fitted)
        })
    };
    pool::map(shown.len(), machine::threads(), distribution).into_iter().flatten().collect()
}

/// Wasserstein-1 distance of simulated and measured samples; NaN where one is not finite.
fn distance(simulated: &[f64], measured: &[f64]) -> f64 {
    let distances = gaitfit_adapt::cost::wasserstein1_of_columns(simulated, measured, 1);
    distances.ok().and_then(|distances| distances.first().copied()).unwrap_or(f64::NAN)
}
