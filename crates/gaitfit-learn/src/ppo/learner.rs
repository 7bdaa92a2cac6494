//! The learner: networks and optimiser.

use super::{Settings, SettingsError, Widths, adam::Adam, minibatch::Gradients};
use gaitfit_policy::network::{Memory, Network, Normaliser, Recurrent, Scratch, ShapeError};

/// Actor, critic, standard deviation, and what is needed to improve them. See [`Learner::update`].
pub struct Learner {
    pub(super) settings: Settings,
    pub(super) widths: Widths,
    pub(super) seed: u64,
    pub(super) actor: Network,
    pub(super) critic: Network,
    pub(super) actor_memory: Option<Recurrent>,
    pub(super) critic_memory: Option<Recurrent>,
    pub(super) log_std: Vec<f32>,
    pub(super) normaliser: Option<Normaliser>,
    pub(super) critic_normaliser: Option<Normaliser>,
    pub(super) adam: Adam,
    pub(super) learning_rate: f64,
    pub(super) gradients: Gradients,
}

/// Reasons why a learner cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LearnerError {
    /// A setting outside its range.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// A network without a possible shape.
    #[error(transparent)]
    Shape(#[from] ShapeError),
    /// A network that can only be run, not trained.
    #[error(
        "the {what} has {why}, which is not trained here: policies with it are evaluated and fitted only"
    )]
    Untrainable {
        /// Which.
        what: &'static str,
        /// Property that prevents it.
        why: String,
    },
    /// Parts that do not fit each other.
    #[error("{what} is {found} wide, the learner needs {expected}")]
    Width {
        /// Part whose width is wrong.
        what: &'static str,
        /// Width that the rows need.
        expected: usize,
        /// Width that was given.
        found: usize,
    },
}

impl Learner {
    /// Fresh networks for rows of `widths`, drawn from `seed` (actor: network 0, critic: network 1, their memories: 2 and 3).
    ///
    /// # Errors
    /// [`LearnerError`] for bad settings, among them networks too large for these rows, or an empty row.
    pub fn new(settings: Settings, widths: Widths, seed: u64) -> Result<Self, LearnerError> {
        let (actor, critic) = settings.shapes(widths)?;
        // The numbers 0 to 3 keep the draws of the four parts apart.
        let actor = Network::random(actor, seed, 0, settings.output_gain)?;
        // The critic's output is no action, so it is not made small.
        let critic = Network::random(critic, seed, 1, 1.0)?;
        let log_std = vec![settings.initial_std.ln() as f32; widths.action];
        let memories = match settings.memories(widths)? {
            None => [None, None],
            Some([actor, critic]) => {
                [Some(Recurrent::random(&actor, seed, 2)), Some(Recurrent::random(&critic, seed, 3))]
            }
        };
        Self::with_memories(settings, widths, seed, [actor, critic], memories, log_std)
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
        log_std: Vec<f32>,
    ) -> Result<Self, LearnerError> {
        Self::with_memories(settings, widths, seed, [actor, critic], [None, None], log_std)
    }

    /// As [`Learner::with_networks`], with recurrent layers before the actor and before the critic,
    /// `memories` in this order, where there are any. A network behind a memory takes its output.
    ///
    /// # Errors
    /// As there.
    pub fn with_memories(
        settings: Settings,
        widths: Widths,
        seed: u64,
        [actor, critic]: [Network; 2],
        memories: [Option<Recurrent>; 2],
        mut log_std: Vec<f32>,
    ) -> Result<Self, LearnerError> {
        // First each part by itself, then how they fit together.
        settings.check()?;
        actor.check()?;
        critic.check()?;
        for (what, network) in [("actor", &actor), ("critic", &critic)] {
            if let Some(why) = network.untrainable() {
                return Err(LearnerError::Untrainable { what, why });
            }
        }
        let [actor_memory, critic_memory] = memories;
        for (what, memory, observed) in [
            ("actor's observation", &actor_memory, widths.observation),
            ("critic's observation", &critic_memory, widths.critic_observation),
        ] {
            // Without a memory the check of the network itself finds an empty input.
            if memory.is_some() && observed == 0 {
                return Err(ShapeError::EmptyLayer(what.to_owned()).into());
            }
        }
        // Without a memory the two ends are the observation's own width, so that one list of checks serves
        // both.
        let ends = |memory: &Option<Recurrent>, observed: usize| {
            memory.as_ref().map_or([observed; 2], |memory| [memory.inputs(), memory.outputs()])
        };
        let [actor_sees, actor_takes] = ends(&actor_memory, widths.observation);
        let [critic_sees, critic_takes] = ends(&critic_memory, widths.critic_observation);
        // From front to back, so that the first width that does not fit is named.
        for (what, expected, found) in [
            ("the input of the actor's memory", widths.observation, actor_sees),
            ("the input of the critic's memory", widths.critic_observation, critic_sees),
            ("the actor's input", actor_takes, actor.shape.inputs),
            ("the actor's output", widths.action, actor.shape.outputs),
            ("the critic's input", critic_takes, critic.shape.inputs),
            ("the critic's output", 1, critic.shape.outputs),
            ("the log standard deviation", widths.action, log_std.len()),
        ] {
            if expected != found {
                return Err(LearnerError::Width { what, expected, found });
            }
        }
        // A fixed σ goes before the given one, which the file of a policy may bring along.
        if let Some(std) = settings.fixed_std {
            log_std.fill(std.ln() as f32);
        }
        let remembering: usize = [&actor_memory, &critic_memory]
            .into_iter()
            .flatten()
            .map(|memory| memory.shape().parameters())
            .sum();
        // One flat gradient holds all: its norm is limited as a whole.
        let size = actor.parameters.len() + critic.parameters.len() + remembering + log_std.len();
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
            actor_memory,
            critic_memory,
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

    /// Observation (normalised, if there is a normaliser), or what the actor's memory makes of it, to mean action.
    pub fn actor(&self) -> &Network {
        &self.actor
    }

    /// Critic's observation (normalised, if there is a normaliser), or what the critic's memory makes of it, to value.
    pub fn critic(&self) -> &Network {
        &self.critic
    }

    /// Recurrent layers between the (normalised) observation and the actor.
    pub fn actor_memory(&self) -> Option<&Recurrent> {
        self.actor_memory.as_ref()
    }

    /// Recurrent layers between the critic's (normalised) observation and the critic.
    pub fn critic_memory(&self) -> Option<&Recurrent> {
        self.critic_memory.as_ref()
    }

    /// Memories of the actor and of the critic for `environments` whose episodes begin; empty without
    /// recurrent layers.
    pub fn blank_memories(&self, environments: usize) -> [Memory; 2] {
        [&self.actor_memory, &self.critic_memory]
            .map(|memory| memory.as_ref().map_or_else(Memory::default, |memory| memory.memory(environments)))
    }

    /// Mean actions, `rows × action`, of raw observations, `rows × observation`, each an episode's first.
    ///
    /// # Panics
    /// If a slice is shorter than its size: an error of the caller.
    pub fn means(&self, rows: usize, observation: &[f32], mean: &mut [f32], scratch: &mut Scratch) {
        let [mut memory, _] = self.blank_memories(rows);
        self.means_with(rows, observation, &mut memory, mean, scratch);
    }

    /// As [`Learner::means`], for `rows` environments side by side, with what the actor remembers of them
    /// ([`Learner::blank_memories`]), which takes in the observations.
    ///
    /// # Panics
    /// If a slice is shorter than its size, or the memory is of other layers: an error of the caller.
    pub fn means_with(
        &self,
        rows: usize,
        observation: &[f32],
        memory: &mut Memory,
        mean: &mut [f32],
        scratch: &mut Scratch,
    ) {
        let recurrent = self.actor_memory.as_ref().map(|recurrent| (recurrent, memory));
        through(recurrent, &self.actor, self.normaliser.as_ref(), (rows, observation), mean, scratch);
    }

    /// Values, `rows`, of the critic's raw observations, `rows × critic_observation`, each an episode's first.
    ///
    /// # Panics
    /// If a slice is shorter than its size: an error of the caller.
    pub fn values(&self, rows: usize, critic_observation: &[f32], value: &mut [f32], scratch: &mut Scratch) {
        let [_, mut memory] = self.blank_memories(rows);
        self.values_with(rows, critic_observation, &mut memory, value, scratch);
    }

    /// As [`Learner::values`], with the critic's memory, as [`Learner::means_with`].
    ///
    /// # Panics
    /// As there.
    pub fn values_with(
        &self,
        rows: usize,
        critic_observation: &[f32],
        memory: &mut Memory,
        value: &mut [f32],
        scratch: &mut Scratch,
    ) {
        let recurrent = self.critic_memory.as_ref().map(|recurrent| (recurrent, memory));
        let normaliser = self.critic_normaliser.as_ref();
        through(recurrent, &self.critic, normaliser, (rows, critic_observation), value, scratch);
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

    /// Replaces the statistics of observations, for fine-tuning a policy that has some. They continue to change only if the
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
}

/// Rows through a normaliser, a memory and a network, of which the first two may be absent.
fn through(
    recurrent: Option<(&Recurrent, &mut Memory)>,
    network: &Network,
    normaliser: Option<&Normaliser>,
    (rows, observation): (usize, &[f32]),
    output: &mut [f32],
    scratch: &mut Scratch,
) {
    // Without a memory normalising and the first layer are one pass.
    let Some((recurrent, memory)) = recurrent else {
        return network.forward_normalised(normaliser, rows, observation, output, scratch);
    };
    // The caller's array may have room for more rows.
    let observation = &observation[..rows * recurrent.inputs()];
    let mut seen = Vec::new();
    match normaliser {
        None => recurrent.step(rows, observation, memory, &mut seen),
        Some(normaliser) => {
            let mut normal = vec![0.0; observation.len()];
            normaliser.apply(observation, &mut normal);
            recurrent.step(rows, &normal, memory, &mut seen);
        }
    }
    network.forward(rows, &seen, output, scratch);
}
