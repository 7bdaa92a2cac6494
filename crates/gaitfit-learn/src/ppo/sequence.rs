//! Some environments over all steps of a rollout through the networks, their loss and back: what a thread does of an
//! update of networks with a memory.

use std::iter;

use aligned_vec::{AVec, avec};

use super::{
    Samples,
    loss::{self, Sums, Targets},
    worker::{Place, Point, Scale, copy},
};
use gaitfit_policy::network::{
    Memory, RecurrentWeights, Scalar, SequenceTape, Sequences, Shape, Tape, Weights,
};

/// Rows that pass forward and back together, a row a step of an environment. One environment passes as a
/// whole, even if it has more.
const ROWS: usize = 1024;

/// Steps and environments of a group.
pub(super) type Sizes = [usize; 2];

/// Cuts environments into groups that pass together, all of as many steps.
pub(super) fn groups<'a>(tiles: &'a [Samples], places: &'a [Place]) -> impl Iterator<Item = &'a [Place]> {
    let mut left = places;
    iter::from_fn(move || {
        let steps = |place: &Place| tiles[place.tile as usize].steps;
        let first = steps(left.first()?);
        let same = left.iter().take_while(|place| steps(place) == first).count();
        // As many environments as `ROWS` has room for, but one at least.
        let (group, rest) = left.split_at(same.min((ROWS / first.max(1)).max(1)));
        left = rest;
        Some(group)
    })
}

/// A thread's working memory.
pub(super) struct SequenceWorker<T> {
    /// Input of a network or of its memory, `steps × environments × width`.
    pub(super) input: AVec<T>,
    /// Whether an episode begins at each step, `steps × environments`.
    pub(super) begins: Vec<bool>,
    /// Memory before the first step, `environments × remembered`.
    pub(super) start: Vec<T>,
    /// Numbers of the samples that the losses need.
    pub(super) targets: Targets<T>,
    sequences: SequenceTape<T>,
    tape: Tape<T>,
    rows: usize,
}

impl<T: Scalar> SequenceWorker<T> {
    /// A worker for networks of these shapes and rollouts of up to `steps` steps.
    pub(super) fn new(actor: &Shape, critic: &Shape, steps: usize) -> Self {
        // A single environment passes as a whole, so the tape must hold all its steps.
        let rows = steps.max(ROWS);
        Self {
            input: avec![],
            begins: Vec::new(),
            start: Vec::new(),
            targets: Targets::default(),
            sequences: SequenceTape::default(),
            tape: Tape::new(&[actor, critic], rows),
            rows,
        }
    }

    /// Steps that a rollout may have.
    pub(super) fn rows(&self) -> usize {
        self.rows
    }

    /// Adds the policy's loss on the gathered rows to `sums` and its derivatives to `gradient`, by the actor's parameters
    /// and then by its memory's, and `of_log_std`. The entropy bonus is not in it.
    pub(super) fn policy(
        &mut self,
        point: &Point<'_, T>,
        sizes: Sizes,
        gradient: &mut [T],
        of_log_std: &mut [T],
        sums: &mut Sums,
    ) {
        self.pass(&point.actor, point.memories[0].as_ref(), sizes, gradient, |targets, mean, derivative| {
            loss::policy(&point.constants, targets, mean, derivative, of_log_std, sums);
        });
    }

    /// As [`Self::policy`], for the values' loss, by the critic's parameters and its memory's.
    pub(super) fn value(&mut self, point: &Point<'_, T>, sizes: Sizes, gradient: &mut [T], sums: &mut Sums) {
        self.pass(
            &point.critic,
            point.memories[1].as_ref(),
            sizes,
            gradient,
            |targets, value, derivative| {
                loss::value(&point.constants, targets, value, derivative, sums);
            },
        );
    }

    /// Forward, the loss on the output, and back.
    fn pass(
        &mut self,
        network: &Weights<'_, T>,
        memory: Option<&RecurrentWeights<T>>,
        [steps, robots]: Sizes,
        gradient: &mut [T],
        loss: impl FnOnce(&Targets<T>, &[T], &mut [T]),
    ) {
        let Self { input, begins, start, targets, sequences, tape, .. } = self;
        let rows = steps * robots;
        let Some(memory) = memory else {
            tape.forward(network, rows, input);
            let (output, derivative) = tape.output(network.shape, rows);
            loss(targets, output, derivative);
            return tape.backward(network, rows, input, gradient);
        };
        // The order of the flat gradient: the network's parameters, then its memory's.
        let (of_network, of_memory) = gradient.split_at_mut(network.shape.parameters());
        let given = Sequences { steps, robots, input, begins, start };
        sequences.forward(memory, &given);
        let (seen, of_seen) = sequences.output();
        tape.forward(network, rows, seen);
        let (output, derivative) = tape.output(network.shape, rows);
        loss(targets, output, derivative);
        // Back in the reverse order: the network's gradient by its input is what the memory's pass starts
        // from.
        tape.backward(network, rows, seen, of_network);
        tape.to_input(network, rows, of_seen);
        sequences.backward(memory, &given, of_memory);
    }
}

impl SequenceWorker<f32> {
    /// Copies what [`Self::policy`] needs of a group of environments into this worker; observations normalised if there
    /// are scales.
    pub(super) fn gather_for_policy(&mut self, tiles: &[Samples], places: &[Place], scale: &Scale) -> Sizes {
        let width = |tile: &Samples| tile.widths.observation;
        let sizes =
            self.gather(tiles, places, scale, |tile| (&tile.observation, width(tile), &tile.actor_memory));
        self.targets.gather_for_policy(rows(tiles, places, sizes[0]));
        sizes
    }

    /// As [`Self::gather_for_policy`], for [`Self::value`].
    pub(super) fn gather_for_value(&mut self, tiles: &[Samples], places: &[Place], scale: &Scale) -> Sizes {
        let width = |tile: &Samples| tile.widths.critic_observation;
        let sizes = self.gather(tiles, places, scale, |tile| {
            (&tile.critic_observation, width(tile), &tile.critic_memory)
        });
        self.targets.gather_for_value(rows(tiles, places, sizes[0]));
        sizes
    }

    /// Observations, beginnings of episodes, and what was remembered before them.
    fn gather(
        &mut self,
        tiles: &[Samples],
        places: &[Place],
        scale: &Scale,
        of: impl Fn(&Samples) -> (&Vec<f32>, usize, &Memory),
    ) -> Sizes {
        let Self { input, begins, start, .. } = self;
        start.clear();
        begins.clear();
        // One memory after the other, in the order in which the places stand side by side below.
        for place in places {
            let (_, _, memory) = of(&tiles[place.tile as usize]);
            memory.append_row(place.row as usize, start);
        }
        // All places of a group have as many steps as the first ([`groups`]).
        let Some(first) = places.first().map(|place| &tiles[place.tile as usize]) else { return [0, 0] };
        let steps = first.steps;
        input.resize(steps * places.len() * of(first).1, 0.0);
        // Step by step, with the group's environments side by side: recurrent layers take one step of all of them at
        // once.
        for (to, (tile, row)) in rows(tiles, places, steps).enumerate() {
            let (source, width, _) = of(tile);
            copy(input, to, source, row, width, scale);
            // An episode that begins with the first step needs no mark: its memory before that step is zero.
            // The same environment's step before lies `environments` rows earlier.
            begins.push(row.checked_sub(tile.environments).is_some_and(|before| tile.done[before] != 0.0));
        }
        [steps, places.len()]
    }
}

/// Tile and row of every sample of some environments, step by step.
fn rows<'a>(
    tiles: &'a [Samples],
    places: &'a [Place],
    steps: usize,
) -> impl Iterator<Item = (&'a Samples, usize)> {
    (0..steps).flat_map(move |step| {
        places.iter().map(move |place| {
            let tile = &tiles[place.tile as usize];
            (tile, step * tile.environments + place.row as usize)
        })
    })
}
