//! MCAP files. The crate `mcap` reads records; chunks are unpacked here, by decoders in Rust.

use crate::budget::{Budget, unlz4, unzstd};
use crate::mcap_error::McapError;
use crate::mcap_write::METADATA;
use crate::problem::Problem;
use crate::ros::{Channel, Messages};
use mcap::records::{Record, op};
use std::collections::HashMap;
use std::rc::Rc;

/// The first bytes of a file.
pub(crate) const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// Schemas and channels seen so far.
#[derive(Default)]
struct Seen {
    /// Schemas by number. Any number of channels may have the same one.
    schemas: HashMap<u16, Schema>,
    /// The number of each channel's topic.
    channels: HashMap<u16, usize>,
}

/// A message type as the file has it.
struct Schema {
    name: Rc<str>,
    encoding: String,
    text: Rc<str>,
}

/// Adds all messages of a file. A file that was cut off is read as far as it goes; returns whether it was.
pub(crate) fn read(bytes: &[u8], messages: &mut Messages<'_>, budget: &mut Budget) -> Result<bool, Problem> {
    let rest = bytes.strip_prefix(MAGIC).ok_or(McapError::NotMcap)?;
    let mut seen = Seen::default();
    records(rest, &mut seen, messages, budget, true)
}

fn records(
    mut rest: &[u8],
    seen: &mut Seen,
    messages: &mut Messages<'_>,
    budget: &mut Budget,
    outside: bool,
) -> Result<bool, Problem> {
    while let Some((head, after)) = rest.split_at_checked(9) {
        let code = head[0];
        // A record begins with its kind (1 byte) and its length (8 bytes, little-endian).
        let size = head[1..].iter().rev().fold(0u64, |sum, byte| (sum << 8) | u64::from(*byte));
        let body = usize::try_from(size).ok().and_then(|size| after.split_at_checked(size));
        // A record that is not complete: the recorder was killed. All before it counts.
        let Some((body, next)) = body else { return Ok(true) };
        rest = next;
        match code {
            // After the footer there is only the magic once more.
            op::FOOTER if outside => return Ok(false),
            op::CHUNK if outside => {
                let Record::Chunk { header, data } = parse(code, body)? else { continue };
                let packed: &[u8] = &data;
                let unpacked = match header.compression.as_str() {
                    "" => None,
                    "zstd" => Some(unzstd(packed, budget)?),
                    "lz4" => Some(unlz4(packed, budget)?),
                    other => {
                        return Err(McapError::Packer(other.to_owned()).into());
                    }
                };
                // Chunks do not nest, so records of one are not `outside`.
                records(unpacked.as_deref().unwrap_or(packed), seen, messages, budget, false)?;
            }
            op::SCHEMA => {
                if let Record::Schema { header, data } = parse(code, body)? {
                    budget.take_bytes(data.len())?;
                    let text = String::from_utf8_lossy(&data).into();
                    let schema = Schema { name: header.name.into(), encoding: header.encoding, text };
                    seen.schemas.insert(header.id, schema);
                }
            }
            op::CHANNEL => {
                if let Record::Channel(channel) = parse(code, body)? {
                    let schema = seen.schemas.get(&channel.schema_id);
                    // Other languages of definitions are not read; types of ROS and Unitree are known without.
                    let readable = schema.filter(|schema| schema.encoding == "ros2msg");
                    let channel_of_topic = Channel {
                        topic: channel.topic,
                        kind: schema.map(|schema| schema.name.clone()).unwrap_or_default(),
                        encoding: channel.message_encoding,
                        definition: readable.map(|schema| schema.text.clone()).unwrap_or_default(),
                    };
                    let number = messages.channel(channel_of_topic, budget)?;
                    seen.channels.insert(channel.id, number);
                }
            }
            op::MESSAGE => {
                // A message of a channel that no record describes is passed over.
                if let Record::Message { header, data } = parse(code, body)?
                    && let Some(number) = seen.channels.get(&header.channel_id)
                {
                    let time = i64::try_from(header.log_time).unwrap_or(i64::MAX);
                    messages.message(*number, time, &data, budget)?;
                }
            }
            op::METADATA => {
                if let Record::Metadata(metadata) = parse(code, body)?
                    && metadata.name == METADATA
                {
                    messages.take_metadata(metadata.metadata);
                }
            }
            // Indexes, statistics, attachments.
            _ => {}
        }
    }
    // The file ended without a footer, so it was cut; a chunk has none.
    Ok(outside)
}

/// Whether the lengths that a record gives its texts fit into it. The crate `mcap` takes the memory before it looks.
fn lengths_fit(code: u8, mut body: &[u8]) -> bool {
    // Bytes before the texts, and how many texts (or tables of texts, whose length comes first) follow, by MCAP's
    // specification.
    let (fixed, texts) = match code {
        op::CHUNK => (28, 1),
        op::SCHEMA => (2, 3),
        op::CHANNEL => (4, 3),
        op::METADATA => (0, 2),
        _ => return true,
    };
    let mut table = match body.split_at_checked(fixed) {
        Some((_, rest)) => {
            body = rest;
            None
        }
        None => return false,
    };
    for number in 0..texts {
        let Some((text, rest)) = text(body) else { return false };
        if number + 1 == texts && matches!(code, op::CHANNEL | op::METADATA) {
            table = Some(text);
        }
        body = rest;
    }
    let mut inside = table.unwrap_or_default();
    while !inside.is_empty() {
        let Some((_, rest)) = text(inside) else { return false };
        inside = rest;
    }
    true
}

/// A text with its length before it, and what follows.
fn text(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<4>()?;
    rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?)
}

fn parse(code: u8, body: &[u8]) -> Result<Record<'_>, Problem> {
    if !lengths_fit(code, body) {
        return Err(McapError::TextBeyond.into());
    }
    Ok(mcap::parse_record(code, body).map_err(|error| McapError::Damaged(error.to_string()))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_beyond_a_record_are_refused_before_memory_is_taken() {
        let text = |text: &str| [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat();
        let channel = |table: &[u8]| {
            let length = (table.len() as u32).to_le_bytes();
            [&[1, 0, 1, 0][..], &text("/joints"), &text("cdr"), &length, table].concat()
        };
        assert!(lengths_fit(op::CHANNEL, &channel(&[text("a"), text("b")].concat())));
        assert!(lengths_fit(op::SCHEMA, &[&[1, 0][..], &text("n"), &text("ros2msg"), &text("x")].concat()));
        let huge = u32::MAX.to_le_bytes();
        assert!(!lengths_fit(op::CHANNEL, &channel(&huge)));
        assert!(!lengths_fit(op::SCHEMA, &[&[1, 0][..], &huge, b"name"].concat()));
        assert!(!lengths_fit(op::METADATA, &huge));
        assert!(!lengths_fit(op::CHUNK, &[&[0; 28][..], &huge].concat()));
        assert!(!lengths_fit(op::CHUNK, &[0; 20]));
    }
}
