//! How much memory an import may take: a hostile file must not name its own size.

use crate::budget_error::{BudgetError, UnpackError};
use crate::problem::Problem;

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

/// Unpacks one or more Zstandard frames.
pub(crate) fn unzstd(bytes: &[u8], budget: &mut Budget) -> Result<Vec<u8>, Problem> {
    let mut input = bytes;
    let decoder = ruzstd::decoding::StreamingDecoder::new(&mut input)
        .map_err(|error| UnpackError::NoFrame(error.to_string()))?;
    read_all(decoder, budget, "zstd")
}

/// Unpacks an LZ4 frame.
pub(crate) fn unlz4(bytes: &[u8], budget: &mut Budget) -> Result<Vec<u8>, Problem> {
    read_all(lz4_flex::frame::FrameDecoder::new(bytes), budget, "lz4")
}
