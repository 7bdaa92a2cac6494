//! The CSV files of a folder. Links and pipes do not pass unseen.

use crate::LogError;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Max number of entries of a folder that are looked at.
const MAX_ENTRIES: usize = 100_000;

/// Targets of a chirp, and what a simulation expects of it: files that `gaitfit excite` writes beside `play.py`.
const EXCITE: [&str; 2] = ["chirp.csv", "expected.csv"];

/// The `*.csv` files of a folder, by name, and links to files; not those of folders in it, nor those that `gaitfit excite`
/// wrote beside its script: these are what a robot is to do, not what it did.
///
/// # Errors
/// A folder that cannot be read or holds more than 100,000 entries; a `*.csv` that is a link to no regular file, or a
/// pipe or device, which could block the reader for ever.
pub fn csv_files(folder: &Path) -> Result<Vec<PathBuf>, LogError> {
    entries(folder)?.into_iter().map(|(path, wrong)| wrong.map_or(Ok(path), Err)).collect()
}

/// As [`csv_files`], with what is wrong beside each file.
pub(crate) fn entries(folder: &Path) -> Result<Vec<(PathBuf, Option<LogError>)>, LogError> {
    let unreadable = |source| LogError::Io {
        path: folder.to_owned(),
        action: "list the folder",
        source,
        remedy: "check the path and its permissions",
    };
    let mut files = Vec::new();
    for (number, entry) in std::fs::read_dir(folder).map_err(unreadable)?.enumerate() {
        if number >= MAX_ENTRIES {
            return Err(LogError::TooManyFiles { path: folder.to_owned(), limit: MAX_ENTRIES });
        }
        let path = entry.map_err(unreadable)?.path();
        if !path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv")) {
            continue;
        }
        // A folder may be called so.
        if std::fs::symlink_metadata(&path).is_ok_and(|metadata| metadata.is_dir()) {
            continue;
        }
        let wrong = check_entry(&path).err();
        files.push((path, wrong));
    }
    // The folder of an excitation holds the motion to play beside its script; these are no logs.
    if folder.join("play.py").is_file() && folder.join(EXCITE[0]).is_file() {
        files.retain(|(path, _)| {
            !EXCITE.iter().any(|name| path.file_name().is_some_and(|file| file == *name))
        });
    }
    // Folders list files in any order; results must not depend on it.
    files.sort_by(|a, b| a.0.cmp(&b.0));
    Ok(files)
}

/// Refuses what is neither a regular file nor a link to one. The message names a link, where it leads and what to do.
///
/// # Errors
/// An entry that is neither, or that cannot be looked at.
pub fn check_entry(path: &Path) -> Result<(), LogError> {
    let io = |source| LogError::Io {
        path: path.to_owned(),
        action: "look at the file",
        source,
        remedy: "check its permissions",
    };
    let itself = std::fs::symlink_metadata(path).map_err(io)?;
    if itself.is_file() {
        return Ok(());
    }
    if !itself.is_symlink() {
        return Err(LogError::NotAFile { path: path.to_owned() });
    }
    let target = std::fs::read_link(path).map_err(io)?;
    let refuse = |problem, remedy| Err(LogError::Link { path: path.to_owned(), target, problem, remedy });
    // `metadata` follows the link.
    match std::fs::metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            refuse("which does not exist", "restore that file, or delete the link")
        }
        Err(_) => refuse("which cannot be reached", "check that path's permissions, or delete the link"),
        Ok(metadata) if metadata.is_file() => Ok(()),
        Ok(metadata) if metadata.is_dir() => {
            refuse("which is a folder", "name that folder instead, or delete the link")
        }
        Ok(_) => refuse("which is no regular file", "save what it gives as a file"),
    }
}
