//! A whole training on a GPU, or on several GPUs of one host.

use std::ops::Range;
use std::time::Instant;

use gaitfit_learn::ppo::Diagnostics;
use gaitfit_learn::{Growth, Iteration, Tally, Training, TrainingError, TrainingSettings, max_diverged};

use super::RolloutError;
use super::run::{Planned, Rollout};
use super::scene::{Mode, Sizes};
use super::sums::Sum;
use crate::ppo::{Batch, Learner, PpoError, Precision, Share, run_together, update_together};
use crate::runtime::{Device, Event, Graph};

/// A training in the memory of one GPU or several: rollouts and updates in turn, as [`Training::iterate`] does them. Between
/// two iterations it can be given back to the CPU's training, which can save it or continue it.
///
/// Several GPUs share the robots, in equal parts. A robot's draws depend on its number in the whole training. All GPUs have the
/// same weights; see [`crate::ppo::update_together`].
pub struct Trainer<'a> {
    devices: Vec<Device>,
    /// Each GPU's part of the robots, and its learner.
    rollouts: Vec<Rollout<'a>>,
    learners: Vec<Learner>,
    graphs: Vec<Graph>,
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
        Self::together(std::slice::from_ref(device), training, precision)
    }

    /// As [`Trainer::new`], on all of `devices`, in this order. Precision and device are those of every part.
    ///
    /// # Errors
    /// As there; [`RolloutError::Uneven`] if the robots cannot be shared evenly; [`RolloutError::On`] names the GPU that
    /// failed.
    pub fn together(
        devices: &[Device],
        training: &mut Training<'a>,
        precision: Precision,
    ) -> Result<Self, RolloutError> {
        let (task, settings, seed) = (training.task(), training.settings().clone(), training.seed());
        let shares = shares(settings.environments, devices.len())?;
        for device in devices {
            devices.iter().try_for_each(|other| device.reach(other).map(drop))?;
        }
        let host = training.learner();
        let networks = host.actor().parameters.len() + host.critic().parameters.len();
        let (steps, gamma, mode) = (settings.steps, host.settings().gamma, Mode::Training);
        let remembered = host.critic_memory().map_or(0, |memory| memory.shape().remembered());
        let (mut rollouts, mut learners) = (Vec::new(), Vec::new());
        for ((number, device), part) in devices.iter().enumerate().zip(shares) {
            let environments = part.len();
            let share = Share { number, count: devices.len() };
            let batch = Batch { steps, environments, tile: Training::TILE, share };
            let sizes = Sizes { steps, environments, networks, gamma, remembered, mode };
            let made = || -> Result<(Learner, Rollout<'a>), RolloutError> {
                let candidates = training.candidates();
                let planned = Planned::new(device, task, candidates, sizes)?;
                let _ahead = device.compile_ahead(planned.programs());
                let learner = Learner::new(device, host, batch, precision)?;
                let (stream, first) = (learner.stream(), part.start as u32);
                let planned = (planned, sizes);
                let rollout = Rollout::from_plan(device, stream, task, candidates, planned, (seed, first))?;
                Ok((learner, rollout))
            };
            let (learner, rollout) = made().map_err(|error| error.on(device, devices.len()))?;
            learners.push(learner);
            rollouts.push(rollout);
        }
        let mut trainer = Self {
            devices: devices.to_vec(),
            rollouts,
            learners,
            graphs: Vec::new(),
            settings,
            terms: task.reward_names().len(),
            seed,
            iteration: 0,
            growth: Growth::default(),
        };
        trainer.load(training)?;
        Ok(trainer)
    }

    /// Robots of a GPU.
    fn each(&self) -> usize {
        self.settings.environments / self.devices.len().max(1)
    }

    /// Goes on from where `training`, of the same settings, is.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn load(&mut self, training: &mut Training<'_>) -> Result<(), RolloutError> {
        let (snapshots, memories) = (training.snapshots(), training.memories());
        let (each, count) = (self.each(), self.devices.len());
        for (number, (rollout, learner)) in self.rollouts.iter_mut().zip(&mut self.learners).enumerate() {
            learner.load(training.learner())?;
            let environments = number * each..(number + 1) * each;
            rollout.load(learner.stream(), snapshots.get(environments).unwrap_or_default())?;
            let rows_of_gpu = memories.each_ref().map(|rows| {
                let part = rows.len() / count;
                rows[number * part..(number + 1) * part].to_vec()
            });
            learner.set_memories(&rows_of_gpu)?;
        }
        self.iteration = training.iteration();
        self.growth = training.growth();
        Ok(())
    }

    /// Writes the present state into the CPU's training, of the same settings.
    ///
    /// # Errors
    /// A training of other settings, or a failure of the GPU; the training is then of no use. [`RolloutError::Apart`] if the
    /// GPUs do not have the same weights.
    pub fn store(&self, training: &mut Training<'_>) -> Result<(), RolloutError> {
        self.check_weights()?;
        self.first().1.store(training.learner_mut())?;
        let (mut snapshots, mut memories) = (Vec::new(), [Vec::new(), Vec::new()]);
        for (rollout, learner) in self.rollouts.iter().zip(&self.learners) {
            snapshots.extend(rollout.snapshots(learner.stream())?);
            for (all, own) in memories.iter_mut().zip(learner.memories()?) {
                all.extend(own);
            }
        }
        training.set_snapshots(self.iteration, self.growth, &snapshots)?;
        training.set_memories(&memories)?;
        Ok(())
    }

    /// Whether all GPUs have the same weights, to the bit.
    fn check_weights(&self) -> Result<(), RolloutError> {
        if self.learners.len() < 2 {
            return Ok(());
        }
        let weights = |learner: &Learner| -> Result<Vec<u32>, RolloutError> {
            let parameters = [learner.read_f32("parameters")?, learner.read_f32("memory_parameters")?];
            Ok(parameters.concat().into_iter().map(f32::to_bits).collect())
        };
        let first = weights(self.first().1)?;
        for (learner, device) in self.learners.iter().zip(&self.devices) {
            if weights(learner)? != first {
                return Err(RolloutError::Apart { ordinal: device.info().ordinal });
            }
        }
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

    /// Bytes of a GPU's memory that the training takes, besides what the driver needs.
    pub fn bytes(&self) -> u64 {
        let (rollout, learner) = self.first();
        rollout.bytes() + learner.plan().arrays.iter().map(|array| array.bytes()).sum::<u64>()
    }

    /// The first GPU's part. [`Trainer::together`] makes one at least.
    fn first(&self) -> (&Rollout<'a>, &Learner) {
        (&self.rollouts[0], &self.learners[0])
    }

    /// The rollout of the first GPU.
    pub fn rollout(&self) -> &Rollout<'a> {
        self.first().0
    }

    /// The learner of the first GPU.
    pub fn learner(&self) -> &Learner {
        self.first().1
    }

    /// The learners of all GPUs.
    pub fn learners(&self) -> &[Learner] {
        &self.learners
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
        let ranges = self.growth.ranges(self.task(), number);
        let each = self.each();
        for (part, (rollout, learner)) in self.rollouts.iter_mut().zip(&self.learners).enumerate() {
            rollout.number(learner.stream(), first_step, self.seed, ranges, (part * each) as u32)?;
        }
        self.launch()?;
        let tally = self.tally()?;
        if tally.diverged > max_diverged(self.settings.environments) {
            return Err(self.diverged(tally.diverged as usize)?.into());
        }
        let rollout_seconds = begin.elapsed().as_secs_f64();
        let begin = Instant::now();
        let diagnostics = self.update(number)?;
        self.iteration += 1;
        let commands = self.growth.take(self.task(), number, self.settings.steps, &tally);
        let update_seconds = begin.elapsed().as_secs_f64();
        Ok(Iteration { number, tally, diagnostics, commands, rollout_seconds, update_seconds })
    }

    fn task(&self) -> &'a gaitfit_learn::task::Task {
        self.rollout().task()
    }

    /// Starts the rollouts' graphs.
    fn launch(&mut self) -> Result<(), RolloutError> {
        if self.graphs.is_empty() {
            for (rollout, learner) in self.rollouts.iter().zip(&self.learners) {
                self.graphs.push(learner.stream().record(|stream| rollout.start(stream, learner))?);
            }
        }
        for (graph, learner) in self.graphs.iter_mut().zip(&self.learners) {
            graph.launch(learner.stream())?;
        }
        Ok(())
    }

    fn update(&mut self, iteration: u32) -> Result<Diagnostics, RolloutError> {
        update_together(&mut self.learners, iteration).map_err(|error| match error {
            PpoError::Update(error) => TrainingError::Update { iteration, error }.into(),
            error => error.into(),
        })
    }

    /// Sums over the rollouts of all GPUs, in order.
    fn tally(&self) -> Result<Tally, RolloutError> {
        let mut totals: Vec<f64> = Vec::new();
        for (rollout, learner) in self.rollouts.iter().zip(&self.learners) {
            let sums = rollout.read_f64(learner.stream(), "totals")?;
            totals.resize(sums.len(), 0.0);
            totals.iter_mut().zip(sums).for_each(|(total, sum)| *total += sum);
        }
        let TrainingSettings { steps, environments, .. } = self.settings;
        let sum = |sum: Sum| totals[sum.place(self.terms)];
        Ok(Tally {
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
        })
    }

    /// The error that names the first of the `robots` that diverged.
    fn diverged(&self, robots: usize) -> Result<TrainingError, RolloutError> {
        let each = self.each();
        let [mut steps, mut terms] = [Vec::new(), Vec::new()];
        for (rollout, learner) in self.rollouts.iter().zip(&self.learners) {
            let tally = rollout.read_f64(learner.stream(), "tally")?;
            for (to, sum) in [(&mut steps, Sum::BrokenAt), (&mut terms, Sum::BrokenTerm)] {
                to.extend_from_slice(&tally[sum.place(self.terms) * each..][..each]);
            }
        }
        // Steps count from 1 here: 0 stands for a robot that did not diverge.
        let broken = steps.iter().enumerate().filter(|(_, step)| **step > 0.0);
        let (environment, step) =
            broken.min_by(|a, b| a.1.total_cmp(b.1)).map_or((0, 1), |(e, &step)| (e, step as usize));
        let names = self.task().reward_names();
        let term = (terms[environment] as usize).checked_sub(1).and_then(|term| names.get(term));
        let (iteration, term) = (self.iteration, term.map(|name| (*name).to_owned()));
        Ok(TrainingError::Diverged { iteration, robots, environment, step: step - 1, term })
    }

    /// Where the time of an iteration goes, on the first GPU; the update is that of all. The training's state is spoilt: it is for
    /// benchmarks.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn breakdown(&mut self) -> Result<Breakdown, RolloutError> {
        self.launch()?;
        let device = &self.devices[0];
        let part = |part: &str| -> Result<f64, RolloutError> {
            let (rollout, learner) = self.first();
            let stream = learner.stream();
            let mut graph = stream.record(|stream| rollout.start_part(stream, learner, part))?;
            let (from, to) = (Event::new(device)?, Event::new(device)?);
            graph.launch(stream)?;
            from.record(stream)?;
            graph.launch(stream)?;
            to.record(stream)?;
            Ok(from.seconds_until(&to)?)
        };
        let parts = [part("observe")?, part("foresee")?, part("act")?, part("physics")?, part("finish")?];
        let [observe, networks, act, physics, finish] = parts;
        let (from, middle, to) = (Event::new(device)?, Event::new(device)?, Event::new(device)?);
        from.record(self.first().1.stream())?;
        self.launch()?;
        middle.record(self.first().1.stream())?;
        run_together(&mut self.learners)?;
        to.record(self.first().1.stream())?;
        let rollout = from.seconds_until(&middle)?;
        let update = middle.seconds_until(&to)?;
        self.learners.iter().try_for_each(|learner| learner.stream().wait())?;
        Ok(Breakdown { observe, networks, act, physics, finish, rollout, update })
    }
}

/// Which robots each of so many GPUs has.
fn shares(environments: usize, gpus: usize) -> Result<Vec<Range<usize>>, RolloutError> {
    if gpus == 0 || !environments.is_multiple_of(gpus) {
        return Err(RolloutError::Uneven { environments, gpus });
    }
    let each = environments / gpus;
    Ok((0..gpus).map(|number| number * each..(number + 1) * each).collect())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn robots_are_shared_evenly_or_not_at_all() {
        assert_eq!(shares(6, 2).unwrap(), [0..3, 3..6]);
        assert_eq!(shares(6, 3).unwrap(), [0..2, 2..4, 4..6]);
        let error = shares(4096, 3).unwrap_err().to_string();
        assert!(error.contains("4096") && error.contains("4095 or 4098"), "{error}");
    }
}
