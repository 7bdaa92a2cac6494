//! Rollouts: a policy acts in a tile of environments, and what happens is written down for the learner.

use crate::ppo::{End, Learner, Recorder};
use crate::task::{Ended, Environment};

/// Sums over the steps and the ended episodes of a rollout.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tally {
    /// Control steps of all environments.
    pub steps: f64,
    /// Reward.
    pub reward: f64,
    /// Weighted reward terms, in the task's order.
    pub terms: Vec<f64>,
    /// Horizontal velocity error, m/s, and yaw-rate error, rad/s.
    pub tracking: [f64; 2],
    /// Episodes that ended.
    pub episodes: f64,
    /// Episodes that ended by a fall, or because the simulation diverged.
    pub falls: f64,
    /// Episodes that ended because the simulation diverged. Their last step pays nothing, and is in no sum
    /// but that of steps.
    pub diverged: f64,
    /// Their lengths, control steps.
    pub episode_steps: f64,
    /// Their summed rewards.
    pub episode_return: f64,
    /// Levels of the ground that robots are on, over all control steps; 0 without levels.
    pub levels: f64,
    /// Control steps that were left of episodes that ended by a fall.
    pub lost_steps: f64,
}

impl Tally {
    /// Adds a control step of one environment.
    fn step(&mut self, reward: f32, tracking: [f32; 2]) {
        self.steps += 1.0;
        self.reward += f64::from(reward);
        self.tracking.iter_mut().zip(tracking).for_each(|(sum, error)| *sum += f64::from(error));
    }

    /// Adds an episode that ended: its summed reward, its steps, and those that were left of it.
    fn episode(&mut self, [sum, steps]: [f32; 2], ended: Ended, left: u32) {
        self.episodes += 1.0;
        self.episode_return += f64::from(sum);
        self.episode_steps += f64::from(steps);
        if ended != Ended::TimeOut {
            self.falls += 1.0;
            self.lost_steps += f64::from(left);
        }
        if ended == Ended::Diverged {
            self.diverged += 1.0;
        }
    }

    /// Adds another's sums.
    pub fn add(&mut self, other: &Self) {
        self.steps += other.steps;
        self.reward += other.reward;
        // A tally that nothing was added to has no terms yet.
        self.terms.resize(other.terms.len(), 0.0);
        self.terms.iter_mut().zip(&other.terms).for_each(|(sum, term)| *sum += term);
        self.tracking.iter_mut().zip(other.tracking).for_each(|(sum, error)| *sum += error);
        self.episodes += other.episodes;
        self.falls += other.falls;
        self.diverged += other.diverged;
        self.episode_steps += other.episode_steps;
        self.episode_return += other.episode_return;
        self.levels += other.levels;
        self.lost_steps += other.lost_steps;
    }
}

/// A robot whose simulation diverged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Divergence {
    /// Step in the rollout.
    pub step: usize,
    /// Environment in the tile.
    pub environment: usize,
    /// The reward term that was not finite, if the state was.
    pub term: Option<String>,
}

/// One tile with its samples and the buffers of its rollouts.
pub struct Runner<'a> {
    /// The robots.
    pub environment: Environment<'a>,
    /// Samples of the last rollout.
    pub recorder: Recorder,
    /// Sums of the last rollout.
    pub tally: Tally,
    /// The first robot that diverged in it.
    pub divergence: Option<Divergence>,
    /// Whether the task's function of the caller failed in it.
    pub terms_failed: bool,
    /// Reward and steps since each episode began.
    pub(crate) returns: Vec<[f32; 2]>,
    ended: Vec<Ended>,
    ends: Vec<End>,
}

impl<'a> Runner<'a> {
    /// A runner for `environment`, with room in `recorder` for as many environments.
    pub fn new(environment: Environment<'a>, recorder: Recorder) -> Self {
        let count = environment.count();
        Self {
            environment,
            recorder,
            tally: Tally::default(),
            divergence: None,
            terms_failed: false,
            returns: vec![[0.0; 2]; count],
            ended: vec![Ended::No; count],
            ends: vec![End::No; count],
        }
    }

    /// Fills the samples with one rollout under the learner's policy, its actions drawn around their means.
    /// Steps are numbered from `first_step`. A robot that diverges has fallen: its step pays nothing, and a new episode
    /// begins.
    pub fn rollout(&mut self, learner: &Learner, first_step: u32) {
        let Self { environment, recorder, tally, divergence, terms_failed, returns, ended, ends } = self;
        *tally = Tally::default();
        (*divergence, *terms_failed) = (None, false);
        recorder.begin();
        for t in 0..recorder.samples.steps {
            // Numbers run on from rollout to rollout, so that no draw comes twice.
            let step = first_step + t as u32;
            let (observation, critic_observation) = recorder.observations();
            environment.observe(step, observation);
            environment.observe_critic(critic_observation);
            recorder.act(learner, step);
            let (action, reward) = recorder.exchange();
            environment.step(step, action, reward, ended);
            // After a first failure the function is not called again: the iteration ends with an error
            // anyway.
            if let Some(terms) = environment.user_terms().filter(|_| !*terms_failed) {
                *terms_failed = !terms.apply(environment, reward, ended);
            }
            if let Some(first) = ended.iter().position(|&ended| ended == Ended::Diverged) {
                let term = environment.broken_term(first).map(str::to_owned);
                // Only the first divergence of a rollout is reported.
                divergence.get_or_insert(Divergence { step: t, environment: first, term });
            }
            for (index, reward) in reward.iter().enumerate() {
                // The state of a robot that came apart would make the mean errors NaN.
                let whole = ended[index] != Ended::Diverged;
                tally.step(*reward, if whole { environment.tracking_error(index) } else { [0.0; 2] });
                tally.levels += environment.cell(index).map_or(0.0, |cell| cell.level as f64);
                let so_far = &mut returns[index];
                so_far[0] += reward;
                so_far[1] += 1.0;
                ends[index] = match ended[index] {
                    // A time-out says nothing of the state's value, so the critic stands in for the reward
                    // that is cut off.
                    Ended::No => End::No,
                    Ended::TimeOut => End::Truncated,
                    Ended::Fall | Ended::Diverged => End::Terminated,
                };
                if ends[index] != End::No {
                    tally.episode(std::mem::take(so_far), ended[index], environment.steps_left(index));
                }
            }
            // Before new episodes begin: the critic values the states in which episodes were cut off.
            recorder.end(learner, ends, |rows| environment.observe_critic(rows));
            environment.begin_episodes(step, ended);
        }
        recorder.finish(learner, |rows| environment.observe_critic(rows));
        tally.terms = environment.take_terms();
    }
}
