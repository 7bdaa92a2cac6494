//! A policy at work in a tile of environments: its mean actions, no learning.

use crate::task::{Ended, Environment, Task, TaskError};
use gaitfit_policy::Policy;
use gaitfit_policy::network::{Memory, Scratch};
use gaitfit_policy::walker::WalkerError;

/// A policy and the tile it moves. Ended episodes are left where they are.
pub struct Player<'a> {
    /// The robots.
    pub environment: Environment<'a>,
    /// Last actions, policy order; `environments × joints`.
    pub action: Vec<f32>,
    /// Reward of the last step.
    pub reward: Vec<f32>,
    /// How each episode stands.
    pub ended: Vec<Ended>,
    policy: &'a Policy,
    observation: Vec<f32>,
    memory: Memory,
    scratch: Scratch,
}

impl<'a> Player<'a> {
    /// `policy` in `environment`, which is of `task`.
    pub fn new(task: &'a Task, policy: &'a Policy, environment: Environment<'a>) -> Self {
        let count = environment.count();
        Self {
            environment,
            action: vec![0.0; count * task.walker.joints.len()],
            reward: vec![0.0; count],
            ended: vec![Ended::No; count],
            policy,
            observation: vec![0.0; count * task.walker.interface.observation_width()],
            memory: policy.memory(count),
            scratch: Scratch::default(),
        }
    }

    /// One control period, numbered `step`.
    ///
    /// # Errors
    /// A policy's function that failed.
    pub fn step(&mut self, step: u32) -> Result<(), TaskError> {
        let count = self.environment.count();
        self.environment.observe(step, &mut self.observation);
        let Self { policy, observation, memory, action, scratch, .. } = self;
        policy.act_with(count, observation, memory, action, scratch);
        if policy.has_failed() {
            return Err(WalkerError::Failed.into());
        }
        self.environment.step(step, &self.action, &mut self.reward, &mut self.ended);
        Ok(())
    }
}
