//! The folder of one run. Every file in it is written whole or not at all, and no run writes into another's.

use super::absent;
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

/// Most runs of one name.
const MAX_RUNS: usize = 10_000;
/// Longest name of a run, bytes.
const MAX_NAME: usize = 100;
/// How names of files begin that are not whole yet.
const WRITING: &str = ".writing-";

impl RunFolder {
    /// A new folder `runs/name`, or `runs/name-2`, … : the number after that of the latest run.
    pub fn fresh(runs: &Path, name: &str) -> Result<Self, Error> {
        check_name(name)?;
        fs::create_dir_all(runs).map_err(|error| unwritable(runs, error))?;
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
    /// With `resume`, that there is none; the names that there are.
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
            let mut file = readable(&mut tempfile::Builder::new()).prefix(WRITING).tempfile_in(folder)?;
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
            no_pipe(&path)?;
            fs::OpenOptions::new().create(true).append(true).open(&path)?.write_all(text.as_bytes())
        };
        add().map_err(|error| unwritable(&path, error))
    }

    /// Waits until what was appended to a file is on the disk.
    pub fn sync(&self, name: &str) -> Result<(), Error> {
        let path = self.path.join(name);
        let sync = || no_pipe(&path).and_then(|()| File::open(&path)?.sync_all());
        sync().map_err(|error| unwritable(&path, error))
    }
}

/// Refuses what is there and is no regular file: opening a pipe would wait for ever.
pub(super) fn no_pipe(path: &Path) -> std::io::Result<()> {
    match files::regular(path) {
        Err(error) if error.kind() == ErrorKind::InvalidInput => {
            Err(std::io::Error::new(ErrorKind::AlreadyExists, error))
        }
        _ => Ok(()),
    }
}

/// Temporary files are private by default; these become results that others may read, as the umask says.
#[cfg(unix)]
pub fn readable<'a, 'b, 'c>(builder: &'c mut tempfile::Builder<'a, 'b>) -> &'c mut tempfile::Builder<'a, 'b> {
    use std::os::unix::fs::PermissionsExt;
    builder.permissions(fs::Permissions::from_mode(0o666))
}

/// As the system does it.
#[cfg(not(unix))]
pub fn readable<'a, 'b, 'c>(builder: &'c mut tempfile::Builder<'a, 'b>) -> &'c mut tempfile::Builder<'a, 'b> {
    builder
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
        if number > highest && path.is_dir() && own_name(&path).is_none_or(|own| own == name) {
            highest = number;
        }
    }
    Ok(highest)
}

/// Which run called `name` has a folder called `file`: 1 for the name itself.
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

/// The name of the run in a folder: `walk-2024` may be a run of that name, or run 2024 of `walk`.
pub(super) fn own_name(folder: &Path) -> Option<String> {
    let text = files::read_text(&folder.join(super::protocol::CONFIG), files::MAX_BYTES).unwrap_or_default();
    let settings: toml::Table = toml::from_str(&text).unwrap_or_default();
    settings.get("name").and_then(toml::Value::as_str).map(str::to_owned)
}

fn check_name(name: &str) -> Result<(), Error> {
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
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn a_second_run_gets_its_own_folder_and_the_latest_is_found() {
        let runs = tempfile::tempdir().unwrap();
        assert!(RunFolder::latest(runs.path(), "a").unwrap().is_none());
        let first = RunFolder::fresh(runs.path(), "a").unwrap();
        first.write("theta.toml", b"one").unwrap();
        let second = RunFolder::fresh(runs.path(), "a").unwrap();
        assert_eq!((first.name().as_str(), second.name().as_str()), ("a", "a-2"));
        assert_eq!(first.read("theta.toml").unwrap().as_deref(), Some("one"));
        assert_eq!(second.read("theta.toml").unwrap(), None);
        let busy = RunFolder::latest(runs.path(), "a").unwrap_err();
        assert!(busy.to_string().contains("another process"), "{busy}");
        // Folders of processes that are gone: a lock dropped here may live on for a moment in what another test starts.
        for name in ["b", "b-2"] {
            fs::create_dir(runs.path().join(name)).unwrap();
        }
        assert_eq!(RunFolder::latest(runs.path(), "b").unwrap().unwrap().name(), "b-2");
        assert_eq!(RunFolder::only(runs.path(), "b").unwrap().name(), "b");
        assert_eq!(RunFolder::only(runs.path(), "c").unwrap().name(), "c");
    }

    #[test]
    fn a_missing_number_hides_no_later_run() {
        let runs = tempfile::tempdir().unwrap();
        for name in ["a", "a-3", "a-007", "a-b", "a-1"] {
            fs::create_dir(runs.path().join(name)).unwrap();
        }
        // A file, and the run of another name.
        fs::write(runs.path().join("a-9"), "").unwrap();
        fs::create_dir(runs.path().join("a-8")).unwrap();
        fs::write(runs.path().join("a-8/config.toml"), "name = \"a-8\"\n").unwrap();
        assert_eq!(RunFolder::latest(runs.path(), "a").unwrap().unwrap().name(), "a-3");
        assert_eq!(RunFolder::fresh(runs.path(), "a").unwrap().name(), "a-4", "a new run is the latest");
        fs::remove_dir(runs.path().join("a")).unwrap();
        fs::write(runs.path().join("a-3/config.toml"), "name = \"a\"\n").unwrap();
        fs::remove_dir_all(runs.path().join("a-4")).unwrap();
        assert_eq!(RunFolder::latest(runs.path(), "a").unwrap().unwrap().name(), "a-3");
        assert_eq!(RunFolder::latest(runs.path(), "a-8").unwrap().unwrap().name(), "a-8");
    }

    #[cfg(unix)]
    #[test]
    fn a_folder_exchanged_for_another_is_an_error_and_gets_nothing() {
        let runs = tempfile::tempdir().unwrap();
        let folder = RunFolder::fresh(runs.path(), "a").unwrap();
        folder.write("checkpoint.json", b"own").unwrap();
        fs::rename(folder.path(), runs.path().join("aside")).unwrap();
        let gone = folder.write("checkpoint.json", b"own").unwrap_err().to_string();
        assert!(gone.contains("no longer the folder of this run"), "{gone}");
        // Another run, with a lock of its own.
        fs::create_dir(runs.path().join("a")).unwrap();
        fs::write(runs.path().join("a/.lock"), "").unwrap();
        for error in [
            folder.write("checkpoint.json", b"own").unwrap_err(),
            folder.append("metrics.jsonl", "own").unwrap_err(),
            folder.make("seed-1").unwrap_err(),
            folder.read("checkpoint.json").unwrap_err(),
        ] {
            assert!(error.to_string().contains("exchanged for another"), "{error}");
        }
        assert_eq!(fs::read_dir(runs.path().join("a")).unwrap().count(), 1);
        fs::remove_dir_all(runs.path().join("a")).unwrap();
        fs::rename(runs.path().join("aside"), folder.path()).unwrap();
        folder.write("checkpoint.json", b"own again").unwrap();
    }

    #[test]
    fn a_write_replaces_the_whole_file_and_leaves_nothing_behind() {
        let runs = tempfile::tempdir().unwrap();
        let folder = RunFolder::fresh(runs.path(), "a").unwrap();
        folder.write("x", b"a long first version").unwrap();
        folder.write("x", b"short").unwrap();
        folder.append("x", " tail").unwrap();
        assert_eq!(folder.read("x").unwrap().as_deref(), Some("short tail"));
        let names: Vec<_> =
            fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(names.len(), 2, "{names:?}");
    }

    #[test]
    fn what_a_killed_run_left_unfinished_is_swept_and_other_runs_are_not() {
        let runs = tempfile::tempdir().unwrap();
        let killed = runs.path().join("a");
        for name in ["seed-1", "round-1/adapt"] {
            fs::create_dir_all(killed.join(name)).unwrap();
        }
        let left = ["seed-1/.writing-x", ".writing-y", "round-1/adapt/.writing-z"];
        for name in ["round-1/adapt/.lock", "seed-1/whole"].iter().chain(&left) {
            fs::write(killed.join(name), "half").unwrap();
        }
        let folder = RunFolder::latest(runs.path(), "a").unwrap().unwrap();
        let there = |name: &str| folder.path().join(name).exists();
        assert_eq!(left.map(there), [false, false, true]);
        assert!(there("seed-1/whole"));
    }

    #[test]
    fn names_that_leave_the_folder_are_refused() {
        for name in ["", ".", "..", "../a", "a/b", ".a"] {
            assert!(check_name(name).is_err(), "{name}");
        }
        assert!(check_name("go2-air_1.5").is_ok());
        let error = check_name(&"a".repeat(300)).unwrap_err().to_string();
        assert!(error.contains("has 300 bytes") && error.len() < 200, "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn pipes_and_folders_in_place_of_a_runs_files_are_named_and_not_opened() {
        let runs = tempfile::tempdir().unwrap();
        let folder = RunFolder::fresh(runs.path(), "a").unwrap();
        let pipe = |path: PathBuf| std::process::Command::new("mkfifo").arg(path).status().unwrap().success();
        assert!(pipe(folder.path().join("checkpoint.json")));
        fs::create_dir(folder.path().join("manifest.json")).unwrap();
        for (name, error) in [
            ("checkpoint.json", folder.read("checkpoint.json").unwrap_err()),
            ("manifest.json", folder.read_bytes("manifest.json").unwrap_err()),
            ("checkpoint.json", folder.append("checkpoint.json", "x").unwrap_err()),
            ("checkpoint.json", folder.sync("checkpoint.json").unwrap_err()),
        ] {
            let error = error.to_string();
            assert!(error.contains(name) && error.contains("not a regular file; "), "{error}");
        }
        fs::create_dir(runs.path().join("c")).unwrap();
        assert!(["config.toml", ".lock"].iter().all(|name| pipe(runs.path().join("c").join(name))));
        let error = RunFolder::latest(runs.path(), "c").unwrap_err().to_string();
        assert!(error.contains(".lock: not a regular file"), "{error}");
    }

    #[test]
    fn a_file_in_the_way_is_named() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let error = RunFolder::fresh(file.path(), "a").unwrap_err();
        assert!(error.to_string().contains(&file.path().display().to_string()), "{error}");
        assert!(error.to_string().contains("--set runs="), "{error}");
    }
}
