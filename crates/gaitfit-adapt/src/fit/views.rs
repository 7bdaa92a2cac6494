//! Costs of rollouts on all recordings and without some of them, from the same simulations.

use super::{FitError, Predicted};
use crate::cost::{Cost, CostError};
use crate::{Cancel, Rollout, Signals, Simulator, Theta};
use gaitfit_sim::stats;
use std::sync::Mutex;

/// Groups of recordings.
const GROUPS: usize = 8;

/// The costs of a rollout, one a view; `None` where it diverged.
pub type Costs = Option<Vec<f64>>;

/// The sets of recordings of a cost: first all, then all but one group, for each group.
pub struct Views<'a> {
    cost: &'a dyn Cost,
    recordings: usize,
    without: Vec<(Box<dyn Cost>, Vec<usize>)>,
}

impl<'a> Views<'a> {
    /// One view of all `recordings` of this number of `logs` ([`Simulator::logs`]), and views that each leave out a
    /// group of logs, if there are at least two logs and the cost can be computed for fewer. Recordings of one log are
    /// in one group: they do not differ by chance alone.
    pub fn new(cost: &'a dyn Cost, recordings: usize, logs: usize) -> Self {
        let logs = logs.clamp(1, recordings.max(1));
        // A further group costs one more evaluation of the cost, and no simulation.
        let groups = logs.min(GROUPS);
        let without = |group: usize| {
            let kept: Vec<usize> =
                // Recordings repeat the logs in their order, so `recording % logs` is the log.
                (0..recordings).filter(|recording| recording % logs % groups != group).collect();
            Some((cost.subset(&kept)?, kept))
        };
        // Without the only group nothing would be left to compare.
        let all = if groups < 2 { None } else { (0..groups).map(without).collect::<Option<_>>() };
        Self { cost, recordings, without: all.unwrap_or_default() }
    }

    /// All recordings alone.
    pub fn whole(cost: &'a dyn Cost, recordings: usize) -> Self {
        Self { cost, recordings, without: Vec::new() }
    }

    /// The cost, of all recordings.
    pub fn cost(&self) -> &'a dyn Cost {
        self.cost
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        1 + self.without.len()
    }

    /// The costs of all views.
    fn totals(&self, signals: &[Option<Predicted>]) -> Result<Vec<f64>, CostError> {
        let whole = total(self.cost, 0..self.recordings, signals);
        let parts = self.without.iter();
        let parts = parts.map(|(cost, kept)| total(cost.as_ref(), kept.iter().copied(), signals));
        std::iter::once(whole).chain(parts).collect()
    }
}

/// The costs of each rollout, and the bytes of the first one's signals, which were in memory together: what
/// [`Simulator::views`] does by default. `notify` is called for each rollout that is done.
///
/// # Errors
/// As [`Simulator::views`].
pub fn measure<S: Simulator + ?Sized>(
    simulator: &S,
    theta: &Theta,
    views: &Views<'_>,
    rollouts: &[Rollout],
    notify: &(dyn Fn() + Sync),
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
        // A panic on another thread must not hide behind a second one here.
        let mut pending = pending.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        // A simulator may bring a recording only once.
        let Some(slot) = pending.signals.get_mut(recording).filter(|slot| slot.is_none()) else { return };
        let predicted = Predicted::from_signals(&signals);
        let bytes = predicted.bytes();
        *slot = Some(predicted);
        pending.bytes += bytes;
        pending.missing -= 1;
        if pending.missing == 0 {
            // Taken out, so that the signals are freed as soon as their costs are known.
            let signals = std::mem::take(&mut pending.signals);
            pending.costs = Some(views.totals(&signals));
            notify();
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
        // A diverged rollout has no costs; any other error is the caller's.
        costs.push(match pending.costs {
            Some(Ok(costs)) => costs.iter().all(|cost| cost.is_finite()).then_some(costs),
            Some(Err(error)) if error.is_candidate_failure() => None,
            Some(Err(error)) => return Err(FitError::Cost(error)),
            None => return Err(FitError::Incomplete),
        });
    }
    Ok((costs, bytes))
}

/// The cost of some recordings, which it numbers anew.
fn total(
    cost: &dyn Cost,
    recordings: impl Iterator<Item = usize>,
    signals: &[Option<Predicted>],
) -> Result<f64, CostError> {
    let mut accumulator = cost.begin();
    for (number, recording) in recordings.enumerate() {
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
