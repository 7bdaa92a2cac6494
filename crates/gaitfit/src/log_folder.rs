//! Folders of logs.

use crate::Error;
use gaitfit_learn::collect::Collected;
use gaitfit_log::write_csv;
use gaitfit_model::{escaped, shown_path};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Logs that were written.
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
/// A file that cannot be written. None is left then: part of the logs is taken for all of them.
pub fn write_logs(folder: &Path, logs: &[Collected]) -> Result<Written, Error> {
    let writer = LogWriter::new(folder, logs.len())?;
    writer.put_all(logs)?;
    writer.finish()
}

/// A folder's logs, one CSV a trajectory, written while others are still recorded. Until all are there they are in a hidden
/// folder of their own, because part of the logs is taken for all of them; without [`LogWriter::finish`] none is left.
pub struct LogWriter {
    folder: PathBuf,
    partial: tempfile::TempDir,
    digits: usize,
    /// Number of each trajectory that was put, whether it has a file, and whether its robot fell.
    put: Mutex<Vec<(usize, bool, bool)>>,
}

impl LogWriter {
    /// A writer of `count` trajectories into a folder that exists.
    ///
    /// # Errors
    /// A folder that cannot be written.
    pub fn new(folder: &Path, count: usize) -> Result<Self, Error> {
        let unwritable = |error: std::io::Error| Error::unwritable(folder, error);
        // The caller owns the folder, so no other process can be writing there.
        remove_killed(folder, WRITING).map_err(unwritable)?;
        Ok(Self {
            folder: folder.to_owned(),
            partial: tempfile::Builder::new().prefix(WRITING).tempdir_in(folder).map_err(unwritable)?,
            // All names have the same length, so that they sort by number.
            digits: count.saturating_sub(1).to_string().len().max(2),
            put: Mutex::new(Vec::with_capacity(count)),
        })
    }

    fn name(&self, number: usize) -> String {
        let digits = self.digits;
        format!("trajectory_{number:0digits$}.csv")
    }

    /// Writes the log of a trajectory; one without a row has no file.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn put(&self, number: usize, log: &Collected) -> Result<(), Error> {
        let has_rows = !log.trajectory.is_empty();
        if has_rows {
            write_csv(&self.partial.path().join(self.name(number)), &log.trajectory)?;
        }
        self.put.lock().unwrap_or_else(PoisonError::into_inner).push((number, has_rows, log.fell));
        Ok(())
    }

    /// Writes the logs of all trajectories in their order.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn put_all(&self, logs: &[Collected]) -> Result<(), Error> {
        logs.iter().enumerate().try_for_each(|(number, log)| self.put(number, log))
    }

    /// Puts all logs in their place.
    ///
    /// # Errors
    /// A file that cannot be moved. None is left then.
    pub fn finish(self) -> Result<Written, Error> {
        let mut put = std::mem::take(&mut *self.put.lock().unwrap_or_else(PoisonError::into_inner));
        // Threads put logs in any order.
        put.sort_unstable();
        let mut files = Vec::with_capacity(put.len());
        // A robot that fell before its log began has a number and no file.
        for (number, ..) in put.iter().filter(|(_, has_rows, _)| *has_rows) {
            let (from, to) =
                (self.partial.path().join(self.name(*number)), self.folder.join(self.name(*number)));
            if let Err(error) = fs::rename(&from, &to) {
                // What cannot be removed keeps a later call from the folder, and is seen there.
                files.iter().for_each(|path: &PathBuf| drop(fs::remove_file(path)));
                return Err(Error::unwritable(&to, error));
            }
            files.push(to);
        }
        let without = put.iter().filter(|(_, has_rows, _)| !has_rows).map(|(number, ..)| *number).collect();
        Ok(Written { files, falls: put.iter().filter(|(.., fell)| *fell).count(), without })
    }
}

/// Removes the folders in `parent` that killed runs left: `prefix`, then random letters. A name with another `-` belongs to
/// another collection, which may be writing it.
fn remove_killed(parent: &Path, prefix: &str) -> std::io::Result<()> {
    for entry in fs::read_dir(parent)? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        let is_left = name.strip_prefix(prefix).is_some_and(|random| !random.contains('-'));
        if is_left && entry.path().is_dir() {
            fs::remove_dir_all(entry.path())?;
        }
    }
    Ok(())
}

/// Beginning of the names of folders that are not whole yet.
const WRITING: &str = ".writing-";

/// Has `fill` fill a new folder beside `into`, which then takes that name: whoever finds it finds all of it. Each
/// attempt has a folder that no earlier one had: a program that outlived its caller cannot write into it.
///
/// # Errors
/// Those of `fill`, or a folder that cannot be written.
pub fn write_whole(into: &Path, fill: impl FnOnce(&Path) -> Result<(), Error>) -> Result<(), Error> {
    let name = into.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    // The parent of a plain name is the empty path, which cannot be opened.
    let parent = into.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let unwritable = |error: std::io::Error| Error::unwritable(into, error);
    let prefix = format!("{WRITING}{name}-");
    // The hidden folder must be on the disk of `into`, or the rename could not be one step.
    fs::create_dir_all(parent).map_err(unwritable)?;
    // What a killed program left of earlier attempts would stay for ever.
    remove_killed(parent, &prefix).map_err(unwritable)?;
    let mut builder = tempfile::Builder::new();
    let partial = folder_like(&mut builder).prefix(&prefix).tempdir_in(parent).map_err(unwritable)?.keep();
    // After a failure the folder stays: a program that outlived its caller may still write there. The next
    // attempt removes it.
    fill(&partial)?;
    // Contents reach the disk before the name does: after a power cut, a folder of this name is whole.
    for entry in fs::read_dir(&partial).map_err(unwritable)? {
        let entry = entry.map_err(unwritable)?;
        // Opening anything else might wait for ever.
        if entry.file_type().map_err(unwritable)?.is_file() {
            fs::File::open(entry.path()).and_then(|file| file.sync_all()).map_err(unwritable)?;
        }
    }
    // A rename is one step: the folder is there with all its logs, or it is not.
    fs::rename(&partial, into).map_err(unwritable)?;
    fs::File::open(parent).and_then(|parent| parent.sync_all()).map_err(unwritable)
}

/// Temporary folders are private by default; these become results that others may read, as the umask says.
#[cfg(unix)]
fn folder_like<'a, 'b, 'c>(builder: &'c mut tempfile::Builder<'a, 'b>) -> &'c mut tempfile::Builder<'a, 'b> {
    use std::os::unix::fs::PermissionsExt;
    builder.permissions(fs::Permissions::from_mode(0o777))
}

/// As the system does it.
#[cfg(not(unix))]
fn folder_like<'a, 'b, 'c>(builder: &'c mut tempfile::Builder<'a, 'b>) -> &'c mut tempfile::Builder<'a, 'b> {
    builder
}

/// Refuses what another program may leave in a folder of logs and nobody can read: pipes, sockets, devices, links that
/// lead nowhere or to these, folders called like a log. Other folders are left alone.
///
/// # Errors
/// In words, naming the entry.
pub fn check_recorded(folder: &Path) -> Result<(), String> {
    let unreadable = |error: std::io::Error| format!("cannot read {}: {error}", folder.display());
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let entry = entry.map_err(unreadable)?;
        let path = entry.path();
        let name = escaped(&entry.file_name().to_string_lossy(), 200);
        let link = entry.file_type().map_err(unreadable)?.is_symlink();
        // Follows links, which is what a reader of the log would do.
        let file_type = match fs::metadata(&path) {
            Ok(metadata) => metadata.file_type(),
            Err(error) if link => {
                let leads = fs::read_link(&path).unwrap_or_default();
                return Err(format!(
                    "it left `{name}`, a symbolic link to {}, which cannot be read: {error}. Write the log itself into \
                     {{folder}}.",
                    shown_path(&leads)
                ));
            }
            Err(error) => return Err(format!("it left `{name}`, which cannot be read: {error}")),
        };
        // A folder called like a log would be opened as one by the reader.
        if !(file_type.is_file() || file_type.is_dir() && !is_csv(&path)) {
            let leads = if link { "a symbolic link to " } else { "" };
            return Err(format!(
                "it left `{name}`, {leads}{}: only regular files can be logs. Write the log itself into {{folder}}.",
                kind(file_type)
            ));
        }
    }
    Ok(())
}

#[cfg(unix)]
fn kind(file_type: fs::FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    if file_type.is_fifo() {
        "a pipe"
    } else if file_type.is_socket() {
        "a socket"
    } else if file_type.is_dir() {
        "a folder"
    } else {
        "a device"
    }
}

#[cfg(not(unix))]
fn kind(file_type: fs::FileType) -> &'static str {
    if file_type.is_dir() { "a folder" } else { "no file" }
}

fn is_csv(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv"))
}

#[cfg(all(test, unix))]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_log::csv_files;
    use std::os::unix::fs::symlink;

    #[test]
    fn every_attempt_has_a_folder_of_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let into = folder.path().join("logs");
        let mut first = PathBuf::new();
        let failed = write_whole(&into, |partial| {
            first = partial.to_owned();
            Err(Error::failed("off"))
        });
        assert!(failed.is_err() && first.is_dir() && !into.exists());
        write_whole(&into, |partial| {
            assert!(*partial != first && !first.exists());
            // The program of the first attempt is late.
            assert!(fs::write(first.join("late.csv"), "").is_err());
            fs::write(partial.join("a.csv"), "t").map_err(Error::failed)
        })
        .unwrap();
        assert_eq!(csv_files(&into).unwrap(), [into.join("a.csv")]);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn folders_of_other_collections_stay() {
        let folder = tempfile::tempdir().unwrap();
        let names = [".writing-logs-killed", ".writing-logs2-ABCDEF", ".writing-logs-2-ABCDEF"];
        let [killed, longer, numbered] = names.map(|name| folder.path().join(name));
        for path in [&killed, &longer, &numbered] {
            fs::create_dir(path).unwrap();
        }
        write_whole(&folder.path().join("logs"), |_| Ok(())).unwrap();
        assert!(!killed.exists() && longer.is_dir() && numbered.is_dir());
    }

    #[test]
    fn logs_are_on_the_disk_before_all_are_recorded_and_none_is_left_of_a_part() {
        let folder = tempfile::tempdir().unwrap();
        let log = |fell: bool, rows: usize| {
            let joints = vec!["knee".to_owned()];
            let time = (0..rows).map(|row| 0.02 * row as f64).collect();
            let trajectory =
                gaitfit_log::Trajectory::of_joints(joints, 50.0, time, vec![0.1; rows], vec![0.0; rows]);
            Collected { trajectory, fell }
        };
        let writer = LogWriter::new(folder.path(), 3).unwrap();
        writer.put(1, &log(true, 5)).unwrap();
        let hidden = fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        assert!(hidden.join("trajectory_01.csv").is_file());
        assert!(csv_files(folder.path()).unwrap().is_empty(), "a part of the logs is no folder of logs");
        drop(writer);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        // What a killed program left.
        fs::create_dir(folder.path().join(".writing-killed")).unwrap();
        let writer = LogWriter::new(folder.path(), 3).unwrap();
        for (number, one) in [(2, log(false, 5)), (0, log(true, 5)), (1, log(true, 0))] {
            writer.put(number, &one).unwrap();
        }
        let written = writer.finish().unwrap();
        assert_eq!((written.falls, written.without), (2, vec![1]));
        assert_eq!(written.files, csv_files(folder.path()).unwrap());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn what_is_no_file_is_named_and_not_opened() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::write(path("log.csv"), "t").unwrap();
        fs::create_dir(path("notes")).unwrap();
        symlink(path("log.csv"), path("same.csv")).unwrap();
        check_recorded(folder.path()).unwrap();
        let refused = |name: &str, what: &str| {
            let error = check_recorded(folder.path()).unwrap_err();
            assert!(error.contains(name) && error.contains(what), "{error}");
            let _ = fs::remove_file(path(name)).or_else(|_| fs::remove_dir(path(name)));
        };
        symlink("nowhere.csv", path("gone.csv")).unwrap();
        refused("gone.csv", "a symbolic link to nowhere.csv");
        symlink("/dev/zero", path("zero.csv")).unwrap();
        refused("zero.csv", "a symbolic link to a device");
        fs::create_dir(path("folder.csv")).unwrap();
        refused("folder.csv", "a folder");
        let _socket = std::os::unix::net::UnixListener::bind(path("socket")).unwrap();
        refused("socket", "a socket");
        assert!(std::process::Command::new("mkfifo").arg(path("pipe.csv")).status().unwrap().success());
        refused("pipe.csv", "a pipe");
        check_recorded(folder.path()).unwrap();
    }
}
