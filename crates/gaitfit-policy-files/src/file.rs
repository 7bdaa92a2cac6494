//! Files that may hold a policy, read within bounds.

use gaitfit_policy::PolicyError;
use std::fs::File;
use std::io::{Error, ErrorKind, Read};
use std::path::Path;

/// Largest policy file.
const MAX_BYTES: u64 = 32 << 20;

/// The ending of a file's name, in small letters.
pub(super) fn ending(path: &Path) -> Option<String> {
    path.extension().map(|ending| ending.to_string_lossy().to_lowercase())
}

/// The bytes of a regular file of moderate size: a pipe would hang, a device would fill the memory.
pub(super) fn bytes(path: &Path) -> Result<Vec<u8>, PolicyError> {
    let read = || -> std::io::Result<Vec<u8>> {
        if !std::fs::metadata(path)?.is_file() {
            return Err(Error::new(ErrorKind::InvalidInput, "not a regular file"));
        }
        let mut bytes = Vec::new();
        // One byte more than allowed tells a file that is too large, also one that grows while it is read.
        File::open(path)?.take(MAX_BYTES + 1).read_to_end(&mut bytes)?;
        if bytes.len() as u64 > MAX_BYTES {
            return Err(Error::new(
                ErrorKind::InvalidInput,
                "larger than 32 MiB, no policy of a legged robot",
            ));
        }
        Ok(bytes)
    };
    read().map_err(|source| PolicyError::Read { path: path.to_owned(), source })
}
