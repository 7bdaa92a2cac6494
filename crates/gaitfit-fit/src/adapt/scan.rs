//! The simulations after a search, which measure how well the logs identify each parameter. Their progress is shown.

use crate::watch::{Counting, Watch, Work};
use gaitfit_adapt::fit::{Costs, FitError, Views};
use gaitfit_adapt::{Cancel, Consume, Identity, Rollout, Signals, Simulator, SimulatorError, Theta};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Batches of fewer candidates are not shown.
const FEW: usize = 16;

/// A simulator whose large batches are shown. Its signals are the other's.
pub struct Scan<'a> {
    simulator: &'a dyn Simulator,
    cost: String,
    watch: &'a Watch<'a>,
}

impl<'a> Scan<'a> {
    /// `cost`: whose parameters are measured, for the progress bar.
    pub fn new(simulator: &'a dyn Simulator, cost: &str, watch: &'a Watch<'a>) -> Self {
        Self { simulator, cost: cost.to_owned(), watch }
    }

    fn counting(&self, candidates: usize) -> Counting<'_> {
        let what = format!("{}: interval, candidate", self.cost);
        self.watch.begin(Work { what: &what, total: candidates, first: 0, parts: "candidates", seed: None })
    }
}

impl Simulator for Scan<'_> {
    fn identity(&self) -> &Identity {
        self.simulator.identity()
    }

    fn simulate(
        &self,
        theta: &Theta,
        candidates: &[Rollout],
        consume: &Consume<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<(), SimulatorError> {
        if candidates.len() <= FEW {
            return self.simulator.simulate(theta, candidates, consume, cancel);
        }
        let counting = self.counting(candidates.len());
        let recordings = self.recordings().max(1);
        let simulated = AtomicUsize::new(0);
        let counted = |candidate: usize, recording: usize, signals: Signals<'_>| {
            consume(candidate, recording, signals);
            let done = simulated.fetch_add(1, Ordering::Relaxed) + 1;
            // Recordings of several candidates end in any order, so whole candidates are counted by their number.
            if done.is_multiple_of(recordings) {
                counting.step(done / recordings, 1, "");
            }
        };
        self.simulator.simulate(theta, candidates, &counted, cancel)
    }

    fn views(
        &self,
        theta: &Theta,
        views: &Views<'_>,
        rollouts: &[Rollout],
        notify: &(dyn Fn() + Sync),
        cancel: &Cancel<'_>,
    ) -> Result<(Vec<Costs>, usize), FitError> {
        if rollouts.len() <= FEW {
            return self.simulator.views(theta, views, rollouts, notify, cancel);
        }
        let counting = self.counting(rollouts.len());
        let done = AtomicUsize::new(0);
        // Both progress displays are told: this bar, and whoever asked for the views.
        let notify = || {
            counting.step(done.fetch_add(1, Ordering::Relaxed) + 1, 1, "");
            notify();
        };
        self.simulator.views(theta, views, rollouts, &notify, cancel)
    }

    fn inner(&self) -> Option<&dyn Simulator> {
        Some(self.simulator)
    }
}
