//! The gradient of one minibatch, by several threads, to the same bits whatever their number.
//!
//! A minibatch is cut into a fixed number of pieces. Threads take pieces as they come free; each piece has its own
//! gradient and sums, and these are added up in the order of the pieces.

use std::sync::{Mutex, PoisonError};

use super::{
    Samples,
    loss::Sums,
    worker::{Place, Point, Scale, TILE, Worker},
};
use crate::network::add_slices;

/// Pieces of a minibatch: the greatest number of threads that have work.
const PIECES: usize = 16;
/// Parameters that one thread adds up at a time.
const SPAN: usize = 4096;

/// Gradient and sums of one piece.
struct Piece {
    gradient: Vec<f32>,
    sums: Sums,
}

/// Memory for gradients, kept between minibatches.
pub(super) struct Gradients {
    workers: Vec<Worker<f32>>,
    pieces: Vec<Piece>,
    /// The gradient of the last minibatch: actor, critic, ln σ.
    pub(super) total: Vec<f32>,
}

impl Gradients {
    /// For gradients of `size` numbers; nothing is allocated yet.
    pub(super) fn new(size: usize) -> Self {
        Self { workers: Vec::new(), pieces: Vec::new(), total: vec![0.0; size] }
    }

    /// Readies memory for `threads` workers, made by `worker`.
    pub(super) fn prepare(&mut self, threads: usize, worker: impl Fn() -> Worker<f32>) {
        let size = self.total.len();
        self.workers.resize_with(threads.clamp(1, PIECES), worker);
        self.pieces.resize_with(PIECES, || Piece { gradient: vec![0.0; size], sums: Sums::default() });
    }

    /// Fills `total` with the gradient over the samples at `places` and returns the sums of the losses.
    pub(super) fn of(
        &mut self,
        point: &Point<'_, f32>,
        tiles: &[Samples],
        places: &[Place],
        scales: &[Scale; 2],
    ) -> Sums {
        let count = self.pieces.len();
        let pieces = self.pieces.iter_mut().enumerate().map(|(index, piece)| {
            let part = &places[index * places.len() / count..(index + 1) * places.len() / count];
            (part, piece)
        });
        share(&mut self.workers, pieces, |worker, (places, piece)| {
            piece.gradient.fill(0.0);
            piece.sums = Sums::default();
            for places in places.chunks(TILE) {
                worker.gather(tiles, places, scales);
                worker.accumulate(point, places.len(), &mut piece.gradient, &mut piece.sums);
            }
        });

        let pieces = &self.pieces;
        share(&mut self.workers, self.total.chunks_mut(SPAN).enumerate(), |_, (index, total)| {
            let range = index * SPAN..index * SPAN + total.len();
            total.copy_from_slice(&pieces[0].gradient[range.clone()]);
            for piece in &pieces[1..] {
                add_slices(total, &piece.gradient[range.clone()]);
            }
        });
        let mut sums = Sums::default();
        for piece in pieces {
            sums.add(&piece.sums);
        }
        sums
    }
}

/// Does every job once: one thread a worker, the calling thread among them, each taking the next job when it is free.
fn share<W: Send, J: Send>(
    workers: &mut [W],
    jobs: impl Iterator<Item = J> + Send,
    work: impl Fn(&mut W, J) + Sync,
) {
    let queue = Mutex::new(jobs);
    let run = |worker: &mut W| {
        loop {
            let job = queue.lock().unwrap_or_else(PoisonError::into_inner).next();
            match job {
                Some(job) => work(worker, job),
                None => break,
            }
        }
    };
    let Some((first, others)) = workers.split_first_mut() else { return };
    std::thread::scope(|scope| {
        for worker in others {
            scope.spawn(|| run(worker));
        }
        run(first);
    });
}
