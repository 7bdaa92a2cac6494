//! Work on many environments, shared by threads a tile at a time, results in order.

use gaitfit_sim::pool;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::task::TaskError;

/// Runs `work(first, count)` on tiles of at most `tile` of `count` environments, and joins what each returns in the
/// environments' order. Results do not depend on the number of threads.
///
/// # Errors
/// That of a tile that failed; tiles that have not begun by then are left out.
pub(crate) fn in_tiles<T: Send>(
    count: usize,
    tile: usize,
    threads: usize,
    work: impl Fn(u32, usize) -> Result<Vec<T>, TaskError> + Sync,
) -> Result<Vec<T>, TaskError> {
    let failed = AtomicBool::new(false);
    // Relaxed is enough: the flag only saves work, and each result tells of its own failure.
    let one = |index: usize| {
        if failed.load(Ordering::Relaxed) {
            // The caller never gets this empty result: the loop below returns the error.
            return Ok(Vec::new());
        }
        let first = index * tile;
        let done = work(first as u32, tile.min(count - first));
        failed.fetch_or(done.is_err(), Ordering::Relaxed);
        done
    };
    let mut results = Vec::with_capacity(count);
    for result in pool::map(count.div_ceil(tile), threads, one) {
        results.extend(result?);
    }
    Ok(results)
}
