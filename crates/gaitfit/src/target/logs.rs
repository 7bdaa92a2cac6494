//! Folders of logs.

use crate::Error;
use gaitfit_learn::collect::Collected;
use gaitfit_log::write_csv;
use std::fs;
use std::path::{Path, PathBuf};

/// What was written.
pub struct Written {
    /// The logs.
    pub files: Vec<PathBuf>,
    /// Robots that fell.
    pub falls: usize,
    /// Trajectories without a file: their robot fell before its log began.
    pub without: Vec<usize>,
}

/// Writes one CSV a trajectory into a folder that exists.
///
/// # Errors
/// A file that cannot be written.
pub fn write_logs(folder: &Path, logs: &[Collected]) -> Result<Written, Error> {
    let mut files = Vec::with_capacity(logs.len());
    let mut without = Vec::new();
    let digits = logs.len().saturating_sub(1).to_string().len().max(2);
    for (number, log) in logs.iter().enumerate() {
        if log.trajectory.is_empty() {
            without.push(number);
            continue;
        }
        let path = folder.join(format!("trajectory_{number:0digits$}.csv"));
        write_csv(&path, &log.trajectory).map_err(Error::failed)?;
        files.push(path);
    }
    Ok(Written { files, falls: logs.iter().filter(|log| log.fell).count(), without })
}

/// Has `fill` fill a folder beside `into`, which then takes that name: whoever finds it finds all of it.
///
/// # Errors
/// Those of `fill`, or a folder that cannot be written.
pub fn write_whole(into: &Path, fill: impl FnOnce(&Path) -> Result<(), Error>) -> Result<(), Error> {
    let name = into.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let partial = into.with_file_name(format!(".writing-{name}"));
    let unwritable =
        |error: std::io::Error| Error::failed(format!("cannot write {}: {error}", into.display()));
    // What a killed run left.
    if partial.exists() {
        fs::remove_dir_all(&partial).map_err(unwritable)?;
    }
    fs::create_dir_all(&partial).map_err(unwritable)?;
    fill(&partial)?;
    for entry in fs::read_dir(&partial).map_err(unwritable)? {
        fs::File::open(entry.map_err(unwritable)?.path())
            .and_then(|file| file.sync_all())
            .map_err(unwritable)?;
    }
    fs::rename(&partial, into).map_err(unwritable)?;
    let parent = into.parent().unwrap_or(Path::new("."));
    fs::File::open(parent).and_then(|parent| parent.sync_all()).map_err(unwritable)
}

/// The CSV files of a folder, by name.
///
/// # Errors
/// A folder that cannot be read.
pub fn csv_files(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let unreadable =
        |error: std::io::Error| Error::failed(format!("cannot read {}: {error}", folder.display()));
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv")) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}
