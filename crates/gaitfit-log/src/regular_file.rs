//! Regular files of bounded size: what every command reads.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read};
use std::path::Path;

/// The bytes of a regular file of at most `max` bytes. The kind of file is checked before it is opened: opening a pipe
/// waits for ever, and a device fills the memory.
///
/// # Errors
/// The system's error, and `InvalidInput` for what is no regular file or too large.
pub fn read(path: &Path, max: u64) -> io::Result<Vec<u8>> {
    let too_large = || {
        let limit = if max >= 1 << 20 { format!("{} MiB", max >> 20) } else { format!("{} KiB", max >> 10) };
        io::Error::new(ErrorKind::InvalidInput, format!("larger than {limit}, more than such a file has"))
    };
    if regular(path)?.len() > max {
        return Err(too_large());
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(max + 1).read_to_end(&mut bytes)?;
    // It may have grown.
    if bytes.len() as u64 > max { Err(too_large()) } else { Ok(bytes) }
}

/// The text of a regular file of at most `max` bytes; see [`read`].
///
/// # Errors
/// As [`read`], and `InvalidData` for bytes that are no UTF-8.
pub fn read_text(path: &Path, max: u64) -> io::Result<String> {
    let not_text = |_| io::Error::new(ErrorKind::InvalidData, "not a text in UTF-8");
    String::from_utf8(read(path, max)?).map_err(not_text)
}

/// Refuses what exists and is no regular file.
///
/// # Errors
/// `InvalidInput` for what is no regular file; the system's error for what does not exist.
pub fn regular(path: &Path) -> io::Result<fs::Metadata> {
    let data = fs::metadata(path)?;
    if data.is_file() {
        return Ok(data);
    }
    Err(io::Error::new(ErrorKind::InvalidInput, "not a regular file"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_of_moderate_size_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, "four").unwrap();
        assert_eq!(read_text(&path, 4).unwrap(), "four");
        assert!(read(&path, 3).unwrap_err().to_string().contains("larger than"));
        assert!(read(folder.path(), 4).unwrap_err().to_string().contains("not a regular file"));
        fs::write(&path, [0xff]).unwrap();
        assert!(read_text(&path, 4).unwrap_err().to_string().contains("UTF-8"));
        assert_eq!(read(&folder.path().join("b"), 4).unwrap_err().kind(), ErrorKind::NotFound);
    }
}
