//! npy and npz files of NumPy.

use crate::arrays::{Array, Arrays};
use crate::budget::{Budget, read_all};
use gaitfit_log::npy::{Npy, NpyError};
use gaitfit_model::shown;
use std::io::Cursor;
use zip::ZipArchive;

/// Most files in an archive.
pub(crate) const MOST_ENTRIES: usize = 10_000;

/// The arrays of an npz archive. Arrays of Python objects are refused: they are pickles.
pub(crate) fn read_npz(bytes: &[u8], budget: &mut Budget) -> Result<Arrays, String> {
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|error| format!("zip: {error}"))?;
    if archive.len() > MOST_ENTRIES {
        return Err(format!("{} files in it; is this a log?", archive.len()));
    }
    let mut arrays = Arrays::default();
    for i in 0..archive.len() {
        let entry = archive.by_index(i).map_err(|error| format!("zip: {error}"))?;
        let name = entry.name().map_err(|error| format!("zip: {error}"))?.trim_end_matches(".npy").to_owned();
        let content = read_all(entry, budget, "zip")?;
        add(&name, &content, &mut arrays, budget)?;
    }
    Ok(arrays)
}

/// Reads one npy file as the array `name`.
pub(crate) fn add(name: &str, bytes: &[u8], arrays: &mut Arrays, budget: &mut Budget) -> Result<(), String> {
    let refuse = |problem: &dyn std::fmt::Display| format!("{}: {problem}", shown(name));
    let array = Npy::parse(bytes).map_err(|error| refuse(&error))?;
    budget.take_values(array.elements)?;
    if array.dtype.is_text() {
        let words = array.words().ok_or_else(|| refuse(&"words that are no text"))?;
        arrays.words.insert(name.to_owned(), words);
    } else {
        let data = array.numbers().ok_or_else(|| refuse(&NpyError::Cut))?;
        arrays.numbers.insert(name.to_owned(), Array { shape: array.shape, data });
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_log::npy;

    /// NumPy wrote the fixture: its files of numbers are those that gaitfit writes.
    #[test]
    fn arrays_are_written_as_numpy_writes_them() {
        let bytes = include_bytes!("../tests/fixtures/motion.npz");
        let mut archive = ZipArchive::new(Cursor::new(&bytes[..])).unwrap();
        let mut compared = 0;
        for i in 0..archive.len() {
            let mut file = Vec::new();
            std::io::Read::read_to_end(&mut archive.by_index(i).unwrap(), &mut file).unwrap();
            let array = Npy::parse(&file).unwrap();
            if array.dtype == npy::DType::parse("<f8").unwrap() && !array.fortran {
                assert_eq!(npy::bytes(&array.shape, &array.numbers().unwrap()), file, "{:?}", array.shape);
                compared += 1;
            }
        }
        assert!(compared > 1, "{compared}");
    }
}
