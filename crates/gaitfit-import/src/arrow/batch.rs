//! A batch of rows: its buffers in the order of the fields.

use super::fields::{Field, Layout, Physical};
use crate::budget::{Budget, unlz4, unzstd};
use crate::columnar::{Frame, Values};
use crate::columnar_error::{ColumnarError, damaged};
use crate::dtype::DType;
use crate::problem::Problem;
use crate::table_error::TableError;
use gaitfit_model::shown;
use polars_arrow_format::ipc::planus::Vector;
use polars_arrow_format::ipc::{BufferRef, CompressionType, FieldNodeRef, RecordBatchRef};
use std::borrow::Cow;

const CUT: &str = "a buffer is cut short";

/// Adds the rows of a batch to the columns of `frame`.
pub(super) fn read(
    header: RecordBatchRef<'_>,
    body: &[u8],
    fields: &[Field],
    frame: &mut Frame,
    budget: &mut Budget,
) -> Result<(), Problem> {
    let rows = usize::try_from(header.length().map_err(damaged)?).map_err(damaged)?;
    let packed = match header.compression().map_err(damaged)? {
        None => None,
        Some(compression) => Some(compression.codec().map_err(damaged)?),
    };
    let views = header.variadic_buffer_counts().map_err(damaged)?;
    let mut batch = Batch {
        nodes: header.nodes().map_err(damaged)?.ok_or_else(|| damaged(CUT))?,
        buffers: header.buffers().map_err(damaged)?.ok_or_else(|| damaged(CUT))?,
        views: views.map(|all| all.iter().collect()).unwrap_or_default(),
        body,
        packed,
        node: 0,
        buffer: 0,
        view: 0,
        frame,
        budget,
    };
    // Rows are kept as numbers of 4 bytes.
    u32::try_from(batch.frame.rows.saturating_add(rows)).map_err(|_| TableError::ManyRows)?;
    // Nodes and buffers have no names: fields take them in the order of the schema.
    for field in fields {
        batch.field(field, rows, None, None)?;
    }
    batch.frame.rows += rows;
    Ok(())
}

struct Batch<'a, 'b> {
    nodes: Vector<'a, FieldNodeRef<'a>>,
    buffers: Vector<'a, BufferRef<'a>>,
    /// Buffers of each column of views.
    views: Vec<i64>,
    body: &'a [u8],
    packed: Option<CompressionType>,
    /// Places of the next node, buffer and count of views.
    node: usize,
    buffer: usize,
    view: usize,
    frame: &'b mut Frame,
    budget: &'b mut Budget,
}

impl<'a> Batch<'a, '_> {
    /// Reads a field of `length` places. `valid`: which of them the groups above have; `lists`: the lengths of the lists that
    /// its places are in.
    fn field(
        &mut self,
        field: &Field,
        length: usize,
        valid: Option<&[bool]>,
        lists: Option<&[u32]>,
    ) -> Result<(), Problem> {
        let node = self.nodes.get(self.node).ok_or_else(|| damaged(CUT))?;
        self.node += 1;
        // A field knows its own number of places, and a list's may have more than its lists cover.
        let places = usize::try_from(node.length()).map_err(damaged)?;
        if lists.is_none() && places != length || places < length {
            let name = shown(&field.name);
            return Err(damaged(format!("`{name}` has {places} places where {length} are")).into());
        }
        // A column of nulls has a node, but no buffer, not even one of validity.
        if field.layout == Layout::None {
            return Ok(());
        }
        if field.refused.is_some() {
            return self.skip(field, true);
        }
        // The places' validity takes memory too.
        self.budget.take_values(length / 4)?;
        let validity = self.take()?;
        let bit = |i: usize| validity.get(i / 8).is_some_and(|byte| byte >> (i % 8) & 1 == 1);
        // The format lets a writer leave the buffer out if no value is missing.
        let all = node.null_count() == 0 || validity.is_empty();
        let is_valid =
            |i: usize| (all || bit(i)) && valid.is_none_or(|valid| valid.get(i).copied().unwrap_or(false));
        match field.layout {
            Layout::Numbers(physical) => {
                let data = self.take()?;
                self.numbers(field, physical, &data, length, &is_valid, lists)
            }
            Layout::Children => {
                let valid: Vec<bool> = (0..length).map(is_valid).collect();
                field.children.iter().try_for_each(|child| self.field(child, length, Some(&valid), lists))
            }
            Layout::Lists(size) => {
                let offsets = self.take()?;
                let at = |i: usize| -> Result<usize, Problem> {
                    let number = offsets.get(i * size..(i + 1) * size).ok_or_else(|| damaged(CUT))?;
                    let mut word = [0u8; 8];
                    word[..size].copy_from_slice(number);
                    Ok(usize::try_from(u64::from_le_bytes(word)).map_err(damaged)?)
                };
                let mut lengths = Vec::new();
                // Offsets of a part of an array need not begin at 0.
                let first = if length == 0 { 0 } else { at(0)? };
                let mut last = first;
                for i in 0..length {
                    let end = at(i + 1)?;
                    let wide =
                        end.checked_sub(last).ok_or_else(|| damaged("lists that end before they begin"))?;
                    lengths.push(if is_valid(i) { u32::try_from(wide).map_err(damaged)? } else { 0 });
                    // The format allows values behind a missing list; they would be taken for those of the
                    // next one.
                    if !is_valid(i) && wide > 0 {
                        return Err(wrong(field, "has values where its list is missing").into());
                    }
                    last = end;
                }
                self.list(field, first, last, &lengths)
            }
            Layout::FixedLists(size) => {
                let values = length.checked_mul(size).ok_or_else(|| damaged(CUT))?;
                if (0..length).any(|i| !is_valid(i)) {
                    return Err(wrong(field, "has rows without a list; fill them").into());
                }
                self.list(field, 0, values, &vec![u32::try_from(size).map_err(damaged)?; length])
            }
            // Fields of these layouts are refused, so they were passed over above.
            Layout::None | Layout::Skipped(_) | Layout::Views => Err(damaged(CUT).into()),
        }
    }

    /// The inside of lists, whose values are those from `first` to `last`.
    fn list(&mut self, field: &Field, first: usize, last: usize, lengths: &[u32]) -> Result<(), Problem> {
        // The values below are read from the first on, and those before this list would be taken for its own.
        if first > 0 {
            return Err(wrong(field, "is a part of a longer table; write it anew").into());
        }
        field.children.iter().try_for_each(|child| self.field(child, last, None, Some(lengths)))
    }

    fn numbers(
        &mut self,
        field: &Field,
        physical: Physical,
        data: &[u8],
        length: usize,
        is_valid: &dyn Fn(usize) -> bool,
        lists: Option<&[u32]>,
    ) -> Result<(), Problem> {
        // A place takes 12 bytes: its value (8) and the number of its row (4).
        self.budget.take_values(length.saturating_add(length / 2))?;
        let values = values(physical, data, length)?;
        let row = self.frame.rows;
        let Some(column) = self.frame.columns.get_mut(&field.name) else { return Ok(()) };
        // In a list every place counts, so an empty one cannot be passed over.
        if let (Some(own), Some(lists)) = (&mut column.lengths, lists) {
            if (0..length).any(|i| !is_valid(i)) {
                return Err(wrong(field, "has lists with empty places; fill them").into());
            }
            own.extend(lists);
            column.values.append(values);
            return Ok(());
        }
        // A column keeps its rows, so rows without a value are simply not there.
        let places: Vec<usize> = (0..length).filter(|i| is_valid(*i)).collect();
        // The numbers fit into 4 bytes: `read` refuses more rows.
        column.rows.extend(places.iter().map(|place| (row + place) as u32));
        column.values.append(match values {
            all if places.len() == length => all,
            Values::Integers(all) => Values::Integers(places.iter().map(|place| all[*place]).collect()),
            Values::Reals(all) => Values::Reals(places.iter().map(|place| all[*place]).collect()),
        });
        Ok(())
    }

    /// Passes the buffers of a field that is not read; `begun`: its node has been taken.
    fn skip(&mut self, field: &Field, begun: bool) -> Result<(), Problem> {
        self.node += usize::from(!begun);
        self.buffer += match field.layout {
            Layout::None => 0,
            Layout::Children | Layout::FixedLists(_) => 1,
            Layout::Numbers(_) | Layout::Lists(_) => 2,
            Layout::Skipped(buffers) => 1 + buffers,
            Layout::Views => {
                let count = self.views.get(self.view).copied().unwrap_or(0);
                self.view += 1;
                2 + usize::try_from(count).map_err(damaged)?
            }
        };
        field.children.iter().try_for_each(|child| self.skip(child, false))
    }

    /// The next buffer, unpacked.
    fn take(&mut self) -> Result<Cow<'a, [u8]>, Problem> {
        let buffer = self.buffers.get(self.buffer).ok_or_else(|| damaged(CUT))?;
        self.buffer += 1;
        let begin = usize::try_from(buffer.offset()).map_err(damaged)?;
        let length = usize::try_from(buffer.length()).map_err(damaged)?;
        let bytes = begin
            .checked_add(length)
            .and_then(|end| self.body.get(begin..end))
            .ok_or_else(|| damaged(CUT))?;
        let Some(codec) = self.packed.filter(|_| !bytes.is_empty()) else { return Ok(Cow::Borrowed(bytes)) };
        let (size, bytes) = bytes.split_first_chunk::<8>().ok_or_else(|| damaged(CUT))?;
        // −1: this buffer is not packed, as packing would not have made it smaller (Arrow's Message.fbs).
        if i64::from_le_bytes(*size) == -1 {
            return Ok(Cow::Borrowed(bytes));
        }
        Ok(Cow::Owned(match codec {
            CompressionType::Lz4Frame => unlz4(bytes, self.budget)?,
            CompressionType::Zstd => unzstd(bytes, self.budget)?,
        }))
    }
}

/// `length` numbers of a buffer.
fn values(physical: Physical, data: &[u8], length: usize) -> Result<Values, Problem> {
    let numbers =
        |bytes: usize| length.checked_mul(bytes).and_then(|all| data.get(..all)).ok_or_else(|| damaged(CUT));
    Ok(match physical {
        Physical::Bool => {
            let data = data.get(..length.div_ceil(8)).ok_or_else(|| damaged(CUT))?;
            Values::Integers((0..length).map(|i| i64::from(data[i / 8] >> (i % 8) & 1)).collect())
        }
        Physical::Int { bytes, signed } => {
            let integer = |number: &[u8]| {
                // Bytes above the number's own are filled with its sign.
                let negative = signed && number.last().is_some_and(|byte| byte & 0x80 != 0);
                let mut word = [if negative { 0xff } else { 0 }; 8];
                word[..bytes].copy_from_slice(number);
                i64::from_le_bytes(word)
            };
            Values::Integers(numbers(bytes)?.chunks_exact(bytes).map(integer).collect())
        }
        Physical::Real { bytes } => {
            // 2, 4 and 8 bytes, in this order.
            let dtype = DType::parse(["<f2", "<f4", "<f8"][bytes.ilog2() as usize - 1])
                .ok_or_else(|| damaged(CUT))?;
            let reals = numbers(bytes)?.chunks_exact(bytes).map(|number| dtype.number(number));
            Values::Reals(reals.collect::<Option<_>>().ok_or_else(|| damaged(CUT))?)
        }
    })
}

fn wrong(field: &Field, problem: &'static str) -> ColumnarError {
    ColumnarError::Values { column: field.name.clone(), problem }
}
