//! PyTorch's files (`torch.save`), such as PACE's recordings: a zip archive of a pickle and raw numbers.

use crate::archive_error::{ArchiveError, MAX_PICKLE};
use crate::arrays::Arrays;
use crate::budget::{Budget, read_all};
use crate::npz::MAX_ENTRIES;
use crate::pickle;
use crate::problem::Problem;
use std::collections::HashMap;
use std::io::Cursor;
use std::rc::Rc;
use zip::ZipArchive;

/// Whether a zip archive is one of PyTorch.
pub(crate) fn is_torch(bytes: &[u8]) -> bool {
    let archive = ZipArchive::new(Cursor::new(bytes));
    archive.is_ok_and(|archive| archive.len() <= MAX_ENTRIES && pickle_name(&archive).is_some())
}

fn pickle_name(archive: &ZipArchive<Cursor<&[u8]>>) -> Option<String> {
    let mut names = archive.file_names().flatten();
    names.find(|name| *name == "data.pkl" || name.ends_with("/data.pkl")).map(|name| name.into_owned())
}

/// The named arrays of the file.
pub(crate) fn read(bytes: &[u8], budget: &mut Budget) -> Result<Arrays, Problem> {
    let damaged = |error: zip::result::ZipError| ArchiveError::Zip(error.to_string());
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(damaged)?;
    let name = pickle_name(&archive).ok_or(ArchiveError::NoPickle)?;
    let folder = name.strip_suffix("data.pkl").unwrap_or("").to_owned();
    // Older archives do not state their order of bytes and are taken for little-endian.
    if let Ok(entry) = archive.by_name(&format!("{folder}byteorder")) {
        let order = read_all(entry, budget, "zip")?;
        if order != b"little" {
            return Err(ArchiveError::BigEndian.into());
        }
    }
    let entry = archive.by_name(&name).map_err(damaged)?;
    if entry.size() > MAX_PICKLE {
        return Err(ArchiveError::LargePickle.into());
    }
    let content = read_all(entry, budget, "zip")?;
    let pickle = pickle::read(&content, budget)?;
    let mut read: HashMap<String, Rc<[u8]>> = HashMap::new();
    let mut storages = |key: &str, budget: &mut Budget| -> Result<Rc<[u8]>, Problem> {
        // Tensors may share a storage: it is unpacked once.
        if let Some(bytes) = read.get(key) {
            return Ok(bytes.clone());
        }
        let entry = archive.by_name(&format!("{folder}data/{key}")).map_err(damaged)?;
        let bytes: Rc<[u8]> = read_all(entry, budget, "zip")?.into();
        read.insert(key.to_owned(), bytes.clone());
        Ok(bytes)
    };
    pickle::arrays(&pickle, &mut storages, budget)
}
