//! The learner's update: advantages, gradients, steps.

use std::ops::Range;

use super::{
    Culprit, Diagnostics, Learner, Samples, SamplesError, Schedule, Settings, UpdateError,
    adam::Adam,
    gae,
    loss::{Constants, HALF_LOG_TAU, Sums},
    sequence::SequenceWorker,
    shuffle,
    worker::{Point, Worker},
};
use gaitfit_policy::network::{Network, Normaliser, Recurrent, RecurrentWeights, Weights};

/// Where each part lies in the flat gradient. A memory lies behind its network.
struct Parts {
    actor: Range<usize>,
    critic: Range<usize>,
    log_std: Range<usize>,
}

impl Learner {
    /// One update by PPO (Schulman et al. 2017): advantages, then `epochs × minibatches` steps of Adam.
    ///
    /// The samples were drawn by this learner's actor and `log_std` as they are now, and hold raw observations (the
    /// networks saw them normalised, if there are normalisers). `iteration` numbers the update; it and the seed
    /// determine the order of the samples. Neither `threads` nor how threads are scheduled changes a bit of the
    /// result. Statistics of observations take in the samples after the last step. In the first `critic_warmup`
    /// updates the actor stays as it is; after them the moments of Adam start at 0 again.
    ///
    /// # Errors
    /// [`UpdateError`]: unfit samples (the learner is unchanged), or arithmetic that is not finite (parameters and
    /// moments are those before the step named).
    pub fn update(
        &mut self,
        tiles: &mut [Samples],
        iteration: u32,
        threads: usize,
    ) -> Result<Diagnostics, UpdateError> {
        let Settings { epochs, minibatches, gamma, lambda, .. } = self.settings;
        // Before any change, so that unfit samples leave the learner as it was.
        gae::check_and_estimate(tiles, self.widths, gamma, lambda, threads)?;
        let remembers = self.actor_memory.is_some() || self.critic_memory.is_some();
        let samples = tiles.iter().map(Samples::rows).sum();
        let robots = tiles.iter().map(|tile| tile.environments).sum();
        if remembers {
            for (index, tile) in tiles.iter().enumerate() {
                let memories = [&self.actor_memory, &self.critic_memory];
                tile.check_memories(index, memories.map(|memory| memory.as_ref().map(Recurrent::shape)))?;
            }
            if robots < minibatches {
                return Err(SamplesError::TooFewRobots { robots, minibatches }.into());
            }
        }
        if samples < minibatches {
            return Err(SamplesError::TooFew { samples, minibatches }.into());
        }
        // What minibatches are made of: single samples, or with a memory whole robots.
        let count = |tile: &Samples| if remembers { tile.environments } else { tile.rows() };
        let counts: Vec<usize> = tiles.iter().map(count).collect();
        let units = if remembers { robots } else { samples };
        // Before the advantages are normalised: the variance is that of the critic's plain errors. Returns
        // that do not vary have none.
        let explained_variance = gae::explained_variance(tiles).unwrap_or(0.0);
        if self.settings.normalise_advantage {
            gae::normalise_advantages(tiles);
        }
        let warmup = self.settings.critic_warmup.unwrap_or(0);
        let critic_alone = iteration < warmup;
        if warmup > 0 && iteration == warmup {
            // The correction for moments that started at 0 would have run out before the actor's first step.
            self.adam = Adam::new(self.gradients.total.len());
        }
        // Fixed for the whole update: the statistics take in these samples only at its end.
        let scales = [&self.normaliser, &self.critic_normaliser].map(|n| n.as_ref().map(Normaliser::scale));
        let (actor, critic) = (&self.actor.shape, &self.critic.shape);
        if remembers {
            // Workers keep the longest sequence of any tile; shorter ones use a part of it.
            let steps = tiles.iter().map(|tile| tile.steps).max().unwrap_or(0);
            self.gradients.prepare_sequences(threads, steps, || SequenceWorker::new(actor, critic, steps));
        } else {
            self.gradients.prepare(threads, || Worker::new(actor, critic));
        }

        // σ of the policy that sampled: ratios and divergences are against it in all epochs.
        let old_log_std = self.log_std.clone();
        let mut report = Diagnostics { explained_variance, ..Diagnostics::default() };
        // Every epoch deals the samples anew, so minibatches differ from epoch to epoch.
        for epoch in 0..epochs {
            let places = shuffle::deal(&counts, minibatches, self.seed, iteration, epoch as u32);
            for minibatch in 0..minibatches {
                let part = &places[shuffle::range(units, minibatches, minibatch)];
                // Losses are means over samples, also where a minibatch is made of whole robots.
                let rows = match remembers {
                    true => part.iter().map(|place| tiles[place.tile as usize].steps).sum(),
                    false => part.len(),
                };
                let mut constants = Constants::new(&self.settings, rows, &self.log_std, &old_log_std);
                // The clip would keep a critic near the values that it had in the other simulator.
                constants.clipped_value_loss &= !critic_alone;
                let point = Point {
                    actor: weights(&self.actor, &self.actor_memory),
                    critic: weights(&self.critic, &self.critic_memory),
                    memories: [&self.actor_memory, &self.critic_memory]
                        .map(|memory| memory.as_ref().map(RecurrentWeights::from)),
                    constants,
                };
                let sums = match remembers {
                    true => self.gradients.compute_sequences(&point, tiles, part, &scales),
                    false => self.gradients.compute(&point, tiles, part, &scales),
                };
                // Before the actor's first step the policy is the one that sampled: its divergence says nothing.
                let unmoved = critic_alone || (epoch == 0 && minibatch == 0);
                self.step(&sums, rows, critic_alone, unmoved, &mut report)
                    .map_err(|culprit| UpdateError::NotFinite { culprit, iteration, epoch, minibatch })?;
            }
        }
        report.divide((epochs * minibatches) as f64);
        report.learning_rate = self.learning_rate;
        report.mean_std =
            self.log_std.iter().map(|&s| f64::from(s).exp()).sum::<f64>() / self.log_std.len() as f64;
        // After the last step: networks in this update and the rollout before it saw the same normalisation.
        self.observe(tiles);
        Ok(report)
    }

    /// Checks the minibatch's gradient, moves the learning rate and steps; adds to `report`.
    fn step(
        &mut self,
        sums: &Sums,
        rows: usize,
        critic_alone: bool,
        unmoved: bool,
        report: &mut Diagnostics,
    ) -> Result<(), Culprit> {
        let parts = self.parts();
        // A fixed σ has no gradient. During the warm-up the policy must not move, and σ is a part of it.
        let learn_std = self.settings.fixed_std.is_none() && !critic_alone;
        let gradient = &mut self.gradients.total;
        // The actor's part is zeroed before the norm is taken: it must not shrink the critic's step.
        if critic_alone {
            gradient[parts.actor.clone()].fill(0.0);
        }
        for g in &mut gradient[parts.log_std.clone()] {
            // ∂H/∂ln σ = 1 for each element: H = Σ ln σ + ½ ln 2πe.
            *g = if learn_std { *g - self.settings.entropy_coefficient as f32 } else { 0.0 };
        }
        let count = rows as f64;
        let kl = sums.kl / count;
        // Squares of `f32` gradients could overflow in `f32`; each part is summed apart to name the culprit.
        let squares =
            |range: &Range<usize>| gradient[range.clone()].iter().map(|&g| f64::from(g).powi(2)).sum::<f64>();
        let squares = [&parts.actor, &parts.critic, &parts.log_std].map(squares);
        for (number, culprit) in [
            (sums.surrogate, Culprit::PolicyLoss),
            (sums.value, Culprit::ValueLoss),
            (kl, Culprit::KlDivergence),
            (squares[0], Culprit::ActorGradient),
            (squares[1], Culprit::CriticGradient),
            (squares[2], Culprit::LogStdGradient),
        ] {
            if !number.is_finite() {
                return Err(culprit);
            }
        }
        // Rule and factors of rsl_rl (Rudin et al. 2022), which legged_gym trains with.
        if self.settings.schedule == Schedule::Adaptive && !unmoved {
            let [min, max] = self.settings.learning_rate_limits;
            if kl > 2.0 * self.settings.desired_kl {
                self.learning_rate = (self.learning_rate / 1.5).max(min);
            } else if kl < 0.5 * self.settings.desired_kl {
                self.learning_rate = (self.learning_rate * 1.5).min(max);
            }
        }
        let norm = squares.iter().sum::<f64>().sqrt();
        // 1e-6 as in PyTorch's `clip_grad_norm_`: a gradient of zero divides by no zero.
        let factor = (self.settings.max_gradient_norm / (norm + 1e-6)).min(1.0);
        // Before the step: of the policy that the losses were computed with.
        report.entropy += self.entropy();
        // Parameters that are not among the targets keep their values and their moments.
        let mut targets = Vec::new();
        push_parts(&mut targets, parts.critic.start, &mut self.critic, &mut self.critic_memory);
        if !critic_alone {
            push_parts(&mut targets, parts.actor.start, &mut self.actor, &mut self.actor_memory);
        }
        if learn_std {
            targets.push((parts.log_std, self.log_std.as_mut_slice()));
        }
        self.adam.step(&mut targets, &self.gradients.total, factor, self.learning_rate);
        report.policy_loss += sums.surrogate / count;
        report.value_loss += sums.value / count;
        report.kl += kl;
        report.kl_last = kl;
        report.approx_kl_k1 += sums.k1 / count;
        report.approx_kl_k3 += sums.k3 / count;
        report.clip_fraction += sums.clipped / count;
        report.gradient_norm += norm;
        Ok(())
    }

    /// H = Σ ln σ + ½ ln 2πe.
    fn entropy(&self) -> f64 {
        self.log_std.iter().map(|&s| f64::from(s) + HALF_LOG_TAU + 0.5).sum()
    }

    fn parts(&self) -> Parts {
        let size = |network: &Network, memory: &Option<Recurrent>| {
            network.parameters.len() + memory.as_ref().map_or(0, |memory| memory.shape().parameters())
        };
        let actor = 0..size(&self.actor, &self.actor_memory);
        let critic = actor.end..actor.end + size(&self.critic, &self.critic_memory);
        let log_std = critic.end..critic.end + self.log_std.len();
        Parts { actor, critic, log_std }
    }

    /// Takes the samples into the statistics of observations, if the settings ask for them.
    fn observe(&mut self, tiles: &[Samples]) {
        if !self.settings.normalise_observations {
            return;
        }
        // In the order of the tiles, so that the sums do not depend on threads.
        for tile in tiles {
            if let Some(normaliser) = &mut self.normaliser {
                normaliser.merge(&Normaliser::from_samples(self.widths.observation, &tile.observation));
            }
            if let Some(normaliser) = &mut self.critic_normaliser {
                normaliser.merge(&Normaliser::from_samples(
                    self.widths.critic_observation,
                    &tile.critic_observation,
                ));
            }
        }
    }
}

/// A network's parameters for its passes.
fn weights<'a>(network: &'a Network, memory: &Option<Recurrent>) -> Weights<'a, f32> {
    let weights = match memory {
        None => Weights::new(&network.shape, &network.parameters),
        // Behind a memory the derivative by the input is needed too: it goes back into the memory.
        Some(_) => Weights::behind_another(&network.shape, &network.parameters),
    };
    weights.with_output(network.output)
}

/// Where a network's and its memory's parameters lie in the flat gradient from `start` on.
fn push_parts<'a>(
    parts: &mut Vec<(Range<usize>, &'a mut [f32])>,
    start: usize,
    network: &'a mut Network,
    memory: &'a mut Option<Recurrent>,
) {
    let end = start + network.parameters.len();
    parts.push((start..end, network.parameters.as_mut_slice()));
    for ((_, range), values) in memory.iter_mut().flat_map(Recurrent::parameters_mut) {
        parts.push((end + range.start..end + range.end, values));
    }
}

impl Diagnostics {
    /// Turns sums over `count` minibatches into means.
    fn divide(&mut self, count: f64) {
        for number in [
            &mut self.policy_loss,
            &mut self.value_loss,
            &mut self.entropy,
            &mut self.kl,
            &mut self.approx_kl_k1,
            &mut self.approx_kl_k3,
            &mut self.clip_fraction,
            &mut self.gradient_norm,
        ] {
            *number /= count;
        }
    }
}
