//! A training run: rollouts and updates in turn.

use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use gaitfit_model::shown;
use gaitfit_sim::{Candidate, pool};
use serde::{Deserialize, Serialize};

use crate::curriculum::{self, Commands, Growth};
use crate::ppo::{
    self, Diagnostics, Exploration, Learner, LearnerError, Recorder, Samples, SettingsError, UpdateError,
    Widths,
};
use crate::rollout::{Divergence, Runner, Tally};
use crate::task::{Environment, Task, TaskError};
use gaitfit_policy::network::{Network, Recurrent, RecurrentShape};
use gaitfit_policy::{Front, Policy, Provenance};

/// How much is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainingSettings {
    /// Robots that are stepped together.
    pub environments: usize,
    /// Control steps of a rollout.
    pub steps: usize,
    /// Rollouts and updates.
    pub iterations: u32,
}

impl TrainingSettings {
    /// Refuses numbers out of range.
    ///
    /// # Errors
    /// [`TrainingError::Setting`] naming the first.
    pub fn check(&self) -> Result<(), TrainingError> {
        let refuse = |setting, value: usize, must: &str| {
            Err(TrainingError::Setting { setting, value: value.to_string(), must: must.to_owned() })
        };
        let Self { environments, steps, iterations } = *self;
        if environments == 0 || environments > MAX_ENVIRONMENTS {
            return refuse("environments", environments, "from 1 to 1048576");
        }
        // Both numbers come from a file, so their product may overflow.
        if steps == 0 || environments.saturating_mul(steps) > MAX_SAMPLES {
            return refuse("steps", steps, "at least 1, and times environments at most 16777216");
        }
        if u64::from(iterations) * steps as u64 > u64::from(u32::MAX / 2) {
            return refuse(
                "iterations",
                iterations as usize,
                "such that iterations times steps stays below 2^31",
            );
        }
        Ok(())
    }
}

impl TrainingSettings {
    /// Refuses what a policy with a memory cannot learn from: its minibatches take whole robots, over all steps.
    ///
    /// # Errors
    /// [`TrainingError::Setting`] naming the first.
    pub fn check_sequences(&self, minibatches: usize) -> Result<(), TrainingError> {
        let refuse = |setting, value: usize, must: String| {
            Err(TrainingError::Setting { setting, value: value.to_string(), must })
        };
        if self.environments < minibatches {
            let must = format!(
                "at least ppo.minibatches, {minibatches}, where a policy has a memory: a minibatch takes whole robots"
            );
            return refuse("environments", self.environments, must);
        }
        if self.steps > MAX_SEQUENCE {
            let must = format!("at most {MAX_SEQUENCE} where a policy has a memory");
            return refuse("steps", self.steps, must);
        }
        Ok(())
    }
}

impl Default for TrainingSettings {
    fn default() -> Self {
        // 4096 robots and 24 steps are the values of legged_gym (Rudin et al. 2022).
        Self { environments: 4096, steps: 24, iterations: 400 }
    }
}

/// Max steps that are propagated back through at once: activations of every step are kept for each robot.
const MAX_SEQUENCE: usize = 4096;
/// Environments that one thread advances together.
pub(crate) const TILE: usize = 256;
/// Max number of environments, and of samples in a rollout (a sample takes about half a kilobyte).
const MAX_ENVIRONMENTS: usize = 1 << 20;
const MAX_SAMPLES: usize = 1 << 24;

/// Why training stopped.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrainingError {
    /// A setting out of range.
    #[error("train.{setting} is {value}; it must be {must}")]
    Setting {
        /// Which.
        setting: &'static str,
        /// Its value.
        value: String,
        /// What it must be.
        must: String,
    },
    /// The task.
    #[error(transparent)]
    Task(#[from] TaskError),
    /// The networks.
    #[error(transparent)]
    Learner(#[from] LearnerError),
    /// More robots than one in a hundred diverged in one rollout.
    #[error(
        "iteration {iteration}: {robots} of the simulated robots diverged, robot {environment} in step {step} of the \
         rollout (its state or reward is not finite, or impossible{}); the policy is as it was before it. {}",
        of_term(term.as_deref()),
        remedy(term.as_deref())
    )]
    Diverged {
        /// Iteration.
        iteration: u32,
        /// Episodes that ended so.
        robots: usize,
        /// Number of the environment of the first.
        environment: usize,
        /// Its step in the rollout.
        step: usize,
        /// The reward term that was not finite, if the robot's state still was.
        term: Option<String>,
    },
    /// The function of the caller.
    #[error("iteration {iteration}: the function that gives rewards and ends of episodes failed")]
    UserTerms {
        /// Iteration.
        iteration: u32,
    },
    /// The update.
    #[error("iteration {iteration}: {error}")]
    Update {
        /// Iteration.
        iteration: u32,
        /// What was not finite.
        error: UpdateError,
    },
}

/// Advice against robots that diverge.
pub const MEND_DIVERGENCE: &str = "Use more substeps (task.substeps), the preset `accurate`, pyramidal cones (cone) or \
     smaller gains";

/// Divergences of a rollout of `environments` robots that training bears, each as a fall: one in a hundred, and one where
/// there are fewer robots.
pub fn max_diverged(environments: usize) -> f64 {
    (environments / 100).max(1) as f64
}

fn of_term(term: Option<&str>) -> String {
    term.map_or_else(String::new, |term| format!(": the reward term `{}`", shown(term)))
}

fn remedy(term: Option<&str>) -> &'static str {
    match term {
        Some(_) => {
            "A term must be finite wherever a robot may get to: look for divisions, roots and logarithms in it"
        }
        None => MEND_DIVERGENCE,
    }
}

/// Results of one iteration.
#[derive(Clone, Debug, PartialEq)]
pub struct Iteration {
    /// Number of the iteration, from 0.
    pub number: u32,
    /// Sums over the rollout.
    pub tally: Tally,
    /// The update.
    pub diagnostics: Diagnostics,
    /// Its commands, if they grow.
    pub commands: Option<Commands>,
    /// Wall-clock time of the rollout, s.
    pub rollout_seconds: f64,
    /// Wall-clock time of the update, s.
    pub update_seconds: f64,
}

/// A training run on a task.
pub struct Training<'a> {
    pub(crate) task: &'a Task,
    settings: TrainingSettings,
    pub(crate) candidates: Vec<Candidate>,
    pub(crate) seed: u64,
    pub(crate) learner: Learner,
    pub(crate) runners: Vec<Mutex<Runner<'a>>>,
    pub(crate) iteration: u32,
    pub(crate) growth: Growth,
}

/// Widths of a task's rows.
pub fn widths(task: &Task) -> Widths {
    Widths {
        observation: task.walker.interface.observation_width(),
        critic_observation: task.walker.interface.critic_width(),
        action: task.walker.joints.len(),
    }
}

impl<'a> Training<'a> {
    /// A run from the start. `candidate`: what robots are varied around; the robot of the file if none is given.
    ///
    /// # Errors
    /// Settings out of range, or robots that cannot be.
    pub fn new(
        task: &'a Task,
        candidate: Option<&Candidate>,
        settings: &TrainingSettings,
        learner: Learner,
        seed: u64,
    ) -> Result<Self, TrainingError> {
        let nominal = || Candidate::nominal(task.walker.model());
        let candidate = candidate.cloned().unwrap_or_else(nominal);
        Self::among(task, &[candidate], settings, learner, seed)
    }

    /// As [`Training::new`], with robots varied around several: robot number `e` around number `e` modulo
    /// their count.
    ///
    /// # Errors
    /// As [`Training::new`], and as [`Environment::among`].
    pub fn among(
        task: &'a Task,
        candidates: &[Candidate],
        settings: &TrainingSettings,
        learner: Learner,
        seed: u64,
    ) -> Result<Self, TrainingError> {
        settings.check()?;
        if learner.actor_memory().is_some() || learner.critic_memory().is_some() {
            settings.check_sequences(learner.settings().minibatches)?;
        }
        curriculum::check(task)?;
        let growth = Growth::default();
        let TrainingSettings { environments, steps, .. } = *settings;
        let mut runners = Vec::new();
        for first in (0..environments).step_by(TILE) {
            let count = TILE.min(environments - first);
            let mut environment = Environment::among(task, candidates, seed, first as u32, count)?;
            // Ages, ranges and commands are set before the first rollout, because `Environment::among` starts
            // all robots alike.
            environment.stagger();
            environment.set_command_ranges(growth.ranges(task, 0));
            environment.draw_commands();
            let samples = Samples::new(steps, count, widths(task));
            let recorder = Recorder::new(samples, Exploration::new(seed, first as u32));
            runners.push(Mutex::new(Runner::new(environment, recorder)));
        }
        let (settings, candidates) = (settings.clone(), candidates.to_vec());
        Ok(Self { task, settings, candidates, seed, learner, runners, iteration: 0, growth })
    }

    /// A learner with new networks for a task.
    ///
    /// # Errors
    /// PPO settings out of range.
    pub fn fresh_learner(task: &Task, ppo: &ppo::Settings, seed: u64) -> Result<Learner, TrainingError> {
        Ok(Learner::new(ppo.clone(), widths(task), seed)?)
    }

    /// A learner that continues from `policy`. It has the policy's networks, also if the settings state other shapes, and its
    /// normalisers, which continue to learn if the settings ask for it. A policy without a critic gets a new one, drawn
    /// from `seed`, for the task's critic observation, behind a memory like the actor's if there is one.
    ///
    /// # Errors
    /// PPO settings out of range, normalised observations where the policy takes them as they are, or a policy that
    /// does not fit the task.
    pub fn learner_from(
        task: &Task,
        ppo: &ppo::Settings,
        policy: &Policy,
        seed: u64,
    ) -> Result<Learner, TrainingError> {
        // A fresh normaliser would scale inputs that the networks were trained without.
        if ppo.normalise_observations && policy.normaliser.is_none() {
            return Err(TrainingError::Learner(LearnerError::Settings(SettingsError {
                name: "normalise_observations",
                value: "true".to_owned(),
                remedy: "the policy takes observations as they are, and a normaliser would change it: leave it false",
            })));
        }
        if let Some(why) = policy.untrainable() {
            return Err(TrainingError::Learner(LearnerError::Untrainable { what: "policy", why }));
        }
        let widths = widths(task);
        let actor_memory = policy.actor_memory().cloned();
        let (critic, critic_memory) = match &policy.critic {
            Some(critic) => (critic.clone(), policy.critic_memory.clone()),
            // A memory like the actor's, with weights of its own drawn from another number of the stream.
            None => {
                let like = |actor: &Recurrent| {
                    let shape = RecurrentShape { inputs: widths.critic_observation, ..actor.shape() };
                    Recurrent::random(&shape, seed, 3)
                };
                let memory = actor_memory.as_ref().map(like);
                let (_, mut shape) = ppo.shapes(widths).map_err(LearnerError::from)?;
                shape.inputs = memory.as_ref().map_or(widths.critic_observation, Recurrent::outputs);
                (Network::random(shape, seed, 1, 1.0).map_err(LearnerError::from)?, memory)
            }
        };
        let (networks, memories) = ([policy.actor.clone(), critic], [actor_memory, critic_memory]);
        let log_std = policy.log_std.clone();
        let mut learner = Learner::with_memories(ppo.clone(), widths, seed, networks, memories, log_std)?;
        // A new critic keeps the new normaliser that the settings may have given it.
        let critic_normaliser = match &policy.critic {
            Some(_) => policy.critic_normaliser.clone(),
            None => learner.critic_normaliser().cloned(),
        };
        learner.set_normalisers(policy.normaliser.clone(), critic_normaliser)?;
        Ok(learner)
    }

    /// The task.
    pub fn task(&self) -> &'a Task {
        self.task
    }

    /// How much is trained.
    pub fn settings(&self) -> &TrainingSettings {
        &self.settings
    }

    /// The learner.
    pub fn learner(&self) -> &Learner {
        &self.learner
    }

    /// The policy as it is now, for its file.
    ///
    /// `configuration_hash`: SHA-256 of what determines the training, hexadecimal.
    pub fn policy(&self, configuration_hash: &str, program_version: &str) -> Policy {
        let learner = &self.learner;
        Policy {
            interface: self.task.walker.interface.clone(),
            front: learner.actor_memory().cloned().map(Front::Recurrent),
            actor: learner.actor().clone(),
            log_std: learner.log_std().to_vec(),
            critic: Some(learner.critic().clone()),
            critic_memory: learner.critic_memory().cloned(),
            normaliser: learner.normaliser().cloned(),
            critic_normaliser: learner.critic_normaliser().cloned(),
            provenance: Provenance {
                seed: self.seed,
                configuration_hash: configuration_hash.to_owned(),
                iteration: self.iteration,
                program_version: program_version.to_owned(),
                // Settings are numbers, names and tables: they have a TOML form.
                task: toml::to_string(&self.task.settings).unwrap_or_default(),
                ..Provenance::default()
            },
            notes: Vec::new(),
        }
    }

    /// Iterations done.
    pub fn iteration(&self) -> u32 {
        self.iteration
    }

    /// Growth of its commands so far; the default without a curriculum.
    pub fn growth(&self) -> Growth {
        self.growth
    }

    /// Whether the policy has learnt anything: in the first `critic_warmup` iterations only the critic does.
    pub fn policy_trained(&self) -> bool {
        // Number `critic_warmup`, from 0, is the first iteration that moves the policy.
        self.iteration > self.learner.settings().critic_warmup.unwrap_or(0)
    }

    /// Whether all iterations are done.
    pub fn finished(&self) -> bool {
        self.iteration >= self.settings.iterations
    }

    /// One rollout of all environments and one update. The result depends on the number of threads in nothing
    /// but time.
    ///
    /// # Errors
    /// A number that is not finite in the update, or more robots that diverged than [`max_diverged`]; the learner then
    /// holds the last finite parameters.
    pub fn iterate(&mut self, threads: usize) -> Result<Iteration, TrainingError> {
        let number = self.iteration;
        let begin = Instant::now();
        // Step 0 is the start of the very first episodes.
        let first_step = number * self.settings.steps as u32 + 1;
        let ranges = self.growth.ranges(self.task, number);
        pool::for_each(
            self.runners.len(),
            threads,
            || (),
            |(), tile| {
                // Each tile is locked once by whichever thread takes it: nobody waits.
                let mut runner = self.runners[tile].lock().unwrap_or_else(PoisonError::into_inner);
                runner.environment.set_command_ranges(ranges);
                runner.rollout(&self.learner, first_step);
            },
        );
        let rollout_seconds = begin.elapsed().as_secs_f64();
        let begin = Instant::now();
        let mut tally = Tally::default();
        let (mut first, mut terms_failed) = (None, false);
        // In the order of the tiles, so that sums and the first divergence do not depend on threads.
        for (tile, runner) in self.runners.iter_mut().enumerate() {
            let runner = runner.get_mut().unwrap_or_else(PoisonError::into_inner);
            tally.add(&runner.tally);
            terms_failed |= runner.terms_failed;
            let divergence = runner.divergence.take();
            first = first.or(divergence.map(|one| (tile * TILE + one.environment, one)));
        }
        if terms_failed {
            return Err(TrainingError::UserTerms { iteration: number });
        }
        let max = max_diverged(self.settings.environments);
        if let Some((environment, Divergence { step, term, .. })) = first.filter(|_| tally.diverged > max) {
            let (iteration, robots) = (number, tally.diverged as usize);
            return Err(TrainingError::Diverged { iteration, robots, environment, step, term });
        }
        let mut samples = Vec::with_capacity(self.runners.len());
        for runner in &mut self.runners {
            let runner = runner.get_mut().unwrap_or_else(PoisonError::into_inner);
            // The learner takes all tiles as one slice. Samples are moved out and back, which copies nothing.
            let empty = Samples::new(0, 0, runner.recorder.samples.widths);
            samples.push(std::mem::replace(&mut runner.recorder.samples, empty));
        }
        let updated = self.learner.update(&mut samples, number, threads);
        // Before a failed update is reported: recorders need their room in any case.
        for (runner, samples) in self.runners.iter_mut().zip(samples) {
            runner.get_mut().unwrap_or_else(PoisonError::into_inner).recorder.samples = samples;
        }
        let diagnostics = updated.map_err(|error| TrainingError::Update { iteration: number, error })?;
        self.iteration += 1;
        let commands = self.growth.take(self.task, number, self.settings.steps, &tally);
        let update_seconds = begin.elapsed().as_secs_f64();
        Ok(Iteration { number, tally, diagnostics, commands, rollout_seconds, update_seconds })
    }
}
