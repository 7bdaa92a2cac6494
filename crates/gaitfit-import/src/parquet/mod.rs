//! Parquet files: their thrift headers by a library that bounds what it makes, their pages here. A reader that unpacks
//! pages itself would make as much memory as they state, and needs C for Zstandard.

mod encodings;
mod pages;
mod schema;

use crate::budget::Budget;
use crate::columnar::{Column, Frame};
use crate::columnar_error::{ColumnarError, damaged};
use crate::kind::PARQUET as MAGIC;
use crate::problem::Problem;
use gaitfit_model::shown;
use polars_parquet_format::FileMetaData;
use polars_parquet_format::thrift::protocol::TCompactInputProtocol;

/// Max number of bytes that the footer may make.
const MAX_FOOTER: usize = 256 << 20;

/// The columns of the file.
pub(crate) fn read(file: &[u8], budget: &mut Budget) -> Result<Frame, Problem> {
    let cut = || ColumnarError::NoEnd;
    // The file is read from its end: the footer says where everything is.
    let footer = file.strip_suffix(MAGIC).ok_or_else(cut)?;
    let (footer, length) = footer.split_last_chunk::<4>().ok_or_else(cut)?;
    let length = u32::from_le_bytes(*length) as usize;
    // The magic stands at the file's beginning too.
    let begin = footer.len().checked_sub(length).filter(|begin| *begin >= MAGIC.len()).ok_or_else(cut)?;
    let mut protocol = TCompactInputProtocol::new(&footer[begin..], MAX_FOOTER);
    let metadata = FileMetaData::read_from_in_protocol(&mut protocol)
        .map_err(|error| damaged(format!("its footer: {error}")))?;
    let leaves = schema::leaves(&metadata.schema)?;
    let mut frame = Frame::default();
    for leaf in &leaves {
        match leaf.refused {
            Some(reason) => frame.left_out.push(format!("{}: {reason}", shown(&leaf.name))),
            None => frame.add(leaf.name.clone(), Column::new(leaf.repeated > 0, leaf.per_second))?,
        }
    }
    for group in &metadata.row_groups {
        let rows = usize::try_from(group.num_rows).map_err(|_| cut())?;
        if group.columns.len() != leaves.len() {
            return Err(damaged("a part with other columns than the schema").into());
        }
        // Columns of a row group stand in the order of the schema's leaves.
        for (leaf, chunk) in leaves.iter().zip(&group.columns) {
            let Some(column) = frame.columns.get_mut(&leaf.name).filter(|_| leaf.refused.is_none()) else {
                continue;
            };
            if chunk.file_path.is_some() {
                return Err(ColumnarError::NotRead("columns in other files; write it as one file").into());
            }
            let meta = chunk
                .meta_data
                .as_ref()
                .ok_or(ColumnarError::NotRead("encrypted columns; write it again without encryption"))?;
            let count = pages::read(file, meta, leaf, frame.rows, column, budget).map_err(|problem| {
                ColumnarError::Column { column: leaf.name.clone(), problem: problem.into() }
            })?;
            if count != rows {
                let name = shown(&leaf.name);
                return Err(damaged(format!("column `{name}`: {count} rows in a part of {rows}")).into());
            }
        }
        frame.rows += rows;
    }
    Ok(frame)
}
