//! One CMA-ES run of a fit, and the checkpoint of all.

use super::driver::{FitOptions, RunGeneration};
use super::{Evaluation, FitError, RunOutcome};
use crate::Theta;
use crate::cmaes::{Best, Cma, CmaError, Population, Settings, State, StopReason, default_population};
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
    cma: Cma,
    asked: Option<Population>,
}

impl Run {
    pub fn new(cost: usize, seed: u64, theta: &Theta, options: &FitOptions) -> Result<Self, FitError> {
        let cma = Cma::new(settings(seed, theta, options)).map_err(FitError::Optimizer)?;
        Ok(Self { cost, seed, stop: None, diverged: 0, falls: 0, cma, asked: None })
    }

    /// Number of the next generation, from 1.
    pub fn generation(&self) -> u32 {
        self.cma.generation() + 1
    }

    /// The candidates of the next generation.
    pub fn ask(&mut self) -> Vec<Vec<f64>> {
        let population = self.cma.ask();
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
        let generation = self.cma.generation() as usize + 1;
        let finite: Vec<f64> = found.iter().filter_map(|found| found.cost).collect();
        let population = self.asked.take().unwrap_or_else(|| self.cma.ask());
        let told: Vec<f64> = found.iter().map(|found| found.cost.unwrap_or(f64::INFINITY)).collect();
        self.cma.tell(&population, &told).map_err(FitError::Optimizer)?;
        let diverged = found.len() - finite.len();
        let falls = found.iter().map(|found| found.falls).sum();
        self.diverged += diverged;
        self.falls += falls;
        let Some(best) = self.cma.best().filter(|_| !finite.is_empty()) else {
            return Err(FitError::AllDiverged { cost: name.to_owned(), seed: self.seed, generation });
        };
        self.stop = self.why_stop(options);
        Ok(RunGeneration {
            cost: name.to_owned(),
            seed: self.seed,
            best: finite.iter().copied().fold(f64::INFINITY, f64::min),
            mean: finite.iter().sum::<f64>() / finite.len() as f64,
            sigma: self.cma.sigma(),
            diverged,
            fallen: found.iter().filter(|found| found.falls > 0).count(),
            falls,
            best_so_far: best.cost,
            best_values: best.x.clone(),
            stop: self.stop,
        })
    }

    fn why_stop(&self, options: &FitOptions) -> Option<Stop> {
        if let Some(reason) = self.cma.stop() {
            return Some(match reason {
                StopReason::TolXUp | StopReason::ConditionCov | StopReason::NumericalFailure => {
                    Stop::Degenerate
                }
                StopReason::MaxGenerations => Stop::Generations,
                _ => Stop::Converged,
            });
        }
        let first = &self.cma.settings().deviation;
        let left =
            self.cma.deviations().iter().zip(first).map(|(now, first)| now / first).fold(0.0, f64::max);
        (left <= options.tolerance).then_some(Stop::Tolerance)
    }

    /// What the run found so far; `None` before its first finite cost.
    pub fn outcome(&self) -> Option<RunOutcome> {
        let best = self.cma.best()?;
        Some(RunOutcome {
            seed: self.seed,
            best_cost: best.cost,
            values: best.x.clone(),
            generations: self.cma.generation() as usize,
            stop: self.stop,
            diverged: self.diverged,
            falls: self.falls,
        })
    }

    /// The best candidate so far.
    pub fn best(&self) -> Option<&Best> {
        self.cma.best()
    }

    /// State to save, under the cost's name.
    pub fn save(&self, cost: &str) -> SavedRun {
        SavedRun {
            cost: cost.to_owned(),
            seed: self.seed,
            stop: self.stop,
            diverged: self.diverged,
            falls: self.falls,
            state: self.cma.state().clone(),
        }
    }

    /// This run in the state `saved`.
    pub fn restored(&self, cost: &str, saved: SavedRun) -> Result<Self, FitError> {
        if saved.cost != cost || saved.seed != self.seed {
            let found = format!("it holds {} with seed {}", saved.cost, saved.seed);
            return Err(FitError::Checkpoint(format!("{found} where {cost} with seed {} is due", self.seed)));
        }
        let cma = Cma::resume(self.cma.settings().clone(), saved.state)
            .map_err(|error: CmaError| FitError::Checkpoint(error.to_string()))?;
        Ok(Self {
            cost: self.cost,
            seed: self.seed,
            stop: saved.stop,
            diverged: saved.diverged,
            falls: saved.falls,
            cma,
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
    pub state: State,
}
