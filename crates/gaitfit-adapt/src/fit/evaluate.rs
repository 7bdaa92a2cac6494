//! Costs of many candidates on all recordings, as one batch of the simulator.

use super::{FallPenalty, FitError, Predicted};
use crate::cost::{Accumulator, Cost, CostError};
use crate::{Cancel, Resets, Rollout, Signals, Simulator, Theta, never};
use serde::{Deserialize, Serialize};
use std::sync::Mutex;

/// One candidate to evaluate.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Job {
    /// Index into the costs.
    pub cost: usize,
    /// One value an entry of θ.
    pub values: Vec<f64>,
    /// Random draws of its simulation, see [`Rollout::draw`].
    pub draw: u64,
}

/// The cost and the falls of a candidate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// The cost, with the charge for falls, the modifications' regularisation and the priors; `None` if the simulation diverged.
    pub cost: Option<f64>,
    /// Recordings in which the simulated robot fell.
    pub falls: usize,
}

/// The state of a candidate while its recordings come in.
struct Pending<'a> {
    accumulator: Box<dyn Accumulator + 'a>,
    missing: usize,
    falls: usize,
    cost: Option<Result<f64, CostError>>,
}

/// Evaluates every job, in order: its cost, with the charge for falls, the regularisation and the priors.
///
/// # Errors
/// As [`Simulator::costs`]; [`FitError::Incomplete`] if it does not return one evaluation for each job.
pub fn evaluate(
    simulator: &dyn Simulator,
    theta: &Theta,
    costs: &[Box<dyn Cost>],
    falls: &FallPenalty,
    jobs: &[Job],
    cancel: &Cancel<'_>,
) -> Result<Vec<Evaluation>, FitError> {
    if jobs.is_empty() {
        return Ok(Vec::new());
    }
    let recordings = simulator.recordings();
    let mut evaluations = simulator.costs(theta, costs, jobs, cancel)?;
    if evaluations.len() != jobs.len() {
        return Err(FitError::Incomplete);
    }
    for (evaluation, job) in evaluations.iter_mut().zip(jobs) {
        // The samples that a fall loses are in the cost already; the charge is for the fall itself.
        let charge = falls.charge(costs[job.cost].as_ref(), evaluation.falls, recordings);
        let charged = evaluation
            .cost
            .map(|cost| cost + charge + theta.regularisation(&job.values) + theta.prior_cost(&job.values));
        evaluation.cost = charged.filter(|cost| cost.is_finite());
    }
    Ok(evaluations)
}

/// Simulates every job and compares its signals. [`Simulator::costs`] does this by default.
///
/// # Errors
/// As [`Simulator::costs`].
pub fn accumulate<S: Simulator + ?Sized>(
    simulator: &S,
    theta: &Theta,
    costs: &[Box<dyn Cost>],
    jobs: &[Job],
    cancel: &Cancel<'_>,
) -> Result<Vec<Evaluation>, FitError> {
    let recordings = simulator.recordings();
    let begin = |job: &Job| {
        let accumulator = costs[job.cost].begin();
        Mutex::new(Pending { accumulator, missing: recordings, falls: 0, cost: None })
    };
    // One lock a candidate: its recordings may end on different threads.
    let pending: Vec<Mutex<Pending>> = jobs.iter().map(begin).collect();
    let rollout =
        |job: &Job| Rollout { values: job.values.clone(), resets: costs[job.cost].resets(), draw: job.draw };
    let rollouts: Vec<Rollout> = jobs.iter().map(rollout).collect();
    // The thread that brings a candidate's last recording also finishes its cost: sorting runs in parallel.
    let consume = |candidate: usize, recording: usize, signals: Signals<'_>| {
        let Some(pending) = pending.get(candidate) else { return };
        // A panic on another thread must not hide behind a second one here.
        let mut pending = pending.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        pending.falls += usize::from(signals.fell_at.is_some());
        // An error has already ended this candidate's comparison; its falls still count.
        if pending.cost.is_some() {
            return;
        }
        match pending.accumulator.add(recording, signals) {
            Err(error) => pending.cost = Some(Err(error)),
            Ok(()) => {
                pending.missing -= 1;
                if pending.missing == 0 {
                    let finished = pending.accumulator.finish().map(|breakdown| breakdown.total);
                    pending.cost = Some(finished);
                }
            }
        }
    };
    simulator.simulate(theta, &rollouts, &consume, cancel)?;
    let finish = |pending: Mutex<Pending>| {
        let pending = pending.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
        let cost = match pending.cost {
            Some(Ok(cost)) => cost.is_finite().then_some(cost),
            // A candidate that cannot be compared (a diverged one, say) is ranked last; any other error is the
            // caller's.
            Some(Err(error)) if error.is_candidate_failure() => None,
            Some(Err(error)) => return Err(FitError::Cost(error)),
            None => return Err(FitError::Incomplete),
        };
        Ok(Evaluation { cost, falls: pending.falls })
    };
    pending.into_iter().map(finish).collect()
}

/// The signals of one candidate on every recording, in their order.
///
/// # Errors
/// [`FitError::Simulator`], [`FitError::Incomplete`].
pub fn simulate_one(
    simulator: &dyn Simulator,
    theta: &Theta,
    values: &[f64],
    resets: Resets,
) -> Result<Vec<Predicted>, FitError> {
    let rollout = Rollout { values: values.to_vec(), resets, ..Rollout::default() };
    simulate_rollout(simulator, theta, rollout, &never)
}

/// The signals of one rollout on every recording, in their order, until `cancel` asks to stop.
///
/// # Errors
/// [`FitError::Simulator`], [`FitError::Incomplete`], [`FitError::Cancelled`].
pub fn simulate_rollout(
    simulator: &dyn Simulator,
    theta: &Theta,
    rollout: Rollout,
    cancel: &Cancel<'_>,
) -> Result<Vec<Predicted>, FitError> {
    let predictions: Vec<Mutex<Option<Predicted>>> =
        (0..simulator.recordings()).map(|_| Mutex::new(None)).collect();
    let consume = |_: usize, recording: usize, signals: Signals<'_>| {
        if let Some(slot) = predictions.get(recording) {
            *slot.lock().unwrap_or_else(|poisoned| poisoned.into_inner()) =
                Some(Predicted::from_signals(&signals));
        }
    };
    simulator.simulate(theta, &[rollout], &consume, cancel)?;
    let take = |slot: Mutex<Option<Predicted>>| {
        slot.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner()).ok_or(FitError::Incomplete)
    };
    predictions.into_iter().map(take).collect()
}
