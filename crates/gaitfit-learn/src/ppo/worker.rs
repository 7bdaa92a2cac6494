//! One tile of rows through both networks, the losses and back: what a thread does.

use super::{
    Samples,
    loss::{self, Constants, Sums, Targets},
};
use crate::network::{Scalar, Shape, Tape, normalise_row};

/// Rows that pass forward and back together, so that the activations stay in the second-level cache.
pub(super) const TILE: usize = 512;

/// Where a sample lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    /// Which tile of environments.
    pub(super) tile: u32,
    /// Which row of it.
    pub(super) row: u32,
}

/// Factor and offset of every element of an observation, [`crate::network::Normaliser::scale`].
pub(super) type Scale = Option<Vec<(f32, f32)>>;

/// The parameters that a minibatch is evaluated at.
pub(super) struct Point<'a, T> {
    /// Of the actor.
    pub(super) actor: &'a [T],
    /// Of the critic.
    pub(super) critic: &'a [T],
    /// Settings, standard deviation and number of rows.
    pub(super) constants: Constants<T>,
}

/// A thread's working memory.
pub(super) struct Worker<T> {
    /// `TILE × observation`.
    pub(super) observation: Vec<T>,
    /// `TILE × critic_observation`.
    pub(super) critic_observation: Vec<T>,
    /// What the losses need of the samples.
    pub(super) targets: Targets<T>,
    shapes: [Shape; 2],
    tape: Tape<T>,
}

impl<T: Scalar> Worker<T> {
    /// For networks of these shapes.
    pub(super) fn new(actor: &Shape, critic: &Shape) -> Self {
        Self {
            observation: vec![T::ZERO; TILE * actor.inputs],
            critic_observation: vec![T::ZERO; TILE * critic.inputs],
            targets: Targets::default(),
            tape: Tape::new(&[actor, critic], TILE),
            shapes: [actor.clone(), critic.clone()],
        }
    }

    /// Adds the loss of the first `rows` gathered rows to `sums` and its derivative to `gradient`: actor, critic,
    /// ln σ, one after the other. The entropy bonus is not in it. Gathered observations are used up: rows without a
    /// derivative are overwritten.
    pub(super) fn accumulate(
        &mut self,
        point: &Point<'_, T>,
        rows: usize,
        gradient: &mut [T],
        sums: &mut Sums,
    ) {
        let (of_actor, rest) = gradient.split_at_mut(point.actor.len());
        let (of_critic, of_log_std) = rest.split_at_mut(point.critic.len());

        let Self { observation, critic_observation, targets, shapes: [actor, critic], tape } = self;

        tape.forward(actor, point.actor, rows, observation);
        let (mean, derivative) = tape.output(actor, rows);
        loss::policy(&point.constants, targets, mean, derivative, of_log_std, sums);
        let active = tape.drop_idle(actor, rows, observation);
        tape.backward(actor, point.actor, active, observation, of_actor);

        tape.forward(critic, point.critic, rows, critic_observation);
        let (value, derivative) = tape.output(critic, rows);
        loss::value(&point.constants, targets, value, derivative, sums);
        let active = tape.drop_idle(critic, rows, critic_observation);
        tape.backward(critic, point.critic, active, critic_observation, of_critic);
    }
}

impl Worker<f32> {
    /// Copies the samples at `places`, at most [`TILE`], into this worker, normalised if there are scales.
    pub(super) fn gather(&mut self, tiles: &[Samples], places: &[Place], scales: &[Scale; 2]) {
        let Targets { action, mean, log_probability, advantage, value, returns } = &mut self.targets;
        for numbers in [&mut *action, mean, log_probability, advantage, value, returns] {
            numbers.clear();
        }
        for (to, place) in places.iter().enumerate() {
            let (tile, row) = (&tiles[place.tile as usize], place.row as usize);
            copy(&mut self.observation, to, &tile.observation, row, tile.widths.observation, &scales[0]);
            let width = tile.widths.critic_observation;
            copy(&mut self.critic_observation, to, &tile.critic_observation, row, width, &scales[1]);
            let width = tile.widths.action;
            action.extend_from_slice(&tile.action[row * width..(row + 1) * width]);
            mean.extend_from_slice(&tile.mean[row * width..(row + 1) * width]);
            log_probability.push(tile.log_probability[row]);
            advantage.push(tile.advantage[row]);
            value.push(tile.value[row]);
            returns.push(tile.returns[row]);
        }
    }
}

/// Row `from` of `source` to row `to` of `target`, both of `width`.
fn copy(target: &mut [f32], to: usize, source: &[f32], from: usize, width: usize, scale: &Scale) {
    let target = &mut target[to * width..(to + 1) * width];
    let source = &source[from * width..(from + 1) * width];
    match scale {
        None => target.copy_from_slice(source),
        Some(scale) => normalise_row(scale, source, target),
    }
}
