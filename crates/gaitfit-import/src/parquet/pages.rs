//! A column's pages: unpacked within the budget, whatever sizes they state.

use super::encodings::{CUT, Physical, delta, dictionary, hybrid, plain, split};
use super::schema::Leaf;
use crate::budget::{Budget, read_all, unzstd};
use crate::columnar::{Column, Values};
use crate::columnar_error::{ColumnarError, damaged};
use crate::problem::Problem;
use crate::table_error::TableError;
use polars_parquet_format::thrift::protocol::TCompactInputProtocol;
use polars_parquet_format::{ColumnMetaData, CompressionCodec, Encoding, PageHeader, PageType};
use std::borrow::Cow;

/// Max number of bytes that a page's header may make: it holds names and statistics.
const MAX_HEADER: usize = 1 << 20;

/// Adds the column's values in one row group, which begins at row `first`, to `column`.
pub(super) fn read(
    file: &[u8],
    chunk: &ColumnMetaData,
    leaf: &Leaf,
    first: usize,
    column: &mut Column,
    budget: &mut Budget,
) -> Result<usize, Problem> {
    let place = |offset: i64| usize::try_from(offset).ok().filter(|at| *at < file.len());
    // No page begins at 0, where the file's magic bytes are.
    let begin = match chunk.dictionary_page_offset.filter(|offset| *offset > 0) {
        Some(offset) => place(offset.min(chunk.data_page_offset)),
        None => place(chunk.data_page_offset),
    };
    let mut rest = &file[begin.ok_or_else(|| damaged("a column begins outside the file"))?..];
    let wanted = usize::try_from(chunk.num_values).map_err(|_| damaged(CUT))?;
    let mut entries: Option<Values> = None;
    let (mut values, mut row) = (0, first);
    // Pages follow one another; a dictionary comes before the pages that refer to it.
    while values < wanted {
        let header = {
            let mut protocol = TCompactInputProtocol::new(&mut rest, MAX_HEADER);
            PageHeader::read_from_in_protocol(&mut protocol)
        };
        let header = header.map_err(|error| damaged(format!("a page's header: {error}")))?;
        let size = usize::try_from(header.compressed_page_size).ok().filter(|size| *size <= rest.len());
        let (page, after) = rest.split_at(size.ok_or_else(|| damaged(CUT))?);
        rest = after;
        let packed = Packed { codec: chunk.codec, size: header.uncompressed_page_size };
        if header.type_ == PageType::DICTIONARY_PAGE {
            let head = header.dictionary_page_header.ok_or_else(|| damaged(CUT))?;
            let count = usize::try_from(head.num_values).map_err(|_| damaged(CUT))?;
            let page = packed.open(page, budget)?;
            budget.take_values(count)?;
            entries = Some(plain(&page, leaf.physical, count)?);
        } else if header.type_ == PageType::DATA_PAGE {
            let head = header.data_page_header.ok_or_else(|| damaged(CUT))?;
            let count = usize::try_from(head.num_values).map_err(|_| damaged(CUT))?;
            budget.take_values(count)?;
            let page = packed.open(page, budget)?;
            let mut page: &[u8] = &page;
            let repeated = levels(&mut page, head.repetition_level_encoding, leaf.repeated, count)?;
            let defined = levels(&mut page, head.definition_level_encoding, leaf.defined, count)?;
            // Values that are missing have a level but no number.
            let there = present(&defined, leaf, count);
            let decoded = decode(page, head.encoding, leaf.physical, there, entries.as_ref())?;
            row = place_values(column, leaf, row, count, &repeated, &defined, decoded)?;
            // Each page has a header, so a file of pages without values ends too.
            values += count;
        } else if header.type_ == PageType::DATA_PAGE_V2 {
            let head = header.data_page_header_v2.ok_or_else(|| damaged(CUT))?;
            let count = usize::try_from(head.num_values).map_err(|_| damaged(CUT))?;
            budget.take_values(count)?;
            let mut page = page;
            let repeated = take(&mut page, head.repetition_levels_byte_length)?;
            let defined = take(&mut page, head.definition_levels_byte_length)?;
            let repeated = hybrid(repeated, width(leaf.repeated), count)?;
            let defined = hybrid(defined, width(leaf.defined), count)?;
            let levels =
                head.repetition_levels_byte_length.saturating_add(head.definition_levels_byte_length);
            // In pages of the second version the levels are not packed, but count in the stated size.
            let packed = match head.is_compressed {
                Some(false) => Packed { codec: CompressionCodec::UNCOMPRESSED, size: 0 },
                _ => Packed { size: packed.size.saturating_sub(levels), ..packed },
            };
            let page = packed.open(page, budget)?;
            let there = present(&defined, leaf, count);
            let decoded = decode(&page, head.encoding, leaf.physical, there, entries.as_ref())?;
            row = place_values(column, leaf, row, count, &repeated, &defined, decoded)?;
            values += count;
        }
    }
    Ok(row - first)
}

/// Takes `length` bytes from a page's beginning.
fn take<'a>(page: &mut &'a [u8], length: i32) -> Result<&'a [u8], Problem> {
    let length =
        usize::try_from(length).ok().filter(|length| *length <= page.len()).ok_or_else(|| damaged(CUT))?;
    let (taken, rest) = page.split_at(length);
    *page = rest;
    Ok(taken)
}

/// Bits of levels up to `max`.
fn width(max: u32) -> usize {
    (u32::BITS - max.leading_zeros()) as usize
}

/// The levels at the beginning of a page of the first version: 4 bytes of length, then runs.
fn levels(page: &mut &[u8], encoding: Encoding, max: u32, count: usize) -> Result<Vec<u32>, Problem> {
    if max == 0 {
        return Ok(Vec::new());
    }
    if encoding != Encoding::RLE {
        return Err(ColumnarError::NotRead(
            "levels in an encoding that is not read; write the file again with pyarrow",
        )
        .into());
    }
    let (length, rest) = page.split_first_chunk::<4>().ok_or_else(|| damaged(CUT))?;
    let length = u32::from_le_bytes(*length) as usize;
    let levels = hybrid(rest.get(..length).ok_or_else(|| damaged(CUT))?, width(max), count)?;
    *page = &rest[length..];
    Ok(levels)
}

/// Returns the number of a page's places that have a value.
fn present(defined: &[u32], leaf: &Leaf, count: usize) -> usize {
    match leaf.defined {
        0 => count,
        max => defined.iter().filter(|level| **level == max).count(),
    }
}

fn decode(
    page: &[u8],
    encoding: Encoding,
    physical: Physical,
    count: usize,
    entries: Option<&Values>,
) -> Result<Values, Problem> {
    match (encoding, physical) {
        (Encoding::PLAIN, _) => plain(page, physical, count),
        (Encoding::PLAIN_DICTIONARY | Encoding::RLE_DICTIONARY, _) => {
            let entries = entries.ok_or_else(|| damaged("places of a dictionary that is not there"))?;
            // Without values a page has not even the width of its places.
            if count == 0 { Ok(Values::Integers(Vec::new())) } else { dictionary(page, entries, count) }
        }
        (Encoding::RLE, Physical::Bool) => {
            // The first 4 bytes are the length of what follows.
            let bits = hybrid(page.get(4..).ok_or_else(|| damaged(CUT))?, 1, count)?;
            Ok(Values::Integers(bits.into_iter().map(i64::from).collect()))
        }
        (Encoding::DELTA_BINARY_PACKED, Physical::Int { .. }) => delta(page, physical, count),
        (Encoding::BYTE_STREAM_SPLIT, _) if physical != Physical::Bool => split(page, physical, count),
        _ => Err(ColumnarError::NotRead(
            "numbers in an encoding that is not read; write the file again with pyarrow",
        )
        .into()),
    }
}

/// Puts a page's values into their rows; gives the row after the last one that has begun.
fn place_values(
    column: &mut Column,
    leaf: &Leaf,
    mut row: usize,
    count: usize,
    repeated: &[u32],
    defined: &[u32],
    values: Values,
) -> Result<usize, Problem> {
    let many = || TableError::ManyRows;
    let defined_at = |i: usize| defined.get(i).copied().unwrap_or(leaf.defined);
    // Level 0 begins a new row; every other level goes on with the list of the row before.
    if let Some(lengths) = &mut column.lengths {
        for i in 0..count {
            if repeated.get(i).copied().unwrap_or(0) == 0 {
                lengths.push(0);
                row += 1;
            }
            let length = lengths.last_mut().ok_or_else(|| damaged("a list without a beginning"))?;
            if defined_at(i) == leaf.defined {
                *length += 1;
            } else if defined_at(i) >= leaf.in_list {
                // A place of the list without a value. At lower levels the list itself is empty or missing.
                return Err(ColumnarError::Values {
                    column: leaf.name.clone(),
                    problem: "has lists with empty places; fill them",
                }
                .into());
            }
        }
    } else {
        for i in 0..count {
            if defined_at(i) == leaf.defined {
                column.rows.push(u32::try_from(row).map_err(|_| many())?);
            }
            row += 1;
        }
    }
    column.values.append(values);
    u32::try_from(row).map_err(|_| many())?;
    Ok(row)
}

/// Compression of a page.
#[derive(Clone, Copy)]
struct Packed {
    codec: CompressionCodec,
    /// Bytes that it states to have when unpacked.
    size: i32,
}

impl Packed {
    fn open<'a>(self, page: &'a [u8], budget: &mut Budget) -> Result<Cow<'a, [u8]>, Problem> {
        let size = usize::try_from(self.size).map_err(|_| damaged(CUT))?;
        let snappy =
            |error: snap::Error| ColumnarError::Packed { packer: "snappy", problem: error.to_string() };
        // An empty page is not packed.
        if self.codec == CompressionCodec::UNCOMPRESSED || page.is_empty() {
            return Ok(Cow::Borrowed(page));
        }
        Ok(Cow::Owned(match self.codec {
            CompressionCodec::SNAPPY => {
                let length = snap::raw::decompress_len(page).map_err(snappy)?;
                if length != size {
                    return Err(damaged(CUT).into());
                }
                budget.take_bytes(length)?;
                snap::raw::Decoder::new().decompress_vec(page).map_err(snappy)?
            }
            CompressionCodec::LZ4_RAW => {
                // A block of LZ4 does not state its size; the page's header does.
                budget.take_bytes(size)?;
                lz4_flex::block::decompress(page, size)
                    .map_err(|error| ColumnarError::Packed { packer: "lz4", problem: error.to_string() })?
            }
            CompressionCodec::GZIP => read_all(flate2::read::MultiGzDecoder::new(page), budget, "gzip")?,
            CompressionCodec::ZSTD => unzstd(page, budget)?,
            _ => {
                return Err(ColumnarError::NotRead("packed by a method that is not read; write the file again with compression='zstd' or 'snappy'").into());
            }
        }))
    }
}
