//! The gradient of one minibatch, by several threads, to the same bits whatever their number.
//!
//! A minibatch is cut into a fixed number of pieces, each with its own gradient and sums. Threads take them as they come
//! free, the actor's and the critic's part one by one; gradients and sums are added up in the order of the pieces.

use aligned_vec::{AVec, avec};
use gaitfit_sim::pool::share;

use super::{
    Samples,
    loss::Sums,
    sequence::{self, SequenceWorker},
    worker::{Place, Point, Scale, TILE, Worker},
};
use gaitfit_policy::network::{RecurrentWeights, Shape, add_slices};

/// Pieces of a minibatch; twice as many threads have work, because a piece has the actor's part and the
/// critic's.
/// The number is the same on all machines: it sets the order of the sums, and with it their last bits.
const PIECES: usize = 16;
/// Min environments of a piece, of learners with a memory, if there are enough: as many as the widest vectors
/// have lanes.
const MIN_ROBOTS: usize = 16;
/// Parameters that one thread adds up at a time.
const SPAN: usize = 4096;

/// Gradient and sums of one piece.
struct Piece {
    gradient: AVec<f32>,
    sums: Sums,
    value_sums: Sums,
}

/// One network's part of a piece.
enum Part<'a> {
    Policy { gradient: &'a mut [f32], of_log_std: &'a mut [f32], sums: &'a mut Sums },
    Value { gradient: &'a mut [f32], sums: &'a mut Sums },
}

/// Memory for gradients, kept between minibatches.
pub(super) struct Gradients {
    workers: Vec<Worker<f32>>,
    /// Workers of learners with a memory, which take the workers' place.
    sequence_workers: Vec<SequenceWorker<f32>>,
    pieces: Vec<Piece>,
    /// The gradient of the last minibatch: actor, critic, ln σ.
    pub(super) total: Vec<f32>,
}

impl Gradients {
    /// Room for gradients of `size` numbers; nothing is allocated yet.
    pub(super) fn new(size: usize) -> Self {
        Self { workers: Vec::new(), sequence_workers: Vec::new(), pieces: Vec::new(), total: vec![0.0; size] }
    }

    /// Readies memory for `threads` workers, made by `worker`.
    pub(super) fn prepare(&mut self, threads: usize, worker: impl Fn() -> Worker<f32>) {
        // A piece has two parts, so further threads would have no work.
        self.workers.resize_with(threads.clamp(1, 2 * PIECES), worker);
        self.prepare_pieces();
    }

    /// As [`Self::prepare`], for learners with a memory and rollouts of up to `steps` steps.
    pub(super) fn prepare_sequences(
        &mut self,
        threads: usize,
        steps: usize,
        worker: impl Fn() -> SequenceWorker<f32>,
    ) {
        // A worker's tape has a fixed number of rows: longer rollouts need new ones.
        if self.sequence_workers.first().is_some_and(|worker| worker.rows() < steps) {
            self.sequence_workers.clear();
        }
        self.sequence_workers.resize_with(threads.clamp(1, 2 * PIECES), worker);
        self.prepare_pieces();
    }

    fn prepare_pieces(&mut self) {
        let size = self.total.len();
        self.pieces.resize_with(PIECES, || Piece {
            gradient: avec![0.0; size],
            sums: Sums::default(),
            value_sums: Sums::default(),
        });
    }

    /// Fills `total` with the gradient over the samples at `places` and returns the sums of the losses.
    pub(super) fn compute(
        &mut self,
        point: &Point<'_, f32>,
        tiles: &[Samples],
        places: &[Place],
        scales: &[Scale; 2],
    ) -> Sums {
        let parts = parts(
            &mut self.pieces,
            places,
            [&point.actor, &point.critic].map(|network| network.shape.parameters()),
        );
        let [scale, critic_scale] = scales;
        // Actor and critic of a piece are jobs of their own: a free thread takes whichever comes next.
        share(&mut self.workers, parts, |worker, (places, part)| match part {
            Part::Policy { gradient, of_log_std, sums } => {
                gradient.fill(0.0);
                of_log_std.fill(0.0);
                *sums = Sums::default();
                // A worker has room for a tile's rows.
                for places in places.chunks(TILE) {
                    worker.gather_for_policy(tiles, places, scale);
                    worker.policy(point, places.len(), gradient, of_log_std, sums);
                }
            }
            Part::Value { gradient, sums } => {
                gradient.fill(0.0);
                *sums = Sums::default();
                for places in places.chunks(TILE) {
                    worker.gather_for_value(tiles, places, critic_scale);
                    worker.value(point, places.len(), gradient, sums);
                }
            }
        });

        add_up(&mut self.workers, &self.pieces, &mut self.total)
    }

    /// As [`Self::compute`], for learners with a memory: `places` are environments, of which all steps count.
    pub(super) fn compute_sequences(
        &mut self,
        point: &Point<'_, f32>,
        tiles: &[Samples],
        places: &[Place],
        scales: &[Scale; 2],
    ) -> Sums {
        // As many environments side by side as fill vectors, whatever the number of threads.
        // It follows from the minibatch alone, so the sums' order does too.
        let count = (places.len() / MIN_ROBOTS).clamp(1, self.pieces.len());
        let size = |shape: &Shape, memory: &Option<RecurrentWeights<f32>>| {
            shape.parameters() + memory.as_ref().map_or(0, |memory| memory.shape.parameters())
        };
        let sizes =
            [size(point.actor.shape, &point.memories[0]), size(point.critic.shape, &point.memories[1])];
        let parts = parts(&mut self.pieces[..count], places, sizes);
        let [scale, critic_scale] = scales;
        share(&mut self.sequence_workers, parts, |worker, (places, part)| match part {
            Part::Policy { gradient, of_log_std, sums } => {
                gradient.fill(0.0);
                of_log_std.fill(0.0);
                *sums = Sums::default();
                for places in sequence::groups(tiles, places) {
                    let sizes = worker.gather_for_policy(tiles, places, scale);
                    worker.policy(point, sizes, gradient, of_log_std, sums);
                }
            }
            Part::Value { gradient, sums } => {
                gradient.fill(0.0);
                *sums = Sums::default();
                for places in sequence::groups(tiles, places) {
                    let sizes = worker.gather_for_value(tiles, places, critic_scale);
                    worker.value(point, sizes, gradient, sums);
                }
            }
        });
        add_up(&mut self.sequence_workers, &self.pieces[..count], &mut self.total)
    }
}

/// The work on `places`, two parts a piece. `sizes`: parameters of the actor and of the critic, memories included.
fn parts<'a>(
    pieces: &'a mut [Piece],
    places: &'a [Place],
    [actor_size, critic_size]: [usize; 2],
) -> impl Iterator<Item = (&'a [Place], Part<'a>)> {
    let count = pieces.len();
    pieces.iter_mut().enumerate().flat_map(move |(index, piece)| {
        // Cuts at equal shares: pieces differ by one place at most, and together they are all places.
        let places = &places[index * places.len() / count..(index + 1) * places.len() / count];
        let Piece { gradient, sums, value_sums } = piece;
        let (of_actor, rest) = gradient.split_at_mut(actor_size);
        let (of_critic, of_log_std) = rest.split_at_mut(critic_size);
        [
            (places, Part::Policy { gradient: of_actor, of_log_std, sums }),
            (places, Part::Value { gradient: of_critic, sums: value_sums }),
        ]
    })
}

/// Adds up the pieces' gradients in `total`, and their sums.
fn add_up<W: Send>(workers: &mut [W], pieces: &[Piece], total: &mut [f32]) -> Sums {
    share(workers, total.chunks_mut(SPAN).enumerate(), |_, (index, total)| {
        let range = index * SPAN..index * SPAN + total.len();
        // The first piece overwrites what the last minibatch left, so nothing is cleared.
        total.copy_from_slice(&pieces[0].gradient[range.clone()]);
        for piece in &pieces[1..] {
            add_slices(total, &piece.gradient[range.clone()]);
        }
    });
    let mut sums = Sums::default();
    for piece in pieces {
        sums.add(&piece.sums);
        sums.add(&piece.value_sums);
    }
    sums
}
