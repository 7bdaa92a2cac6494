//! Compiled programs on disk.
//!
//! A file's name is the hash of all that its content depends on; the content begins with its own hash, so that a
//! damaged file is seen and made anew. Files are written under another name and renamed. When there are too many, those
//! used longest ago go.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use sha2::{Digest, Sha256};

use super::nvrtc::Image;

/// Begins every file; changes with the format.
const MAGIC: &[u8; 8] = b"gfcuda01";
/// Max bytes of all files.
const MAX_BYTES: u64 = 512 << 20;
/// Max number of files.
const MAX_FILES: usize = 512;

/// A folder of compiled programs.
#[derive(Clone, Debug)]
pub struct Cache {
    folder: PathBuf,
    most_bytes: u64,
    most_files: usize,
}

impl Cache {
    /// The user's: `gaitfit/cuda` in `XDG_CACHE_HOME`, else in `~/.cache` (on Windows in `LOCALAPPDATA`). None where
    /// the system names no such folder.
    pub fn of_user() -> Option<Self> {
        let variable =
            |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
        let base = variable("XDG_CACHE_HOME")
            .or_else(|| variable("HOME").map(|home| home.join(".cache")))
            .or_else(|| variable("LOCALAPPDATA"))?;
        Some(Self::new(base.join("gaitfit").join("cuda")))
    }

    /// A cache in this folder, which is made when there is something to keep.
    pub fn new(folder: PathBuf) -> Self {
        Self { folder, most_bytes: MAX_BYTES, most_files: MAX_FILES }
    }

    /// Sets other limits.
    pub fn with_limits(self, most_bytes: u64, most_files: usize) -> Self {
        Self { most_bytes, most_files, ..self }
    }

    /// Folder of the files.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Name of the file for a program: a hash over all of these parts and their lengths.
    pub fn key(parts: &[&str]) -> String {
        let mut hash = Sha256::new();
        for part in parts {
            hash.update((part.len() as u64).to_le_bytes());
            hash.update(part);
        }
        // Half of the hash makes a short name, and with 128 bits no two programs meet.
        hex(&hash.finalize()[..16])
    }

    fn path(&self, key: &str) -> PathBuf {
        self.folder.join(format!("{key}.bin"))
    }

    /// The program kept under `key`, if it is there and whole.
    pub fn read(&self, key: &str) -> Option<Image> {
        let path = self.path(key);
        let bytes = fs::read(&path).ok()?;
        let image = unpack(&bytes);
        if image.is_none() {
            // A damaged file would be read again at every start.
            let _ = fs::remove_file(&path);
        } else if let Ok(file) = fs::File::options().append(true).open(&path) {
            let _ = file.set_modified(SystemTime::now());
        }
        image
    }

    /// Keeps a program and deletes what is too much.
    ///
    /// # Errors
    /// A failure of the file system.
    pub fn write(&self, key: &str, image: &Image) -> std::io::Result<()> {
        fs::create_dir_all(&self.folder)?;
        let mut file = tempfile::Builder::new().prefix(".new-").tempfile_in(&self.folder)?;
        file.write_all(&pack(image))?;
        // By the clock of `read`: the file system's own lags behind it, and a new file would pass for an old one.
        file.as_file().set_modified(SystemTime::now())?;
        file.persist(self.path(key)).map_err(|error| error.error)?;
        self.trim();
        Ok(())
    }

    fn trim(&self) {
        // A cache that cannot be read is not worth an error: programs are compiled again.
        let Ok(entries) = fs::read_dir(&self.folder) else { return };
        let mut files: Vec<(SystemTime, u64, PathBuf)> = entries
            .flatten()
            .filter(|entry| entry.path().extension().is_some_and(|extension| extension == "bin"))
            .filter_map(|entry| {
                let data = entry.metadata().ok()?;
                Some((data.modified().ok()?, data.len(), entry.path()))
            })
            .collect();
        files.sort_by(|a, b| b.cmp(a));
        let mut bytes = 0;
        for (index, (_, size, path)) in files.iter().enumerate() {
            bytes += size;
            // The newest stays, however large.
            if index > 0 && (index >= self.most_files || bytes > self.most_bytes) {
                let _ = fs::remove_file(path);
            }
        }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Magic, hash of the rest, length of the log, log, code.
fn pack(image: &Image) -> Vec<u8> {
    let mut body = (image.log.len() as u64).to_le_bytes().to_vec();
    body.extend_from_slice(image.log.as_bytes());
    body.extend_from_slice(&image.code);
    let mut bytes = MAGIC.to_vec();
    bytes.extend_from_slice(&Sha256::digest(&body));
    bytes.extend_from_slice(&body);
    bytes
}

fn unpack(bytes: &[u8]) -> Option<Image> {
    let rest = bytes.strip_prefix(MAGIC)?;
    let (hash, body) = rest.split_at_checked(32)?;
    if Sha256::digest(body).as_slice() != hash {
        return None;
    }
    let (length, body) = body.split_first_chunk::<8>()?;
    let (log, code) = body.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    Some(Image { code: code.to_vec(), log: String::from_utf8(log.to_vec()).ok()? })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

    use super::*;

    fn image(byte: u8) -> Image {
        Image { code: vec![byte; 1000], log: format!("log {byte}") }
    }

    #[test]
    fn what_was_kept_comes_back_and_damage_is_seen_at_every_byte() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path().join("deep/er"));
        let key = Cache::key(&["text", "options"]);
        assert_eq!(cache.read(&key), None);
        cache.write(&key, &image(7)).unwrap();
        assert_eq!(cache.read(&key), Some(image(7)));
        let path = cache.path(&key);
        let whole = fs::read(&path).unwrap();
        for at in (0..whole.len()).step_by(13) {
            let mut damaged = whole.clone();
            damaged[at] ^= 4;
            assert_eq!(unpack(&damaged), None, "byte {at}");
            assert_eq!(unpack(&whole[..at]), None, "cut at {at}");
        }
        fs::write(&path, &whole[..500]).unwrap();
        assert_eq!(cache.read(&key), None);
        assert!(!path.exists(), "a damaged file is deleted");
        let names: Vec<_> = fs::read_dir(cache.folder()).unwrap().collect();
        assert!(names.is_empty(), "nothing half-written is left: {names:?}");
    }

    #[test]
    fn keys_do_not_run_into_each_other() {
        assert_ne!(Cache::key(&["ab", "c"]), Cache::key(&["a", "bc"]));
        assert_eq!(Cache::key(&["ab", "c"]).len(), 32);
    }

    #[test]
    fn the_longest_unused_go_first() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::new(folder.path().to_path_buf()).with_limits(u64::MAX, 3);
        for number in 0..3u8 {
            cache.write(&format!("{number}"), &image(number)).unwrap();
            let file = fs::File::options().append(true).open(cache.path(&number.to_string())).unwrap();
            file.set_modified(SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(number.into()))
                .unwrap();
        }
        assert!(cache.read("0").is_some(), "a look counts as use");
        cache.write("3", &image(3)).unwrap();
        let left: Vec<bool> = (0..4).map(|number| cache.read(&number.to_string()).is_some()).collect();
        assert_eq!(left, [true, false, true, true]);
        cache.clone().with_limits(1500, 9).write("4", &image(4)).unwrap();
        assert!(cache.read("4").is_some() && fs::read_dir(cache.folder()).unwrap().count() == 1);
    }
}
