//! Arrow's IPC files (Feather among them) and streams: their flatbuffers by a library, their buffers here, within the budget.
//!
//! Both kinds are a row of messages: a schema, then batches of rows. A file has its batches listed once more at its end,
//! which is not looked at: so a file that was cut off is read as far as it goes.

mod batch;
mod fields;

use crate::budget::Budget;
use crate::columnar::{Column, Frame};
use crate::columnar_error::{ColumnarError, damaged};
use crate::kind::{ARROW as MAGIC, ARROW_MESSAGE as CONTINUED};
use crate::problem::Problem;
use fields::Field;
use gaitfit_model::shown;
use polars_arrow_format::ipc::planus::ReadAsRoot;
use polars_arrow_format::ipc::{Endianness, MessageHeaderRef, MessageRef};

/// The columns of a file or stream.
pub(crate) fn read(file: &[u8], budget: &mut Budget) -> Result<Frame, Problem> {
    let mut rest = file.strip_prefix(MAGIC).unwrap_or(file);
    let mut frame = Frame::default();
    let mut fields: Option<Vec<Field>> = None;
    loop {
        let message = match next(&mut rest) {
            Next::Message(message) => message,
            Next::End => break,
            Next::Cut => {
                frame.cut = true;
                break;
            }
        };
        let message = MessageRef::read_as_root(message).map_err(damaged)?;
        let length = usize::try_from(message.body_length().map_err(damaged)?).map_err(damaged)?;
        // The recorder was stopped in the middle of a batch; all before it counts.
        let Some((body, after)) = rest.split_at_checked(length) else {
            frame.cut = true;
            break;
        };
        rest = after;
        match message.header().map_err(damaged)? {
            // A second schema is passed over.
            Some(MessageHeaderRef::Schema(schema)) if fields.is_none() => {
                if schema.endianness().map_err(damaged)? == Endianness::Big {
                    return Err(ColumnarError::NotRead(
                        "it was written on a big-endian machine; write it again on this one",
                    )
                    .into());
                }
                let tree = fields::fields(schema.fields().map_err(damaged)?)?;
                for leaf in tree.iter().flat_map(Field::leaves) {
                    match leaf.refused {
                        Some(reason) => frame.left_out.push(format!("{}: {reason}", shown(&leaf.name))),
                        None => frame.add(leaf.name.clone(), Column::new(leaf.in_list, leaf.per_second))?,
                    }
                }
                fields = Some(tree);
            }
            Some(MessageHeaderRef::RecordBatch(header)) => {
                let fields = fields.as_ref().ok_or_else(|| damaged("rows before a schema"))?;
                batch::read(header, body, fields, &mut frame, budget)?;
            }
            // Dictionaries hold words.
            _ => {}
        }
    }
    if fields.is_none() {
        return Err(damaged("no schema").into());
    }
    Ok(frame)
}

enum Next<'a> {
    Message(&'a [u8]),
    End,
    Cut,
}

/// Takes the next message's description: 4 bytes ff, its length, itself. A length of 0 is the end.
fn next<'a>(rest: &mut &'a [u8]) -> Next<'a> {
    if rest.is_empty() {
        return Next::End;
    }
    // Writers before Arrow 0.15 put the length alone, without the 4 bytes ff.
    let body = rest.strip_prefix(CONTINUED).unwrap_or(rest);
    let Some((length, body)) = body.split_first_chunk::<4>() else { return Next::Cut };
    let length = u32::from_le_bytes(*length) as usize;
    if length == 0 {
        return Next::End;
    }
    let Some((message, after)) = body.split_at_checked(length) else { return Next::Cut };
    *rest = after;
    Next::Message(message)
}
