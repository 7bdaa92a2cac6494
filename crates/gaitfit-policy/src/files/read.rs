//! A policy from a path, whatever wrote it.

use super::{Description, onnx, weights};
use crate::error::invalid;
use crate::{Policy, PolicyError};
use std::fs::File;
use std::io::{Error, ErrorKind, Read};
use std::path::{Path, PathBuf};

/// Largest policy file.
const MOST_BYTES: u64 = 32 << 20;

/// Reads a policy: `.safetensors` and `.onnx` written by this program, or a `.toml` that describes a policy trained
/// elsewhere ([`Description`]).
///
/// # Errors
/// [`PolicyError`], always with the file's name.
pub fn read(path: &Path) -> Result<Policy, PolicyError> {
    let inside = |source| PolicyError::In { path: path.to_owned(), source: Box::new(source) };
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    match ending.as_deref() {
        Some("safetensors") => weights::read(&bytes(path)?).map_err(inside),
        Some("onnx") => onnx::read(&bytes(path)?).map_err(inside),
        Some("toml") => description(path)?.load(folder(path)).map_err(inside),
        _ => Err(inside(invalid("no policy by its ending; give a .safetensors, .onnx or .toml file"))),
    }
}

/// The files that [`read`] reads: the one named, and the weights that a description names.
///
/// # Errors
/// A description that cannot be read.
pub fn files_of(path: &Path) -> Result<Vec<PathBuf>, PolicyError> {
    let mut files = vec![path.to_owned()];
    if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")) {
        files.push(folder(path).join(description(path)?.file));
    }
    Ok(files)
}

fn folder(path: &Path) -> &Path {
    path.parent().unwrap_or(Path::new(""))
}

fn description(path: &Path) -> Result<Description, PolicyError> {
    let inside = |source| PolicyError::In { path: path.to_owned(), source: Box::new(source) };
    let bytes = bytes(path)?;
    let text = std::str::from_utf8(&bytes).map_err(|error| inside(invalid(error.to_string())))?;
    Description::parse(text).map_err(inside)
}

/// The bytes of a regular file of moderate size: a pipe would hang, a device would fill the memory.
pub(super) fn bytes(path: &Path) -> Result<Vec<u8>, PolicyError> {
    let read = || -> std::io::Result<Vec<u8>> {
        if !std::fs::metadata(path)?.is_file() {
            return Err(Error::new(ErrorKind::InvalidInput, "not a regular file"));
        }
        let mut bytes = Vec::new();
        File::open(path)?.take(MOST_BYTES + 1).read_to_end(&mut bytes)?;
        if bytes.len() as u64 > MOST_BYTES {
            return Err(Error::new(
                ErrorKind::InvalidInput,
                "larger than 32 MiB, no policy of a legged robot",
            ));
        }
        Ok(bytes)
    };
    read().map_err(|source| PolicyError::Read { path: path.to_owned(), source })
}
