//! Arrays in NumPy's `.npz` archives.

use crate::exit::Failure;
use gaitfit::files;
use gaitfit_log::npy::{self, Npy, NpyError};
use std::fs::File;
use std::io::{BufReader, BufWriter, Error, Read, Seek, Write};
use std::path::Path;
use zip::ZipArchive;
use zip::result::ZipError;
use zip::write::{SimpleFileOptions, ZipWriter};

/// Max bytes of one array that is read: 2²⁶ numbers and a header.
const MAX_BYTES: u64 = (1 << 29) + (1 << 14);

/// An array of numbers, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Length of each dimension.
    pub shape: Vec<usize>,
    /// Length of the first dimension.
    pub rows: usize,
    /// Values.
    pub values: Vec<f64>,
}

impl Array {
    /// An array to be filled.
    pub fn empty(shape: &[usize]) -> Self {
        let values = Vec::with_capacity(shape.iter().product());
        Self { shape: shape.to_vec(), rows: shape.first().copied().unwrap_or(0), values }
    }
}

/// Reads the arrays called `names`.
pub fn read(path: &Path, names: &[&str]) -> Result<Vec<Array>, Failure> {
    let shown = path.display();
    // Asked before opening: a pipe without a writer would hang.
    if std::fs::metadata(path).is_ok_and(|data| !data.is_file()) {
        return Err(Failure::failed(format!(
            "{shown}: not a regular file; name an archive written with numpy.savez"
        )));
    }
    let file = File::open(path).map_err(|error| {
        Failure::failed(format!("cannot read {shown}: {error}; check the path and the permissions"))
    })?;
    let mut archive = ZipArchive::new(BufReader::new(file)).map_err(|error| {
        Failure::failed(format!("{shown}: no .npz archive ({error}); write it with numpy.savez"))
    })?;
    let found: Vec<String> =
        archive.file_names().flatten().map(|name| name.trim_end_matches(".npy").to_owned()).collect();
    let mut arrays = Vec::with_capacity(names.len());
    for name in names {
        let entry = match archive.by_name(&format!("{name}.npy")) {
            Ok(entry) => entry,
            Err(ZipError::FileNotFound) => {
                let found = found.join(", ");
                return Err(Failure::failed(format!(
                    "{shown}: there is no array `{name}`; it holds {found}"
                )));
            }
            Err(error) => return Err(Failure::failed(format!("{shown}: cannot read `{name}`: {error}"))),
        };
        arrays.push(array(entry).map_err(|problem| {
            Failure::failed(format!("{shown}: `{name}`: {problem}; write it again with numpy.savez"))
        })?);
    }
    Ok(arrays)
}

fn array(entry: impl Read) -> Result<Array, String> {
    let mut bytes = Vec::new();
    entry.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err("more values than the program takes; split the file".into());
    }
    let array = Npy::parse(&bytes).map_err(|error| error.to_string())?;
    if !array.dtype.is_float() {
        return Err("neither float64 nor float32; save astype(float) of it".into());
    }
    let values = array.numbers().ok_or_else(|| NpyError::Cut.to_string())?;
    Ok(Array { rows: array.shape.first().copied().unwrap_or(0), shape: array.shape, values })
}

/// Writes an archive whole or not at all.
pub fn write(path: &Path, arrays: &[(&'static str, Array)]) -> Result<(), Failure> {
    Ok(files::write_with(path, |file| fill(BufWriter::new(file), arrays))?)
}

fn fill(out: impl Write + Seek, arrays: &[(&'static str, Array)]) -> Result<(), Error> {
    let mut archive = ZipWriter::new(out);
    for (name, array) in arrays {
        archive.start_file(format!("{name}.npy"), SimpleFileOptions::default())?;
        archive.write_all(&npy::bytes(&array.shape, &array.values))?;
    }
    archive.finish()?.flush()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        let a =
            Array { shape: vec![2, 3], rows: 2, values: vec![1.0, 2.0, 3.0, 4.0, f64::MIN_POSITIVE, -0.1] };
        write(&path, &[("a", a.clone()), ("b", Array::empty(&[0, 4]))]).unwrap();
        assert_eq!(read(&path, &["a", "b"]).unwrap(), [a, Array::empty(&[0, 4])]);
        let error = read(&path, &["c"]).unwrap_err();
        assert!(error.message.contains("a, b"), "{error}");
    }

    #[test]
    fn other_files_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        std::fs::write(&path, b"not a zip").unwrap();
        assert!(read(&path, &["a"]).unwrap_err().message.contains("numpy.savez"));
        assert!(write(&folder.path().join("none/a.npz"), &[]).is_err());
    }
}
