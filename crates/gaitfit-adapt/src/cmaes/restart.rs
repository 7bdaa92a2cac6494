//! Several runs after one another: the spread of their results tells how far to trust them, and larger populations
//! find their way out of local minima.

use super::{Best, Cma, CmaError, Population, Settings, State, StopReason};
use gaitfit_random::{Purpose, Stream, derive_seed};
use serde::{Deserialize, Serialize};

/// Where runs after the first begin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RestartStart {
    /// At the same start as the first.
    #[default]
    Same,
    /// Uniformly drawn between the bounds, which must be finite.
    Uniform,
}

/// How often to start, and how the runs differ. Every run has its own seed: run 0 that of the settings, run r a
/// seed derived from it and r.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RestartPlan {
    /// Number of runs, at least 1.
    pub runs: u32,
    /// Population of each run relative to the one before: 1 for independent runs, 2 for IPOP-CMA-ES (Auger and
    /// Hansen, CEC 2005).
    pub population_factor: u32,
    /// Where the runs begin.
    pub start: RestartStart,
}

impl Default for RestartPlan {
    fn default() -> Self {
        Self { runs: 1, population_factor: 1, start: RestartStart::Same }
    }
}

/// Result of one finished run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunSummary {
    /// Number of the run, from 0.
    pub run: u32,
    /// Its seed.
    pub seed: u64,
    /// Its population.
    pub population: usize,
    /// Generations it took.
    pub generations: u32,
    /// Candidates it evaluated.
    pub evaluations: u64,
    /// Why it ended.
    pub stop: StopReason,
    /// Its best candidate; `None` if every candidate failed.
    pub best: Option<Best>,
    /// Its final mean, in the problem's units.
    pub mean: Vec<f64>,
    /// Its final standard deviations, in the problem's units.
    pub deviations: Vec<f64>,
}

/// Everything to save of a [`Search`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SearchState {
    /// Finished runs, in order.
    pub finished: Vec<RunSummary>,
    /// State of the run under way, or of the last one when all are finished.
    pub current: State,
}

/// Largest population that doubling may reach.
const POPULATION_MAX: usize = 1 << 20;

/// Runs of [`Cma`] one after the other, as a [`RestartPlan`] has them. Callers ask for candidates and report costs
/// (tell) as for a single run.
#[derive(Clone, Debug, PartialEq)]
pub struct Search {
    settings: Settings,
    plan: RestartPlan,
    finished: Vec<RunSummary>,
    current: Cma,
}

impl Search {
    /// A search at the start of run 0.
    ///
    /// # Errors
    /// As [`Settings::check`], and if the plan cannot be carried out.
    pub fn new(settings: Settings, plan: RestartPlan) -> Result<Self, CmaError> {
        check(&settings, plan)?;
        let current = Cma::new(run_settings(&settings, plan, 0))?;
        Ok(Self { settings, plan, finished: Vec::new(), current })
    }

    /// Continues from a saved `state` of a search with the same `settings` and `plan`, to the same bits. The limit of
    /// generations may have changed: if it is higher now, a last run that ended at the old limit goes on.
    ///
    /// # Errors
    /// [`CmaError::State`] if the state does not fit, and as [`Self::new`].
    pub fn resume(settings: Settings, plan: RestartPlan, state: SearchState) -> Result<Self, CmaError> {
        check(&settings, plan)?;
        let mut finished = state.finished;
        let ended = finished.len() as u64;
        let mut complete = ended == u64::from(plan.runs) || has_target(&finished);
        if ended > u64::from(plan.runs) {
            return Err(CmaError::State(format!("it has {ended} finished runs of {}", plan.runs)));
        }
        // A state read from a file is checked in full: a damaged one would give other results without an error.
        let n = settings.start.len();
        for (number, run) in (0_u32..).zip(&finished) {
            // A run in which every candidate failed has no best one, and nothing to check.
            let bests = run.best.as_ref().map(|best| best.x.len());
            if run.run != number
                || run.mean.len() != n
                || run.deviations.len() != n
                || bests.unwrap_or(n) != n
            {
                return Err(CmaError::State(format!("its finished run {number} is damaged")));
            }
        }
        // The state of a search that is complete is that of its last run.
        let run = if complete { ended.saturating_sub(1) } else { ended } as u32;
        // The cast above is exact: `ended` is at most `plan.runs`, which has 32 bits.
        let current = Cma::resume(run_settings(&settings, plan, run), state.current)?;
        let limit = settings.tolerances.max_generations.unwrap_or(u32::MAX);
        // A run was cut if it ended at its limit of generations and the limit is higher now.
        let cut = |run: &RunSummary| run.stop == StopReason::MaxGenerations && run.generations < limit;
        if complete && finished.last().is_some_and(cut) {
            // The run goes on from its state, which `current` still holds.
            finished.pop();
            complete = false;
        }
        // A run that is followed by others cannot go on, and none can be cut: only the limit that it ended at fits.
        let other_limit = |run: &&RunSummary| cut(run) || run.generations > limit;
        if let Some(other) = finished.iter().find(other_limit) {
            let (run, done) = (u64::from(other.run) + 1, other.generations);
            return Err(CmaError::State(format!(
                "its search number {run} ended after {done} generations, and the limit is {limit} now: give {done}"
            )));
        }
        if current.generation() > limit {
            let done = current.generation();
            return Err(CmaError::State(format!(
                "it has done {done} generations, and the limit is {limit} now"
            )));
        }
        let mut search = Self { settings, plan, finished, current };
        // A lower limit that is reached already, or a criterion that was met together with the lower limit.
        if let (false, Some(stop)) = (complete, search.current.stop()) {
            search.conclude(stop)?;
        }
        Ok(search)
    }

    /// Everything to save for [`Self::resume`].
    pub fn state(&self) -> SearchState {
        SearchState { finished: self.finished.clone(), current: self.current.state().clone() }
    }

    /// The candidates due. Pure: asking again returns the same.
    pub fn ask(&self) -> Population {
        self.current.ask()
    }

    /// Updates the run under way as [`Cma::tell`]. When that ends it, the next one begins and the summary of the
    /// ended one is returned.
    ///
    /// # Errors
    /// As [`Cma::tell`]; [`CmaError::Finished`] if no run is left.
    pub fn tell(&mut self, population: &Population, costs: &[f64]) -> Result<Option<&RunSummary>, CmaError> {
        if self.is_finished() {
            return Err(CmaError::Finished);
        }
        self.current.tell(population, costs)?;
        match self.current.stop() {
            Some(stop) => self.conclude(stop).map(Some),
            None => Ok(None),
        }
    }

    /// Ends the run under way as [`StopReason::Ended`]; the next one begins. Returns the ended run's summary.
    ///
    /// # Errors
    /// [`CmaError::Finished`] if no run is left.
    pub fn end(&mut self) -> Result<&RunSummary, CmaError> {
        if self.is_finished() {
            return Err(CmaError::Finished);
        }
        self.conclude(StopReason::Ended)
    }

    fn conclude(&mut self, stop: StopReason) -> Result<&RunSummary, CmaError> {
        // A summary is all that stays of an ended run; the next one takes the place of its state.
        self.finished.push(RunSummary {
            run: self.run(),
            seed: self.current.settings().seed,
            population: self.current.settings().population,
            generations: self.current.generation(),
            evaluations: self.current.evaluations(),
            stop,
            best: self.current.best().cloned(),
            mean: self.current.mean(),
            deviations: self.current.deviations(),
        });
        // After the last run `current` stays that run, so that its state can still be saved.
        if !self.is_finished() {
            self.current = Cma::new(run_settings(&self.settings, self.plan, self.finished.len() as u32))?;
        }
        // A summary was pushed above, so there is a last one.
        self.finished.last().ok_or(CmaError::Finished)
    }

    /// Whether all runs have ended, or one reached the target cost.
    pub fn is_finished(&self) -> bool {
        self.finished.len() as u64 == u64::from(self.plan.runs) || has_target(&self.finished)
    }

    /// Number of the run under way (or due), from 0.
    pub fn run(&self) -> u32 {
        self.finished.len() as u32
    }

    /// Finished runs, in order.
    pub fn finished(&self) -> &[RunSummary] {
        &self.finished
    }

    /// The run under way, or the last one when all are finished.
    pub fn current(&self) -> &Cma {
        &self.current
    }

    /// The best candidate of all runs; of equal ones the earliest.
    pub fn best(&self) -> Option<&Best> {
        let runs = self.finished.iter().filter_map(|run| run.best.as_ref());
        // Once all runs have ended, `current` comes twice. Of equal costs the first counts, so that changes nothing.
        runs.chain(self.current.best())
            .reduce(|best, other| if other.cost < best.cost { other } else { best })
    }

    /// The run before [`Self::current`] that found [`Self::best`]; `None` if `current` did.
    pub fn best_run(&self) -> Option<&RunSummary> {
        // Once all runs have ended, the last of them is `current`.
        let before = self.finished.len().saturating_sub(usize::from(self.is_finished()));
        let best = self.best()?;
        self.finished.iter().take(before).find(|run| run.best.as_ref() == Some(best))
    }

    /// Number of generations in all runs whose costs were reported.
    pub fn generation(&self) -> u32 {
        let ended: u32 = self.finished.iter().map(|run| run.generations).sum();
        // After the last run `current` is still that run, which is already among the finished ones.
        if self.is_finished() { ended } else { ended + self.current.generation() }
    }

    /// Number of candidates in all runs whose costs were reported.
    pub fn evaluations(&self) -> u64 {
        let ended: u64 = self.finished.iter().map(|run| run.evaluations).sum();
        if self.is_finished() { ended } else { ended + self.current.evaluations() }
    }
}

fn has_target(finished: &[RunSummary]) -> bool {
    finished.last().is_some_and(|run| run.stop == StopReason::TargetCost)
}

fn check(settings: &Settings, plan: RestartPlan) -> Result<(), CmaError> {
    for (what, value) in [("runs", plan.runs), ("population factor", plan.population_factor)] {
        if value == 0 {
            return Err(CmaError::Setting { what, value: 0.0, requirement: "at least 1" });
        }
    }
    settings.check()?;
    if plan.start == RestartStart::Uniform {
        for (what, bounds) in [("lower bound", &settings.lower), ("upper bound", &settings.upper)] {
            if let Some(index) = bounds.iter().position(|bound| !bound.is_finite()) {
                let requirement = "finite for uniform starts";
                return Err(CmaError::Coordinate { what, index, value: bounds[index], requirement });
            }
        }
    }
    Ok(())
}

/// The settings of run `run`.
fn run_settings(settings: &Settings, plan: RestartPlan, run: u32) -> Settings {
    let mut changed = settings.clone();
    if run == 0 {
        return changed;
    }
    // With the seed of run 0, a run from the same start with the same population would be its copy.
    changed.seed = derive_seed(settings.seed, Purpose::RESTART, run);
    // Saturating: the limit below cuts what is too large.
    let factor = (plan.population_factor as usize).saturating_pow(run);
    // A stated population above the limit stays as it is.
    changed.population =
        settings.population.saturating_mul(factor).min(POPULATION_MAX.max(settings.population));
    if plan.start == RestartStart::Uniform {
        let stream = Stream::new(changed.seed, Purpose::RESTART);
        for (i, start) in changed.start.iter_mut().enumerate() {
            let (lower, upper) = (settings.lower[i], settings.upper[i]);
            // Rounding may carry the draw beyond the upper bound.
            *start = (lower + stream.uniform(i as u32) * (upper - lower)).clamp(lower, upper);
        }
    }
    changed
}
