//! How precisely a fit of a chirp's log will identify the parameters.

use super::body::Body;
use super::settings::ChirpSettings;
use gaitfit_adapt::cost::CostKind;
use gaitfit_adapt::fit::{Problem, off_bounds};
use gaitfit_adapt::{Rollout, Signals, Simulator, Theta};
use gaitfit_fit::adapt::{LogSet, Method, ParameterSensitivity, sensitivities};
use gaitfit_fit::air::Clamped;
use gaitfit_fit::log::Log;
use gaitfit_run::machine;
use gaitfit_settings::Error;
use gaitfit_sim::Candidate;
use std::num::NonZeroUsize;
use std::sync::{Mutex, PoisonError};

/// As `gaitfit sensitivity` on the log that the robot at the start of the search makes.
pub(super) fn forecast(
    settings: &ChirpSettings,
    body: &Body,
    targets: &[f64],
    theta: &Theta,
) -> Result<Vec<ParameterSensitivity>, Error> {
    let config =
        gaitfit_settings::settings::AdaptConfig { costs: vec![CostKind::MatchO], ..body.config.clone() };
    // Differences need room on both sides of a value.
    let values: Vec<f64> = theta.entries().iter().map(|entry| off_bounds(entry, entry.start)).collect();
    let base = Candidate::nominal(&body.model);
    let threads = settings.threads.map_or_else(machine::threads, NonZeroUsize::get);
    let clamped = Clamped::new(&config, body.model.clone(), theta, &base, threads);
    let width = body.names.len();
    // The replay takes its start alone from the joints' signals; the simulated ones then take their place.
    let start = [body.centre.repeat(targets.len() / width), vec![0.0; targets.len()]];
    let mut log = Log {
        name: "the chirp".to_owned(),
        path: "the chirp".into(),
        sidecars: Vec::new(),
        joints: body.names.clone(),
        trajectory: body.trajectory(settings.rate, targets, start),
        mounting: None,
        filled: Vec::new(),
    };
    // First the robot makes the log, then the log is compared with variants of the robot.
    let simulator = clamped.simulator(base.clone(), std::slice::from_ref(&log))?;
    let made = Mutex::new([Vec::new(), Vec::new()]);
    let keep = |_: usize, _: usize, signals: Signals<'_>| {
        let wide = |signal: &[f32]| signal.iter().map(|&value| f64::from(value)).collect();
        *made.lock().unwrap_or_else(PoisonError::into_inner) =
            [wide(signals.position), wide(signals.velocity)];
    };
    let rollout = Rollout { values: values.clone(), ..Rollout::default() };
    simulator.simulate(theta, &[rollout], &keep, &gaitfit_adapt::never).map_err(Error::failed)?;
    [log.trajectory.position, log.trajectory.velocity] =
        made.into_inner().unwrap_or_else(PoisonError::into_inner);
    let set = LogSet::new(&config, &Method::Replay(Box::new(clamped)), &base, vec![log])?;
    let costs = set.costs(&config)?;
    let cost = costs.first().ok_or_else(|| Error::failed("no cost compares the chirp"))?.as_ref();
    let problem =
        Problem { simulator: set.simulator.as_ref(), theta, cost, draw: 0, cancel: &gaitfit_adapt::never };
    let sensitivities = sensitivities(problem, &values, Some(settings.difference))?;
    Ok(sensitivities
        .ok_or_else(|| Error::failed("the simulation of the chirp diverges at the start of the search"))?
        .1)
}
