//! TensorBoard event files: scalars by tag and step.
//!
//! An event file is a sequence of records (TensorFlow's `record_writer`): length as `u64`, its masked CRC-32C, the
//! payload, its masked CRC-32C, all little-endian. A payload is an `Event` message of TensorFlow's `event.proto`.

use prost::Message;
use std::fs::{File, OpenOptions};
use std::io::{self, BufReader, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Version in the first record of every file.
const VERSION: &str = "brain.Event:2";
/// Largest record; scalars need far less.
const MAX_BYTES: u64 = 16 << 20;
/// Bytes of a record before its payload: the length and its checksum.
const HEAD: u64 = 12;
/// Bytes of a record after its payload: the payload's checksum.
const TAIL: u64 = 4;

#[derive(Clone, PartialEq, Message)]
struct Event {
    /// Seconds since 1970.
    #[prost(double, tag = "1")]
    wall_time: f64,
    #[prost(int64, tag = "2")]
    step: i64,
    #[prost(string, optional, tag = "3")]
    file_version: Option<String>,
    #[prost(message, optional, tag = "5")]
    summary: Option<Summary>,
}

#[derive(Clone, PartialEq, Message)]
struct Summary {
    #[prost(message, repeated, tag = "1")]
    value: Vec<Value>,
}

#[derive(Clone, PartialEq, Message)]
struct Value {
    #[prost(string, tag = "1")]
    tag: String,
    #[prost(float, optional, tag = "2")]
    simple_value: Option<f32>,
}

/// An event file that is being written.
#[derive(Debug)]
pub struct EventFile {
    file: File,
}

impl EventFile {
    /// Opens the file, or makes it; TensorBoard finds names that contain `tfevents`, for example
    /// `events.out.tfevents.0.train`. What a crash left torn at its end is cut off, and so is every record of a
    /// step after `last_step`, which a resumed run writes again.
    ///
    /// # Errors
    /// The system's error, and `InvalidData` for a file of something else.
    pub fn open(path: &Path, last_step: Option<u64>) -> io::Result<Self> {
        match crate::files::regular(path) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        let mut file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path)?;
        let length = file.metadata()?.len();
        // A record that is torn hides all that follow, because nothing else says where the next one begins.
        let keep = whole_records(&file, length, last_step)?;
        file.set_len(keep)?;
        file.seek(SeekFrom::End(0))?;
        let mut events = Self { file };
        if keep == 0 {
            events.file.write_all(&first_record())?;
        }
        Ok(events)
    }

    /// Appends one record of scalars, stored as `f32`; `wall_time` in seconds since 1970.
    ///
    /// # Errors
    /// The system's error.
    pub fn scalars(&mut self, step: u64, wall_time: f64, scalars: &[(&str, f64)]) -> io::Result<()> {
        let value =
            |&(tag, value): &(&str, f64)| Value { tag: tag.to_owned(), simple_value: Some(value as f32) };
        let summary = Some(Summary { value: scalars.iter().map(value).collect() });
        // Steps of TensorFlow's events are signed.
        let step = i64::try_from(step).unwrap_or(i64::MAX);
        self.append(&Event { wall_time, step, file_version: None, summary })
    }

    fn append(&mut self, event: &Event) -> io::Result<()> {
        self.file.write_all(&record(event))
    }
}

fn record(event: &Event) -> Vec<u8> {
    let payload = event.encode_to_vec();
    let length = (payload.len() as u64).to_le_bytes();
    // `HEAD` and `TAIL` together.
    let mut record = Vec::with_capacity(payload.len() + 16);
    record.extend(length);
    record.extend(masked_crc(&length).to_le_bytes());
    record.extend(&payload);
    record.extend(masked_crc(&payload).to_le_bytes());
    record
}

/// Returns the first record of every file.
fn first_record() -> Vec<u8> {
    record(&Event { file_version: Some(VERSION.to_owned()), ..Event::default() })
}

/// CRC-32C, rotated and offset as TensorFlow's crc32c.h does it, so that a checksum of data with checksums in it is
/// none of them.
fn masked_crc(bytes: &[u8]) -> u32 {
    crc32c::crc32c(bytes).rotate_right(15).wrapping_add(0xa282_ead8)
}

/// The place up to which the records are whole and of steps up to `last_step`.
fn whole_records(file: &File, length: u64, last_step: Option<u64>) -> io::Result<u64> {
    let mut reader = BufReader::new(file);
    let first = first_record();
    let mut start = Vec::new();
    reader.by_ref().take(first.len() as u64).read_to_end(&mut start)?;
    // A file of another program must not be cut. An empty or torn one is a beginning of the first record.
    if !event_file(&start) {
        let why = "no TensorBoard event file; move it away or write elsewhere";
        return Err(io::Error::new(ErrorKind::InvalidData, why));
    }
    reader.rewind()?;
    let last_step = last_step.map_or(i64::MAX, |last| i64::try_from(last).unwrap_or(i64::MAX));
    let mut good = 0;
    while let Some((size, event)) = next(&mut reader, length - good)? {
        // The first record has the version and no step. It stays whatever `last_step` is.
        if good > 0 && event.step > last_step {
            break;
        }
        good += size;
    }
    Ok(good)
}

/// Whether a file that starts so is this program's, perhaps cut short.
fn event_file(start: &[u8]) -> bool {
    first_record().starts_with(start)
}

/// The next record's size and content; `None` at the end and where it is torn.
fn next(reader: &mut impl Read, rest: u64) -> io::Result<Option<(u64, Event)>> {
    // Too short for any record: the end of the file, or a torn one.
    if rest < HEAD + TAIL {
        return Ok(None);
    }
    let mut head = [0; HEAD as usize];
    reader.read_exact(&mut head)?;
    let ([length], [crc]) = (head[..8].as_chunks().0, head[8..].as_chunks().0) else { return Ok(None) };
    let size = u64::from_le_bytes(*length);
    // The size is checked before memory of this size is taken. `rest` is at least `HEAD + TAIL`, see above.
    if masked_crc(length) != u32::from_le_bytes(*crc) || size > MAX_BYTES || size > rest - HEAD - TAIL {
        return Ok(None);
    }
    let mut payload = vec![0; size as usize];
    reader.read_exact(&mut payload)?;
    let mut crc = [0; TAIL as usize];
    reader.read_exact(&mut crc)?;
    if masked_crc(&payload) != u32::from_le_bytes(crc) {
        return Ok(None);
    }
    Ok(Event::decode(payload.as_slice()).ok().map(|event| (HEAD + size + TAIL, event)))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    /// Steps and values of a file.
    fn events(path: &Path) -> Vec<Event> {
        let bytes = std::fs::read(path).unwrap();
        let (mut rest, mut events) = (bytes.as_slice(), Vec::new());
        while let Some((_, event)) = read_next(&mut rest) {
            events.push(event);
        }
        assert!(rest.is_empty(), "{} bytes are no record", rest.len());
        events
    }

    fn read_next(rest: &mut &[u8]) -> Option<(u64, Event)> {
        let length = rest.len() as u64;
        next(rest, length).unwrap()
    }

    fn steps(path: &Path) -> Vec<i64> {
        events(path).iter().map(|event| event.step).collect()
    }

    #[test]
    fn the_checksum_is_the_published_one() {
        // CRC-32C of "123456789" is 0xe3069283 (RFC 3720's polynomial); masked by TensorFlow's formula.
        assert_eq!(masked_crc(b"123456789"), 0xe306_9283_u32.rotate_right(15).wrapping_add(0xa282_ead8));
        assert_eq!(masked_crc(b""), 0xa282_ead8);
    }

    #[test]
    fn scalars_are_read_back_and_appended_to() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events.out.tfevents.0.test");
        let mut file = EventFile::open(&path, None).unwrap();
        file.scalars(0, 1.5e9, &[("reward/total", 1.25), ("kl", -0.5)]).unwrap();
        drop(file);
        EventFile::open(&path, None).unwrap().scalars(1, 1.5e9 + 0.25, &[("reward/total", 2.0)]).unwrap();
        let events = events(&path);
        assert_eq!(events.len(), 3);
        assert_eq!(events[0].file_version.as_deref(), Some(VERSION));
        let values: Vec<_> = events[1].summary.as_ref().unwrap().value.iter().collect();
        assert_eq!((values[0].tag.as_str(), values[0].simple_value), ("reward/total", Some(1.25)));
        assert_eq!((values[1].tag.as_str(), values[1].simple_value), ("kl", Some(-0.5)));
        assert_eq!((events[2].step, events[2].wall_time), (1, 1.5e9 + 0.25));
    }

    #[test]
    fn a_torn_record_is_cut_off_wherever_it_was_torn() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events.out.tfevents.0.test");
        let mut file = EventFile::open(&path, None).unwrap();
        file.scalars(1, 0.0, &[("a", 1.0)]).unwrap();
        let whole = std::fs::metadata(&path).unwrap().len() as usize;
        file.scalars(2, 0.0, &[("a", 2.0)]).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        for length in 0..bytes.len() {
            std::fs::write(&path, &bytes[..length]).unwrap();
            EventFile::open(&path, None).unwrap().scalars(3, 0.0, &[("a", 3.0)]).unwrap();
            let expected = if length < whole { vec![0, 3] } else { vec![0, 1, 3] };
            assert_eq!(steps(&path), expected, "{length}");
        }
        // A flipped bit is a torn record too.
        let mut damaged = bytes.clone();
        *damaged.last_mut().unwrap() ^= 1;
        std::fs::write(&path, &damaged).unwrap();
        drop(EventFile::open(&path, None).unwrap());
        assert_eq!(steps(&path), [0, 1]);
    }

    #[test]
    fn a_resumed_run_forgets_later_steps() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events.out.tfevents.0.test");
        let mut file = EventFile::open(&path, None).unwrap();
        for step in 1..=5 {
            file.scalars(step, 0.0, &[("a", step as f64)]).unwrap();
        }
        EventFile::open(&path, Some(3)).unwrap().scalars(4, 9.0, &[("a", 40.0)]).unwrap();
        assert_eq!(steps(&path), [0, 1, 2, 3, 4]);
        assert_eq!(events(&path)[4].wall_time, 9.0);
    }

    #[test]
    fn another_file_is_not_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("thesis.txt");
        for text in ["years of work".to_owned(), "years of work ".repeat(100)] {
            std::fs::write(&path, &text).unwrap();
            assert_eq!(EventFile::open(&path, None).unwrap_err().kind(), ErrorKind::InvalidData);
            assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
        }
    }

    #[test]
    #[ignore = "needs the Python packages of tools/setup_venv.sh"]
    fn python_tensorboard_reads_the_file() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let python = root.join(".venv/bin/python");
        let folder = tempfile::tempdir().unwrap();
        let mut file = EventFile::open(&folder.path().join("events.out.tfevents.0.test"), None).unwrap();
        file.scalars(10, 1.5e9, &[("reward/total", 1.25), ("kl", -0.5)]).unwrap();
        file.scalars(20, 1.5e9 + 1.0, &[("reward/total", 2.5)]).unwrap();
        let read = std::process::Command::new(&python)
            .arg(root.join("tools/read_events.py"))
            .arg(folder.path())
            .output()
            .unwrap();
        let values: serde_json::Value = serde_json::from_slice(&read.stdout)
            .unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&read.stderr)));
        assert_eq!(
            values,
            serde_json::json!({ "reward/total": [[10, 1.25], [20, 2.5]], "kl": [[10, -0.5]] })
        );
    }
}
