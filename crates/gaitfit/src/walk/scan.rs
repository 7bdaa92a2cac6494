//! The simulations after a search, which measure how well the logs identify each parameter: shown, and stopped when that
//! is asked for.

use crate::watch::{Watch, Work};
use gaitfit_adapt::cost::Signal;
use gaitfit_adapt::{Consume, Rollout, Simulator, SimulatorError, Theta};

/// Rollouts between looks at whether to stop.
const PART: usize = 16;

/// A simulator that takes large batches in parts. Its signals are the other's.
pub struct Scan<'a, S> {
    simulator: &'a S,
    cost: String,
    watch: &'a Watch<'a>,
}

impl<'a, S: Simulator> Scan<'a, S> {
    /// `cost`: whose parameters are measured, for the progress bar.
    pub fn new(simulator: &'a S, cost: &str, watch: &'a Watch<'a>) -> Self {
        Self { simulator, cost: cost.to_owned(), watch }
    }
}

impl<S: Simulator> Simulator for Scan<'_, S> {
    fn joints(&self) -> &[String] {
        self.simulator.joints()
    }

    fn recordings(&self) -> usize {
        self.simulator.recordings()
    }

    fn provides(&self, signal: Signal) -> bool {
        self.simulator.provides(signal)
    }

    fn simulate(
        &self,
        theta: &Theta,
        candidates: &[Rollout],
        consume: &Consume<'_>,
    ) -> Result<(), SimulatorError> {
        let what = format!("{}: interval, candidate", self.cost);
        let all = candidates.len();
        let work = Work { what: &what, total: all, first: 0, parts: "candidates" };
        let counting = (all > PART).then(|| self.watch.begin(work));
        let mut done = 0;
        for part in candidates.chunks(PART) {
            let offset = done;
            self.simulator.simulate(theta, part, &|candidate, recording, signals| {
                consume(offset + candidate, recording, signals);
            })?;
            done += part.len();
            if let Some(counting) = &counting {
                counting.step(done, part.len(), "");
            }
            if self.watch.stop() && done < all {
                break;
            }
        }
        if done < all {
            return Err(SimulatorError("interrupted".to_owned()));
        }
        Ok(())
    }
}
