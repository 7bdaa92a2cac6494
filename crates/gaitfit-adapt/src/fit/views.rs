//! Costs of rollouts on all recordings and without some of them, from the same simulations.

use super::{FitError, Predicted};
use crate::cost::{Cost, CostError};
use crate::{Cancel, Rollout, Signals, Simulator, Theta};
use gaitfit_sim::stats;
use std::sync::Mutex;

/// Groups of recordings.
const GROUPS: usize = 8;

/// The costs of a rollout, one a view; `None` where it diverged.
pub(super) type Costs = Option<Vec<f64>>;

/// A cost and the numbers of the recordings it sees.
pub(super) struct View<'a> {
    pub(super) cost: &'a dyn Cost,
    pub(super) recordings: &'a [usize],
}

/// The cost without each group of recordings, with the numbers of those kept; none if there are fewer than two.
pub(super) fn without_groups(cost: &dyn Cost, recordings: usize) -> Vec<(Box<dyn Cost>, Vec<usize>)> {
    let groups = recordings.min(GROUPS);
    if groups < 2 {
        return Vec::new();
    }
    let without = |group: usize| {
        let kept: Vec<usize> = (0..recordings).filter(|recording| recording % groups != group).collect();
        Some((cost.subset(&kept)?, kept))
    };
    (0..groups).map(without).collect::<Option<_>>().unwrap_or_default()
}

/// The costs of each rollout, one a view, `None` where it diverged; and the bytes of the first one's signals.
pub(super) fn measure(
    simulator: &dyn Simulator,
    theta: &Theta,
    views: &[View<'_>],
    rollouts: &[Rollout],
    cancel: &Cancel<'_>,
) -> Result<(Vec<Costs>, usize), FitError> {
    struct Pending {
        signals: Vec<Option<Predicted>>,
        missing: usize,
        bytes: usize,
        costs: Option<Result<Vec<f64>, CostError>>,
    }
    let recordings = simulator.recordings();
    let begin = |_: &Rollout| {
        Mutex::new(Pending { signals: vec![None; recordings], missing: recordings, bytes: 0, costs: None })
    };
    let pending: Vec<Mutex<Pending>> = rollouts.iter().map(begin).collect();
    let consume = |candidate: usize, recording: usize, signals: Signals<'_>| {
        let Some(pending) = pending.get(candidate) else { return };
        let mut pending = pending.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let Some(slot) = pending.signals.get_mut(recording).filter(|slot| slot.is_none()) else { return };
        let predicted = Predicted::of(&signals);
        let bytes = predicted.bytes();
        *slot = Some(predicted);
        pending.bytes += bytes;
        pending.missing -= 1;
        if pending.missing == 0 {
            let signals = std::mem::take(&mut pending.signals);
            pending.costs = Some(views.iter().map(|view| total(view, &signals)).collect());
        }
    };
    simulator.simulate(theta, rollouts, &consume, cancel)?;
    let mut costs = Vec::with_capacity(rollouts.len());
    let mut bytes = 0;
    for (number, pending) in pending.into_iter().enumerate() {
        let pending = pending.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
        if number == 0 {
            bytes = pending.bytes;
        }
        costs.push(match pending.costs {
            Some(Ok(costs)) => costs.iter().all(|cost| cost.is_finite()).then_some(costs),
            Some(Err(error)) if error.is_candidate_failure() => None,
            Some(Err(error)) => return Err(FitError::Cost(error)),
            None => return Err(FitError::Incomplete),
        });
    }
    Ok((costs, bytes))
}

fn total(view: &View<'_>, signals: &[Option<Predicted>]) -> Result<f64, CostError> {
    let mut accumulator = view.cost.begin();
    for (number, &recording) in view.recordings.iter().enumerate() {
        let signals = signals.get(recording).and_then(Option::as_ref);
        accumulator.add(number, signals.ok_or(CostError::Missing(recording))?.signals())?;
    }
    Ok(accumulator.finish()?.total)
}

/// Jackknife standard error from the values without each group: √((g − 1)/g Σ (xᵢ − x̄)²).
pub(super) fn jackknife(without: &[f64]) -> f64 {
    if without.is_empty() {
        return 0.0;
    }
    let groups = without.len() as f64;
    ((groups - 1.0) / groups * stats::squares(without)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Leave-one-out means of 1, 2, 3, 4 have the standard error of the mean: √(5/3 / 4).
    #[test]
    fn the_jackknife_of_a_mean_is_its_standard_error() {
        let without = [3.0, 8.0 / 3.0, 7.0 / 3.0, 2.0];
        assert!((jackknife(&without) - (5.0_f64 / 12.0).sqrt()).abs() < 1e-15);
    }
}
