//! Fits of a simulator that is written in Python.

use crate::errors::{failed, value};
use crate::watch::in_place;
use gaitfit::watch::{Watch, Work};
use gaitfit_adapt::cost::{Cost, CostKind, Recorded, Reference, Signal};
use gaitfit_adapt::fit::{Checkpoint, CostOutcome, Fit, FitError, FitOptions};
use gaitfit_adapt::{
    Cancel, Consume, Entry, Identity, Modification, Resets, Rollout, Signals, Simulator, SimulatorError,
    Theta,
};
use gaitfit_sim::{Candidate, pool};
use numpy::{PyArray2, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// One recorded run of the robot.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Log<'py> {
    position: PyReadonlyArray2<'py, f64>,
    velocity: PyReadonlyArray2<'py, f64>,
    action: Option<PyReadonlyArray2<'py, f64>>,
}

/// One number to search.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Parameter {
    name: String,
    unit: String,
    lower: f64,
    upper: f64,
    start: f64,
    deviation: f64,
}

/// How to search.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Search {
    cost: String,
    skip: usize,
    population: usize,
    generations: usize,
    seeds: Vec<u64>,
    tolerance: f64,
    checkpoint: Option<PathBuf>,
    intervals: bool,
    max_seconds: Option<f64>,
}

/// Numbers that only the user's simulator understands.
#[derive(Debug)]
struct Numbers(Vec<Entry>);

impl Modification for Numbers {
    fn entries(&self) -> &[Entry] {
        &self.0
    }

    fn apply(&self, _values: &[f64], _joints: &[String], _candidate: &mut Candidate) {}
}

/// The user's function, and the exception that it raised.
struct Own {
    identity: Identity,
    samples: Vec<usize>,
    simulate: Py<PyAny>,
    raised: Mutex<Option<PyErr>>,
}

/// The signals of all candidates on one recording, `candidates × samples × joints`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct Simulated<'py> {
    position: PyReadonlyArray3<'py, f32>,
    velocity: PyReadonlyArray3<'py, f32>,
    action: Option<PyReadonlyArray3<'py, f32>>,
}

impl Own {
    fn call(&self, py: Python<'_>, candidates: &[Rollout], consume: &Consume<'_>) -> PyResult<()> {
        let values: Vec<Vec<f64>> = candidates.iter().map(|candidate| candidate.values.clone()).collect();
        let values = PyArray2::from_vec2(py, &values).map_err(value)?;
        let all: Vec<Simulated<'_>> = self.simulate.call1(py, (values,))?.extract(py)?;
        if all.len() != self.samples.len() {
            let (found, needed) = (all.len(), self.samples.len());
            return Err(value(format!("simulate returned {found} recordings; there are {needed} logs")));
        }
        let width = self.identity.joints.len();
        for (recording, (simulated, &samples)) in all.iter().zip(&self.samples).enumerate() {
            let check = |what: &str, array: &PyReadonlyArray3<'_, f32>| -> PyResult<Vec<f32>> {
                let array = array.as_array();
                let needed = [candidates.len(), samples, width];
                if array.shape() != needed {
                    let found = array.shape();
                    return Err(value(format!(
                        "simulate: {what} of log {recording} has the shape {found:?}; needed: candidates × samples × \
                         joints = {needed:?}"
                    )));
                }
                Ok(array.iter().copied().collect())
            };
            let position = check("position", &simulated.position)?;
            let velocity = check("velocity", &simulated.velocity)?;
            let action = match (&simulated.action, self.provides(Signal::Action)) {
                (Some(action), true) => Some(check("action", action)?),
                (None, true) => {
                    return Err(value(format!(
                        "simulate gave no action for log {recording}, and the logs have actions"
                    )));
                }
                _ => None,
            };
            let size = samples * width;
            let one = |_: &mut (), index: usize| {
                let rows = index * size..(index + 1) * size;
                let signals = Signals {
                    position: &position[rows.clone()],
                    velocity: &velocity[rows.clone()],
                    action: action.as_ref().map(|action| &action[rows.clone()]),
                    ..Signals::default()
                };
                consume(index, recording, signals);
            };
            let mut threads = vec![(); gaitfit::machine::threads()];
            py.detach(|| pool::share(&mut threads, 0..candidates.len(), one));
        }
        Ok(())
    }
}

impl Simulator for Own {
    fn identity(&self) -> &Identity {
        &self.identity
    }

    fn simulate(
        &self,
        _theta: &Theta,
        candidates: &[Rollout],
        consume: &Consume<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<(), SimulatorError> {
        if candidates.iter().any(|candidate| candidate.resets != Resets::Never) {
            return Err(SimulatorError::failed(
                "a simulator in Python cannot be reset on its way: take wass or matcho",
            ));
        }
        if cancel() {
            return Err(SimulatorError::Cancelled);
        }
        Python::attach(|py| self.call(py, candidates, consume)).map_err(|error| {
            let message = SimulatorError::failed(&error);
            *self.raised.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
            message
        })
    }
}

fn recorded(log: &Log<'_>) -> Recorded {
    let flat = |array: &PyReadonlyArray2<'_, f64>| array.as_array().iter().copied().collect();
    Recorded {
        position: flat(&log.position),
        velocity: flat(&log.velocity),
        action: log.action.as_ref().map(flat),
        ..Recorded::default()
    }
}

/// Fits `parameters` of the function `simulate` to `logs`; what was found, as JSON.
#[pyfunction]
pub fn fit_simulator(
    py: Python<'_>,
    simulate: Py<PyAny>,
    joints: Vec<String>,
    logs: Vec<Log<'_>>,
    parameters: Vec<Parameter>,
    search: Search,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    for (number, log) in logs.iter().enumerate() {
        let shape = log.position.as_array().dim();
        let others = [Some(&log.velocity), log.action.as_ref()];
        if shape.1 != joints.len()
            || others.into_iter().flatten().any(|array| array.as_array().dim() != shape)
        {
            return Err(value(format!(
                "log {number}: position, velocity and action must be samples × joints, with {} joints, as position's \
                 {shape:?}",
                joints.len()
            )));
        }
    }
    let entries = parameters.into_iter().map(|parameter| Entry {
        name: parameter.name,
        kind: "parameter",
        unit: parameter.unit,
        joints: Vec::new(),
        lower: parameter.lower,
        upper: parameter.upper,
        start: parameter.start,
        deviation: parameter.deviation,
    });
    let theta = Theta::new(vec![Box::new(Numbers(entries.collect()))]).map_err(value)?;
    let recordings: Vec<Recorded> = logs.iter().map(recorded).collect();
    let mut identity = Identity::new(joints.clone(), logs.len());
    if !logs.is_empty() && logs.iter().all(|log| log.action.is_some()) {
        identity.signals.push(Signal::Action);
    }
    let own = Own {
        identity,
        samples: logs.iter().map(|log| log.position.as_array().nrows()).collect(),
        simulate,
        raised: Mutex::new(None),
    };
    drop(logs);
    let reference = Arc::new(Reference::new(joints, &recordings, search.skip).map_err(value)?);
    let kind: CostKind = search.cost.parse().map_err(value)?;
    let costs: Vec<Box<dyn Cost>> = vec![kind.build(&reference, &own).map_err(value)?];
    let options = FitOptions {
        population: search.population,
        generations: search.generations,
        seeds: search.seeds.clone(),
        tolerance: search.tolerance,
        ..FitOptions::default()
    };
    let outcome =
        in_place(py, progress.as_ref(), |watch| searched(&own, &theta, &costs, options, &search, watch))?;
    if let Some(raised) = own.raised.lock().unwrap_or_else(PoisonError::into_inner).take() {
        return Err(raised);
    }
    serde_json::to_string(&outcome?).map_err(failed)
}

/// Steps the fit to its end, with a checkpoint after every generation.
fn searched(
    own: &Own,
    theta: &Theta,
    costs: &[Box<dyn Cost>],
    options: FitOptions,
    search: &Search,
    watch: &Watch<'_>,
) -> PyResult<serde_json::Value> {
    let wrong = |error: FitError| failed(error);
    let generations = options.max_generations();
    let mut fit = match &search.checkpoint {
        Some(path) if path.exists() => {
            let text = gaitfit::files::read(path, gaitfit::files::MAX_BYTES)
                .map_err(|error| failed(format!("{}: {error}", path.display())))?;
            let checkpoint: Checkpoint = serde_json::from_slice(&text)
                .map_err(|error| failed(format!("{}: {error}", path.display())))?;
            Fit::resume(own, theta, costs, options, checkpoint).map_err(wrong)?
        }
        _ => Fit::new(own, theta, costs, options).map_err(wrong)?,
    };
    let counting = watch.begin(Work {
        what: "generation",
        total: generations,
        first: fit.generation(),
        parts: "candidates",
        seed: None,
    });
    let (cancel, begun) = (|| watch.stop(), Instant::now());
    let limit = search.max_seconds.unwrap_or(f64::INFINITY);
    let mut is_cut = false;
    while let Some(generation) = fit.step(&cancel).map_err(wrong)? {
        if let Some(path) = &search.checkpoint {
            let text = serde_json::to_vec(&fit.checkpoint()).map_err(failed)?;
            gaitfit::files::write(path, &text).map_err(|error| crate::errors::to_py_err(&error.into()))?;
        }
        let best = fit.best_costs().first().copied().flatten();
        let state = best.map_or_else(String::new, |best| format!("cost {best:.5}"));
        counting.step(fit.generation(), generation.evaluations, &state);
        is_cut = begun.elapsed().as_secs_f64() >= limit && !fit.finished();
        if is_cut {
            break;
        }
    }
    drop(counting);
    let mut outcomes: Vec<CostOutcome> = fit.outcomes();
    if let (true, Some(found), Some(cost)) =
        (search.intervals && !is_cut, outcomes.first_mut(), costs.first())
    {
        let draw = found.draw();
        found.identify(own, theta, cost.as_ref(), &[], draw, &cancel).map_err(wrong)?;
    }
    serde_json::to_value(outcomes.first()).map_err(failed)
}
