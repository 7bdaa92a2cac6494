//! Fits of simulated logs, which show what a fit of the real ones is off by.

use super::log_set::LogSet;
use super::setup::Setup;
use crate::Error;
use crate::device::Gpu;
use crate::gpu_ahead::{Ahead, compile_ahead};
use crate::log::Log;
use crate::settings::AdaptConfig;
use crate::walk::recorder::{NoisyRobot, Recorded, Recorder};
use crate::walk::walking::Walking;
use crate::watch::{Counting, Event, Watch, Work};
use gaitfit_adapt::fit::{
    Comparison, CostOutcome, Failure, FitError, Problem, Question, Replicate, World, answers, sets,
};
use gaitfit_adapt::{Entry, Theta};
use gaitfit_model::Model;
use gaitfit_policy::Policy;
use gaitfit_random::{Purpose, derive_seed};
use gaitfit_sim::{Candidate, pool};
use std::cell::Cell;
use std::ops::ControlFlow;
use std::sync::Arc;

/// Least share of the logs that a simulated robot must walk without a fall.
pub(super) const WALKED: f64 = 0.5;

/// The robot as it makes logs.
pub struct Replicas {
    recorder: Recorder,
    base: Candidate,
    /// The program of these robots on a GPU, which is compiled while the search runs. The field only keeps it until the fit ends.
    _program: Ahead,
}

impl Replicas {
    /// The robot of `model` that θ changes from `base`, which walks as in `logs`. `threads` and `gpus` simulate it.
    ///
    /// # Errors
    /// As [`Walking::new`].
    pub fn new(
        config: &AdaptConfig,
        policy: Policy,
        model: &Model,
        theta: &Theta,
        base: &Candidate,
        (threads, gpus): (usize, &[Gpu]),
        logs: &[Log],
    ) -> Result<Self, Error> {
        let robot = Walking::robot(config, policy, model, theta, base, threads)?;
        let robot = Walking { gpus: gpus.to_vec(), ..robot };
        let trajectories: Vec<_> = logs.iter().map(|log| &log.trajectory).collect();
        let program = compile_ahead(&robot, theta, base);
        let recorder = Recorder::new(Arc::new(robot), base.clone(), &trajectories);
        Ok(Self { recorder, base: base.clone(), _program: program })
    }

    /// Makes the logs.
    pub(super) fn recorder(&self) -> &Recorder {
        &self.recorder
    }

    /// Corrects the outcome of cost number `cost` of `setup`, which least squares of `problem` found; returns why it does
    /// not, if it does not.
    ///
    /// # Errors
    /// As [`CostOutcome::correct`].
    pub(super) fn correct(
        &self,
        setup: &Setup,
        cost: usize,
        outcome: &mut CostOutcome,
        problem: Problem<'_>,
        watch: &Watch<'_>,
    ) -> Result<Option<String>, FitError> {
        let each = setup.config.optimizer.replicates;
        let what = format!("{}: correction, set of simulated logs", outcome.cost);
        let counting =
            watch.begin(Work { what: &what, total: sets(each), first: 0, parts: "sets", seed: None });
        let world = Robots { replicas: self, setup, cost, watch, counting: &counting, made: Cell::new(0) };
        outcome.correct(problem, &world, each)
    }

    /// The answer of one set of simulated logs, for another process; see [`World::ask`].
    ///
    /// # Errors
    /// As there.
    pub(super) fn answer(
        &self,
        setup: &Setup,
        cost: usize,
        problem: Problem<'_>,
        question: &Question,
        number: u32,
    ) -> Result<Comparison, Failure> {
        // In another process nobody watches the progress. The watch only passes on the question whether to
        // stop.
        let callback = |_: Event<'_>| match (problem.cancel)() {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        };
        let watch = Watch::new(&callback);
        let counting = watch.begin(Work { what: "set", total: 1, first: 0, parts: "sets", seed: None });
        let (watch, counting, made) = (&watch, &counting, Cell::new(0));
        let world = Robots { replicas: self, setup, cost, watch, counting, made };
        answers(&world, problem, question, &[number])?.pop().ok_or(Failure::Fit(FitError::Incomplete))
    }

    /// The recording of a simulated robot, as the fit compares it.
    fn replicate(&self, setup: &Setup, cost: usize, recorded: &[Recorded]) -> Result<Replicate, String> {
        let Setup { config, method, fit, .. } = setup;
        let margin = method.samples(config.fall_margin(), &fit.logs);
        // A simulated log must be as long as a stretch of a real log that counts.
        let min = method.samples(config.min_stretch() + config.skip_seconds(), &fit.logs);
        let mut logs = Vec::with_capacity(recorded.len());
        for (log, recorded) in fit.logs.iter().zip(recorded) {
            if let Some(trajectory) = recorded.clone().before_fall(&log.trajectory, margin, min)? {
                logs.push(Log { trajectory, ..log.clone() });
            }
        }
        let count = fit.logs.len();
        // With most logs missing, the set no longer stands for the commands of the fit's logs.
        if (logs.len() as f64) < WALKED * count as f64 {
            let fell = count - logs.len();
            return Err(format!("The simulated robot falls in {fell} of {count} logs."));
        }
        let base = &self.base;
        let set = LogSet::new(config, method, base, logs).map_err(|error| error.to_string())?.scaled_as(fit);
        let cost = config.costs[cost].build(&set.reference, set.simulator.as_ref());
        Ok(Replicate { cost: cost.map_err(|error| format!("{error}."))?, simulator: set.simulator })
    }
}

/// A fit's robot, simulated.
struct Robots<'a> {
    replicas: &'a Replicas,
    setup: &'a Setup,
    /// Number of the cost that compares.
    cost: usize,
    watch: &'a Watch<'a>,
    counting: &'a Counting<'a>,
    made: Cell<usize>,
}

impl World for Robots<'_> {
    fn shares(&self, entry: &Entry) -> bool {
        let (fitted, robot) = (self.setup.method.physics_step(), self.replicas.recorder.physics_step());
        // 1e-6 is rounding of steps that are computed as a period over a whole number.
        !entry.depends_on_step() || fitted.is_some_and(|fitted| (fitted / robot - 1.0).abs() < 1e-6)
    }

    fn replicates(&self, values: &[f64], noise: f64, numbers: &[u32]) -> Result<Vec<Replicate>, String> {
        let Setup { config, theta, .. } = self.setup;
        let robot = |&number: &u32| NoisyRobot {
            values: values.to_vec(),
            noise,
            seed: derive_seed(config.optimizer.seed, Purpose::TORQUE_NOISE, number.wrapping_add(1)),
        };
        let robots: Vec<NoisyRobot> = numbers.iter().map(robot).collect();
        let stop = || self.watch.stop();
        let recorded = self.replicas.recorder.record(theta, &robots, &stop);
        let recorded = recorded.map_err(|error| format!("The fitted robot cannot be simulated: {error}."))?;
        if stop() {
            return Err("interrupted".to_owned());
        }
        let (replicas, setup, cost) = (self.replicas, self.setup, self.cost);
        let sets = pool::map(recorded.len(), setup.fit.simulator.threads(), |set| {
            replicas.replicate(setup, cost, &recorded[set])
        });
        // Counted here and not by the threads, because `made` is a cell of this thread.
        sets.iter().for_each(|_| self.notify());
        sets.into_iter().collect()
    }

    fn ask(
        &self,
        problem: Problem<'_>,
        question: &Question,
        numbers: &[u32],
    ) -> Result<Vec<Comparison>, Failure> {
        match &self.setup.shares {
            Some(shares) => shares.ask(self.cost, problem, question, numbers, &|| self.notify()),
            None => answers(self, problem, question, numbers),
        }
    }
}

impl Robots<'_> {
    /// One set more is done.
    fn notify(&self) {
        self.made.set(self.made.get() + 1);
        self.counting.step(self.made.get(), 1, "");
    }
}
