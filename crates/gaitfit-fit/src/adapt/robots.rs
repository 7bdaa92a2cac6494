//! Simulated robots with values drawn around those found, which correct fits of walking logs by distributions.

use super::replicas::Replicas;
use super::setup::Setup;
use crate::settings::AdaptConfig;
use crate::watch::{Counting, Watch, Work};
use gaitfit_adapt::cost::CostKind;
use gaitfit_adapt::fit::{
    CostOutcome, Distributions, FitError, Logs, Method, Predicted, Problem, Regression, Walks, regress,
};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Robots of a round for each of `optimizer.replicates`.
const EACH: usize = 20;

/// Time at the start of each log that does not count here, in addition to the time that does not count in costs, s. Simulated
/// robots do not begin as the real one did, and a walk shows for a while how it began. On three robots in MuJoCo, robots with the
/// true values had a mean square distance from the logs of 2.2, 1.3 and 2.1 without this time, and 1.3, 1.1 and 1.4 with it.
const SETTLING_S: f64 = 0.5;

/// Whether simulated robots correct what CMA-ES finds with `cost`. Networks stand for what no parameter describes: there is
/// no value of theirs that the robot has.
pub fn applies(config: &AdaptConfig, cost: CostKind) -> bool {
    config.optimizer.replicates > 0
        && config.optimizer.method != Method::LeastSquares
        && config.network.is_empty()
        && cost == CostKind::Wass
}

/// Why simulated robots do not correct a fit, and their regression nevertheless: it widens the intervals.
pub struct Refused {
    /// Why, in a sentence.
    pub why: String,
    /// The regression; `None` if there is none.
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
    let counting = watch.begin(Work {
        what: &what,
        total: Regression::robots(each),
        first: 0,
        parts: "robots",
        seed: None,
    });
    // Counted in samples of the simulated logs, which are at the policy's rate.
    let settling = (SETTLING_S / replicas.recorder().period()).round() as usize;
    let distributions = Distributions::new(&setup.fit.reference, settling);
    let seed = setup.config.optimizer.seed;
    let done = AtomicUsize::new(0);
    let world = World { setup, replicas, distributions, seed, watch, counting: &counting, done };
    let (theta, values) = (&setup.theta, outcome.values());
    let threads = setup.method.walking().map_or(1, |walking| walking.threads);
    let logs = Logs { numbers: distributions.recorded(), groups: distributions.groups(), threads };
    match regress(theta, &values, &logs, &world, each, seed, problem.cancel)? {
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

impl Walks for World<'_> {
    fn walk(&self, robots: &[Vec<f64>], first: u32) -> Result<Vec<Option<Vec<f64>>>, String> {
        let Self { distributions, watch, counting, done, .. } = self;
        let per_robot: Mutex<Vec<Option<Vec<f64>>>> = Mutex::new(vec![None; robots.len()]);
        let keep = |robot: usize, logs: Vec<Predicted>| {
            let numbers = distributions.simulated(&logs);
            if let Some(slot) = per_robot.lock().unwrap_or_else(PoisonError::into_inner).get_mut(robot) {
                *slot = numbers;
            }
            // Relaxed is enough: the number is for the progress bar alone.
            counting.step(done.fetch_add(1, Ordering::Relaxed) + 1, 1, "");
        };
        let (recorder, theta) = (self.replicas.recorder(), &self.setup.theta);
        recorder
            .walk(theta, robots, [self.seed, u64::from(first)], &keep, &|| watch.stop())
            .map_err(|error| format!("A robot with drawn values cannot be simulated: {error}."))?;
        Ok(per_robot.into_inner().unwrap_or_else(PoisonError::into_inner))
    }
}
