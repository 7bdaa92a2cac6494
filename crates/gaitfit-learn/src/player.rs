//! A policy at work in a tile of environments: its mean actions, no learning.

use crate::subject::Subject;
use crate::task::{Ended, Environment, TaskError};
use gaitfit_policy::network::{Memory, Scratch};
use gaitfit_policy::walker::WalkerError;

/// A subject's policy and the tile it moves. Ended episodes are left where they are.
pub struct Player<'a> {
    /// The robots.
    pub environment: Environment<'a>,
    /// Last actions, policy order; `environments × joints`.
    pub action: Vec<f32>,
    /// Reward of the last step.
    pub reward: Vec<f32>,
    /// State of each episode.
    pub ended: Vec<Ended>,
    subject: Subject<'a>,
    observation: Vec<f32>,
    memory: Memory,
    scratch: Scratch,
}

impl<'a> Player<'a> {
    /// The policy of `subject` in `environment`, which is of its task.
    pub fn new(subject: &Subject<'a>, environment: Environment<'a>) -> Self {
        let Subject { task, policy, .. } = *subject;
        let count = environment.count();
        Self {
            environment,
            action: vec![0.0; count * task.walker.joints.len()],
            reward: vec![0.0; count],
            ended: vec![Ended::No; count],
            subject: *subject,
            observation: vec![0.0; count * task.walker.interface.observation_width()],
            memory: policy.memory(count),
            scratch: Scratch::default(),
        }
    }

    /// One control period, numbered `step`.
    ///
    /// # Errors
    /// A policy's function that failed, or the subject's `cancel`.
    pub fn step(&mut self, step: u32) -> Result<(), TaskError> {
        if self.subject.cancel.is_some_and(|cancel| cancel()) {
            return Err(TaskError::Interrupted);
        }
        let count = self.environment.count();
        self.environment.observe(step, &mut self.observation);
        let policy = self.subject.policy;
        let Self { observation, memory, action, scratch, .. } = self;
        policy.act_with(count, observation, memory, action, scratch);
        // A function of a policy cannot return an error from inside `act_with`, so its failure is asked for
        // here.
        if policy.has_failed() {
            return Err(WalkerError::Failed.into());
        }
        self.environment.step(step, &self.action, &mut self.reward, &mut self.ended);
        self.skip(1);
        Ok(())
    }

    /// Counts control periods of all robots as done: the one that was simulated, or the rest that need not be simulated.
    pub fn skip(&self, periods: u32) {
        self.subject.count(periods as usize * self.environment.count());
    }
}
