//! What a run's result depends on, as hashes: a checkpoint is continued only where they are the same.

use super::setup::Setup;
use crate::config::AdaptConfig;
use crate::exit::Failure;
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
    /// Hashes the inputs of a run.
    pub fn new(config: &AdaptConfig, setup: &Setup) -> Result<Self, Failure> {
        let mut files = BTreeMap::new();
        let mut add = |path: &Path| -> Result<(), Failure> {
            let bytes = std::fs::read(path)
                .map_err(|error| Failure::failed(format!("cannot read {}: {error}", path.display())))?;
            files.insert(path.display().to_string(), hash(&bytes));
            Ok(())
        };
        add(&setup.robot_path)?;
        for log in setup.fit.logs.iter().chain(setup.validate.iter().flat_map(|set| &set.logs)) {
            add(&log.path)?;
            log.sidecars.iter().try_for_each(|path| add(path))?;
        }
        // Where results go, how often they are saved and on how many threads they are found changes nothing.
        let mut settings = config.clone();
        settings.name = None;
        settings.runs = String::new();
        settings.checkpoint_seconds = 0.0;
        settings.simulation.threads = 0;
        settings.optimizer.max_seconds = 0.0;
        Ok(Self { files, model: hash(&json(&setup.model)?), settings: hash(&json(&settings)?) })
    }

    /// What differs from `saved`, in words; `None` when nothing does.
    pub fn difference(&self, saved: &Self) -> Option<String> {
        let changed = |path: &&String| saved.files.get(*path) != self.files.get(*path);
        if let Some(path) = self.files.keys().chain(saved.files.keys()).find(changed) {
            return Some(format!("{path} is not the file it was"));
        }
        if self.model != saved.model {
            return Some(
                "the robot (a file it includes, or this program's reading of it) has changed".to_owned(),
            );
        }
        (self.settings != saved.settings).then(|| "the settings have changed".to_owned())
    }
}

fn json<T: Serialize>(value: &T) -> Result<Vec<u8>, Failure> {
    serde_json::to_vec(value)
        .map_err(|error| Failure::failed(format!("cannot hash the run's inputs: {error}")))
}

fn hash(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}
