//! Numbers that an update reports, and reasons why it stops.

use serde::{Deserialize, Serialize};

use super::samples::SamplesError;

/// Numbers about one update; means over all its minibatches unless said otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Diagnostics {
    /// Clipped surrogate loss.
    pub policy_loss: f64,
    /// Value loss, without its coefficient.
    pub value_loss: f64,
    /// Entropy of the policy's distribution, nats.
    pub entropy: f64,
    /// KL divergence from the sampling policy, closed form, nats.
    pub kl: f64,
    /// Its mean over the last minibatch alone, which shows how far the whole update went.
    pub kl_last: f64,
    /// Its estimate −mean(ln r).
    pub approx_kl_k1: f64,
    /// Its estimate mean((r − 1) − ln r).
    pub approx_kl_k3: f64,
    /// Share of samples with |r − 1| > ε.
    pub clip_fraction: f64,
    /// 1 − Var(R − V)/Var(R) of the rollout, before the update; 0 if the returns do not vary.
    pub explained_variance: f64,
    /// Learning rate of the last step.
    pub learning_rate: f64,
    /// Euclidean norm of the gradient before clipping.
    pub gradient_norm: f64,
    /// Mean standard deviation of the action's elements, after the update.
    pub mean_std: f64,
}

/// What was not finite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Culprit {
    /// The clipped surrogate.
    PolicyLoss,
    /// The critic's loss.
    ValueLoss,
    /// The divergence from the sampling policy.
    KlDivergence,
    /// A derivative by the actor's parameters.
    ActorGradient,
    /// A derivative by the critic's parameters.
    CriticGradient,
    /// A derivative by ln σ.
    LogStdGradient,
}

impl std::fmt::Display for Culprit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::PolicyLoss => "policy loss",
            Self::ValueLoss => "value loss",
            Self::KlDivergence => "KL divergence",
            Self::ActorGradient => "gradient of the actor",
            Self::CriticGradient => "gradient of the critic",
            Self::LogStdGradient => "gradient of the log standard deviation",
        })
    }
}

/// Why an update stopped.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum UpdateError {
    /// The samples cannot be learned from; nothing was changed.
    #[error(transparent)]
    Samples(#[from] SamplesError),
    /// The networks' arithmetic overflowed. Parameters are those before the step named.
    #[error(
        "the {culprit} is not finite at iteration {iteration}, epoch {epoch}, minibatch {minibatch}: \
         lower the learning rate or look for rewards that grow without bound"
    )]
    NotFinite {
        /// What was not finite.
        culprit: Culprit,
        /// The caller's number of the update.
        iteration: u32,
        /// Pass over the samples, from 0.
        epoch: usize,
        /// Minibatch of the pass, from 0.
        minibatch: usize,
    },
}
