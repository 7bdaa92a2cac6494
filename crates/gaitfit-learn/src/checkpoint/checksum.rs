//! The checksum of a checkpoint: SHA-256 over the whole file, so that no bit of it changes unseen.
//!
//! It stands at the head of the checkpoint's metadata, in hexadecimal digits that count as zeros while it is computed.

use sha2::{Digest, Sha256};

/// Digits of a checksum.
const DIGITS: usize = 64;
/// What stands before them: the metadata's key and the beginning of its JSON, as JSON text.
const BEFORE: &[u8] = br#""gaitfit-checkpoint":"{\"sha256\":\""#;

/// What stands in the place of the checksum until it is known.
pub(super) fn blank() -> String {
    "0".repeat(DIGITS)
}

/// Where the digits are.
fn place(bytes: &[u8]) -> Option<std::ops::Range<usize>> {
    let start = bytes.windows(BEFORE.len()).position(|window| window == BEFORE)? + BEFORE.len();
    (start + DIGITS <= bytes.len()).then_some(start..start + DIGITS)
}

/// Of the file with `place` blank.
fn of(bytes: &[u8], place: std::ops::Range<usize>) -> String {
    let mut hash = Sha256::new();
    hash.update(&bytes[..place.start]);
    hash.update(blank());
    hash.update(&bytes[place.end..]);
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Writes the checksum into its place; false if there is none.
pub(super) fn seal(bytes: &mut [u8]) -> bool {
    let Some(place) = place(bytes) else { return false };
    let digits = of(bytes, place.clone());
    bytes[place].copy_from_slice(digits.as_bytes());
    true
}

/// Whether the file is the one that was sealed.
pub(super) fn intact(bytes: &[u8]) -> bool {
    place(bytes).is_some_and(|place| of(bytes, place.clone()).as_bytes() == &bytes[place])
}
