//! One tile of rows through a network, its loss and back: what a thread does.

use aligned_vec::{AVec, avec};

use super::{
    Samples,
    loss::{self, Constants, Sums, Targets},
};
use gaitfit_policy::network::{RecurrentWeights, Scalar, Shape, Tape, Weights, normalise_row};

/// Rows that pass forward and back together, so that the activations stay in the second-level cache.
pub(super) const TILE: usize = 512;

/// Where a sample lies; or, of learners with a memory, all samples of one environment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place {
    /// Tile of environments.
    pub(super) tile: u32,
    /// Row of the tile, or environment of it.
    pub(super) row: u32,
}

/// Factor and offset of every element of an observation, [`gaitfit_policy::network::Normaliser::scale`].
pub(super) type Scale = Option<Vec<(f32, f32)>>;

/// The parameters that a minibatch is evaluated at.
pub(super) struct Point<'a, T> {
    /// Parameters of the actor.
    pub(super) actor: Weights<'a, T>,
    /// Parameters of the critic.
    pub(super) critic: Weights<'a, T>,
    /// Parameters of the recurrent layers before the actor and before the critic, if there are any.
    pub(super) memories: [Option<RecurrentWeights<T>>; 2],
    /// Settings, standard deviation and number of rows.
    pub(super) constants: Constants<T>,
}

/// A thread's working memory.
pub(super) struct Worker<T> {
    /// `TILE × observation`.
    pub(super) observation: AVec<T>,
    /// `TILE × critic_observation`.
    pub(super) critic_observation: AVec<T>,
    /// Numbers of the samples that the losses need.
    pub(super) targets: Targets<T>,
    tape: Tape<T>,
}

impl<T: Scalar> Worker<T> {
    /// A worker for networks of these shapes.
    pub(super) fn new(actor: &Shape, critic: &Shape) -> Self {
        Self {
            // As large as a whole tile needs; the last tile of a piece uses a part of it.
            observation: avec![T::ZERO; TILE * actor.inputs],
            critic_observation: avec![T::ZERO; TILE * critic.inputs],
            targets: Targets::default(),
            tape: Tape::new(&[actor, critic], TILE),
        }
    }

    /// Adds the policy's loss on the first `rows` gathered rows to `sums` and its derivatives to `gradient`, by the
    /// actor's parameters, and `of_log_std`. The entropy bonus is not in it. Gathered observations are used up: rows
    /// without a derivative are overwritten.
    pub(super) fn policy(
        &mut self,
        point: &Point<'_, T>,
        rows: usize,
        gradient: &mut [T],
        of_log_std: &mut [T],
        sums: &mut Sums,
    ) {
        let Self { observation, targets, tape, .. } = self;
        tape.forward(&point.actor, rows, observation);
        let (mean, derivative) = tape.output(point.actor.shape, rows);
        loss::policy(&point.constants, targets, mean, derivative, of_log_std, sums);
        // A sample whose ratio is clipped has no derivative, so the way back leaves it out.
        let active = tape.drop_idle(&point.actor, rows, observation);
        tape.backward(&point.actor, active, observation, gradient);
    }

    /// As [`Self::policy`], for the values' loss, by the critic's parameters.
    pub(super) fn value(&mut self, point: &Point<'_, T>, rows: usize, gradient: &mut [T], sums: &mut Sums) {
        let Self { critic_observation, targets, tape, .. } = self;
        tape.forward(&point.critic, rows, critic_observation);
        let (value, derivative) = tape.output(point.critic.shape, rows);
        loss::value(&point.constants, targets, value, derivative, sums);
        let active = tape.drop_idle(&point.critic, rows, critic_observation);
        tape.backward(&point.critic, active, critic_observation, gradient);
    }
}

impl Worker<f32> {
    /// Copies what [`Self::policy`] needs of the samples at `places`, at most [`TILE`], into this worker; observations
    /// normalised if there are scales.
    pub(super) fn gather_for_policy(&mut self, tiles: &[Samples], places: &[Place], scale: &Scale) {
        for (to, (tile, row)) in rows(tiles, places).enumerate() {
            copy(&mut self.observation, to, &tile.observation, row, tile.widths.observation, scale);
        }
        self.targets.gather_for_policy(rows(tiles, places));
    }

    /// As [`Self::gather_for_policy`], for [`Self::value`].
    pub(super) fn gather_for_value(&mut self, tiles: &[Samples], places: &[Place], scale: &Scale) {
        for (to, (tile, row)) in rows(tiles, places).enumerate() {
            let width = tile.widths.critic_observation;
            copy(&mut self.critic_observation, to, &tile.critic_observation, row, width, scale);
        }
        self.targets.gather_for_value(rows(tiles, places));
    }
}

/// Tile and row of the samples at `places`.
fn rows<'a>(tiles: &'a [Samples], places: &'a [Place]) -> impl Iterator<Item = (&'a Samples, usize)> {
    places.iter().map(|place| (&tiles[place.tile as usize], place.row as usize))
}

/// Row `from` of `source` to row `to` of `target`, both of `width`.
pub(super) fn copy(target: &mut [f32], to: usize, source: &[f32], from: usize, width: usize, scale: &Scale) {
    let target = &mut target[to * width..(to + 1) * width];
    let source = &source[from * width..(from + 1) * width];
    match scale {
        None => target.copy_from_slice(source),
        Some(scale) => normalise_row(scale, source, target),
    }
}
