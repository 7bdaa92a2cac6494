//! The folder of one run. Every file in it is written whole or not at all, and no run writes into another's.

use super::absent;
use super::names::own_name;
use super::owned::{LOCK, Owned};
use crate::{Access, Error, files};
use gaitfit_model::shown;
use serde::Serialize;
use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// A run's folder, locked by this process.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    owned: Owned,
}

/// Max number of runs of one name.
const MAX_RUNS: usize = 10_000;
/// Longest name of a run, bytes.
const MAX_NAME: usize = 100;
/// Beginning of the names of files that are not whole yet.
const WRITING: &str = ".writing-";

impl RunFolder {
    /// A new folder `runs/name`, or `runs/name-2`, … : the number after that of the latest run.
    pub fn fresh(runs: &Path, name: &str) -> Result<Self, Error> {
        check_name(name)?;
        fs::create_dir_all(runs).map_err(|error| unwritable(runs, error))?;
        // Another process may take the next number in between: making the folder decides, and the loop goes
        // on.
        for number in latest(runs, name)? + 1..=MAX_RUNS {
            let path = numbered(runs, name, number);
            match fs::create_dir(&path) {
                Ok(()) => return Self::lock(path),
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => return Err(unwritable(&path, error)),
            }
        }
        let runs = runs.display();
        Err(Error::failed(format!(
            "{runs} has numbered runs called {name} up to {MAX_RUNS}; take another --name"
        )))
    }

    /// The folder of a new run, or with `resume` the latest of that name.
    ///
    /// # Errors
    /// With `resume`: an error that there is none, with the names that there are.
    pub fn begin(runs: &Path, name: &str, resume: bool) -> Result<Self, Error> {
        if !resume {
            return Self::fresh(runs, name);
        }
        Self::latest(runs, name)?.ok_or_else(|| absent::nothing_to_resume(runs, name))
    }

    /// The folder `within/name` itself, new or as an earlier process left it; never one of the numbered ones beside it,
    /// which a stage repeated by hand may have made.
    pub fn only(within: &Path, name: &str) -> Result<Self, Error> {
        check_name(name)?;
        let path = within.join(name);
        fs::create_dir_all(&path).map_err(|error| unwritable(&path, error))?;
        Self::lock(path)
    }

    /// The latest folder of that name, the one with the highest number, if there is one.
    pub fn latest(runs: &Path, name: &str) -> Result<Option<Self>, Error> {
        check_name(name)?;
        match latest(runs, name)? {
            0 => Ok(None),
            number => Self::lock(numbered(runs, name, number)).map(Some),
        }
    }

    fn lock(path: PathBuf) -> Result<Self, Error> {
        match Owned::take(&path).map_err(|error| unwritable(&path.join(LOCK), error))? {
            // Only the owner may remove unfinished files: those of another process are still being written.
            Some(owned) => {
                sweep(&path);
                Ok(Self { path, owned })
            }
            None => Err(Error::failed(format!(
                "another process is working on {}; wait for it, or take another --name",
                path.display()
            ))),
        }
    }

    /// The folder's path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Name of the folder itself, for example `go2-air-2`.
    pub fn name(&self) -> String {
        self.path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
    }

    /// Refuses to work on where another folder has been put in this one's place.
    fn same(&self) -> Result<(), Error> {
        if self.owned.is(&self.path) {
            return Ok(());
        }
        Err(Error::failed(format!(
            "{} is no longer the folder of this run: it was moved, removed or exchanged for another one while the run \
             worked, so nothing more is written there. Put the run's own folder back and continue with --resume.",
            self.path.display()
        )))
    }

    /// Makes a folder in this one, if it is not there yet. Files in it have names such as `seed-1/metrics.jsonl`.
    ///
    /// # Errors
    /// A folder that cannot be made; another folder in this one's place.
    pub fn make(&self, name: &str) -> Result<(), Error> {
        self.same()?;
        let path = self.path.join(name);
        fs::create_dir_all(&path).map_err(|error| unwritable(&path, error))
    }

    /// Writes a file whole: a temporary file beside it, synced, then renamed.
    ///
    /// # Errors
    /// A file that cannot be written; another folder in this one's place.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<(), Error> {
        self.same()?;
        let path = self.path.join(name);
        let folder = path.parent().unwrap_or(&self.path);
        let whole = || -> std::io::Result<()> {
            // In the same folder, because a rename is only atomic within one file system.
            let mut file =
                files::readable(&mut tempfile::Builder::new()).prefix(WRITING).tempfile_in(folder)?;
            file.write_all(bytes)?;
            file.as_file().sync_all()?;
            file.persist(&path).map_err(|error| error.error)?;
            // The rename itself reaches the disk with the folder.
            File::open(folder)?.sync_all()
        };
        whole().map_err(|error| unwritable(&path, error))
    }

    /// Writes a value as a JSON document, whole.
    pub fn write_json<T: Serialize>(&self, name: &str, value: &T) -> Result<(), Error> {
        let mut text = serde_json::to_string_pretty(value)
            .map_err(|error| Error::failed(format!("cannot write {name}: {error}")))?;
        text.push('\n');
        self.write(name, text.as_bytes())
    }

    /// Reads a text; `None` where there is none.
    pub fn read(&self, name: &str) -> Result<Option<String>, Error> {
        self.read_as(name, files::read_text)
    }

    /// Reads a file; `None` where there is none.
    pub fn read_bytes(&self, name: &str) -> Result<Option<Vec<u8>>, Error> {
        self.read_as(name, files::read)
    }

    fn read_as<T>(
        &self,
        name: &str,
        read: impl Fn(&Path, u64) -> std::io::Result<T>,
    ) -> Result<Option<T>, Error> {
        self.same()?;
        let path = self.path.join(name);
        match read(&path, files::MAX_BYTES) {
            Ok(content) => Ok(Some(content)),
            // A run that was killed early may lack any file. What cannot be read for another reason is an
            // error.
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(source) => {
                let remedy = "; restore it, or start afresh without --resume".to_owned();
                Err(Error::File { access: Access::Read, path, source, remedy })
            }
        }
    }

    /// Adds lines to a file. A line cut short by a crash is mended by [`RunFolder::write`] on resuming.
    ///
    /// # Errors
    /// A file that cannot be written; another folder in this one's place.
    pub fn append(&self, name: &str, text: &str) -> Result<(), Error> {
        self.same()?;
        let path = self.path.join(name);
        let add = || {
            files::no_pipe(&path)?;
            fs::OpenOptions::new().create(true).append(true).open(&path)?.write_all(text.as_bytes())
        };
        add().map_err(|error| unwritable(&path, error))
    }

    /// Waits until what was appended to a file is on the disk.
    pub fn sync(&self, name: &str) -> Result<(), Error> {
        let path = self.path.join(name);
        let sync = || files::no_pipe(&path).and_then(|()| File::open(&path)?.sync_all());
        sync().map_err(|error| unwritable(&path, error))
    }
}

/// Where the latest run of that name is, if there is one; nothing is locked.
pub fn latest_path(runs: &Path, name: &str) -> Option<PathBuf> {
    check_name(name).ok()?;
    let number = latest(runs, name).ok().filter(|&number| number > 0)?;
    Some(numbered(runs, name, number))
}

fn numbered(runs: &Path, name: &str, number: usize) -> PathBuf {
    if number == 1 { runs.join(name) } else { runs.join(format!("{name}-{number}")) }
}

/// The highest number of a run called `name`; 0 if there is none.
fn latest(runs: &Path, name: &str) -> Result<usize, Error> {
    let unreadable = |error| Error::unreadable(runs, error);
    let entries = match fs::read_dir(runs) {
        Ok(entries) => entries,
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => return Ok(0),
        Err(error) => return Err(unreadable(error)),
    };
    let mut highest = 0;
    for entry in entries {
        let entry = entry.map_err(unreadable)?;
        let file = entry.file_name();
        let Some(number) = file.to_str().and_then(|file| number(file, name)) else { continue };
        let path = entry.path();
        // A folder without a configuration counts too: its run may have been killed before it wrote one.
        if number > highest && path.is_dir() && own_name(&path).is_none_or(|own| own == name) {
            highest = number;
        }
    }
    Ok(highest)
}

/// Returns the number of the run called `name` in a folder called `file`: 1 for the name itself.
fn number(file: &str, name: &str) -> Option<usize> {
    let rest = file.strip_prefix(name)?;
    if rest.is_empty() {
        return Some(1);
    }
    let digits = rest.strip_prefix('-')?;
    let number = digits.parse().ok().filter(|number| (2..=MAX_RUNS).contains(number))?;
    // Not `-007` and not `-+7`.
    (number.to_string() == digits).then_some(number)
}

fn check_name(name: &str) -> Result<(), Error> {
    // A name is one folder: separators of paths and names such as `..` would lead elsewhere.
    let plain = |letter: char| letter.is_alphanumeric() || "._-".contains(letter);
    let wrong = if name.len() > MAX_NAME {
        format!("it has {} bytes; give --name one of at most {MAX_NAME}", name.len())
    } else if name.is_empty() || name.starts_with('.') || !name.chars().all(plain) {
        "use letters, digits, `-`, `_` and `.`, not beginning with a dot".to_owned()
    } else {
        return Ok(());
    };
    Err(Error::settings(format!("`{}` cannot name a run folder: {wrong}", shown(name))))
}

/// Removes the unfinished files that a killed run left in a folder of its own; folders with a lock are other runs'.
fn sweep(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let kind = entry.file_type();
        if kind.as_ref().is_ok_and(fs::FileType::is_dir) && !path.join(LOCK).exists() {
            sweep(&path);
        } else if kind.is_ok_and(|kind| kind.is_file())
            && entry.file_name().to_string_lossy().starts_with(WRITING)
        {
            // What cannot be removed does no harm.
            fs::remove_file(&path).ok();
        }
    }
}

fn unwritable(path: &Path, source: std::io::Error) -> Error {
    let remedy = match source.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge => {
            "free some space, or raise the limit of file sizes (`ulimit -f`), then continue with --resume"
        }
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
            "make it writable, or write elsewhere with --set runs=FOLDER"
        }
        ErrorKind::NotADirectory | ErrorKind::AlreadyExists | ErrorKind::IsADirectory => {
            "something else has that name: move it away, or write elsewhere with --set runs=FOLDER"
        }
        _ => "check the disk, or write elsewhere with --set runs=FOLDER",
    };
    let remedy = format!("; {remedy}. Earlier results are intact.");
    Error::File { access: Access::Write, path: path.to_owned(), source, remedy }
}

#[cfg(test)]
mod tests;
