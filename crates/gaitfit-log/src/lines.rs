//! The lines of a log file with their numbers, within limits, as text.

use crate::LogError;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Longest line, bytes: 4096 columns of the longest numbers fit.
const LINE_LIMIT: usize = 1 << 20;

/// The file's lines with their numbers, within the limits.
pub(crate) struct Lines<'a> {
    path: &'a Path,
    input: BufReader<File>,
    line: u64,
    bytes: u64,
    max_bytes: u64,
    buffer: Vec<u8>,
}

impl<'a> Lines<'a> {
    /// Opens a regular file of which at most `max_bytes` will be read.
    pub fn open(path: &'a Path, max_bytes: u64) -> Result<Lines<'a>, LogError> {
        let io = |source| LogError::Io {
            path: path.to_owned(),
            action: "read the log",
            source,
            remedy: "check the path and its permissions",
        };
        let metadata = std::fs::metadata(path).map_err(io)?;
        if !metadata.is_file() {
            return Err(LogError::NotAFile { path: path.to_owned() });
        }
        // Asked first, so that nothing of a huge file is read.
        if metadata.len() > max_bytes {
            return Err(LogError::TooLarge { path: path.to_owned(), limit: max_bytes });
        }
        let input = BufReader::new(File::open(path).map_err(io)?);
        Ok(Lines { path, input, line: 0, bytes: 0, max_bytes, buffer: Vec::new() })
    }

    /// Next line without its end, and its number from 1.
    pub fn next(&mut self) -> Result<Option<(u64, &str)>, LogError> {
        self.buffer.clear();
        // One byte more than the limit tells a line that is too long from one that just fits.
        let read = (&mut self.input)
            .take(LINE_LIMIT as u64 + 1)
            .read_until(b'\n', &mut self.buffer)
            .map_err(|source| LogError::Io {
                path: self.path.to_owned(),
                action: "read the log",
                source,
                remedy: "check the disk",
            })?;
        if read == 0 {
            return Ok(None);
        }
        self.line += 1;
        self.bytes += read as u64;
        // The file may have grown since.
        if self.bytes > self.max_bytes {
            return Err(LogError::TooLarge { path: self.path.to_owned(), limit: self.max_bytes });
        }
        // A binary file has its own message, before anything is said about lines or letters.
        if self.line == 1
            && let Some(hint) = binary_hint(&self.buffer)
        {
            return Err(LogError::NotUtf8 { path: self.path.to_owned(), line: 1, hint });
        }
        if read > LINE_LIMIT {
            return Err(LogError::LineTooLong {
                path: self.path.to_owned(),
                line: self.line,
                limit: LINE_LIMIT,
            });
        }
        let mut text = std::str::from_utf8(&self.buffer).map_err(|_| LogError::NotUtf8 {
            path: self.path.to_owned(),
            line: self.line,
            hint: "save the log as UTF-8 CSV text; if it was, the file is damaged here",
        })?;
        text = text.strip_suffix('\n').unwrap_or(text);
        // Files of Windows end their lines with two characters, and may begin with a mark of their encoding.
        text = text.strip_suffix('\r').unwrap_or(text);
        if self.line == 1 {
            text = text.strip_prefix('\u{feff}').unwrap_or(text);
        }
        Ok(Some((self.line, text)))
    }
}

fn binary_hint(start: &[u8]) -> Option<&'static str> {
    match start {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => Some("it looks like UTF-16; save the log as UTF-8"),
        [0x1f, 0x8b, ..] => Some("it is compressed with gzip; decompress it first"),
        [b'P', b'K', 3, 4, ..] => Some("it is a zip archive or a spreadsheet; export it as CSV"),
        _ => None,
    }
}
