//! How much memory an import may take: a hostile file must not name its own size.

use crate::budget_error::{BudgetError, UnpackError};
use crate::problem::Problem;
use ruzstd::decoding::{FrameDecoder, StreamingDecoder};

/// Values and bytes that may still be made.
#[derive(Debug)]
pub(crate) struct Budget {
    values: usize,
    bytes: usize,
    most_values: usize,
    most_bytes: usize,
}

impl Budget {
    /// A budget of numbers (8 bytes each) and of bytes that decompression may make.
    pub fn new(most_values: usize, most_bytes: usize) -> Self {
        Budget { values: most_values, bytes: most_bytes, most_values, most_bytes }
    }

    /// Takes `count` numbers.
    pub fn take_values(&mut self, count: usize) -> Result<(), BudgetError> {
        let left = self.values.checked_sub(count);
        self.values = left.ok_or(BudgetError::Values { limit: self.most_values })?;
        Ok(())
    }

    /// Takes `count` bytes.
    pub fn take_bytes(&mut self, count: usize) -> Result<(), BudgetError> {
        self.bytes = self.bytes.checked_sub(count).ok_or(BudgetError::Bytes { limit: self.most_bytes })?;
        Ok(())
    }

    /// Bytes left.
    pub fn bytes_left(&self) -> usize {
        self.bytes
    }
}

/// Unpacks `reader` to its end within the budget.
pub(crate) fn read_all(
    reader: impl std::io::Read,
    budget: &mut Budget,
    packer: &'static str,
) -> Result<Vec<u8>, Problem> {
    use std::io::Read;
    let mut out = Vec::new();
    let limit = budget.bytes_left() as u64;
    // One byte more than is left, so that too much is noticed and not cut off.
    reader
        .take(limit.saturating_add(1))
        .read_to_end(&mut out)
        .map_err(|source| UnpackError::Damaged { packer, source })?;
    budget.take_bytes(out.len())?;
    Ok(out)
}

/// Whether a Zstandard file begins so: with a frame, or one to skip (RFC 8878, clause 3.1), as pzstd writes them.
pub(crate) fn is_zstd(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x28, 0xb5, 0x2f, 0xfd]) || matches!(bytes, [0x50..=0x5f, 0x2a, 0x4d, 0x18, ..])
}

/// Unpacks one or more Zstandard frames. Zeros behind them are padding.
pub(crate) fn unzstd(bytes: &[u8], budget: &mut Budget) -> Result<Vec<u8>, Problem> {
    let no_frame = |what: String| Problem::from(UnpackError::NoFrame(what));
    let mut rest = bytes;
    let mut out = Vec::new();
    // One decoder for all: a frame of some bytes may ask for a large window.
    let mut frames = FrameDecoder::new();
    loop {
        if let [0x50..=0x5f, 0x2a, 0x4d, 0x18, a, b, c, d, content @ ..] = rest {
            // A frame to skip states only its length.
            let length = u32::from_le_bytes([*a, *b, *c, *d]) as usize;
            rest =
                content.get(length..).ok_or_else(|| no_frame("a frame to skip is cut short".to_owned()))?;
        } else {
            let decoder = StreamingDecoder::new_with_decoder(&mut rest, &mut frames)
                .map_err(|error| no_frame(error.to_string()))?;
            let mut content = read_all(decoder, budget, "zstd")?;
            // Most files have one frame, which is not copied.
            if out.is_empty() {
                out = content;
            } else {
                out.append(&mut content);
            }
        }
        if rest.iter().all(|byte| *byte == 0) {
            return Ok(out);
        }
    }
}

/// Unpacks an LZ4 frame.
pub(crate) fn unlz4(bytes: &[u8], budget: &mut Budget) -> Result<Vec<u8>, Problem> {
    read_all(lz4_flex::frame::FrameDecoder::new(bytes), budget, "lz4")
}

#[cfg(test)]
mod tests {
    use super::*;
    use ruzstd::encoding::{CompressionLevel, compress_to_vec};

    #[test]
    fn all_frames_are_unpacked_within_one_budget() -> Result<(), Problem> {
        let frame = |text: &str| compress_to_vec(text.as_bytes(), CompressionLevel::Fastest);
        let skipped = |length: u8| [&[0x5a, 0x2a, 0x4d, 0x18, length, 0, 0, 0][..], b"note"].concat();
        let packed = [skipped(4), frame("one "), frame(""), skipped(4), frame("two"), vec![0; 5]].concat();
        assert!(is_zstd(&packed) && is_zstd(&frame("one")));
        let mut budget = Budget::new(0, 7);
        assert_eq!(unzstd(&packed, &mut budget)?, b"one two");
        assert_eq!(budget.bytes_left(), 0);
        assert!(unzstd(&packed, &mut Budget::new(0, 6)).is_err());
        for wrong in [Vec::new(), skipped(5), [frame("one"), b"and more".to_vec()].concat()] {
            assert!(unzstd(&wrong, &mut Budget::new(0, 100)).is_err());
        }
        Ok(())
    }
}
