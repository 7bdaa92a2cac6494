//! The driver: all runs in lock-step, one batch a generation.

use super::evaluate::{Job, evaluate};
use super::least_squares::{self, MAX_ENTRIES, Problem};
use super::run::{Checkpoint, Run};
use super::stop::Stop;
use super::{CostOutcome, FallPenalty, FitError, Origin};
use crate::cmaes::{BoundHandling, CovarianceKind};
use crate::cost::Cost;
use crate::{Cancel, Resets, Simulator, Theta};
use gaitfit_random::{Purpose, derive_seed};
use serde::{Deserialize, Serialize};
use std::sync::OnceLock;

/// Settings of a fit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitOptions {
    /// How runs search.
    #[serde(default)]
    pub method: Method,
    /// Candidates a generation; 0 takes 4 + ⌊3 ln n⌋.
    pub population: usize,
    /// Generations of every start.
    pub generations: usize,
    /// Starts after the first, each once the one before has ended, with twice its population.
    pub restarts: u32,
    /// Seeds: one run for each and each cost.
    pub seeds: Vec<u64>,
    /// Covariance model.
    pub covariance: CovarianceKind,
    /// The treatment of draws outside the bounds. A start or an optimum on bounds (dry friction of 0) is common,
    /// and wants [`BoundHandling::Reflect`].
    pub bounds: BoundHandling,
    /// A run of CMA-ES stops once the smallest costs of this many generations hardly change: the means of their
    /// halves differ by less than a fiftieth, standard error included; 0 never.
    #[serde(default)]
    pub patience: usize,
    /// A run stops once the largest standard deviation of any parameter, or its next step of least squares, fell to
    /// this part of its initial deviation; 0 never stops early.
    pub tolerance: f64,
    /// The charge for falls.
    pub falls: FallPenalty,
    /// Which candidates see the same random draws; nothing to a simulator without randomness.
    pub random_numbers: RandomNumbers,
}

impl Default for FitOptions {
    /// 200 generations of one seed, with the population and covariance of Hansen's tutorial.
    fn default() -> Self {
        Self {
            method: Method::Auto,
            population: 0,
            generations: 200,
            restarts: 0,
            seeds: vec![1],
            covariance: CovarianceKind::Full,
            bounds: BoundHandling::Reflect,
            patience: 0,
            tolerance: 1e-4,
            falls: FallPenalty::default(),
            random_numbers: RandomNumbers::default(),
        }
    }
}

impl FitOptions {
    /// The most generations that a seed can take, restarts among them.
    pub fn max_generations(&self) -> usize {
        self.generations.saturating_mul(self.restarts as usize + 1)
    }
}

/// How a run searches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Least squares for costs of short predictions ([`Resets::Sensors`]) over θ without regularisation, CMA-ES for
    /// all others.
    #[default]
    Auto,
    /// Candidates drawn around a mean that moves to the better ones.
    CmaEs,
    /// Steps along derivatives, for costs that compare sample by sample.
    LeastSquares,
}

impl Method {
    /// Whether runs of `cost` over `theta` are least squares.
    ///
    /// # Errors
    /// [`FitError::Distributions`], [`FitError::Regularised`], [`FitError::TooManyEntries`] where they were asked to be
    /// and cannot.
    pub fn least_squares(self, cost: &dyn Cost, theta: &Theta) -> Result<bool, FitError> {
        let deviations: Vec<f64> = theta.entries().iter().map(|entry| entry.deviation).collect();
        let refused = if cost.differences().is_none() {
            FitError::Distributions(cost.name().to_owned())
        } else if theta.regularisation(&deviations) > 0.0 {
            FitError::Regularised
        } else if theta.len() > MAX_ENTRIES {
            FitError::TooManyEntries { count: theta.len(), max: MAX_ENTRIES }
        } else {
            return Ok(match self {
                Self::Auto => matches!(cost.resets(), Resets::Sensors(_)),
                Self::CmaEs => false,
                Self::LeastSquares => true,
            });
        };
        if self == Self::LeastSquares { Err(refused) } else { Ok(false) }
    }
}

/// Which candidates see the same random draws (torque noise, observation noise). Draws differ from seed to seed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RandomNumbers {
    /// The candidates of a generation (common random numbers); the next generation sees new ones. Candidates are
    /// compared on equal terms and none can adapt to one set of draws.
    #[default]
    Generation,
    /// All candidates of a run: its cost is a fixed function of θ.
    Run,
    /// None: each has its own, as in the paper.
    Candidate,
}

impl RandomNumbers {
    /// The draw of a candidate, by its address.
    pub(super) fn draw(self, seed: u64, generation: u32, candidate: usize) -> u64 {
        let noise = Purpose::TORQUE_NOISE;
        let generation = derive_seed(seed, noise, generation);
        match self {
            Self::Run => derive_seed(seed, noise, 0),
            Self::Generation => generation,
            Self::Candidate => derive_seed(generation, noise, u32::try_from(candidate).unwrap_or(u32::MAX)),
        }
    }
}

/// A fit in progress.
pub struct Fit<'a> {
    simulator: &'a dyn Simulator,
    theta: &'a Theta,
    costs: &'a [Box<dyn Cost>],
    options: FitOptions,
    runs: Vec<Run>,
    generation: usize,
    /// The inputs of the fit; hashing long logs takes a moment.
    origin: OnceLock<Origin>,
}

/// One generation of all runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Generation {
    /// Number, from 1.
    pub generation: usize,
    /// Candidates simulated on all recordings.
    pub evaluations: usize,
    /// The runs that took part.
    pub runs: Vec<RunGeneration>,
}

/// One generation of one run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunGeneration {
    /// Cost name.
    pub cost: String,
    /// Seed.
    pub seed: u64,
    /// Smallest cost of the generation.
    pub best: f64,
    /// Mean of its finite costs.
    pub mean: f64,
    /// CMA-ES step size; multiplies the entries' initial deviations.
    pub sigma: f64,
    /// Candidates whose simulation diverged.
    pub diverged: usize,
    /// Candidates that fell in at least one recording.
    #[serde(default)]
    pub fallen: usize,
    /// Falls of all candidates in all recordings.
    #[serde(default)]
    pub falls: usize,
    /// Smallest cost so far; of least squares that of the last step.
    pub best_so_far: f64,
    /// Its θ.
    pub best_values: Vec<f64>,
    /// Why the run ended, if this was its last generation.
    pub stop: Option<Stop>,
}

impl<'a> Fit<'a> {
    /// A fresh fit.
    pub fn new(
        simulator: &'a dyn Simulator,
        theta: &'a Theta,
        costs: &'a [Box<dyn Cost>],
        options: FitOptions,
    ) -> Result<Self, FitError> {
        let mut runs = Vec::new();
        for (number, cost) in costs.iter().enumerate() {
            let least_squares = options.method.least_squares(cost.as_ref(), theta)?;
            for &seed in &options.seeds {
                runs.push(Run::new(number, seed, least_squares, theta, &options)?);
            }
        }
        Ok(Self { simulator, theta, costs, options, runs, generation: 0, origin: OnceLock::new() })
    }

    /// Resumes from a checkpoint of a fit with the same arguments. `options` may ask for more generations: the fit then ends
    /// with the bits of one that was begun with them, if it has no restarts.
    ///
    /// # Errors
    /// [`FitError::Checkpoint`] that names what differs (logs, joints, parameters, costs, options), or of a checkpoint
    /// that is damaged or has more generations than `options`.
    pub fn resume(
        simulator: &'a dyn Simulator,
        theta: &'a Theta,
        costs: &'a [Box<dyn Cost>],
        options: FitOptions,
        checkpoint: Checkpoint,
    ) -> Result<Self, FitError> {
        let mut fit = Self::new(simulator, theta, costs, options)?;
        if let Some(difference) = fit.origin().difference(&checkpoint.origin) {
            return Err(FitError::Checkpoint(difference));
        }
        if checkpoint.runs.len() != fit.runs.len() {
            return Err(FitError::Checkpoint(format!("it holds {} runs", checkpoint.runs.len())));
        }
        for (run, saved) in fit.runs.iter_mut().zip(checkpoint.runs) {
            *run = run.restored(costs[run.cost].name(), saved, theta, &fit.options)?;
        }
        fit.generation = checkpoint.generation;
        Ok(fit)
    }

    /// The state, to be saved; small.
    pub fn checkpoint(&self) -> Checkpoint {
        Checkpoint {
            generation: self.generation,
            origin: self.origin().clone(),
            runs: self.runs.iter().map(|run| run.save(self.costs[run.cost].name())).collect(),
        }
    }

    fn origin(&self) -> &Origin {
        self.origin.get_or_init(|| Origin::new(self.simulator, self.theta, self.costs, &self.options))
    }

    /// Generations done.
    pub fn generation(&self) -> usize {
        self.generation
    }

    /// Whether every run has ended.
    pub fn finished(&self) -> bool {
        self.runs.iter().all(|run| run.stop.is_some())
    }

    /// Runs one generation of every run that has not ended. `Ok(None)` once all have.
    ///
    /// # Errors
    /// [`FitError::Cancelled`] soon after `cancel` says so: the fit is then as it was before the call, and can be
    /// saved. Otherwise as [`super::evaluate`]; [`FitError::AllDiverged`].
    pub fn step(&mut self, cancel: &Cancel<'_>) -> Result<Option<Generation>, FitError> {
        let active: Vec<usize> = (0..self.runs.len()).filter(|&run| self.runs[run].stop.is_none()).collect();
        if active.is_empty() {
            return Ok(None);
        }
        let stepped = self.least_squares_steps(&active, cancel)?;
        let mut jobs = Vec::new();
        let mut sizes = Vec::with_capacity(active.len());
        for &index in &active {
            let run = &mut self.runs[index];
            let (cost, seed, generation) = (run.cost, run.seed, run.generation());
            let Some(asked) = run.ask() else { continue };
            sizes.push((index, asked.len()));
            jobs.extend(asked.into_iter().enumerate().map(|(candidate, values)| Job {
                cost,
                values,
                draw: self.options.random_numbers.draw(seed, generation, candidate),
            }));
        }
        let results = evaluate(self.simulator, self.theta, self.costs, &self.options.falls, &jobs, cancel)?;
        let recordings = self.simulator.recordings();
        let generation = self.generation + 1;
        let mut reports = Vec::with_capacity(active.len());
        let mut evaluations = jobs.len();
        let mut from = 0;
        for (index, size) in sizes {
            let batch = from..from + size;
            from += size;
            let run = &mut self.runs[index];
            let cost = self.costs[run.cost].as_ref();
            let price = self.options.falls.risk_price(cost, recordings);
            reports.push((index, run.tell(cost.name(), &results[batch], price, recordings, &self.options)?));
        }
        for (index, moved, (report, simulated)) in stepped {
            self.runs[index] = moved;
            evaluations += simulated;
            reports.push((index, report));
        }
        // Runs of least squares were done first; reports come in the order of the runs.
        reports.sort_by_key(|(index, _)| *index);
        let reports = reports.into_iter().map(|(_, report)| report).collect();
        self.generation = generation;
        Ok(Some(Generation { generation, evaluations, runs: reports }))
    }

    /// Takes one step of every run of least squares among `active`. Simulates as many runs together as memory allows. Returns each
    /// run's number, the run after the step, and its report with the number of evaluations. The steps run on copies: if one is
    /// cancelled, no run has moved.
    #[allow(clippy::type_complexity, reason = "a list of three")]
    fn least_squares_steps(
        &self,
        active: &[usize],
        cancel: &Cancel<'_>,
    ) -> Result<Vec<(usize, Run, (RunGeneration, usize))>, FitError> {
        let numbers: Vec<usize> =
            active.iter().copied().filter(|&run| self.runs[run].is_least_squares()).collect();
        let (theta, simulator, options) = (self.theta, self.simulator, &self.options);
        let cost = |run: usize| self.costs[self.runs[run].cost].as_ref();
        let at_once = |&run: &usize| Problem::at_once(cost(run), 2 * theta.len() + 1);
        let at_once = numbers.iter().map(at_once).min().unwrap_or(1);
        let mut steps = Vec::with_capacity(numbers.len());
        for together in numbers.chunks(at_once) {
            let mut moved: Vec<Run> = together.iter().map(|&run| self.runs[run].clone()).collect();
            let mut searches: Vec<_> = moved
                .iter_mut()
                .zip(together)
                .filter_map(|(run, &number)| {
                    let draw = RandomNumbers::Run.draw(run.seed, 0, 0);
                    let problem = Problem { simulator, theta, cost: cost(number), draw, cancel };
                    Some((run.least_squares()?, problem))
                })
                .collect();
            let stepped = least_squares::step(&mut searches, options.generations, options.tolerance)?;
            for ((mut run, stepped), &number) in moved.into_iter().zip(stepped).zip(together) {
                let report = run.stepped(cost(number).name(), stepped)?;
                steps.push((number, run, report));
            }
        }
        Ok(steps)
    }

    /// Smallest value so far of each cost, in the order of the costs.
    pub fn best_costs(&self) -> Vec<Option<f64>> {
        let best = |cost: usize| {
            let runs = self.runs.iter().filter(|run| run.cost == cost);
            runs.filter_map(Run::best).map(|best| best.cost).reduce(f64::min)
        };
        (0..self.costs.len()).map(best).collect()
    }

    /// θ of the best candidate so far of cost number `cost`.
    pub fn best_values(&self, cost: usize) -> Option<&[f64]> {
        let runs = self.runs.iter().filter(|run| run.cost == cost).filter_map(Run::best);
        runs.min_by(|a, b| a.cost.total_cmp(&b.cost)).map(|best| best.x.as_slice())
    }

    /// The results so far, one outcome for each cost; costs without a finite value yet have none.
    pub fn outcomes(&self) -> Vec<CostOutcome> {
        let outcome = |cost: usize| {
            let runs = self.runs.iter().filter(|run| run.cost == cost).filter_map(Run::outcome).collect();
            CostOutcome::new(self.costs[cost].name().to_owned(), self.theta, runs)
        };
        (0..self.costs.len()).filter_map(outcome).collect()
    }
}
