//! Samples of a rollout, from which the learner learns.

use gaitfit_policy::network::{Memory, RecurrentShape};

/// Widths of the rows that a learner sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Widths {
    /// Numbers in the actor's observation.
    pub observation: usize,
    /// Numbers in the critic's observation.
    pub critic_observation: usize,
    /// Numbers in an action.
    pub action: usize,
}

/// One tile of environments over one rollout. Arrays are `steps × environments × width`, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Samples {
    /// Control steps of the rollout.
    pub steps: usize,
    /// Environments of this tile.
    pub environments: usize,
    /// Widths of the rows.
    pub widths: Widths,
    /// Actor's observation before the action, not normalised; `steps × environments × observation`.
    pub observation: Vec<f32>,
    /// Critic's observation before the action, not normalised; `steps × environments × critic_observation`.
    pub critic_observation: Vec<f32>,
    /// Action drawn; `steps × environments × action`.
    pub action: Vec<f32>,
    /// Actor's output, the mean that it was drawn around; `steps × environments × action`.
    pub mean: Vec<f32>,
    /// Log-probability density of the action; `steps × environments`.
    pub log_probability: Vec<f32>,
    /// Critic's output before the action; `steps × environments`.
    pub value: Vec<f32>,
    /// Reward of the step; after a time-out the caller has added γ V(the state cut off). `steps × environments`.
    pub reward: Vec<f32>,
    /// 1 where the episode ended with this step (fall or time-out), else 0; `steps × environments`.
    pub done: Vec<f32>,
    /// Critic's output after the last step; `environments`.
    pub last_value: Vec<f32>,
    /// Advantage, filled by [`Samples::estimate_advantages`]; `steps × environments`.
    pub advantage: Vec<f32>,
    /// Advantage + value, the critic's target; `steps × environments`.
    pub returns: Vec<f32>,
    /// Memory of the actor's recurrent layers before the first step, an environment each; empty without any.
    pub actor_memory: Memory,
    /// Memory of the critic's recurrent layers before the first step.
    pub critic_memory: Memory,
}

/// Samples that cannot be learned from.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SamplesError {
    /// An array of another size.
    #[error(
        "`{array}` of tile {tile} has {found} numbers, {steps} steps × {environments} environments need {expected}"
    )]
    Size {
        /// Which tile.
        tile: usize,
        /// Which array.
        array: &'static str,
        /// Steps of the tile.
        steps: usize,
        /// Environments of the tile.
        environments: usize,
        /// Numbers needed.
        expected: usize,
        /// Numbers there.
        found: usize,
    },
    /// Rows of other widths than the learner's.
    #[error("tile {tile} has rows of {found:?}, the learner was made for {expected:?}")]
    Widths {
        /// Which tile.
        tile: usize,
        /// The learner's.
        expected: Widths,
        /// The tile's.
        found: Widths,
    },
    /// A NaN or an infinity.
    #[error(
        "`{array}` is {value} at step {step}, environment {environment} of tile {tile}, element {element}"
    )]
    NotFinite {
        /// Which tile.
        tile: usize,
        /// Which array.
        array: &'static str,
        /// Step in the rollout.
        step: usize,
        /// Environment in the tile.
        environment: usize,
        /// Element of the row.
        element: usize,
        /// NaN, inf or -inf.
        value: f32,
    },
    /// Fewer samples than minibatches.
    #[error(
        "{samples} samples cannot fill {minibatches} minibatches: use more environments or steps, or fewer minibatches"
    )]
    TooFew {
        /// Samples of all tiles.
        samples: usize,
        /// Minibatches of the settings.
        minibatches: usize,
    },
    /// Fewer robots than minibatches, of policies with a memory.
    #[error(
        "{robots} robots cannot fill {minibatches} minibatches, which take whole robots where a policy has a memory: use \
         more environments, or fewer minibatches"
    )]
    TooFewRobots {
        /// Environments of all tiles.
        robots: usize,
        /// Minibatches of the settings.
        minibatches: usize,
    },
    /// A memory that is not the learner's.
    #[error(
        "`{array}` of tile {tile} holds {found} numbers of each of its environments, the learner's memory has {expected}: \
         record the rollout with `Recorder`"
    )]
    Memory {
        /// Which tile.
        tile: usize,
        /// Which memory.
        array: &'static str,
        /// The learner's width.
        expected: usize,
        /// The samples'.
        found: usize,
    },
}

impl Samples {
    /// Room for a rollout, all zeros.
    pub fn new(steps: usize, environments: usize, widths: Widths) -> Self {
        // `steps` is the slowest index: the rows of one step lie together, as the simulator writes them.
        let rows = steps * environments;
        let zeros = |width: usize| vec![0.0; rows * width];
        Self {
            steps,
            environments,
            widths,
            observation: zeros(widths.observation),
            critic_observation: zeros(widths.critic_observation),
            action: zeros(widths.action),
            mean: zeros(widths.action),
            log_probability: zeros(1),
            value: zeros(1),
            reward: zeros(1),
            done: zeros(1),
            last_value: vec![0.0; environments],
            advantage: zeros(1),
            returns: zeros(1),
            actor_memory: Memory::default(),
            critic_memory: Memory::default(),
        }
    }

    /// Number of samples, `steps × environments`.
    pub fn rows(&self) -> usize {
        self.steps * self.environments
    }

    /// Refuses memories of another learner, which has recurrent layers of these shapes before its actor and its critic.
    pub(super) fn check_memories(
        &self,
        tile: usize,
        shapes: [Option<RecurrentShape>; 2],
    ) -> Result<(), SamplesError> {
        let memories = [("actor_memory", &self.actor_memory), ("critic_memory", &self.critic_memory)];
        for ((array, memory), shape) in memories.into_iter().zip(shapes) {
            // Widths are compared as one number: all layers' states of one robot in a row.
            let (found, expected) = (memory.width(), shape.map_or(0, |shape| shape.remembered()));
            // A memory without recurrent layers has no rows to count.
            let environments = memory.environments().unwrap_or(self.environments);
            if found != expected || environments != self.environments {
                return Err(SamplesError::Memory { tile, array, expected, found });
            }
            if let Some(&value) = memory.numbers().iter().find(|x| !x.is_finite()) {
                // The error names no place, because a memory belongs to the whole rollout.
                let (step, environment, element) = (0, 0, 0);
                return Err(SamplesError::NotFinite { tile, array, step, environment, element, value });
            }
        }
        Ok(())
    }

    /// Refuses arrays of wrong size and numbers that are not finite.
    pub(super) fn check(&self, tile: usize, widths: Widths) -> Result<(), SamplesError> {
        if self.widths != widths {
            return Err(SamplesError::Widths { tile, expected: widths, found: self.widths });
        }
        let (steps, environments) = (self.steps, self.environments);
        let arrays: [(&'static str, &[f32], usize, usize); 11] = [
            ("observation", &self.observation, steps, widths.observation),
            ("critic_observation", &self.critic_observation, steps, widths.critic_observation),
            ("action", &self.action, steps, widths.action),
            ("mean", &self.mean, steps, widths.action),
            ("log_probability", &self.log_probability, steps, 1),
            ("value", &self.value, steps, 1),
            ("reward", &self.reward, steps, 1),
            ("done", &self.done, steps, 1),
            ("last_value", &self.last_value, 1, 1),
            ("advantage", &self.advantage, steps, 1),
            ("returns", &self.returns, steps, 1),
        ];
        for (array, values, steps, width) in arrays {
            let expected = steps * environments * width;
            let found = values.len();
            // The size comes first, because the place of a bad number is computed from it.
            if found != expected {
                return Err(SamplesError::Size { tile, array, steps, environments, expected, found });
            }
            // Bits of positive floats are ordered as the floats are, and infinity and NaN are above all
            // others. The maximum is one loop of vectors; the place is looked for only if something is wrong.
            let greatest = values.iter().fold(0, |greatest: u32, x| greatest.max(x.abs().to_bits()));
            if greatest < f32::INFINITY.to_bits() {
                continue;
            }
            if let Some(place) = values.iter().position(|x| !x.is_finite()) {
                return Err(SamplesError::NotFinite {
                    tile,
                    array,
                    step: place / width / environments,
                    environment: place / width % environments,
                    element: place % width,
                    value: values[place],
                });
            }
        }
        Ok(())
    }
}
