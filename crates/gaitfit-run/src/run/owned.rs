//! A folder that one process at a time writes into.

use crate::{Access, Error, files};
use std::fs::{self, File};
use std::io;
use std::path::Path;

/// A folder that this process owns until the value is dropped, or the process ends.
#[derive(Debug)]
pub struct Owned {
    /// Held open for its lock, which the system drops with the process, and so that no other file gets its number.
    lock: File,
}

/// The file in an owned folder that carries the lock. It stays: whoever removed it could remove another owner's.
pub(super) const LOCK: &str = ".lock";

impl Owned {
    /// Takes a folder that exists; `None` if another process, or another part of this one, owns it.
    ///
    /// # Errors
    /// The system's, of the folder's `.lock`.
    pub fn take(folder: &Path) -> io::Result<Option<Self>> {
        let path = folder.join(LOCK);
        files::no_pipe(&path)?;
        // A file that exists stays the same file, so all processes lock the same one.
        let lock = File::create(&path)?;
        match lock.try_lock() {
            Ok(()) => Ok(Some(Self { lock })),
            Err(fs::TryLockError::WouldBlock) => Ok(None),
            Err(fs::TryLockError::Error(error)) => Err(error),
        }
    }

    /// Whether the folder at this path is still the one that was taken: another one may have been put in its place.
    #[cfg(unix)]
    pub fn is(&self, folder: &Path) -> bool {
        use std::os::unix::fs::MetadataExt;
        let (Ok(own), Ok(there)) = (self.lock.metadata(), fs::metadata(folder.join(LOCK))) else {
            return false;
        };
        (own.dev(), own.ino()) == (there.dev(), there.ino())
    }

    /// Whether the folder at this path is still the one that was taken: here a folder with an open file keeps its name.
    #[cfg(not(unix))]
    pub fn is(&self, folder: &Path) -> bool {
        self.lock.metadata().is_ok() && folder.is_dir()
    }

    /// Whether a process owns `folder`, or has owned it.
    pub fn was_taken(folder: &Path) -> bool {
        folder.join(LOCK).exists()
    }

    /// Makes the folder that logs go into and takes it. What it holds is checked afterwards: an owner that ended a moment ago
    /// may have left logs.
    ///
    /// # Errors
    /// A folder that cannot be made or that another process owns; each with its remedy.
    pub fn for_logs(folder: &Path) -> Result<Self, Error> {
        fs::create_dir_all(folder).map_err(|source| Error::File {
            access: Access::Make,
            path: folder.to_owned(),
            source,
            remedy: String::new(),
        })?;
        let owned = Self::take(folder).map_err(|error| Error::unwritable(&folder.join(LOCK), error))?;
        owned.ok_or_else(|| {
            Error::failed(format!(
                "--out {}: another process is writing logs into this folder; wait for it, or give another folder",
                folder.display()
            ))
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn a_folder_of_logs_has_one_owner() {
        let folder = tempfile::tempdir().unwrap();
        let logs = folder.path().join("a/b");
        let _owned = Owned::for_logs(&logs).unwrap();
        let error = Owned::for_logs(&logs).unwrap_err();
        assert!(error.to_string().contains("another process is writing logs"), "{error}");
        // The folder of a process that ended: a lock dropped here may live on for a moment in what another test starts.
        fs::create_dir(folder.path().join("left")).unwrap();
        fs::write(folder.path().join("left").join(LOCK), "").unwrap();
        let left = folder.path().join("left");
        let owned = Owned::for_logs(&left).unwrap();
        assert!(owned.is(&left) && !owned.is(&logs));
    }
}
