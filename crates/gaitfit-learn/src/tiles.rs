//! Work on many environments, shared by threads a tile at a time, results in order.

use std::sync::{Mutex, PoisonError};

use gaitfit_sim::pool;

use crate::task::TaskError;

/// Runs `work(first, count)` on tiles of at most `tile` of `count` environments, and joins what each returns in the
/// environments' order. Results do not depend on the number of threads.
///
/// # Errors
/// The first tile's that failed.
pub(crate) fn in_tiles<T: Send>(
    count: usize,
    tile: usize,
    threads: usize,
    work: impl Fn(u32, usize) -> Result<Vec<T>, TaskError> + Sync,
) -> Result<Vec<T>, TaskError> {
    let results: Vec<_> = (0..count.div_ceil(tile)).map(|_| Mutex::new(Ok(Vec::new()))).collect();
    pool::for_each(
        results.len(),
        threads,
        || (),
        |(), index| {
            let first = index * tile;
            let result = work(first as u32, tile.min(count - first));
            *results[index].lock().unwrap_or_else(PoisonError::into_inner) = result;
        },
    );
    let mut all = Vec::with_capacity(count);
    for result in results {
        all.extend(result.into_inner().unwrap_or_else(PoisonError::into_inner)?);
    }
    Ok(all)
}
