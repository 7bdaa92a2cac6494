//! Work shared by threads in pieces.

use std::sync::atomic::{AtomicUsize, Ordering};

/// Runs `work(scratch, piece)` for every piece on `threads` threads, each with its own scratch. Pieces are
/// taken in order but finish in any order: `work` must not care.
pub fn for_each<S>(
    pieces: usize,
    threads: usize,
    scratch: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, usize) + Sync,
) {
    let next = AtomicUsize::new(0);
    let run = || {
        let mut own = scratch();
        loop {
            let piece = next.fetch_add(1, Ordering::Relaxed);
            if piece >= pieces {
                return;
            }
            work(&mut own, piece);
        }
    };
    let threads = threads.clamp(1, pieces.max(1));
    if threads == 1 {
        run();
        return;
    }
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(run);
        }
    });
}
