//! Arrays in NumPy's `.npz` archives.

use crate::exit::Failure;
use gaitfit::files;
use npyz::{NpyFile, Order, WriterBuilder};
use std::fs::File;
use std::io::{BufReader, BufWriter, Error, ErrorKind, Seek, Write};
use std::path::Path;
use zip::ZipArchive;
use zip::result::ZipError;
use zip::write::{SimpleFileOptions, ZipWriter};

/// Most values of one array read: 512 MiB.
const MAX_VALUES: u64 = 1 << 26;

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
    // Names are listed before an array is borrowed from the archive; a message may need them.
    let stored: Vec<String> =
        archive.file_names().flatten().map(|name| name.trim_end_matches(".npy").to_owned()).collect();
    let mut arrays = Vec::with_capacity(names.len());
    for name in names {
        let entry = match archive.by_name(&format!("{name}.npy")) {
            Ok(entry) => entry,
            Err(ZipError::FileNotFound) => {
                let stored = stored.join(", ");
                return Err(Failure::failed(format!(
                    "{shown}: there is no array `{name}`; it holds {stored}"
                )));
            }
            Err(error) => return Err(Failure::failed(format!("{shown}: cannot read `{name}`: {error}"))),
        };
        arrays.push(array(entry).map_err(|error| {
            Failure::failed(format!("{shown}: `{name}`: {}; write it again with numpy.savez", brief(&error)))
        })?);
    }
    Ok(arrays)
}

/// An error in a line: a damaged header comes back whole in the parser's message.
fn brief(error: &Error) -> String {
    // The error may quote the header of a damaged file, which can be long. Two lines of a terminal are enough.
    const MAX_CHARACTERS: usize = 160;
    if error.kind() == ErrorKind::UnexpectedEof {
        return "the array is cut short".to_owned();
    }
    let text = error.to_string();
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    match line.char_indices().nth(MAX_CHARACTERS) {
        Some((end, _)) => format!("{}…", &line[..end]),
        None => line,
    }
}

fn array(entry: impl std::io::Read) -> Result<Array, Error> {
    let refuse = |why: &str| Error::new(ErrorKind::InvalidData, why.to_owned());
    let file = NpyFile::new(entry)?;
    // Values are read one after the other. Column by column they would be states with mixed numbers.
    if file.order() != Order::C {
        return Err(refuse("stored column by column; save numpy.ascontiguousarray(…) of it"));
    }
    let lengths = file.shape().to_vec();
    // A damaged header can claim any shape. So its size is checked, without overflow, before memory is taken.
    let count = lengths.iter().try_fold(1_u64, |product, length| product.checked_mul(*length));
    if count.is_none_or(|count| count > MAX_VALUES) {
        return Err(refuse("more values than the program takes; split the file"));
    }
    let shape: Vec<usize> = lengths.iter().map(|length| *length as usize).collect();
    let values = match file.try_data::<f64>() {
        Ok(values) => values.collect::<Result<Vec<f64>, Error>>()?,
        // Other trainers often save f32.
        Err(file) => match file.try_data::<f32>() {
            Ok(values) => values.map(|value| value.map(f64::from)).collect::<Result<Vec<f64>, Error>>()?,
            Err(_) => return Err(refuse("neither float64 nor float32; save astype(float) of it")),
        },
    };
    Ok(Array { rows: shape.first().copied().unwrap_or(0), shape, values })
}

/// Writes an archive whole or not at all.
pub fn write(path: &Path, arrays: &[(&'static str, Array)]) -> Result<(), Failure> {
    Ok(files::write_with(path, |file| fill(BufWriter::new(file), arrays))?)
}

fn fill(out: impl Write + Seek, arrays: &[(&'static str, Array)]) -> Result<(), Error> {
    let mut archive = ZipWriter::new(out);
    for (name, array) in arrays {
        archive.start_file(format!("{name}.npy"), SimpleFileOptions::default())?;
        let shape: Vec<u64> = array.shape.iter().map(|length| *length as u64).collect();
        let mut writer =
            npyz::WriteOptions::new().default_dtype().shape(&shape).writer(&mut archive).begin_nd()?;
        writer.extend(array.values.iter().copied())?;
        writer.finish()?;
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
