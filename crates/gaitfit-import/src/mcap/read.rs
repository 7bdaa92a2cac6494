//! Reads messages from MCAP files.

use super::{MAGIC, METADATA, op};
use crate::budget::{Budget, unlz4, unzstd};
use crate::ros::{Channel, Messages};
use gaitfit_model::shown;
use std::collections::{BTreeMap, HashMap};

/// Schemas and channels seen so far.
#[derive(Default)]
struct Seen {
    /// Name, encoding and text of schemas.
    schemas: HashMap<u16, (String, String, String)>,
    /// The number of each channel's topic.
    channels: HashMap<u16, usize>,
}

/// Adds all messages of a file. A file that was cut off is read as far as it goes; returns whether it was.
pub(crate) fn read(bytes: &[u8], messages: &mut Messages<'_>, budget: &mut Budget) -> Result<bool, String> {
    let rest = bytes.strip_prefix(MAGIC).ok_or("it does not begin as MCAP files do")?;
    let mut seen = Seen::default();
    records(rest, &mut seen, messages, budget, true)
}

fn records(
    mut rest: &[u8],
    seen: &mut Seen,
    messages: &mut Messages<'_>,
    budget: &mut Budget,
    outside: bool,
) -> Result<bool, String> {
    while let Some((head, after)) = rest.split_at_checked(9) {
        let code = head[0];
        let size = head[1..].iter().rev().fold(0u64, |sum, byte| (sum << 8) | u64::from(*byte));
        let body = usize::try_from(size).ok().and_then(|size| after.split_at_checked(size));
        let Some((body, next)) = body else { return Ok(true) };
        rest = next;
        match code {
            op::FOOTER if outside => return Ok(false),
            op::CHUNK if outside => {
                let chunk = chunk(body).ok_or_else(damaged)?;
                let unpacked = match chunk.packing {
                    "" => None,
                    "zstd" => Some(unzstd(chunk.records, budget)?),
                    "lz4" => Some(unlz4(chunk.records, budget)?),
                    other => {
                        return Err(format!("chunks packed by `{}`; zstd and lz4 are read", shown(other)));
                    }
                };
                records(unpacked.as_deref().unwrap_or(chunk.records), seen, messages, budget, false)?;
            }
            op::SCHEMA => {
                let (number, name, encoding, text) = schema(body).ok_or_else(damaged)?;
                budget.take_bytes(text.len())?;
                let text = String::from_utf8_lossy(text).into_owned();
                seen.schemas.insert(number, (name.to_owned(), encoding.to_owned(), text));
            }
            op::CHANNEL => {
                let channel = channel(body).ok_or_else(damaged)?;
                let (kind, encoding, text) = seen.schemas.get(&channel.schema).cloned().unwrap_or_default();
                // Other languages of definitions are not read; types of ROS and Unitree are known without.
                let definition = if encoding == "ros2msg" { text } else { String::new() };
                let number = messages.channel(Channel {
                    topic: channel.topic.to_owned(),
                    kind,
                    encoding: channel.encoding.to_owned(),
                    definition,
                })?;
                seen.channels.insert(channel.number, number);
            }
            op::MESSAGE => {
                let (channel, time, data) = message(body).ok_or_else(damaged)?;
                if let Some(number) = seen.channels.get(&channel) {
                    messages.message(*number, i64::try_from(time).unwrap_or(i64::MAX), data, budget)?;
                }
            }
            op::METADATA => {
                let (name, table) = metadata(body).ok_or_else(damaged)?;
                if name == METADATA {
                    messages.own(table);
                }
            }
            // Indexes, statistics, attachments.
            _ => {}
        }
    }
    Ok(outside)
}

fn damaged() -> String {
    "a record is damaged: its body is shorter than its fields, or a text is not UTF-8".to_owned()
}

/// The rest of a record's body. Everything taken is a part of it: no length that the file states takes memory.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        let (part, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(part)
    }

    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    fn u16(&mut self) -> Option<u16> {
        self.number().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.number().map(u64::from_le_bytes)
    }

    /// Bytes with their length before them.
    fn bytes(&mut self) -> Option<&'a [u8]> {
        let length = self.u32()?;
        self.take(usize::try_from(length).ok()?)
    }

    fn text(&mut self) -> Option<&'a str> {
        std::str::from_utf8(self.bytes()?).ok()
    }

    fn table(&mut self) -> Option<BTreeMap<String, String>> {
        let mut inside = Fields(self.bytes()?);
        let mut table = BTreeMap::new();
        while !inside.0.is_empty() {
            table.insert(inside.text()?.to_owned(), inside.text()?.to_owned());
        }
        Some(table)
    }
}

/// A chunk of records.
struct Chunk<'a> {
    /// How they are packed; empty if they are not.
    packing: &'a str,
    records: &'a [u8],
}

fn chunk(body: &[u8]) -> Option<Chunk<'_>> {
    let mut fields = Fields(body);
    // First and last time, size and checksum of what is unpacked: indexes and checks are not needed to read all.
    fields.take(8 + 8 + 8 + 4)?;
    let packing = fields.text()?;
    let length = usize::try_from(fields.u64()?).ok()?;
    Some(Chunk { packing, records: fields.take(length)? })
}

/// Number, name, encoding and text of a schema.
fn schema(body: &[u8]) -> Option<(u16, &str, &str, &[u8])> {
    let mut fields = Fields(body);
    Some((fields.u16()?, fields.text()?, fields.text()?, fields.bytes()?))
}

/// A topic.
struct Topic<'a> {
    number: u16,
    schema: u16,
    topic: &'a str,
    /// Of its messages.
    encoding: &'a str,
}

fn channel(body: &[u8]) -> Option<Topic<'_>> {
    let mut fields = Fields(body);
    let topic = Topic {
        number: fields.u16()?,
        schema: fields.u16()?,
        topic: fields.text()?,
        encoding: fields.text()?,
    };
    fields.table()?;
    Some(topic)
}

/// Channel, time in ns and content of a message.
fn message(body: &[u8]) -> Option<(u16, u64, &[u8])> {
    let mut fields = Fields(body);
    let channel = fields.u16()?;
    let _sequence = fields.u32()?;
    let time = fields.u64()?;
    let _published = fields.u64()?;
    Some((channel, time, fields.0))
}

fn metadata(body: &[u8]) -> Option<(&str, BTreeMap<String, String>)> {
    let mut fields = Fields(body);
    Some((fields.text()?, fields.table()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_beyond_a_record_are_refused() {
        let text = |text: &str| [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat();
        let with_table = |table: &[u8]| {
            let length = (table.len() as u32).to_le_bytes();
            [&[1, 0, 1, 0][..], &text("/joints"), &text("cdr"), &length, table].concat()
        };
        assert!(channel(&with_table(&[text("a"), text("b")].concat())).is_some());
        assert!(schema(&[&[1, 0][..], &text("n"), &text("ros2msg"), &text("x")].concat()).is_some());
        let huge = u32::MAX.to_le_bytes();
        assert!(channel(&with_table(&huge)).is_none());
        assert!(schema(&[&[1, 0][..], &huge, b"name"].concat()).is_none());
        assert!(metadata(&huge).is_none());
        assert!(chunk(&[&[0; 28][..], &huge].concat()).is_none());
        assert!(chunk(&[&[0; 28][..], &text("lz4"), &u64::MAX.to_le_bytes(), b"x"].concat()).is_none());
        assert!(chunk(&[0; 20]).is_none());
        assert!(message(&[0; 21]).is_none());
        assert!(message(&[0; 22]).is_some());
    }
}
