//! Inputs of a run's result, as hashes: a checkpoint is continued only where they are the same.

use crate::{Error, files};
use gaitfit_model::Model;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::path::Path;

/// Hashes of a run's inputs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Inputs {
    /// SHA-256 of every file read, by path.
    pub files: BTreeMap<String, String>,
    /// SHA-256 of the robot as compiled: includes count too.
    pub model: String,
    /// SHA-256 of the settings that change the result.
    pub settings: String,
}

impl Inputs {
    /// Hashes the inputs of a run. `settings`: without those that change nothing, such as where results go.
    pub fn new<'a, S: Serialize>(
        files: impl IntoIterator<Item = &'a Path>,
        model: &Model,
        settings: &S,
    ) -> Result<Self, Error> {
        let mut hashes = BTreeMap::new();
        for path in files {
            let hash = hash_file(path)?;
            hashes.insert(path.display().to_string(), hash);
        }
        // JSON has every number with as many digits as bring back its bits, so equal hashes mean equal
        // values.
        Ok(Self { files: hashes, model: hash(&json(model)?), settings: hash(&json(settings)?) })
    }

    /// Returns the first difference from `saved`, in words; `None` when nothing differs.
    pub fn difference(&self, saved: &Self) -> Option<String> {
        let changed = |path: &&String| saved.files.get(*path) != self.files.get(*path);
        // Both lists, so that a file that is new and one that is gone are named too.
        if let Some(path) = self.files.keys().chain(saved.files.keys()).find(changed) {
            return Some(format!("{path} has changed"));
        }
        if self.model != saved.model {
            return Some(
                "the robot (a file it includes, or this program's reading of it) has changed".to_owned(),
            );
        }
        (self.settings != saved.settings).then(|| "the settings have changed".to_owned())
    }
}

fn json<T: Serialize>(value: &T) -> Result<Vec<u8>, Error> {
    serde_json::to_vec(value).map_err(|error| Error::failed(format!("cannot hash the run's inputs: {error}")))
}

/// SHA-256 of a file, hexadecimal.
///
/// # Errors
/// What is no regular file, or cannot be read.
pub fn hash_file(path: &Path) -> Result<String, Error> {
    let bytes = files::read(path, files::MAX_BYTES).map_err(|error| Error::unreadable(path, error))?;
    Ok(hash(&bytes))
}

/// SHA-256, hexadecimal.
pub fn hash(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}
