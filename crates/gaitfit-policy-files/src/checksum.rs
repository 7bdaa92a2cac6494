//! The checksum of a file that carries it itself: SHA-256 over the whole file, so that no bit of it changes unseen.
//!
//! It stands at the head of a JSON object in the file's metadata, in hexadecimal digits that count as zeros while it is
//! computed. It tells damage, not intent: whoever changes a file can write another sum.

use gaitfit_policy::PolicyError;
use gaitfit_policy::invalid;
use serde::Deserialize;
use sha2::{Digest, Sha256};
use std::ops::Range;

/// Digits of a checksum.
const DIGITS: usize = 64;

/// The part of a JSON object in metadata that says whether there is a checksum.
#[derive(Deserialize)]
pub(super) struct Sealed {
    sha256: Option<String>,
}

impl Sealed {
    /// Whether the JSON object `text` has a checksum.
    pub fn is(text: &str) -> bool {
        serde_json::from_str(text).is_ok_and(|Self { sha256 }| sha256.is_some())
    }
}

/// The error of a policy's file that is not as it was sealed.
pub(super) fn damaged() -> PolicyError {
    invalid(
        "its checksum does not fit: the file was damaged or changed since gaitfit wrote it; copy or export it again. If \
         another program changed it on purpose, remove `sha256` from the JSON of its `gaitfit` metadata",
    )
}

/// Placeholder of the checksum until it is known.
pub fn blank() -> String {
    "0".repeat(DIGITS)
}

/// Where the digits are: after the first `before`, which the writer puts there and nowhere else.
fn place(bytes: &[u8], before: &[u8]) -> Option<Range<usize>> {
    let start = bytes.windows(before.len()).position(|window| window == before)? + before.len();
    // A file that ends within the digits has no checksum.
    (start + DIGITS <= bytes.len()).then_some(start..start + DIGITS)
}

/// Checksum of the file with `place` blank.
fn digest(bytes: &[u8], place: Range<usize>) -> String {
    let mut hash = Sha256::new();
    hash.update(&bytes[..place.start]);
    // The sum cannot contain itself, so zeros stand in its place, as they did when it was sealed.
    hash.update(blank());
    hash.update(&bytes[place.end..]);
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Writes the checksum into its place, after `before`; false if there is none.
pub fn seal(bytes: &mut [u8], before: &[u8]) -> bool {
    let Some(place) = place(bytes, before) else { return false };
    let digits = digest(bytes, place.clone());
    bytes[place].copy_from_slice(digits.as_bytes());
    true
}

/// Whether the file is the one that was sealed, its checksum after `before`.
pub fn intact(bytes: &[u8], before: &[u8]) -> bool {
    place(bytes, before).is_some_and(|place| digest(bytes, place.clone()).as_bytes() == &bytes[place])
}
