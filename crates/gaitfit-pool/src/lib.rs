//! Work shared by threads in pieces: the one place where this workspace starts threads for computing.
//!
//! Work may share work of its own. The threads are then divided, rounded up: five jobs on sixteen threads use four threads each.

use std::cell::Cell;
use std::sync::{Mutex, PoisonError};

thread_local! {
    /// Max number of threads that the present thread's work may use, itself among them; no limit outside the work of
    /// this crate.
    static WIDTH: Cell<usize> = const { Cell::new(usize::MAX) };
}

/// Restores a thread's width when dropped.
struct Width(usize);

impl Width {
    fn set(width: usize) -> Self {
        Self(WIDTH.replace(width))
    }
}

impl Drop for Width {
    fn drop(&mut self) {
        WIDTH.set(self.0);
    }
}

/// Threads that can run at once; 1 where the system does not tell.
pub fn threads() -> usize {
    std::thread::available_parallelism().map_or(1, std::num::NonZeroUsize::get)
}

/// Does every job once: one thread a worker, the calling thread among them, each taking the next job when it is free.
/// Jobs are taken in order but finish in any order: `work` must not care. Without workers nothing is done. If the
/// calling thread belongs to other parallel work, fewer workers may be used. Each job may use one thread.
pub fn share<W: Send, J: Send>(
    workers: &mut [W],
    jobs: impl Iterator<Item = J> + Send,
    work: impl Fn(&mut W, J) + Sync,
) {
    let threads = workers.len();
    share_on(threads, workers, jobs, work);
}

/// As [`share`]; with more `threads` than workers, each job may use several of them.
fn share_on<W: Send, J: Send>(
    threads: usize,
    workers: &mut [W],
    jobs: impl Iterator<Item = J> + Send,
    work: impl Fn(&mut W, J) + Sync,
) {
    // Work within work gets the threads of its job, not all of the machine.
    let threads = threads.min(WIDTH.get());
    let used = workers.len().min(threads.max(1));
    let width = threads.div_ceil(used.max(1));
    let queue = Mutex::new(jobs);
    let run = |worker: &mut W| {
        let _restored = Width::set(width);
        loop {
            // The lock is free again before the work begins.
            let job = queue.lock().unwrap_or_else(PoisonError::into_inner).next();
            match job {
                Some(job) => work(worker, job),
                None => break,
            }
        }
    };
    let Some((first, others)) = workers[..used].split_first_mut() else { return };
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
    share_on(threads, &mut workers, 0..pieces, |own, piece| work(own.get_or_insert_with(&scratch), piece));
}

/// Returns the results of `work` for every piece below `pieces`, in their order, on `threads` threads.
pub fn map<R: Send>(pieces: usize, threads: usize, work: impl Fn(usize) -> R + Sync) -> Vec<R> {
    map_each(0..pieces, (threads, threads), work)
}

/// What `work` makes of every one of `jobs`, in their order. `(at_once, threads)`: at most `at_once` jobs at a time, which together
/// use about `threads` threads.
pub fn map_each<J: Send, R: Send>(
    jobs: impl ExactSizeIterator<Item = J> + Send,
    (at_once, threads): (usize, usize),
    work: impl Fn(J) -> R + Sync,
) -> Vec<R> {
    let mut results: Vec<Option<R>> = (0..jobs.len()).map(|_| None).collect();
    let mut workers = vec![(); at_once.clamp(1, jobs.len().max(1))];
    share_on(threads, &mut workers, results.iter_mut().zip(jobs), |(), (slot, job)| *slot = Some(work(job)));
    results.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Barrier;
    use std::sync::atomic::{AtomicUsize, Ordering};

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
                let owned: Vec<String> = squares.iter().map(usize::to_string).collect();
                assert_eq!(map_each(owned.clone().into_iter(), (threads, threads), |text| text), owned);
            }
        }
    }

    #[test]
    fn work_inside_work_divides_the_threads() {
        let (now, max) = (AtomicUsize::new(0), AtomicUsize::new(0));
        // It lets four threads pass together: fewer would wait for ever.
        let four = Barrier::new(4);
        let leaf = |_: usize| {
            max.fetch_max(now.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
            four.wait();
            now.fetch_sub(1, Ordering::SeqCst);
        };
        for outer in [1, 2, 4] {
            map(outer, 4, |_| map(8, 4, leaf).len());
        }
        map_each(0..4, (2, 4), |_| map(8, 4, leaf).len());
        assert_eq!(max.load(Ordering::SeqCst), 4);
        assert_eq!(WIDTH.get(), usize::MAX);
    }
}
