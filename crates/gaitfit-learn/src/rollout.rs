//! Rollouts: a policy acts in a tile of environments, and what happens is written down for the learner.

use gaitfit_random::{Purpose, Stream, fill_normal_rows};

use crate::ppo::{Learner, Samples};
use crate::task::{Ended, Environment};
use gaitfit_policy::network::Scratch;

/// Sums over the steps and the ended episodes of a rollout.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tally {
    /// Control steps of all environments.
    pub steps: f64,
    /// Reward.
    pub reward: f64,
    /// Weighted reward terms, in the scene's order.
    pub terms: Vec<f64>,
    /// Horizontal velocity error, m/s, and yaw-rate error, rad/s.
    pub tracking: [f64; 2],
    /// Episodes that ended.
    pub episodes: f64,
    /// Of them, by a fall.
    pub falls: f64,
    /// Their lengths, control steps.
    pub episode_steps: f64,
    /// Their summed rewards.
    pub episode_return: f64,
}

impl Tally {
    /// Adds another's sums.
    pub fn add(&mut self, other: &Self) {
        self.steps += other.steps;
        self.reward += other.reward;
        self.terms.resize(other.terms.len(), 0.0);
        self.terms.iter_mut().zip(&other.terms).for_each(|(sum, term)| *sum += term);
        self.tracking.iter_mut().zip(other.tracking).for_each(|(sum, error)| *sum += error);
        self.episodes += other.episodes;
        self.falls += other.falls;
        self.episode_steps += other.episode_steps;
        self.episode_return += other.episode_return;
    }
}

/// A robot's state stopped being a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Divergence {
    /// Step in the rollout.
    pub step: usize,
    /// Environment in the tile.
    pub environment: usize,
}

/// One tile with its samples and the buffers of its rollouts.
pub struct Runner<'a> {
    /// The robots.
    pub environment: Environment<'a>,
    /// What the last rollout left.
    pub samples: Samples,
    /// Sums of the last rollout.
    pub tally: Tally,
    /// Reward and steps since each episode began.
    pub(crate) returns: Vec<[f32; 2]>,
    /// Number of the tile's first environment.
    first: u32,
    scratch: Scratch,
    ended: Vec<Ended>,
}

impl<'a> Runner<'a> {
    /// A runner for `environment`, whose first robot has number `first`, with room in `samples`.
    pub fn new(environment: Environment<'a>, first: u32, samples: Samples) -> Self {
        let count = environment.count();
        Self {
            environment,
            samples,
            tally: Tally::default(),
            returns: vec![[0.0; 2]; count],
            first,
            scratch: Scratch::new(),
            ended: vec![Ended::No; count],
        }
    }

    /// Fills the samples with one rollout under the learner's policy, its actions drawn around their means.
    /// Steps are numbered from `first_step`.
    ///
    /// # Errors
    /// A robot that diverged; the samples are then not whole.
    pub fn rollout(&mut self, learner: &Learner, seed: u64, first_step: u32) -> Result<(), Divergence> {
        let samples = &mut self.samples;
        let widths = samples.widths;
        let count = samples.environments;
        let std: Vec<f32> = learner.log_std().iter().map(|x| x.exp()).collect();
        // Σ ln σ + n/2 ln 2π of the density.
        let constant =
            learner.log_std().iter().sum::<f32>() + 0.5 * widths.action as f32 * std::f32::consts::TAU.ln();
        let mut normals = vec![0.0; count * widths.action];
        self.tally = Tally::default();
        for t in 0..samples.steps {
            let step = first_step + t as u32;
            let rows = t * count..(t + 1) * count;
            let of = |width: usize| rows.start * width..rows.end * width;
            let observation = &mut samples.observation[of(widths.observation)];
            self.environment.observe(step, observation);
            let critic_observation = &mut samples.critic_observation[of(widths.critic_observation)];
            self.environment.observe_critic(critic_observation);
            let mean = &mut samples.mean[of(widths.action)];
            let scratch = &mut self.scratch;
            learner.actor().forward_normalised(learner.normaliser(), count, observation, mean, scratch);
            let value = &mut samples.value[rows.clone()];
            let critic_normaliser = learner.critic_normaliser();
            learner.critic().forward_normalised(critic_normaliser, count, critic_observation, value, scratch);
            let action = &mut samples.action[of(widths.action)];
            let stream = Stream::new(seed, Purpose::EXPLORATION).step(step);
            fill_normal_rows(stream, self.first, widths.action, &mut normals);
            let drawn = action.chunks_exact_mut(widths.action).zip(mean.chunks_exact(widths.action));
            for (index, ((action, mean), normals)) in
                drawn.zip(normals.chunks_exact(widths.action)).enumerate()
            {
                let mut squares = 0.0;
                for k in 0..widths.action {
                    let z = normals[k] as f32;
                    action[k] = std[k].mul_add(z, mean[k]);
                    squares += z * z;
                }
                samples.log_probability[rows.start + index] = -0.5 * squares - constant;
            }
            let reward = &mut samples.reward[rows.clone()];
            self.environment.step(step, action, reward, &mut self.ended);
            if let Some(environment) = self.ended.iter().position(|&ended| ended == Ended::Diverged) {
                return Err(Divergence { step: t, environment });
            }
            for (index, reward) in reward.iter().enumerate() {
                let error = self.environment.tracking_error(index);
                self.tally.steps += 1.0;
                self.tally.reward += f64::from(*reward);
                self.tally.tracking[0] += f64::from(error[0]);
                self.tally.tracking[1] += f64::from(error[1]);
                let so_far = &mut self.returns[index];
                so_far[0] += reward;
                so_far[1] += 1.0;
                let ended = self.ended[index];
                samples.done[rows.start + index] = if ended == Ended::No { 0.0 } else { 1.0 };
                if ended != Ended::No {
                    let [sum, steps] = std::mem::take(so_far);
                    self.tally.episodes += 1.0;
                    self.tally.episode_return += f64::from(sum);
                    self.tally.episode_steps += f64::from(steps);
                    self.tally.falls += if ended == Ended::Fall { 1.0 } else { 0.0 };
                }
            }
            if self.ended.contains(&Ended::TimeOut) {
                // An episode cut off would have gone on: its last reward gets γ V of the state it was cut in.
                let mut last = vec![0.0; count * widths.critic_observation];
                self.environment.observe_critic(&mut last);
                let mut values = vec![0.0; count];
                learner.critic().forward_normalised(critic_normaliser, count, &last, &mut values, scratch);
                let gamma = learner.settings().gamma as f32;
                for index in (0..count).filter(|&index| self.ended[index] == Ended::TimeOut) {
                    reward[index] += gamma * values[index];
                }
            }
            self.environment.begin_episodes(step, &self.ended);
        }
        let mut last = vec![0.0; count * widths.critic_observation];
        self.environment.observe_critic(&mut last);
        let critic_normaliser = learner.critic_normaliser();
        let (values, scratch) = (&mut samples.last_value, &mut self.scratch);
        learner.critic().forward_normalised(critic_normaliser, count, &last, values, scratch);
        self.tally.terms = self.environment.take_terms();
        Ok(())
    }
}
