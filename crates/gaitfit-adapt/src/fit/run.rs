//! One CMA-ES run of a fit, and the checkpoint of all.

use super::driver::{FitOptions, RunGeneration};
use super::{Evaluation, FitError, RunOutcome};
use crate::Theta;
use crate::cmaes::{
    Best, CmaError, Population, RestartPlan, RestartStart, Search, SearchState, Settings, StopReason,
    default_population,
};
use serde::{Deserialize, Serialize};

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stop {
    /// It did its generations.
    Generations,
    /// Its deviations shrank to the tolerance.
    Tolerance,
    /// The optimiser's own criteria: nothing changes any more.
    Converged,
    /// The optimiser's own criteria: it cannot go on (steps without bound, degenerate covariance).
    Degenerate,
}

/// One run: a cost and a seed.
#[derive(Clone, Debug)]
pub(super) struct Run {
    /// Index into the costs.
    pub cost: usize,
    pub seed: u64,
    pub stop: Option<Stop>,
    diverged: usize,
    falls: usize,
    search: Search,
    asked: Option<Population>,
}

impl Run {
    pub fn new(cost: usize, seed: u64, theta: &Theta, options: &FitOptions) -> Result<Self, FitError> {
        let search =
            Search::new(settings(seed, theta, options), plan(options)).map_err(FitError::Optimizer)?;
        Ok(Self { cost, seed, stop: None, diverged: 0, falls: 0, search, asked: None })
    }

    /// Number of the next generation, from 1, restarts counted on.
    pub fn generation(&self) -> u32 {
        self.search.generation() + 1
    }

    /// The candidates of the next generation.
    pub fn ask(&mut self) -> Vec<Vec<f64>> {
        let population = self.search.ask();
        let candidates = population.x().to_vec();
        self.asked = Some(population);
        candidates
    }

    /// Takes what the candidates asked for cost (those that diverged are ranked last).
    pub fn tell(
        &mut self,
        name: &str,
        found: &[Evaluation],
        options: &FitOptions,
    ) -> Result<RunGeneration, FitError> {
        let generation = self.generation() as usize;
        let sigma = self.search.current().sigma();
        let finite: Vec<f64> = found.iter().filter_map(|found| found.cost).collect();
        let population = self.asked.take().unwrap_or_else(|| self.search.ask());
        let told: Vec<f64> = found.iter().map(|found| found.cost.unwrap_or(f64::INFINITY)).collect();
        let restarted = self.search.tell(&population, &told).map_err(FitError::Optimizer)?.is_some();
        let diverged = found.len() - finite.len();
        let falls = found.iter().map(|found| found.falls).sum();
        self.diverged += diverged;
        self.falls += falls;
        if finite.is_empty() {
            return Err(FitError::AllDiverged { cost: name.to_owned(), seed: self.seed, generation });
        }
        if !restarted && self.settled(options) {
            self.search.end().map_err(FitError::Optimizer)?;
        }
        self.stop = self.why_stop();
        let Some(best) = self.search.best() else {
            return Err(FitError::AllDiverged { cost: name.to_owned(), seed: self.seed, generation });
        };
        Ok(RunGeneration {
            cost: name.to_owned(),
            seed: self.seed,
            best: finite.iter().copied().fold(f64::INFINITY, f64::min),
            mean: finite.iter().sum::<f64>() / finite.len() as f64,
            sigma,
            diverged,
            fallen: found.iter().filter(|found| found.falls > 0).count(),
            falls,
            best_so_far: best.cost,
            best_values: best.x.clone(),
            stop: self.stop,
        })
    }

    /// Whether the deviations of the run under way shrank to the tolerance.
    fn settled(&self, options: &FitOptions) -> bool {
        let current = self.search.current();
        let first = &current.settings().deviation;
        let left = current.deviations().iter().zip(first).map(|(now, first)| now / first).fold(0.0, f64::max);
        left <= options.tolerance
    }

    /// Why the last restart ended, once it has.
    fn why_stop(&self) -> Option<Stop> {
        let last = self.search.finished().last().filter(|_| self.search.is_finished())?;
        Some(match last.stop {
            StopReason::TolXUp | StopReason::ConditionCov | StopReason::NumericalFailure => Stop::Degenerate,
            StopReason::MaxGenerations => Stop::Generations,
            StopReason::Ended => Stop::Tolerance,
            _ => Stop::Converged,
        })
    }

    /// What the run found so far; `None` before its first finite cost.
    pub fn outcome(&self) -> Option<RunOutcome> {
        let best = self.search.best()?;
        Some(RunOutcome {
            seed: self.seed,
            best_cost: best.cost,
            values: best.x.clone(),
            generations: self.search.generation() as usize,
            stop: self.stop,
            diverged: self.diverged,
            falls: self.falls,
        })
    }

    /// The best candidate so far.
    pub fn best(&self) -> Option<&Best> {
        self.search.best()
    }

    /// State to save, under the cost's name.
    pub fn save(&self, cost: &str) -> SavedRun {
        SavedRun {
            cost: cost.to_owned(),
            seed: self.seed,
            stop: self.stop,
            diverged: self.diverged,
            falls: self.falls,
            state: self.search.state(),
        }
    }

    /// This run in the state `saved`.
    pub fn restored(
        &self,
        cost: &str,
        saved: SavedRun,
        theta: &Theta,
        options: &FitOptions,
    ) -> Result<Self, FitError> {
        if saved.cost != cost || saved.seed != self.seed {
            let found = format!("it holds {} with seed {}", saved.cost, saved.seed);
            return Err(FitError::Checkpoint(format!("{found} where {cost} with seed {} is due", self.seed)));
        }
        let search = Search::resume(settings(self.seed, theta, options), plan(options), saved.state)
            .map_err(|error: CmaError| FitError::Checkpoint(error.to_string()))?;
        Ok(Self {
            cost: self.cost,
            seed: self.seed,
            stop: saved.stop,
            diverged: saved.diverged,
            falls: saved.falls,
            search,
            asked: None,
        })
    }
}

fn settings(seed: u64, theta: &Theta, options: &FitOptions) -> Settings {
    let of = |field: fn(&crate::Entry) -> f64| -> Vec<f64> { theta.entries().iter().map(field).collect() };
    let mut settings = Settings::new(theta.start(seed), of(|entry| entry.deviation), seed)
        .with_bounds(of(|entry| entry.lower), of(|entry| entry.upper));
    settings.population =
        if options.population == 0 { default_population(theta.len()) } else { options.population };
    settings.covariance = options.covariance;
    settings.bound_handling = options.bounds;
    settings.tolerances.max_generations = Some(u32::try_from(options.generations).unwrap_or(u32::MAX));
    settings
}

/// Restarts from the same start with twice the population each time (Auger and Hansen, CEC 2005).
fn plan(options: &FitOptions) -> RestartPlan {
    RestartPlan { runs: options.restarts.saturating_add(1), population_factor: 2, start: RestartStart::Same }
}

/// Everything a fit needs to go on later.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checkpoint {
    /// Generations done.
    pub generation: usize,
    /// Names of θ's entries.
    pub parameters: Vec<String>,
    /// The runs, costs first, then seeds.
    pub runs: Vec<SavedRun>,
}

/// One run as saved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedRun {
    /// Cost name.
    pub cost: String,
    /// Seed.
    pub seed: u64,
    /// Why it ended, if it has.
    pub stop: Option<Stop>,
    /// Candidates that diverged so far.
    pub diverged: usize,
    /// Falls of candidates so far.
    #[serde(default)]
    pub falls: usize,
    /// The optimiser.
    pub state: SearchState,
}
