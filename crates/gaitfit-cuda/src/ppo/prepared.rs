//! Text and plan of an update, made without a GPU.

use gaitfit_learn::ppo::{self, Precision, SamplesError, UpdateError};

use super::error::PpoError;
use super::launch::Batch;
use super::plan::{Plan, Task, check_shared, turns};
use super::text::{MAX_ACTIONS, Room, Text};
use crate::runtime::{Device, Program};
use gaitfit_policy::network::{Cell, Recurrent, RecurrentShape};

/// Properties of a GPU that plans must know.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Multiprocessors.
    pub processors: usize,
    /// Bytes of shared memory that a block may ask for.
    pub shared_memory: usize,
}

impl Limits {
    /// The limits of this GPU.
    pub fn from_device(device: &Device) -> Self {
        let number = |number: i32| usize::try_from(number).unwrap_or(0);
        let info = device.info();
        Self { processors: number(info.processors), shared_memory: number(info.shared_memory) }
    }
}

/// The update's text and plan, made without a GPU.
#[derive(Clone, Debug, PartialEq)]
pub struct Prepared {
    /// The kernels.
    pub program: Program,
    /// Arrays and launches.
    pub plan: Plan,
    /// What the arrays `map`, `forth` and `back` hold: where each parameter's derivative and its two copies lie.
    pub maps: [Vec<u32>; 3],
    /// What the array `memory_turn` holds: where each parameter of the memories lies in their transposed copy.
    pub turn: Vec<u32>,
    /// Parameters of the actor and of the critic.
    pub sizes: [usize; 2],
}

/// Shapes of the actor's and the critic's memory, of a learner that has one. Without a memory before it, a network has a shape
/// without layers.
pub(super) fn memories(learner: &ppo::Learner) -> Option<[RecurrentShape; 2]> {
    let widths = learner.widths();
    let memories = [learner.actor_memory(), learner.critic_memory()];
    let inputs = [widths.observation, widths.critic_observation];
    let shape = |number: usize| {
        let none = || RecurrentShape { cell: Cell::Gru, inputs: inputs[number], hidden: Vec::new() };
        memories[number].map_or_else(none, Recurrent::shape)
    };
    memories.iter().any(Option::is_some).then(|| [0, 1].map(shape))
}

impl Prepared {
    /// For a copy of the CPU's `learner` and rollouts of `batch`.
    ///
    /// # Errors
    /// [`PpoError`] for sizes that the kernels do not take.
    pub fn new(
        learner: &ppo::Learner,
        batch: Batch,
        precision: Precision,
        limits: Limits,
    ) -> Result<Self, PpoError> {
        let (settings, widths) = (learner.settings(), learner.widths());
        check_sizes(settings, widths, batch)?;
        let minibatches = settings.minibatches;
        let networks = [learner.actor(), learner.critic()];
        let memories = memories(learner);
        if let Some(memories) = &memories {
            let robots = batch.environments;
            if robots < minibatches {
                return Err(UpdateError::from(SamplesError::TooFewRobots { robots, minibatches }).into());
            }
            check_shared(memories, limits.shared_memory)?;
        }
        let room = Room {
            shared: limits.shared_memory,
            processors: limits.processors,
            minibatch: batch.rows() / minibatches,
        };
        let text = Text::new(settings, widths, networks, memories.is_some(), precision, room)?;
        let normalised = [learner.normaliser().is_some(), learner.critic_normaliser().is_some()];
        let turn = memories.as_ref().map(turns).unwrap_or_default();
        let processors = limits.processors;
        let plan = Plan::new(&Task { settings, widths, batch, processors, normalised, memories }, &text);
        let (a, c) = (&text.actor, &text.critic);
        let maps = [[&a.map, &c.map], [&a.forth, &c.forth], [&a.back, &c.back]]
            .map(|maps| maps.map(|map| &map[..]).concat());
        let sizes = [text.actor.map.len(), text.critic.map.len()];
        Ok(Self { program: text.program, plan, maps, turn, sizes })
    }
}

/// Max number of minibatches: each block counts its samples of every one in shared memory.
const MAX_MINIBATCHES: usize = 8192;
/// Max number of numbers of an array: kernels count in 32 bits.
const MAX_NUMBERS: usize = u32::MAX as usize / 2;

fn check_sizes(settings: &ppo::Settings, widths: ppo::Widths, batch: Batch) -> Result<(), PpoError> {
    let rows = batch.rows();
    let minibatches = settings.minibatches;
    if rows < minibatches || batch.tile == 0 {
        return Err(UpdateError::from(SamplesError::TooFew { samples: rows, minibatches }).into());
    }
    let widest = widths.observation.max(widths.critic_observation).max(widths.action);
    for (what, found, max) in [
        ("actions", widths.action, MAX_ACTIONS),
        ("minibatches", minibatches, MAX_MINIBATCHES),
        ("numbers of an array", rows.saturating_mul(widest), MAX_NUMBERS),
        ("samples of all epochs", rows.saturating_mul(settings.epochs), MAX_NUMBERS),
    ] {
        if found > max {
            return Err(PpoError::TooMany { what, found, max });
        }
    }
    Ok(())
}
