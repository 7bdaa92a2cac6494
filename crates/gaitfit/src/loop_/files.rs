//! The files of a loop's folder besides those of its stages.

use super::setup::Setup;
use crate::Error;
use crate::run::protocol::CONFIG;
use crate::run::{Protocol, RunFolder};
use crate::settings::LOOP_FREE;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Wall times of the stages.
const TIMES: &str = "times.json";
/// The first policy's file.
const FIRST_POLICY: &str = "policies/policy-0.safetensors";

/// Number of rounds that is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Asked {
    rounds_asked: u32,
}

/// The run of a loop, or of a cell of a table, in its folder.
///
/// # Errors
/// Settings that cannot be written.
pub fn protocol<'a>(folder: &'a RunFolder, setup: &Setup) -> Result<Protocol<'a, Asked>, Error> {
    let settings = setup.config.resolved();
    let target = setup.config.target.as_ref().map(|target| target.seed);
    // For the manifest: the loop's random numbers follow from these seeds.
    let mut seeds = vec![setup.config.adapt.optimizer.seed, setup.config.evaluate.seed];
    seeds.extend(setup.config.finetune.seeds.iter().chain(&target));
    Ok(Protocol {
        folder,
        settings: settings.map_err(|error| Error::failed(format!("cannot write {CONFIG}: {error}")))?,
        free: &LOOP_FREE,
        inputs: setup.inputs.clone(),
        // A resumed loop must read what it read at first, or its rounds would not belong together.
        same_files: true,
        seeds,
        devices: setup.devices.to_string(),
        asked: Asked { rounds_asked: setup.config.rounds },
    })
}

/// Refuses to continue a loop that began with another policy: its file may name others that have changed.
///
/// # Errors
/// As it says, or a folder that cannot be read.
pub fn check_policy(protocol: &Protocol<'_, Asked>, setup: &Setup) -> Result<(), Error> {
    match protocol.folder.read_bytes(FIRST_POLICY)? {
        // Compared by content: the path may be the same and the file another.
        Some(bytes) if bytes != setup.policy_bytes => {
            Err(protocol.refusal(&format!("the policy {} has changed", setup.config.policy)).into())
        }
        _ => Ok(()),
    }
}

/// Writes what is known before the first stage.
///
/// # Errors
/// Files that cannot be written.
pub fn begin(folder: &RunFolder, setup: &Setup) -> Result<(), Error> {
    if let Some(truth) = &setup.truth {
        let text =
            truth.to_toml().map_err(|error| Error::failed(format!("cannot write {TRUTH}: {error}")))?;
        folder.write(TRUTH, text.as_bytes())?;
    }
    Ok(["policies", "evaluations"].iter().try_for_each(|name| folder.make(name))?)
}

/// Numbers of a simulated target, as a `theta.toml`.
const TRUTH: &str = "target.toml";

/// Where [`begin`] writes a simulated target's numbers.
pub fn truth(folder: &RunFolder) -> PathBuf {
    folder.path().join(TRUTH)
}

/// Wall times of the finished stages, s.
pub struct Times<'a> {
    folder: &'a RunFolder,
    seconds: IndexMap<String, f64>,
}

impl<'a> Times<'a> {
    /// Reads the times of earlier sessions.
    pub fn read(folder: &'a RunFolder) -> Result<Self, Error> {
        // Damaged times are no reason to refuse a loop; they begin anew.
        let seconds = folder.read(TIMES)?.and_then(|text| serde_json::from_str(&text).ok());
        Ok(Self { folder, seconds: seconds.unwrap_or_default() })
    }

    /// A stage took so long.
    pub fn set(&mut self, stage: &str, seconds: f64) -> Result<(), Error> {
        self.seconds.insert(stage.to_owned(), seconds);
        Ok(self.folder.write_json(TIMES, &self.seconds)?)
    }

    /// All of them, in the order in which stages first ended.
    pub fn all(&self) -> &IndexMap<String, f64> {
        &self.seconds
    }
}
