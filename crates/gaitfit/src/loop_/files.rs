//! The files of a loop's folder besides those of its stages.

use super::results::Results;
use super::setup::Setup;
use crate::Error;
use crate::machine::now;
use crate::run::RunFolder;
use crate::run::inputs::Inputs;
use crate::run::manifest;
use crate::settings::LOOP_FREE;
use crate::train;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use toml::{Table, Value};

/// The resolved settings.
const CONFIG: &str = "config.toml";
/// What the result depends on.
const INPUTS: &str = "inputs.json";
const RESULT: &str = "result.json";
const TIMES: &str = "times.json";
/// The first policy's file.
const FIRST_POLICY: &str = "policies/policy-0.safetensors";

/// `result.json`.
#[derive(Serialize, Deserialize)]
struct ResultFile {
    rounds_asked: u32,
    results: Results,
}

/// Refuses to continue a run of other settings or inputs, naming one that differs.
pub fn check_same(folder: &RunFolder, setup: &Setup) -> Result<(), Error> {
    let refuse = |difference: String| {
        Err(Error::settings(format!(
            "{} cannot be continued: {difference}. Give the run's own settings (--resume with {}), or start afresh \
             without --resume.",
            folder.path().display(),
            folder.path().join(CONFIG).display()
        )))
    };
    if let Some(difference) = difference(folder, setup)? {
        return refuse(difference);
    }
    match folder.read_bytes(FIRST_POLICY)? {
        Some(bytes) if bytes != setup.policy_bytes => {
            refuse(format!("the policy {} is not the one it was", setup.config.policy))
        }
        _ => Ok(()),
    }
}

/// A setting or input that a folder was made with and that is not so now, in words; none if it has none.
///
/// # Errors
/// Files that are damaged.
pub fn difference(folder: &RunFolder, setup: &Setup) -> Result<Option<String>, Error> {
    let unreadable = |name: &str, error: &dyn std::fmt::Display| {
        Error::failed(format!(
            "{}: {error}. Restore it, or start afresh in another folder.",
            folder.path().join(name).display()
        ))
    };
    if let Some(text) = folder.read(CONFIG)? {
        let saved: Table = toml::from_str(&text).map_err(|error| unreadable(CONFIG, &error))?;
        if let Some(difference) = train::difference("", &bound(saved), &bound(resolved(setup)?)) {
            return Ok(Some(difference));
        }
    }
    let Some(text) = folder.read(INPUTS)? else { return Ok(None) };
    let saved: Inputs = serde_json::from_str(&text).map_err(|error| unreadable(INPUTS, &error))?;
    Ok(setup.inputs.difference(&saved))
}

fn bound(mut settings: Table) -> Value {
    settings.retain(|key, _| !LOOP_FREE.contains(&key));
    Value::Table(settings)
}

fn resolved(setup: &Setup) -> Result<Table, Error> {
    let table = setup.config.resolved();
    table.map_err(|error| Error::failed(format!("cannot write {CONFIG}: {error}")))
}

/// The result of a folder whose loop is finished as it is wanted.
pub fn finished(folder: &RunFolder, setup: &Setup) -> Result<Option<Results>, Error> {
    let Some(text) = folder.read(RESULT)? else { return Ok(None) };
    let file: ResultFile = serde_json::from_str(&text).map_err(|error| {
        Error::failed(format!(
            "{}: not a result of this version: {error}. Start afresh without --resume.",
            folder.path().join(RESULT).display()
        ))
    })?;
    Ok((file.rounds_asked == setup.config.rounds).then_some(file.results))
}

/// Writes what is known before the first stage.
pub fn begin(folder: &RunFolder, setup: &Setup, begun: &str) -> Result<(), Error> {
    let text = toml::to_string_pretty(&resolved(setup)?)
        .map_err(|error| Error::failed(format!("cannot write {CONFIG}: {error}")))?;
    folder.write(CONFIG, text.as_bytes())?;
    folder.write_json(INPUTS, &setup.inputs)?;
    manifest::write(folder, &seeds(setup), &setup.inputs, begun, None)?;
    if let Some(truth) = &setup.truth {
        let text = truth.to_toml().map_err(Error::failed)?;
        folder.write(TRUTH, text.as_bytes())?;
    }
    ["policies", "evaluations"].iter().try_for_each(|name| folder.make(name))
}

/// Numbers of a simulated target, as a `theta.toml`.
const TRUTH: &str = "target.toml";

/// Where [`begin`] writes a simulated target's numbers.
pub fn truth(folder: &RunFolder) -> PathBuf {
    folder.path().join(TRUTH)
}

/// Writes the result, which comes last: a folder that has it has everything.
pub fn finish(folder: &RunFolder, setup: &Setup, begun: &str, results: Results) -> Result<Results, Error> {
    manifest::write(folder, &seeds(setup), &setup.inputs, begun, Some(now()))?;
    let file = ResultFile { rounds_asked: setup.config.rounds, results };
    folder.write_json(RESULT, &file)?;
    Ok(file.results)
}

fn seeds(setup: &Setup) -> Vec<u64> {
    let target = setup.config.target.as_ref().map(|target| target.seed);
    let mut seeds = vec![setup.config.adapt.optimizer.seed, setup.config.evaluate.seed];
    seeds.extend(setup.config.finetune.seeds.iter().chain(&target));
    seeds
}

/// Wall times of the finished stages, s.
pub struct Times<'a> {
    folder: &'a RunFolder,
    seconds: IndexMap<String, f64>,
}

impl<'a> Times<'a> {
    /// Those of earlier sessions.
    pub fn read(folder: &'a RunFolder) -> Result<Self, Error> {
        let seconds = folder.read(TIMES)?.and_then(|text| serde_json::from_str(&text).ok());
        Ok(Self { folder, seconds: seconds.unwrap_or_default() })
    }

    /// A stage took so long.
    pub fn set(&mut self, stage: &str, seconds: f64) -> Result<(), Error> {
        self.seconds.insert(stage.to_owned(), seconds);
        self.folder.write_json(TIMES, &self.seconds)
    }

    /// All of them, in the order in which stages first ended.
    pub fn all(&self) -> &IndexMap<String, f64> {
        &self.seconds
    }
}
