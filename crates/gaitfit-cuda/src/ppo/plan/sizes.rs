//! The numbers that an update's arrays and launches are made of.

use super::super::launch::Batch;
use super::super::text::{MAX_ACTIONS, Text};
use super::{CHUNK, Task, share};
use gaitfit_learn::ppo::Widths;

/// Sizes of an update.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sizes {
    /// Samples.
    pub rows: usize,
    /// Widths of observations and actions.
    pub widths: Widths,
    /// Numbers of an action.
    pub actions: usize,
    /// Steps and environments.
    pub batch: Batch,
    /// Number of units that minibatches are made of (samples; with a memory, robots), and the rows of each.
    pub units: usize,
    pub unit_rows: usize,
    /// Passes over the samples, and steps of the gradient in each.
    pub epochs: usize,
    pub minibatches: usize,
    /// Weights of both networks, and all parameters: those and the actions' spread.
    pub networks: usize,
    pub parameters: usize,
    /// Blocks of the actor and of the critic.
    pub blocks: [usize; 2],
    /// Whether hidden layers keep derivatives for the way back.
    pub keeps: bool,
    /// Blocks of `reduce`.
    pub reduce_blocks: usize,
    /// Parts of the samples, of [`CHUNK`] rows.
    pub chunks: usize,
    /// Samples of all epochs.
    pub cards: usize,
}

impl Sizes {
    pub(super) fn new(task: &Task<'_>, text: &Text) -> Self {
        let &Task { settings, widths, batch, .. } = task;
        let (rows, actions) = (batch.rows(), widths.action.min(MAX_ACTIONS));
        let networks = text.actor.map.len() + text.critic.map.len();
        let mut sizes = Self {
            rows,
            widths,
            actions,
            batch,
            // A memory needs whole sequences: its minibatches are made of robots, each with all of its steps.
            units: if task.memories.is_some() { batch.environments } else { rows },
            unit_rows: if task.memories.is_some() { batch.steps } else { 1 },
            epochs: settings.epochs,
            minibatches: settings.minibatches,
            networks,
            parameters: networks + actions,
            blocks: [0; 2],
            keeps: text.actor.kept + text.critic.kept > 0,
            reduce_blocks: networks.div_ceil(256),
            chunks: rows.div_ceil(CHUNK),
            cards: settings.epochs * rows,
        };
        // The smallest minibatch gives every block a tile.
        let smallest = (0..sizes.minibatches).map(|number| sizes.minibatch_rows(number)).min().unwrap_or(0);
        let work = [text.actor.work, text.critic.work];
        sizes.blocks = share(task.processors, smallest.div_ceil(text.rows), work);
        sizes
    }

    /// The first unit of a minibatch.
    pub(super) fn first(&self, minibatch: usize) -> usize {
        // Minibatches differ by at most one unit, and none is left out.
        minibatch * self.units / self.minibatches
    }

    /// The first row of a minibatch.
    pub(super) fn begin(&self, minibatch: usize) -> usize {
        self.first(minibatch) * self.unit_rows
    }

    /// Rows of a minibatch on all GPUs.
    pub(super) fn whole_rows(&self, minibatch: usize) -> usize {
        self.minibatch_rows(minibatch) * self.batch.share.count
    }

    /// Rows of a minibatch, of this GPU.
    pub(super) fn minibatch_rows(&self, minibatch: usize) -> usize {
        self.begin(minibatch + 1) - self.begin(minibatch)
    }

    /// Numbers of both observations' offsets and factors.
    pub(super) fn scales(&self) -> [usize; 2] {
        [2 * self.widths.observation, 2 * self.widths.critic_observation]
    }
}
