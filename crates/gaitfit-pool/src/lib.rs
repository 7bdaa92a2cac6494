//! Work shared by threads in pieces: the one place where this workspace starts threads for computing.

use std::sync::{Mutex, PoisonError};

/// Does every job once: one thread a worker, the calling thread among them, each taking the next job when it is free.
/// Jobs are taken in order but finish in any order: `work` must not care. Without workers nothing is done.
pub fn share<W: Send, J: Send>(
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

/// Runs `work(scratch, piece)` for every piece below `pieces` on `threads` threads, each with its own scratch, made by
/// the thread itself.
pub fn for_each<S: Send>(
    pieces: usize,
    threads: usize,
    scratch: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, usize) + Sync,
) {
    let mut workers: Vec<Option<S>> = (0..threads.clamp(1, pieces.max(1))).map(|_| None).collect();
    share(&mut workers, 0..pieces, |own, piece| work(own.get_or_insert_with(&scratch), piece));
}

/// What `work` makes of every piece below `pieces`, in their order, on `threads` threads.
pub fn map<R: Send>(pieces: usize, threads: usize, work: impl Fn(usize) -> R + Sync) -> Vec<R> {
    let mut results: Vec<Option<R>> = (0..pieces).map(|_| None).collect();
    let mut workers = vec![(); threads.clamp(1, pieces.max(1))];
    share(&mut workers, results.iter_mut().enumerate(), |(), (piece, slot)| *slot = Some(work(piece)));
    results.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_piece_is_done_once_and_in_its_place() {
        for threads in [0, 1, 3, 40] {
            for pieces in [0, 1, 17] {
                let counts: Vec<Mutex<usize>> = (0..pieces).map(|_| Mutex::new(0)).collect();
                for_each(
                    pieces,
                    threads,
                    || (),
                    |(), piece| *counts[piece].lock().unwrap_or_else(PoisonError::into_inner) += 1,
                );
                assert!(
                    counts.iter().all(|count| *count.lock().unwrap_or_else(PoisonError::into_inner) == 1)
                );
                let squares: Vec<usize> = (0..pieces).map(|piece| piece * piece).collect();
                assert_eq!(map(pieces, threads, |piece| piece * piece), squares);
            }
        }
    }
}
