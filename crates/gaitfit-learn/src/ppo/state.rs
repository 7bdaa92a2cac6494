//! A learner's state as named tensors and a few scalars, exact to the bit.

use serde::{Deserialize, Serialize};

use super::Learner;
use gaitfit_policy::network::Normaliser;

/// What a learner's state holds besides tensors; written as JSON with shortest round-trip numbers it is exact.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scalars {
    /// Seed of the shuffles.
    pub seed: u64,
    /// Steps that Adam has taken.
    pub steps: u64,
    /// Learning rate of the next step.
    pub learning_rate: f64,
    /// Statistics of the actor's observations.
    pub normaliser: Option<Normaliser>,
    /// Statistics of the critic's observations.
    pub critic_normaliser: Option<Normaliser>,
}

/// A state that is not this learner's.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StateError {
    /// A tensor is not there.
    #[error("the learner's state has no tensor `{0}`")]
    Missing(&'static str),
    /// A tensor of another size.
    #[error(
        "tensor `{name}` has {found} numbers, this learner has {expected}: the state is of another network"
    )]
    Size {
        /// Which tensor.
        name: &'static str,
        /// Numbers in this learner.
        expected: usize,
        /// Numbers in the state.
        found: usize,
    },
    /// A number that cannot be.
    #[error("`{name}` is {value} in the learner's state: the file is damaged")]
    Number {
        /// Which tensor or scalar.
        name: &'static str,
        /// What it is.
        value: f64,
    },
    /// Statistics of rows of another width, or there where the settings have none.
    #[error("the statistics `{0}` in the learner's state do not fit this learner's settings and rows")]
    Normaliser(&'static str),
}

impl Learner {
    /// Everything that the next update depends on, but for [`Learner::scalars`] and the settings.
    pub fn tensors(&self) -> [(&'static str, &[f32]); 5] {
        [
            ("actor", &self.actor.parameters),
            ("critic", &self.critic.parameters),
            ("log_std", &self.log_std),
            ("adam.first", &self.adam.first),
            ("adam.second", &self.adam.second),
        ]
    }

    /// The rest of the state.
    pub fn scalars(&self) -> Scalars {
        Scalars {
            seed: self.seed,
            steps: self.adam.steps,
            learning_rate: self.learning_rate,
            normaliser: self.normaliser.clone(),
            critic_normaliser: self.critic_normaliser.clone(),
        }
    }

    /// Takes over a state written by a learner of the same settings and widths: from here on both do the same to the
    /// bit. `tensor` looks a tensor up by its name in [`Learner::tensors`].
    ///
    /// # Errors
    /// [`StateError`] naming what does not fit; the learner is then unchanged.
    pub fn restore<'a>(
        &mut self,
        tensor: impl Fn(&str) -> Option<&'a [f32]>,
        scalars: &Scalars,
    ) -> Result<(), StateError> {
        let mut found = Vec::new();
        for (name, mine) in self.tensors() {
            let values = tensor(name).ok_or(StateError::Missing(name))?;
            if values.len() != mine.len() {
                return Err(StateError::Size { name, expected: mine.len(), found: values.len() });
            }
            // Adam takes roots of its second moments.
            let min = if name == "adam.second" { 0.0 } else { f32::MIN };
            if let Some(&value) = values.iter().find(|&&x| !(x.is_finite() && x >= min)) {
                return Err(StateError::Number { name, value: f64::from(value) });
            }
            found.push(values);
        }
        let rate = scalars.learning_rate;
        if !(rate > 0.0 && rate.is_finite()) {
            return Err(StateError::Number { name: "learning_rate", value: rate });
        }
        for (name, mine, theirs) in [
            ("normaliser", &self.normaliser, &scalars.normaliser),
            ("critic_normaliser", &self.critic_normaliser, &scalars.critic_normaliser),
        ] {
            let widths = |n: &Option<Normaliser>| n.as_ref().map(|n| (n.mean.len(), n.variance.len()));
            if widths(mine) != widths(theirs) {
                return Err(StateError::Normaliser(name));
            }
        }
        let targets: [&mut [f32]; 5] = [
            &mut self.actor.parameters,
            &mut self.critic.parameters,
            &mut self.log_std,
            &mut self.adam.first,
            &mut self.adam.second,
        ];
        for (target, values) in targets.into_iter().zip(found) {
            target.copy_from_slice(values);
        }
        self.seed = scalars.seed;
        self.adam.steps = scalars.steps;
        self.learning_rate = rate;
        self.normaliser = scalars.normaliser.clone();
        self.critic_normaliser = scalars.critic_normaliser.clone();
        Ok(())
    }
}
