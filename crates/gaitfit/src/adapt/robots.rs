//! Simulated robots with values drawn around those found, which correct fits of walking logs by distributions.

use super::replicas::Replicas;
use super::setup::Setup;
use crate::settings::AdaptConfig;
use crate::watch::{Counting, Watch, Work};
use gaitfit_adapt::cost::CostKind;
use gaitfit_adapt::fit::{
    CostOutcome, Distributions, FitError, Logs, Method, Predicted, Problem, Regression, Walks, regress,
};
use gaitfit_adapt::{Resets, Rollout, Signals, Simulator};
use gaitfit_random::{Purpose, derive_seed};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Robots that a GPU simulates at once.
const AT_ONCE: usize = 128;
/// Robots of a round for each of `optimizer.replicates`.
const EACH: usize = 20;

/// Whether simulated robots correct what CMA-ES finds with `cost`. Networks stand for what no parameter describes: there is
/// no value of theirs that the robot has.
pub fn applies(config: &AdaptConfig, cost: CostKind) -> bool {
    config.optimizer.replicates > 0
        && config.optimizer.method != Method::LeastSquares
        && config.network.is_empty()
        && cost == CostKind::Wass
}

/// Why simulated robots do not correct a fit, and what they say all the same.
pub struct Refused {
    /// Why, in a sentence.
    pub why: String,
    /// What they say.
    pub regression: Option<Regression>,
}

/// Corrects the outcome of cost number `cost` of `setup`, which CMA-ES found; returns why it does not, if it does not.
///
/// # Errors
/// As [`regress`] and [`CostOutcome::adopt`].
pub fn correct(
    setup: &Setup,
    replicas: &Replicas,
    outcome: &mut CostOutcome,
    problem: Problem<'_>,
    watch: &Watch<'_>,
) -> Result<Option<Refused>, FitError> {
    let each = Regression::each(setup.theta.len(), EACH, setup.config.optimizer.replicates as usize);
    let what = format!("{}: correction, simulated robot", outcome.cost);
    let counting =
        watch.begin(Work { what: &what, total: Regression::robots(each), first: 0, parts: "robots" });
    let distributions = Distributions::new(&setup.fit.reference);
    let seed = setup.config.optimizer.seed;
    let done = AtomicUsize::new(0);
    let world = World { setup, replicas, distributions, seed, watch, counting: &counting, done };
    let (theta, found) = (&setup.theta, outcome.values());
    let logs = Logs { numbers: distributions.recorded(), groups: distributions.groups() };
    match regress(theta, &found, &logs, &world, each, seed, problem.cancel)? {
        Ok(regression) => {
            let refused = outcome.adopt(problem, &regression)?;
            Ok(refused.map(|why| Refused { why, regression: Some(regression) }))
        }
        Err(why) => Ok(Some(Refused { why, regression: None })),
    }
}

struct World<'a> {
    setup: &'a Setup,
    replicas: &'a Replicas,
    distributions: Distributions<'a>,
    seed: u64,
    watch: &'a Watch<'a>,
    counting: &'a Counting<'a>,
    done: AtomicUsize,
}

impl World<'_> {
    /// The GPU's simulator of the fitted logs, if the robot's physics steps are those of the fit.
    fn on_gpu(&self) -> Option<&dyn Simulator> {
        let (own, robot) = (self.setup.method.physics_step()?, self.replicas.recorder().physics_step());
        let same = (own / robot - 1.0).abs() < 1e-6;
        (same && self.setup.devices.are_gpus()).then_some(self.setup.fit.simulator.as_ref())
    }

    /// As [`Walks::walk`], on a GPU: from where the logs begin.
    fn walk_on(
        &self,
        simulator: &dyn Simulator,
        robots: &[Vec<f64>],
        first: u32,
        keep: &dyn Fn(usize, Vec<Predicted>),
    ) -> Result<(), String> {
        let logs = simulator.recordings();
        let numbered: Vec<(usize, &Vec<f64>)> = robots.iter().enumerate().collect();
        for chunk in numbered.chunks(AT_ONCE) {
            let rollout = |&(number, values): &(usize, &Vec<f64>)| Rollout {
                values: values.clone(),
                resets: Resets::Never,
                draw: derive_seed(self.seed, Purpose::TORQUE_NOISE, first.wrapping_add(number as u32)),
            };
            let rollouts: Vec<Rollout> = chunk.iter().map(rollout).collect();
            let walked = Mutex::new(vec![vec![Predicted::default(); logs]; chunk.len()]);
            let take = |robot: usize, log: usize, signals: Signals<'_>| {
                let mut walked = walked.lock().unwrap_or_else(PoisonError::into_inner);
                if let Some(slot) = walked.get_mut(robot).and_then(|logs| logs.get_mut(log)) {
                    *slot = Predicted::from_signals(&signals);
                }
            };
            simulator
                .simulate(&self.setup.theta, &rollouts, &take, &|| self.watch.stop())
                .map_err(|error| format!("A robot with drawn values cannot be simulated: {error}."))?;
            if self.watch.stop() {
                return Ok(());
            }
            let walked = walked.into_inner().unwrap_or_else(PoisonError::into_inner);
            for ((number, _), logs) in chunk.iter().zip(walked) {
                keep(*number, logs);
            }
        }
        Ok(())
    }
}

impl Walks for World<'_> {
    fn walk(&self, robots: &[Vec<f64>], first: u32) -> Result<Vec<Option<Vec<f64>>>, String> {
        let Self { distributions, watch, counting, done, .. } = self;
        let found: Mutex<Vec<Option<Vec<f64>>>> = Mutex::new(vec![None; robots.len()]);
        let keep = |robot: usize, logs: Vec<Predicted>| {
            let numbers = distributions.simulated(&logs);
            if let Some(slot) = found.lock().unwrap_or_else(PoisonError::into_inner).get_mut(robot) {
                *slot = numbers;
            }
            counting.step(done.fetch_add(1, Ordering::Relaxed) + 1, 1, "");
        };
        if let Some(simulator) = self.on_gpu() {
            self.walk_on(simulator, robots, first, &keep)?;
        } else {
            let (recorder, theta) = (self.replicas.recorder(), &self.setup.theta);
            recorder
                .walk(theta, robots, [self.seed, u64::from(first)], &keep, &|| watch.stop())
                .map_err(|error| format!("A robot with drawn values cannot be simulated: {error}."))?;
        }
        Ok(found.into_inner().unwrap_or_else(PoisonError::into_inner))
    }
}
