//! A learner's state as named tensors and a few scalars, exact to the bit.

use serde::{Deserialize, Serialize};

use super::Learner;
use gaitfit_policy::network::Normaliser;

/// The part of a learner's state that is no tensor. Written as JSON with shortest round-trip numbers it is
/// exact.
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
    Missing(String),
    /// A tensor of another size.
    #[error(
        "tensor `{name}` has {found} numbers, this learner has {expected}: the state is of another network"
    )]
    Size {
        /// Name of the tensor.
        name: String,
        /// Numbers in this learner.
        expected: usize,
        /// Numbers in the state.
        found: usize,
    },
    /// A number that cannot be.
    #[error("`{name}` is {value} in the learner's state: the file is damaged")]
    Number {
        /// Name of the tensor or scalar.
        name: String,
        /// Its value.
        value: f64,
    },
    /// Statistics whose rows have another width, or statistics although the settings ask for none.
    #[error("the statistics `{0}` in the learner's state do not fit this learner's settings and rows")]
    Normaliser(&'static str),
}

impl Learner {
    /// Everything that the next update depends on, but for [`Learner::memory_tensors`], [`Learner::scalars`] and the
    /// settings.
    pub fn tensors(&self) -> [(&'static str, &[f32]); 5] {
        [
            ("actor", &self.actor.parameters),
            ("critic", &self.critic.parameters),
            ("log_std", &self.log_std),
            ("adam.first", &self.adam.first),
            ("adam.second", &self.adam.second),
        ]
    }

    /// The parameters of the recurrent layers before the actor and before the critic, part by part; none without them.
    pub fn memory_tensors(&self) -> Vec<(String, &[f32])> {
        let memories = [("actor_memory", &self.actor_memory), ("critic_memory", &self.critic_memory)];
        let parts = memories.into_iter().flat_map(|(name, memory)| {
            memory.iter().flat_map(move |memory| {
                let parts = memory.shape().parts().into_iter().zip(memory.parameters());
                parts.map(move |((part, _), values)| (format!("{name}.{part}"), values))
            })
        });
        parts.collect()
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
    /// bit. `tensor` looks a tensor up by its name in [`Learner::tensors`] and [`Learner::memory_tensors`].
    ///
    /// # Errors
    /// [`StateError`] naming what does not fit; the learner is then unchanged.
    pub fn restore<'a>(
        &mut self,
        tensor: impl Fn(&str) -> Option<&'a [f32]>,
        scalars: &Scalars,
    ) -> Result<(), StateError> {
        let mut sources = Vec::new();
        let tensors = self.tensors().into_iter().map(|(name, values)| (name.to_owned(), values));
        // `sources` follows the order of the names, and `targets` below has the same order.
        for (name, mine) in tensors.chain(self.memory_tensors()) {
            let Some(values) = tensor(&name) else { return Err(StateError::Missing(name)) };
            if values.len() != mine.len() {
                return Err(StateError::Size { name, expected: mine.len(), found: values.len() });
            }
            // Adam takes roots of its second moments.
            let min = if name == "adam.second" { 0.0 } else { f32::MIN };
            if let Some(&value) = values.iter().find(|&&x| !(x.is_finite() && x >= min)) {
                return Err(StateError::Number { name, value: f64::from(value) });
            }
            sources.push(values);
        }
        let rate = scalars.learning_rate;
        if !(rate > 0.0 && rate.is_finite()) {
            return Err(StateError::Number { name: "learning_rate".to_owned(), value: rate });
        }
        // Both sides have statistics or neither has: the settings decide it.
        for (name, mine, theirs) in [
            ("normaliser", &self.normaliser, &scalars.normaliser),
            ("critic_normaliser", &self.critic_normaliser, &scalars.critic_normaliser),
        ] {
            let widths = |n: &Option<Normaliser>| n.as_ref().map(|n| (n.mean.len(), n.variance.len()));
            // All checks come before the first change, so that a refused state leaves the learner whole.
            if widths(mine) != widths(theirs) {
                return Err(StateError::Normaliser(name));
            }
            let Some(theirs) = theirs else { continue };
            // Observations are divided by roots of variances.
            let count = std::slice::from_ref(&theirs.count);
            for (part, values, min) in [
                ("mean", &theirs.mean[..], f64::MIN),
                ("variance", &theirs.variance[..], 0.0),
                ("count", count, 0.0),
            ] {
                if let Some(&value) = values.iter().find(|&&x| !(x.is_finite() && x >= min)) {
                    return Err(StateError::Number { name: format!("{name}.{part}"), value });
                }
            }
        }
        // From here on nothing can fail.
        let mut targets: Vec<&mut [f32]> = vec![
            &mut self.actor.parameters,
            &mut self.critic.parameters,
            &mut self.log_std,
            &mut self.adam.first,
            &mut self.adam.second,
        ];
        for memory in [&mut self.actor_memory, &mut self.critic_memory].into_iter().flatten() {
            targets.extend(memory.parameters_mut().map(|(_, values)| values));
        }
        for (target, values) in targets.into_iter().zip(sources) {
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
