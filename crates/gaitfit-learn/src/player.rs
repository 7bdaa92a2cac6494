//! A policy at work in a tile of environments: its mean actions, no learning.

use gaitfit_random::{Purpose, Stream};

use crate::policy::{ActScratch, Policy};
use crate::task::{Ended, Environment, Scene};

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
    scene: &'a Scene,
    policy: &'a Policy,
    /// Standard deviation of the torque noise, N·m.
    torque_noise: f64,
    seed: u64,
    first: u32,
    observation: Vec<f32>,
    disturbance: Vec<f32>,
    scratch: ActScratch,
}

impl<'a> Player<'a> {
    /// `policy` in `environment`, whose first robot has number `first`. `torque_noise`: standard deviation of
    /// Gaussian torques added to every joint at every physics step, N·m.
    pub fn new(
        scene: &'a Scene,
        policy: &'a Policy,
        environment: Environment<'a>,
        torque_noise: f64,
        seed: u64,
        first: u32,
    ) -> Self {
        let count = environment.count();
        Self {
            environment,
            action: vec![0.0; count * scene.joints.len()],
            reward: vec![0.0; count],
            ended: vec![Ended::No; count],
            scene,
            policy,
            torque_noise,
            seed,
            first,
            observation: vec![0.0; count * scene.interface.observation_width()],
            disturbance: Vec::new(),
            scratch: ActScratch::default(),
        }
    }

    /// One control period, numbered `step`.
    pub fn step(&mut self, step: u32) {
        let count = self.environment.count();
        self.environment.observe(step, &mut self.observation);
        self.policy.act(count, &self.observation, &mut self.action, &mut self.scratch);
        self.draw_noise(step);
        self.environment.step(step, &self.action, &self.disturbance, &mut self.reward, &mut self.ended);
    }

    fn draw_noise(&mut self, step: u32) {
        if self.torque_noise == 0.0 {
            return;
        }
        let substeps = self.scene.settings.substeps;
        let joints = self.scene.batch.model().joints.len();
        let count = self.environment.count();
        self.disturbance.resize(substeps * count * joints, 0.0);
        let mut normals = vec![0.0; joints];
        for (row, torques) in self.disturbance.chunks_exact_mut(joints).enumerate() {
            let (substep, index) = (row / count, row % count);
            let physics_step = step.wrapping_mul(substeps as u32).wrapping_add(substep as u32);
            Stream::new(self.seed, Purpose::TORQUE_NOISE)
                .environment(self.first + index as u32)
                .step(physics_step)
                .fill_normals(0, &mut normals);
            for (torque, normal) in torques.iter_mut().zip(&normals) {
                *torque = (self.torque_noise * normal) as f32;
            }
        }
    }
}
