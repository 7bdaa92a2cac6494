//! A whole training on a GPU.

use std::time::Instant;

use gaitfit_learn::ppo::Diagnostics;
use gaitfit_learn::{Growth, Iteration, Tally, Training, TrainingError, TrainingSettings, max_diverged};

use super::RolloutError;
use super::run::Rollout;
use super::scene::{Mode, Sizes};
use super::sums::Sum;
use crate::ppo::{Batch, Learner, PpoError, Precision};
use crate::runtime::{Device, Event, Graph};

/// A training in a GPU's memory: rollouts and updates in turn, as [`Training::iterate`] does them. Between two iterations
/// it can be given back to the CPU's training, which can save it, or go on with it.
pub struct Trainer<'a> {
    device: Device,
    rollout: Rollout<'a>,
    learner: Learner,
    graph: Option<Graph>,
    settings: TrainingSettings,
    terms: usize,
    seed: u64,
    iteration: u32,
    growth: Growth,
}

/// Where the time of an iteration goes, s: each part of a rollout alone, all its steps, then the whole rollout and the
/// update as graphs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Breakdown {
    /// Observations and sensor noise.
    pub observe: f64,
    /// Actor and critic.
    pub networks: f64,
    /// Exploration, targets, pushes.
    pub act: f64,
    /// Physics.
    pub physics: f64,
    /// Rewards, ends, new episodes.
    pub finish: f64,
    /// A whole rollout.
    pub rollout: f64,
    /// A whole update.
    pub update: f64,
}

impl<'a> Trainer<'a> {
    /// Takes over `training` as it is. Nothing of it changes until [`Trainer::store`].
    ///
    /// # Errors
    /// [`RolloutError`]: a GPU without room, compiler or the matrix units, or something that only the CPU does.
    pub fn new(
        device: &Device,
        training: &mut Training<'a>,
        precision: Precision,
    ) -> Result<Self, RolloutError> {
        let (task, settings, seed) = (training.task(), training.settings().clone(), training.seed());
        let TrainingSettings { steps, environments, .. } = settings;
        let batch = Batch { steps, environments, tile: Training::TILE };
        let host = training.learner();
        let networks = host.actor().parameters.len() + host.critic().parameters.len();
        let (gamma, mode) = (host.settings().gamma, Mode::Training);
        let remembered = host.critic_memory().map_or(0, |memory| memory.shape().remembered());
        let sizes = Sizes { steps, environments, networks, gamma, remembered, mode };
        let learner = Learner::new(device, host, batch, precision)?;
        let rollout = Rollout::new(device, learner.stream(), task, training.candidates(), sizes, seed)?;
        let mut trainer = Self {
            device: device.clone(),
            rollout,
            learner,
            graph: None,
            settings,
            terms: task.reward_names().len(),
            seed,
            iteration: 0,
            growth: Growth::default(),
        };
        trainer.load(training)?;
        Ok(trainer)
    }

    /// Goes on from where `training`, of the same settings, is.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn load(&mut self, training: &mut Training<'_>) -> Result<(), RolloutError> {
        self.learner.load(training.learner())?;
        self.rollout.load(self.learner.stream(), &training.snapshots())?;
        self.learner.set_memories(&training.memories())?;
        self.iteration = training.iteration();
        self.growth = training.growth();
        Ok(())
    }

    /// Writes the present state into the CPU's training, of the same settings.
    ///
    /// # Errors
    /// A training of other settings, or a failure of the GPU; the training is then of no use.
    pub fn store(&self, training: &mut Training<'_>) -> Result<(), RolloutError> {
        self.learner.store(training.learner_mut())?;
        let snapshots = self.rollout.snapshots(self.learner.stream())?;
        training.set_snapshots(self.iteration, self.growth, &snapshots)?;
        training.set_memories(&self.learner.memories()?)?;
        Ok(())
    }

    /// Iterations done.
    pub fn iteration(&self) -> u32 {
        self.iteration
    }

    /// Whether all iterations are done.
    pub fn finished(&self) -> bool {
        self.iteration >= self.settings.iterations
    }

    /// Bytes of the GPU's memory that the training takes, besides what the driver needs.
    pub fn bytes(&self) -> u64 {
        self.rollout.bytes() + self.learner.plan().arrays.iter().map(|array| array.bytes()).sum::<u64>()
    }

    /// The rollout.
    pub fn rollout(&self) -> &Rollout<'a> {
        &self.rollout
    }

    /// The learner.
    pub fn learner(&self) -> &Learner {
        &self.learner
    }

    /// One rollout of all environments and one update.
    ///
    /// # Errors
    /// As on the CPU, or a failure of the GPU.
    pub fn iterate(&mut self) -> Result<Iteration, RolloutError> {
        let number = self.iteration;
        let begin = Instant::now();
        // Step 0 is the start of the very first episodes.
        let first_step = number * self.settings.steps as u32 + 1;
        let ranges = self.growth.ranges(self.rollout.task(), number);
        self.rollout.number(self.learner.stream(), first_step, self.seed, ranges, 0)?;
        self.launch()?;
        let totals = self.rollout.read_f64(self.learner.stream(), "totals")?;
        let tally = self.tally(&totals);
        if tally.diverged > max_diverged(self.settings.environments) {
            return Err(self.diverged(tally.diverged as usize)?.into());
        }
        let rollout_seconds = begin.elapsed().as_secs_f64();
        let begin = Instant::now();
        let diagnostics = self.update(number)?;
        self.iteration += 1;
        let commands = self.growth.take(self.rollout.task(), number, self.settings.steps, &tally);
        let update_seconds = begin.elapsed().as_secs_f64();
        Ok(Iteration { number, tally, diagnostics, commands, rollout_seconds, update_seconds })
    }

    /// Starts the rollout's graph.
    fn launch(&mut self) -> Result<(), RolloutError> {
        if self.graph.is_none() {
            let (rollout, learner) = (&self.rollout, &self.learner);
            self.graph = Some(learner.stream().record(|stream| rollout.start(stream, learner))?);
        }
        if let Some(graph) = &mut self.graph {
            graph.launch(self.learner.stream())?;
        }
        Ok(())
    }

    fn update(&mut self, iteration: u32) -> Result<Diagnostics, RolloutError> {
        self.learner.update(iteration).map_err(|error| match error {
            PpoError::Update(error) => TrainingError::Update { iteration, error }.into(),
            error => error.into(),
        })
    }

    /// Sums over the rollout.
    fn tally(&self, totals: &[f64]) -> Tally {
        let TrainingSettings { steps, environments, .. } = self.settings;
        let sum = |sum: Sum| totals[sum.place(self.terms)];
        Tally {
            steps: (steps * environments) as f64,
            reward: totals[0],
            terms: totals[1..1 + self.terms].to_vec(),
            tracking: [sum(Sum::VelocityError), sum(Sum::YawError)],
            episodes: sum(Sum::Episodes),
            falls: sum(Sum::Falls),
            episode_steps: sum(Sum::EpisodeSteps),
            episode_return: sum(Sum::EpisodeReturn),
            diverged: sum(Sum::Diverged),
            levels: sum(Sum::Level),
            lost_steps: sum(Sum::LostSteps),
        }
    }

    /// What is said of the first of the `robots` that diverged.
    fn diverged(&self, robots: usize) -> Result<TrainingError, RolloutError> {
        let environments = self.settings.environments;
        let all = self.rollout.read_f64(self.learner.stream(), "tally")?;
        let [steps, terms] = [Sum::BrokenAt, Sum::BrokenTerm]
            .map(|sum| &all[sum.place(self.terms) * environments..][..environments]);
        let broken = steps.iter().enumerate().filter(|(_, step)| **step > 0.0);
        let (environment, step) =
            broken.min_by(|a, b| a.1.total_cmp(b.1)).map_or((0, 1), |(e, &step)| (e, step as usize));
        let names = self.rollout.task().reward_names();
        let term = (terms[environment] as usize).checked_sub(1).and_then(|term| names.get(term));
        let (iteration, term) = (self.iteration, term.map(|name| (*name).to_owned()));
        Ok(TrainingError::Diverged { iteration, robots, environment, step: step - 1, term })
    }

    /// Where the time of an iteration goes. The training's state is spoilt: it is for benchmarks.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn breakdown(&mut self) -> Result<Breakdown, RolloutError> {
        self.launch()?;
        let part = |part: &str| -> Result<f64, RolloutError> {
            let stream = self.learner.stream();
            let mut graph = stream.record(|stream| self.rollout.start_part(stream, &self.learner, part))?;
            let (from, to) = (Event::new(&self.device)?, Event::new(&self.device)?);
            graph.launch(stream)?;
            from.record(stream)?;
            graph.launch(stream)?;
            to.record(stream)?;
            Ok(from.seconds_until(&to)?)
        };
        let parts = [part("observe")?, part("foresee")?, part("act")?, part("physics")?, part("finish")?];
        let [observe, networks, act, physics, finish] = parts;
        let (from, middle, to) =
            (Event::new(&self.device)?, Event::new(&self.device)?, Event::new(&self.device)?);
        from.record(self.learner.stream())?;
        self.launch()?;
        middle.record(self.learner.stream())?;
        self.learner.run()?;
        to.record(self.learner.stream())?;
        let rollout = from.seconds_until(&middle)?;
        Ok(Breakdown { observe, networks, act, physics, finish, rollout, update: middle.seconds_until(&to)? })
    }
}
