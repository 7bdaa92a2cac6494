//! The learner: networks, optimiser and the update.

use std::ops::Range;

use super::{
    Culprit, Diagnostics, Samples, SamplesError, Schedule, Settings, SettingsError, UpdateError, Widths,
    adam::Adam,
    gae,
    loss::{Constants, HALF_LOG_TAU, Sums},
    minibatch::Gradients,
    shuffle,
    worker::{Point, Worker},
};
use gaitfit_policy::network::{Network, Normaliser, Scratch, ShapeError, Weights};

/// Actor, critic, standard deviation, and what is needed to improve them. See [`Learner::update`].
pub struct Learner {
    pub(super) settings: Settings,
    pub(super) widths: Widths,
    pub(super) seed: u64,
    pub(super) actor: Network,
    pub(super) critic: Network,
    pub(super) log_std: Vec<f32>,
    pub(super) normaliser: Option<Normaliser>,
    pub(super) critic_normaliser: Option<Normaliser>,
    pub(super) adam: Adam,
    pub(super) learning_rate: f64,
    gradients: Gradients,
}

/// Why there is no learner.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LearnerError {
    /// A setting outside its range.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// A network that cannot be.
    #[error(transparent)]
    Shape(#[from] ShapeError),
    /// A network that is for inference alone.
    #[error(
        "the {what} has {why}, which is not trained here: policies with it are evaluated and fitted only"
    )]
    Untrainable {
        /// Which.
        what: &'static str,
        /// What of it.
        why: String,
    },
    /// Parts that do not fit each other.
    #[error("{what} is {found} wide, the learner needs {expected}")]
    Width {
        /// Which part.
        what: &'static str,
        /// What the rows need.
        expected: usize,
        /// What there is.
        found: usize,
    },
}

/// Where each part lies in the flat gradient.
struct Parts {
    actor: Range<usize>,
    critic: Range<usize>,
    log_std: Range<usize>,
}

impl Learner {
    /// Fresh networks for rows of `widths`, drawn from `seed` (actor: network 0, critic: network 1).
    ///
    /// # Errors
    /// [`LearnerError`] for bad settings, among them networks too large for these rows, or an empty row.
    pub fn new(settings: Settings, widths: Widths, seed: u64) -> Result<Self, LearnerError> {
        let (actor, critic) = settings.shapes(widths)?;
        let actor = Network::random(actor, seed, 0, settings.output_gain)?;
        let critic = Network::random(critic, seed, 1, 1.0)?;
        let log_std = vec![settings.initial_std.ln() as f32; widths.action];
        Self::with_networks(settings, widths, seed, actor, critic, log_std)
    }

    /// Goes on from given networks, for fine-tuning: their shapes count, not those of the settings. `fixed_std` of
    /// the settings, if given, replaces `log_std`. Moments of Adam start at 0, observations without normalisers
    /// (see [`Learner::set_normalisers`]) start at mean 0 and variance 1 if the settings ask for them.
    /// [`crate::Training::learner_from`] does it for a policy.
    ///
    /// # Errors
    /// [`LearnerError`] for bad settings or a network or `log_std` that does not fit `widths`.
    pub fn with_networks(
        settings: Settings,
        widths: Widths,
        seed: u64,
        actor: Network,
        critic: Network,
        mut log_std: Vec<f32>,
    ) -> Result<Self, LearnerError> {
        settings.check()?;
        actor.check()?;
        critic.check()?;
        for (what, network) in [("actor", &actor), ("critic", &critic)] {
            if let Some(why) = network.untrainable() {
                return Err(LearnerError::Untrainable { what, why });
            }
        }
        for (what, expected, found) in [
            ("the actor's input", widths.observation, actor.shape.inputs),
            ("the actor's output", widths.action, actor.shape.outputs),
            ("the critic's input", widths.critic_observation, critic.shape.inputs),
            ("the critic's output", 1, critic.shape.outputs),
            ("the log standard deviation", widths.action, log_std.len()),
        ] {
            if expected != found {
                return Err(LearnerError::Width { what, expected, found });
            }
        }
        if let Some(std) = settings.fixed_std {
            log_std.fill(std.ln() as f32);
        }
        let size = actor.parameters.len() + critic.parameters.len() + log_std.len();
        let normaliser = |width| settings.normalise_observations.then(|| Normaliser::new(width));
        Ok(Self {
            normaliser: normaliser(widths.observation),
            critic_normaliser: normaliser(widths.critic_observation),
            learning_rate: settings.learning_rate,
            settings,
            widths,
            seed,
            actor,
            critic,
            log_std,
            adam: Adam::new(size),
            gradients: Gradients::new(size),
        })
    }

    /// Settings it was made with.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Widths of the rows it takes.
    pub fn widths(&self) -> Widths {
        self.widths
    }

    /// Observation (normalised, if there is a normaliser) to mean action.
    pub fn actor(&self) -> &Network {
        &self.actor
    }

    /// Critic's observation (normalised, if there is a normaliser) to value.
    pub fn critic(&self) -> &Network {
        &self.critic
    }

    /// Mean actions, `rows × action`, of raw observations, `rows × observation`.
    ///
    /// # Panics
    /// If a slice is shorter than its size: an error of the caller.
    pub fn means(&self, rows: usize, observation: &[f32], mean: &mut [f32], scratch: &mut Scratch) {
        self.actor.forward_normalised(self.normaliser.as_ref(), rows, observation, mean, scratch);
    }

    /// Values, `rows`, of the critic's raw observations, `rows × critic_observation`.
    ///
    /// # Panics
    /// If a slice is shorter than its size: an error of the caller.
    pub fn values(&self, rows: usize, critic_observation: &[f32], value: &mut [f32], scratch: &mut Scratch) {
        let normaliser = self.critic_normaliser.as_ref();
        self.critic.forward_normalised(normaliser, rows, critic_observation, value, scratch);
    }

    /// ln σ of every element of the action.
    pub fn log_std(&self) -> &[f32] {
        &self.log_std
    }

    /// Learning rate of the next step.
    pub fn learning_rate(&self) -> f64 {
        self.learning_rate
    }

    /// Statistics of the actor's observations, if there are any; they change in [`Learner::update`] only, and only if
    /// the settings ask for them.
    pub fn normaliser(&self) -> Option<&Normaliser> {
        self.normaliser.as_ref()
    }

    /// Statistics of the critic's observations.
    pub fn critic_normaliser(&self) -> Option<&Normaliser> {
        self.critic_normaliser.as_ref()
    }

    /// Replaces the statistics of observations, for fine-tuning a policy that has some. They go on changing only if the
    /// settings ask for statistics.
    ///
    /// # Errors
    /// [`LearnerError::Width`] if they do not fit the rows.
    pub fn set_normalisers(
        &mut self,
        normaliser: Option<Normaliser>,
        critic_normaliser: Option<Normaliser>,
    ) -> Result<(), LearnerError> {
        for (what, expected, normaliser) in [
            ("the actor's normaliser", self.widths.observation, &normaliser),
            ("the critic's normaliser", self.widths.critic_observation, &critic_normaliser),
        ] {
            if let Some(normaliser) = normaliser {
                for found in [normaliser.mean.len(), normaliser.variance.len()] {
                    if found != expected {
                        return Err(LearnerError::Width { what, expected, found });
                    }
                }
            }
        }
        self.normaliser = normaliser;
        self.critic_normaliser = critic_normaliser;
        Ok(())
    }

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
        gae::check_and_estimate(tiles, self.widths, gamma, lambda, threads)?;
        let samples = tiles.iter().map(Samples::rows).sum();
        if samples < minibatches {
            return Err(SamplesError::TooFew { samples, minibatches }.into());
        }
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
        let scales = [&self.normaliser, &self.critic_normaliser].map(|n| n.as_ref().map(Normaliser::scale));
        let (actor, critic) = (&self.actor.shape, &self.critic.shape);
        self.gradients.prepare(threads, || Worker::new(actor, critic));

        let old_log_std = self.log_std.clone();
        let mut report = Diagnostics { explained_variance, ..Diagnostics::default() };
        for epoch in 0..epochs {
            let places = shuffle::deal(tiles, minibatches, self.seed, iteration, epoch as u32);
            for minibatch in 0..minibatches {
                let part = &places[shuffle::range(samples, minibatches, minibatch)];
                let mut constants = Constants::new(&self.settings, part.len(), &self.log_std, &old_log_std);
                constants.clipped_value_loss &= !critic_alone;
                let [actor, critic] =
                    [&self.actor, &self.critic].map(|n| Weights::new(&n.shape, &n.parameters));
                let point = Point { actor, critic, constants };
                let sums = self.gradients.compute(&point, tiles, part, &scales);
                // Before the actor's first step the policy is the one that sampled: its divergence says nothing.
                let unmoved = critic_alone || (epoch == 0 && minibatch == 0);
                self.step(&sums, part.len(), critic_alone, unmoved, &mut report)
                    .map_err(|culprit| UpdateError::NotFinite { culprit, iteration, epoch, minibatch })?;
            }
        }
        report.divide((epochs * minibatches) as f64);
        report.learning_rate = self.learning_rate;
        report.mean_std =
            self.log_std.iter().map(|&s| f64::from(s).exp()).sum::<f64>() / self.log_std.len() as f64;
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
        let learn_std = self.settings.fixed_std.is_none() && !critic_alone;
        let gradient = &mut self.gradients.total;
        if critic_alone {
            gradient[parts.actor.clone()].fill(0.0);
        }
        for g in &mut gradient[parts.log_std.clone()] {
            // ∂H/∂ln σ = 1 for each element: H = Σ ln σ + ½ ln 2πe.
            *g = if learn_std { *g - self.settings.entropy_coefficient as f32 } else { 0.0 };
        }
        let count = rows as f64;
        let kl = sums.kl / count;
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
        if self.settings.schedule == Schedule::Adaptive && !unmoved {
            let [min, max] = self.settings.learning_rate_limits;
            if kl > 2.0 * self.settings.desired_kl {
                self.learning_rate = (self.learning_rate / 1.5).max(min);
            } else if kl < 0.5 * self.settings.desired_kl {
                self.learning_rate = (self.learning_rate * 1.5).min(max);
            }
        }
        let norm = squares.iter().sum::<f64>().sqrt();
        let factor = (self.settings.max_gradient_norm / (norm + 1e-6)).min(1.0);
        report.entropy += self.entropy();
        let mut targets = vec![(parts.critic, self.critic.parameters.as_mut_slice())];
        if !critic_alone {
            targets.push((parts.actor, self.actor.parameters.as_mut_slice()));
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
        let actor = 0..self.actor.parameters.len();
        let critic = actor.end..actor.end + self.critic.parameters.len();
        let log_std = critic.end..critic.end + self.log_std.len();
        Parts { actor, critic, log_std }
    }

    /// Takes the samples into the statistics of observations, if the settings ask for them.
    fn observe(&mut self, tiles: &[Samples]) {
        if !self.settings.normalise_observations {
            return;
        }
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
