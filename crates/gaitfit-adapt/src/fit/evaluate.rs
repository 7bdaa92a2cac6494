//! Costs of many candidates on all recordings, as one batch of the simulator.

use super::{FitError, Predicted};
use crate::cost::{Accumulator, Cost, CostError, Simulated};
use crate::{Signals, Simulator, Theta};
use std::sync::Mutex;

/// One candidate to evaluate.
#[derive(Clone, Debug)]
pub struct Job {
    /// Index into the costs.
    pub cost: usize,
    /// One value an entry of θ.
    pub values: Vec<f64>,
}

/// What a worker thread keeps of a candidate while its recordings come in.
struct Pending<'a> {
    accumulator: Box<dyn Accumulator + 'a>,
    missing: usize,
    cost: Option<Result<f64, CostError>>,
}

/// The cost of every job, in their order; `None` for a candidate whose simulation diverged.
pub fn evaluate(
    simulator: &dyn Simulator,
    theta: &Theta,
    costs: &[Box<dyn Cost>],
    jobs: &[Job],
) -> Result<Vec<Option<f64>>, FitError> {
    if jobs.is_empty() {
        return Ok(Vec::new());
    }
    let recordings = simulator.recordings();
    let begin = |job: &Job| {
        Mutex::new(Pending { accumulator: costs[job.cost].begin(), missing: recordings, cost: None })
    };
    let pending: Vec<Mutex<Pending>> = jobs.iter().map(begin).collect();
    let candidates: Vec<Vec<f64>> = jobs.iter().map(|job| job.values.clone()).collect();
    // The thread that brings a candidate's last recording also finishes its cost: sorting runs in parallel.
    simulator.simulate(theta, &candidates, &|candidate, recording, signals: Signals<'_>| {
        let Some(pending) = pending.get(candidate) else { return };
        let mut pending = pending.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if pending.cost.is_some() {
            return;
        }
        let simulated = Simulated {
            position: signals.position,
            velocity: signals.velocity,
            // Replay sends the log's own targets: both sides act the same.
            action: None,
        };
        match pending.accumulator.add(recording, simulated) {
            Err(error) => pending.cost = Some(Err(error)),
            Ok(()) => {
                pending.missing -= 1;
                if pending.missing == 0 {
                    let finished = pending.accumulator.finish().map(|breakdown| breakdown.total);
                    pending.cost = Some(finished);
                }
            }
        }
    })?;
    let finish = |pending: Mutex<Pending>| {
        let pending = pending.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
        match pending.cost {
            Some(Ok(cost)) => Ok(cost.is_finite().then_some(cost)),
            Some(Err(error)) if error.is_candidate_failure() => Ok(None),
            Some(Err(error)) => Err(FitError::Cost(error)),
            None => Err(FitError::Incomplete),
        }
    };
    pending.into_iter().map(finish).collect()
}

/// The signals of one candidate on every recording, in their order.
pub fn simulate_one(
    simulator: &dyn Simulator,
    theta: &Theta,
    values: &[f64],
) -> Result<Vec<Predicted>, FitError> {
    let found: Vec<Mutex<Option<Predicted>>> =
        (0..simulator.recordings()).map(|_| Mutex::new(None)).collect();
    simulator.simulate(theta, &[values.to_vec()], &|_, recording, signals: Signals<'_>| {
        if let Some(slot) = found.get(recording) {
            let predicted =
                Predicted { position: signals.position.to_vec(), velocity: signals.velocity.to_vec() };
            *slot.lock().unwrap_or_else(|poisoned| poisoned.into_inner()) = Some(predicted);
        }
    })?;
    let take = |slot: Mutex<Option<Predicted>>| {
        slot.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner()).ok_or(FitError::Incomplete)
    };
    found.into_iter().map(take).collect()
}
