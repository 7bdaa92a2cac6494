//! The driver: all runs in lock-step, one batch a generation.

use super::evaluate::{Job, evaluate};
use super::generation::{Generation, RunGeneration};
use super::least_squares::{self, Problem};
use super::options::{FitOptions, RandomNumbers};
use super::run::{Checkpoint, Run};
use super::{CostOutcome, FitError, Origin};
use crate::cost::Cost;
use crate::{Cancel, Simulator, Theta};
use std::sync::OnceLock;

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
        // Both lists have the same order: costs first, then seeds.
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
        // Least squares steps on copies, so a cancelled batch below leaves every run as it was.
        let stepped = self.least_squares_steps(&active, cancel)?;
        // Then CMA-ES: the candidates of all its runs, in the order of the runs.
        let mut jobs = Vec::new();
        let mut sizes = Vec::with_capacity(active.len());
        for &index in &active {
            let run = &mut self.runs[index];
            let (cost, seed, generation) = (run.cost, run.seed, run.generation());
            // A run of least squares asks for no candidates: it was stepped above.
            let Some(asked) = run.ask() else { continue };
            sizes.push((index, asked.len()));
            jobs.extend(asked.into_iter().enumerate().map(|(candidate, values)| Job {
                cost,
                values,
                draw: self.options.random_numbers.draw(seed, generation, candidate),
            }));
        }
        // The candidates of all runs are one batch, so that the simulator's threads stay busy to the end.
        let results = evaluate(self.simulator, self.theta, self.costs, &self.options.falls, &jobs, cancel)?;
        let recordings = self.simulator.recordings();
        let generation = self.generation + 1;
        // Results come in the order of the jobs, so each run takes its part of them.
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
        // A step simulates the values and two neighbours of each entry.
        let at_once = |&run: &usize| Problem::at_once(cost(run), 2 * theta.len() + 1);
        // Runs of several costs may share a batch, so the smallest limit of all counts.
        // Without such runs any number does except 0, at which `chunks` panics.
        let at_once = numbers.iter().map(at_once).min().unwrap_or(1);
        let mut steps = Vec::with_capacity(numbers.len());
        for together in numbers.chunks(at_once) {
            let mut moved: Vec<Run> = together.iter().map(|&run| self.runs[run].clone()).collect();
            let mut searches: Vec<_> = moved
                .iter_mut()
                .zip(together)
                .filter_map(|(run, &number)| {
                    // Derivatives are differences of simulations, so all simulations of a run share one draw.
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
