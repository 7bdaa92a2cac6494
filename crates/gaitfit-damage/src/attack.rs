//! Many damaged files, one after the other.

use crate::{Draws, peak};
use std::time::{Duration, Instant};

/// Bounds of memory and time for reading one damaged file.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Bytes that the reader's thread may hold at a time.
    pub bytes: usize,
    /// Time. Generous: machines that test may be slow.
    pub time: Duration,
}

/// Result of reading many damaged files.
#[derive(Clone, Copy, Debug, Default)]
pub struct Outcome {
    /// Files that were read in spite of their damage.
    pub read: usize,
    /// Files that were refused.
    pub refused: usize,
    /// Maximum of the bytes that a reading held.
    pub bytes: usize,
    /// Maximum of the time that a reading took.
    pub time: Duration,
}

/// Names the file that a reader panicked at.
struct Witness<'a>(&'a str, usize);

impl Drop for Witness<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("{}: damaged file {} of the draws", self.0, self.1);
        }
    }
}

/// Reads `rounds` damaged files. `damaged` makes one from draws that depend on the file's number alone; `read` says whether
/// it could be read.
///
/// # Panics
/// Where a reading takes more than `bounds`, or panics itself.
pub fn attack(
    name: &str,
    rounds: usize,
    bounds: Bounds,
    mut damaged: impl FnMut(&mut Draws) -> Vec<u8>,
    mut read: impl FnMut(&[u8]) -> bool,
) -> Outcome {
    let mut outcome = Outcome::default();
    for round in 0..rounds {
        // The seed is the file's number, so that the number in a message is enough to repeat a failure.
        let file = damaged(&mut Draws::new(round as u64));
        let witness = Witness(name, round);
        let start = Instant::now();
        let (is_read, bytes) = peak(|| read(&file));
        let time = start.elapsed();
        drop(witness);
        outcome.read += usize::from(is_read);
        outcome.refused += usize::from(!is_read);
        outcome.bytes = outcome.bytes.max(bytes);
        outcome.time = outcome.time.max(time);
        assert!(bytes <= bounds.bytes, "{name}: damaged file {round} took {bytes} bytes of memory");
        assert!(time <= bounds.time, "{name}: damaged file {round} took {time:?}");
    }
    eprintln!("{name}: {outcome:?}");
    outcome
}
