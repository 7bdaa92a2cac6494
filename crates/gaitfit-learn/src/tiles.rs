//! Work on many environments, shared by threads a tile at a time, results in order.

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
    let one = |index: usize| {
        let first = index * tile;
        work(first as u32, tile.min(count - first))
    };
    let mut all = Vec::with_capacity(count);
    for result in pool::map(count.div_ceil(tile), threads, one) {
        all.extend(result?);
    }
    Ok(all)
}
