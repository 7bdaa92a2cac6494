//! Encodings of Parquet's values and levels (the format's Encodings.md): everything is bounded by the count that is asked
//! for, which the caller takes from its budget.

use crate::columnar::Values;
use crate::columnar_error::damaged;
use crate::problem::Problem;

/// Why a page cannot be read.
pub(super) const CUT: &str = "a page is cut short";

/// Type of a column's numbers in its pages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Physical {
    Bool,
    Int { bytes: usize, signed: bool },
    Float,
    Double,
}

impl Physical {
    /// Bytes of a number; 0 of bits.
    fn size(self) -> usize {
        match self {
            Physical::Bool => 0,
            Physical::Int { bytes, .. } => bytes,
            Physical::Float => 4,
            Physical::Double => 8,
        }
    }

    /// An integer of 8 bytes as this type means it.
    fn integer(self, value: i64) -> i64 {
        match self {
            Physical::Int { bytes: 4, signed: true } => i64::from(value as i32),
            Physical::Int { bytes: 4, signed: false } => i64::from(value as u32),
            _ => value,
        }
    }

    fn read(self, bytes: &[u8], into: &mut Values) -> Result<(), Problem> {
        match (self, into) {
            (Physical::Int { bytes: 4, .. }, Values::Integers(out)) => {
                out.push(self.integer(i64::from(i32::from_le_bytes(array(bytes)?))));
            }
            (Physical::Int { .. }, Values::Integers(out)) => out.push(i64::from_le_bytes(array(bytes)?)),
            (Physical::Float, Values::Reals(out)) => out.push(f64::from(f32::from_le_bytes(array(bytes)?))),
            (Physical::Double, Values::Reals(out)) => out.push(f64::from_le_bytes(array(bytes)?)),
            _ => return Err(damaged(CUT).into()),
        }
        Ok(())
    }

    fn empty(self) -> Values {
        match self {
            Physical::Float | Physical::Double => Values::Reals(Vec::new()),
            _ => Values::Integers(Vec::new()),
        }
    }
}

fn array<const N: usize>(bytes: &[u8]) -> Result<[u8; N], Problem> {
    bytes.first_chunk::<N>().copied().ok_or_else(|| damaged(CUT).into())
}

/// An unsigned number of 7 bits a byte.
pub(super) fn varint(bytes: &mut &[u8]) -> Result<u64, Problem> {
    let mut value = 0u64;
    for shift in (0..64).step_by(7) {
        let (first, rest) = bytes.split_first().ok_or_else(|| damaged(CUT))?;
        *bytes = rest;
        value |= u64::from(first & 0x7f) << shift;
        if first & 0x80 == 0 {
            return Ok(value);
        }
    }
    Err(damaged(CUT).into())
}

/// Number `index` of numbers of `width` bits, lowest bits first; bits beyond the end are 0.
fn packed(bytes: &[u8], width: usize, index: usize) -> u64 {
    let begin = index * width;
    let mut value = 0u128;
    // 64 bits that begin inside a byte reach into nine bytes.
    for (i, byte) in bytes.iter().skip(begin / 8).take(9).enumerate() {
        value |= u128::from(*byte) << (8 * i);
    }
    let mask = if width >= 64 { u128::from(u64::MAX) } else { (1u128 << width) - 1 };
    ((value >> (begin % 8)) & mask) as u64
}

/// `count` numbers of `width` bits, in runs and packed groups (RLE and bit-packing hybrid).
pub(super) fn hybrid(mut bytes: &[u8], width: usize, count: usize) -> Result<Vec<u32>, Problem> {
    if width > 32 {
        return Err(damaged("numbers of more than 32 bits where levels or places are").into());
    }
    let mut out = Vec::new();
    // All numbers are 0 and take no bytes.
    if width == 0 {
        out.resize(count, 0);
        return Ok(out);
    }
    // Runs are cut at `count`, so a stated length cannot take more memory than asked for.
    while out.len() < count {
        let header = varint(&mut bytes)?;
        let left = count - out.len();
        let wanted = usize::try_from(header >> 1).map_err(|_| damaged(CUT))?;
        // Runs of nothing would never reach `count`.
        if wanted == 0 {
            return Err(damaged(CUT).into());
        }
        // The lowest bit tells a run of one number from groups of eight packed ones.
        if header & 1 == 0 {
            let size = width.div_ceil(8);
            let run = bytes.get(..size).ok_or_else(|| damaged(CUT))?;
            bytes = &bytes[size..];
            let value = packed(run, 8 * size, 0) as u32;
            out.resize(out.len() + wanted.min(left), value);
        } else {
            // The last group may lack the bytes of numbers that do not count.
            let size = wanted.checked_mul(width).ok_or_else(|| damaged(CUT))?.min(bytes.len());
            let numbers = wanted.saturating_mul(8).min(8 * size / width).min(left);
            if numbers == 0 {
                return Err(damaged(CUT).into());
            }
            let (group, rest) = bytes.split_at(size);
            out.extend((0..numbers).map(|i| packed(group, width, i) as u32));
            bytes = rest;
        }
    }
    Ok(out)
}

/// `count` numbers as they are.
pub(super) fn plain(bytes: &[u8], physical: Physical, count: usize) -> Result<Values, Problem> {
    let mut out = physical.empty();
    if physical == Physical::Bool {
        if bytes.len() < count.div_ceil(8) {
            return Err(damaged(CUT).into());
        }
        return Ok(Values::Integers((0..count).map(|i| packed(bytes, 1, i) as i64).collect()));
    }
    let size = physical.size();
    let bytes = count.checked_mul(size).and_then(|length| bytes.get(..length)).ok_or_else(|| damaged(CUT))?;
    for number in bytes.chunks_exact(size) {
        physical.read(number, &mut out)?;
    }
    Ok(out)
}

/// `count` numbers whose first bytes come first, then all second bytes, and so on (BYTE_STREAM_SPLIT).
pub(super) fn split(bytes: &[u8], physical: Physical, count: usize) -> Result<Values, Problem> {
    let size = physical.size();
    let bytes = count.checked_mul(size).and_then(|length| bytes.get(..length)).ok_or_else(|| damaged(CUT))?;
    let mut out = physical.empty();
    for i in 0..count {
        let mut number = [0u8; 8];
        (0..size).for_each(|part| number[part] = bytes[part * count + i]);
        physical.read(&number[..size], &mut out)?;
    }
    Ok(out)
}

/// `count` entries of a dictionary by their places.
pub(super) fn dictionary(bytes: &[u8], entries: &Values, count: usize) -> Result<Values, Problem> {
    // The first byte is the width of the places, in bits.
    let (width, rest) = bytes.split_first().ok_or_else(|| damaged(CUT))?;
    let places = hybrid(rest, usize::from(*width), count)?;
    let missing = || damaged("a place beyond its dictionary");
    Ok(match entries {
        Values::Integers(all) => Values::Integers(
            places
                .iter()
                .map(|place| all.get(*place as usize).copied())
                .collect::<Option<_>>()
                .ok_or_else(missing)?,
        ),
        Values::Reals(all) => Values::Reals(
            places
                .iter()
                .map(|place| all.get(*place as usize).copied())
                .collect::<Option<_>>()
                .ok_or_else(missing)?,
        ),
    })
}

/// `count` integers by their differences, in packed blocks (DELTA_BINARY_PACKED).
pub(super) fn delta(mut bytes: &[u8], physical: Physical, count: usize) -> Result<Values, Problem> {
    let bytes = &mut bytes;
    // 0, −1, 1, −2, … are written as 0, 1, 2, 3, …, so that small numbers take few bits.
    let zigzag = |value: u64| (value >> 1) as i64 ^ -((value & 1) as i64);
    let block = usize::try_from(varint(bytes)?).map_err(|_| damaged(CUT))?;
    let parts = usize::try_from(varint(bytes)?).map_err(|_| damaged(CUT))?;
    let total = usize::try_from(varint(bytes)?).map_err(|_| damaged(CUT))?;
    // The header: values in a block, parts of a block, values in all, the first value. Usual blocks have 128 values.
    if parts == 0 || parts > 1 << 16 || block == 0 || block > 1 << 24 || block % parts != 0 || total < count {
        return Err(damaged(CUT).into());
    }
    let each = block / parts;
    let mut value = zigzag(varint(bytes)?);
    let mut out = Vec::new();
    if count > 0 {
        out.push(physical.integer(value));
    }
    while out.len() < count {
        // Each block: its smallest difference, the widths of its parts, and the parts.
        let min = zigzag(varint(bytes)?);
        let widths = bytes.get(..parts).ok_or_else(|| damaged(CUT))?;
        *bytes = &bytes[parts..];
        for width in widths.iter().map(|width| usize::from(*width)) {
            if out.len() >= count {
                break;
            }
            if width > 64 {
                return Err(damaged(CUT).into());
            }
            // The last part may be cut where its numbers do not count.
            let size = (each * width).div_ceil(8).min(bytes.len());
            let (group, rest) = bytes.split_at(size);
            *bytes = rest;
            for i in 0..each.min(count - out.len()) {
                let difference = packed(group, width, i) as i64;
                // The format lets differences wrap around.
                value = value.wrapping_add(min).wrapping_add(difference);
                out.push(physical.integer(value));
            }
        }
    }
    Ok(Values::Integers(out))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn examples_of_the_format_s_document() {
        // 0 to 7 in 3 bits: 10001000 11000110 11111010.
        let bits = [0b1000_1000, 0b1100_0110, 0b1111_1010];
        assert_eq!((0..8).map(|i| packed(&bits, 3, i)).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5, 6, 7]);
        let both = [&[0b11][..], &bits, &[10 << 1, 4]].concat();
        let mut want: Vec<u32> = (0..8).collect();
        want.extend([4; 10]);
        assert_eq!(hybrid(&both, 3, 18).unwrap(), want);
        assert!(hybrid(&both, 3, 19).is_err() && hybrid(&[0, 0], 3, 1).is_err());
        assert_eq!(hybrid(&[], 0, 3).unwrap(), [0; 3]);
        // 1 to 5: differences of 1 need no bits.
        let int = Physical::Int { bytes: 8, signed: true };
        let file = [128, 1, 4, 5, 2, 2, 0, 0, 0, 0];
        assert_eq!(delta(&file, int, 5).unwrap(), Values::Integers(vec![1, 2, 3, 4, 5]));
        // 7, 5, 3, 1, 2, 3, 4, 5: least difference -2, the others in 2 bits.
        let file = [128, 1, 4, 8, 14, 3, 2, 0, 0, 0, 0b1100_0000, 0b0011_1111];
        assert_eq!(delta(&file, int, 8).unwrap(), Values::Integers(vec![7, 5, 3, 1, 2, 3, 4, 5]));
        let bytes = [0xaa, 0xbb, 0xcc, 0xdd, 0x00, 0x11, 0x22, 0x33, 0xa3, 0xb4, 0xc5, 0xd6];
        let spread: Vec<u8> = (0..4).flat_map(|part| (0..3).map(move |i| bytes[4 * i + part])).collect();
        let float = Physical::Float;
        assert_eq!(split(&spread, float, 3).unwrap(), plain(&bytes, float, 3).unwrap());
    }
}
