//! A writer of MCAP records, in the layout of the format's own libraries: data, then a summary with all schemas, channels,
//! statistics and indexes, so that viewers can jump to a time.

use super::{MAGIC, op};
use std::collections::BTreeMap;
use std::io::{Result, Write};

/// A chunk is closed when it is larger than this, bytes. Smaller chunks let a reader jump more precisely; the format's
/// libraries use the same size.
const CHUNK_BYTES: usize = 1 << 20;

/// The body of a record.
#[derive(Clone, Debug, Default)]
struct Body(Vec<u8>);

impl Body {
    fn u16(mut self, number: u16) -> Self {
        self.0.extend(number.to_le_bytes());
        self
    }

    fn u32(mut self, number: u32) -> Self {
        self.0.extend(number.to_le_bytes());
        self
    }

    fn u64(mut self, number: u64) -> Self {
        self.0.extend(number.to_le_bytes());
        self
    }

    /// Bytes with their length before them.
    fn bytes(self, bytes: &[u8]) -> Self {
        let mut body = self.u32(bytes.len() as u32);
        body.0.extend(bytes);
        body
    }

    fn text(self, text: &str) -> Self {
        self.bytes(text.as_bytes())
    }

    fn texts(self, table: &BTreeMap<String, String>) -> Self {
        let inside = table.iter().fold(Body::default(), |inside, (key, value)| inside.text(key).text(value));
        self.bytes(&inside.0)
    }

    fn numbers(self, table: &BTreeMap<u16, u64>) -> Self {
        let inside = table.iter().fold(Body::default(), |inside, (key, value)| inside.u16(*key).u64(*value));
        self.bytes(&inside.0)
    }

    /// The whole record.
    fn record(self, code: u8) -> Vec<u8> {
        let mut record = vec![code];
        record.extend((self.0.len() as u64).to_le_bytes());
        record.extend(self.0);
        record
    }
}

/// First and last time of messages, ns; zeros without messages.
#[derive(Clone, Copy, Debug, Default)]
struct Span(Option<[u64; 2]>);

impl Span {
    fn add(&mut self, time: u64) {
        let [first, last] = self.0.unwrap_or([time; 2]);
        self.0 = Some([first.min(time), last.max(time)]);
    }

    fn times(self) -> [u64; 2] {
        self.0.unwrap_or_default()
    }
}

/// Records that are not in the file yet.
#[derive(Debug, Default)]
struct Chunk {
    records: Vec<u8>,
    span: Span,
    /// Time and place in the chunk of each channel's messages.
    index: BTreeMap<u16, Vec<[u64; 2]>>,
}

/// Writes a file of ROS 2 messages. Nothing is read back or written twice: any sink will do.
#[derive(Debug)]
pub(super) struct Writer<W: Write> {
    sink: W,
    place: u64,
    checksum: crc32fast::Hasher,
    /// The chunk that is being filled; absent where messages are written at once.
    chunk: Option<Chunk>,
    /// Type and definition.
    schemas: Vec<(String, String)>,
    /// Whole records of the summary.
    schema_records: Vec<u8>,
    channel_records: Vec<u8>,
    chunk_indexes: Vec<u8>,
    metadata_indexes: Vec<u8>,
    chunks: u32,
    metadata: u32,
    span: Span,
    /// Messages of each channel.
    counts: BTreeMap<u16, u64>,
    /// The end is written, or cannot be because the sink failed.
    closed: bool,
}

impl<W: Write> Writer<W> {
    /// Begins a file; with `chunked`, messages are collected into chunks of a megabyte.
    pub fn new(sink: W, chunked: bool) -> Result<Self> {
        let mut writer = Writer {
            sink,
            place: 0,
            checksum: crc32fast::Hasher::new(),
            chunk: chunked.then(Chunk::default),
            schemas: Vec::new(),
            schema_records: Vec::new(),
            channel_records: Vec::new(),
            chunk_indexes: Vec::new(),
            metadata_indexes: Vec::new(),
            chunks: 0,
            metadata: 0,
            span: Span::default(),
            counts: BTreeMap::new(),
            closed: false,
        };
        writer.put(MAGIC)?;
        writer.put(&Body::default().text("ros2").text("gaitfit").record(op::HEADER))?;
        Ok(writer)
    }

    /// A named table of texts.
    pub fn metadata(&mut self, name: &str, table: &BTreeMap<String, String>) -> Result<()> {
        self.close_chunk()?;
        let record = Body::default().text(name).texts(table).record(op::METADATA);
        let index = Body::default().u64(self.place).u64(record.len() as u64).text(name);
        self.metadata_indexes.extend(index.record(op::METADATA_INDEX));
        self.metadata += 1;
        self.put(&record)
    }

    /// A new topic of messages of a type with a `ros2msg` definition; returns its channel.
    pub fn channel(&mut self, topic: &str, kind: &str, definition: &str) -> Result<u16> {
        let known = self.schemas.iter().position(|(other, text)| other == kind && text == definition);
        let schema = known.map_or(self.schemas.len(), |place| place) as u16 + 1;
        if known.is_none() {
            self.schemas.push((kind.to_owned(), definition.to_owned()));
            let body = Body::default().u16(schema).text(kind).text("ros2msg").text(definition);
            let record = body.record(op::SCHEMA);
            self.schema_records.extend(&record);
            self.add(record)?;
        }
        let channel = self.counts.len() as u16 + 1;
        self.counts.insert(channel, 0);
        let body = Body::default().u16(channel).u16(schema).text(topic).text("cdr").texts(&BTreeMap::new());
        let record = body.record(op::CHANNEL);
        self.channel_records.extend(&record);
        self.add(record)?;
        Ok(channel)
    }

    /// A message at a time, ns.
    pub fn message(&mut self, channel: u16, sequence: u32, time: u64, data: &[u8]) -> Result<()> {
        self.span.add(time);
        *self.counts.entry(channel).or_default() += 1;
        if self.chunk.as_ref().is_some_and(|chunk| chunk.records.len() > CHUNK_BYTES) {
            self.close_chunk()?;
        }
        let mut body = Body::default().u16(channel).u32(sequence).u64(time).u64(time);
        body.0.extend(data);
        if let Some(chunk) = &mut self.chunk {
            chunk.span.add(time);
            chunk.index.entry(channel).or_default().push([time, chunk.records.len() as u64]);
        }
        self.add(body.record(op::MESSAGE))
    }

    /// Hands everything to the sink and flushes it.
    pub fn flush(&mut self) -> Result<()> {
        self.close_chunk()?;
        self.sink.flush()
    }

    /// Writes the summary and the end of the file, once.
    pub fn finish(&mut self) -> Result<()> {
        if self.closed {
            return Ok(());
        }
        self.close_chunk()?;
        self.closed = true;
        let end = Body::default().u32(self.checksum.clone().finalize()).record(op::DATA_END);
        let start = self.place + end.len() as u64;
        let (mut summary, mut offsets) = (Vec::new(), Vec::new());
        for (code, records) in [
            (op::SCHEMA, std::mem::take(&mut self.schema_records)),
            (op::CHANNEL, std::mem::take(&mut self.channel_records)),
            (op::STATISTICS, self.statistics()),
            (op::CHUNK_INDEX, std::mem::take(&mut self.chunk_indexes)),
            (op::METADATA_INDEX, std::mem::take(&mut self.metadata_indexes)),
        ] {
            if records.is_empty() {
                continue;
            }
            let mut offset = Body(vec![code]).u64(start + summary.len() as u64);
            offset = offset.u64(records.len() as u64);
            offsets.extend(offset.record(op::SUMMARY_OFFSET));
            summary.extend(records);
        }
        let offsets_start = start + summary.len() as u64;
        summary.extend(offsets);
        // The checksum is over the footer too, up to itself.
        summary.push(op::FOOTER);
        summary.extend(Body::default().u64(20).u64(start).u64(offsets_start).0);
        let checksum = crc32fast::hash(&summary);
        let parts = [&end[..], &summary, &checksum.to_le_bytes(), MAGIC];
        parts.into_iter().try_for_each(|part| self.sink.write_all(part))?;
        self.sink.flush()
    }

    fn statistics(&self) -> Vec<u8> {
        let [first, last] = self.span.times();
        let body = Body::default()
            .u64(self.counts.values().sum())
            .u16(self.schemas.len() as u16)
            .u32(self.counts.len() as u32)
            .u32(0) // attachments
            .u32(self.metadata)
            .u32(self.chunks);
        let counts = self.counts.iter().filter(|(_, count)| **count > 0);
        let counts = counts.map(|(channel, count)| (*channel, *count)).collect();
        body.u64(first).u64(last).numbers(&counts).record(op::STATISTICS)
    }

    /// Adds a record to the chunk, or to the file.
    fn add(&mut self, record: Vec<u8>) -> Result<()> {
        match &mut self.chunk {
            Some(chunk) => {
                chunk.records.extend(record);
                Ok(())
            }
            None => self.put(&record),
        }
    }

    /// Writes the chunk with the indexes of its messages.
    fn close_chunk(&mut self) -> Result<()> {
        let Some(chunk) = self.chunk.as_mut().filter(|chunk| !chunk.records.is_empty()) else {
            return Ok(());
        };
        let Chunk { records, span, index } = std::mem::take(chunk);
        let (size, [first, last], start) = (records.len() as u64, span.times(), self.place);
        let mut body = Body::default().u64(first).u64(last).u64(size).u32(crc32fast::hash(&records));
        body = body.text("").u64(size);
        body.0.extend(records);
        self.put(&body.record(op::CHUNK))?;
        let indexes_start = self.place;
        let mut places = BTreeMap::new();
        for (channel, messages) in index {
            places.insert(channel, self.place);
            let entries =
                messages.iter().fold(Body::default(), |entries, [time, at]| entries.u64(*time).u64(*at));
            self.put(&Body::default().u16(channel).bytes(&entries.0).record(op::MESSAGE_INDEX))?;
        }
        let body = Body::default().u64(first).u64(last).u64(start).u64(indexes_start - start);
        let body = body.numbers(&places).u64(self.place - indexes_start).text("").u64(size).u64(size);
        self.chunk_indexes.extend(body.record(op::CHUNK_INDEX));
        self.chunks += 1;
        Ok(())
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        let written = self.sink.write_all(bytes);
        // An end behind half a record would hide where the file broke.
        self.closed |= written.is_err();
        written?;
        self.place += bytes.len() as u64;
        self.checksum.update(bytes);
        Ok(())
    }
}

impl<W: Write> Drop for Writer<W> {
    fn drop(&mut self) {
        // Without its end the file is read as well.
        let _ = self.finish();
    }
}
