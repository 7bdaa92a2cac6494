//! SHA-256 as text, for what must be the same again later.

use sha2::{Digest, Sha256};

/// A sum over parts, each with its length: no two lists of parts have the same one.
#[derive(Default)]
pub(crate) struct Sum(Sha256);

impl Sum {
    /// Adds a text.
    pub fn text(&mut self, text: &str) {
        // The length goes first: otherwise two texts that divide the same bytes differently would have one sum.
        self.0.update((text.len() as u64).to_le_bytes());
        self.0.update(text);
    }

    /// Adds numbers, bit for bit.
    pub fn numbers(&mut self, numbers: &[f64]) {
        self.0.update((numbers.len() as u64).to_le_bytes());
        // Numbers reach the hash in blocks of 4 KiB: a long log has millions of them, and a call for each is slow.
        let mut bytes = [0; 8 * 512];
        for chunk in numbers.chunks(512) {
            for (slot, number) in bytes.chunks_exact_mut(8).zip(chunk) {
                slot.copy_from_slice(&number.to_le_bytes());
            }
            self.0.update(&bytes[..8 * chunk.len()]);
        }
    }

    /// The sum, 64 hexadecimal digits.
    pub fn digits(self) -> String {
        self.0.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

/// SHA-256 of numbers, hexadecimal.
pub(crate) fn of_numbers(numbers: &[f64]) -> String {
    let mut sum = Sum::default();
    sum.numbers(numbers);
    sum.digits()
}
