//! The files of a run folder besides those of its seeds.

use super::metrics::{self, Metric};
use super::report;
use super::results::{Results, SeedResult};
use super::seed::Files;
use super::setup::{self, Setup};
use super::show::{self, Shown};
use crate::config::TrainConfig;
use crate::exit::Failure;
use crate::inputs::Inputs;
use crate::machine::now;
use crate::manifest;
use crate::output::note;
use crate::run_folder::RunFolder;
use gaitfit_learn::policy::weights;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

const CONFIG: &str = "config.toml";
const RESULT: &str = "result.json";

/// `result.json`: the results, and what they belong to.
#[derive(Serialize, Deserialize)]
struct ResultFile {
    inputs: Inputs,
    iterations: u32,
    results: Results,
}

/// Refuses to continue a run of other settings, naming one that differs.
pub fn check_same(folder: &RunFolder, config: &TrainConfig) -> Result<(), Failure> {
    let Some(text) = folder.read(CONFIG)? else { return Ok(()) };
    let shown = folder.path().join(CONFIG);
    let wrong = |error: String| {
        Failure::failed(format!(
            "{}: {error}. Restore it, or start afresh without --resume.",
            shown.display()
        ))
    };
    let saved: TrainConfig = crate::config::load(Some(&shown), &[])
        .map_err(|_| wrong(format!("not a configuration of this version ({} bytes)", text.len())))?;
    let table = |config: &TrainConfig| {
        Table::try_from(setup::settings(config)).map_err(|error| wrong(error.to_string()))
    };
    let (saved, wanted) = (table(&saved)?, table(config)?);
    match difference("", &Value::Table(saved), &Value::Table(wanted)) {
        None => Ok(()),
        Some(difference) => Err(Failure::usage(format!(
            "{} cannot be continued: {difference}. Give the run's own settings (--resume with {}), or start afresh \
             without --resume.",
            folder.path().display(),
            shown.display()
        ))),
    }
}

/// The first setting that differs, in words.
fn difference(path: &str, saved: &Value, wanted: &Value) -> Option<String> {
    let (Value::Table(saved), Value::Table(wanted)) = (saved, wanted) else {
        return (saved != wanted).then(|| format!("`{path}` was {saved}, now it is {wanted}"));
    };
    let inner = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
    for (key, value) in saved {
        let found = match wanted.get(key) {
            Some(other) => difference(&inner(key), value, other),
            None => Some(format!("`{}` was {value}, now it is not set", inner(key))),
        };
        if found.is_some() {
            return found;
        }
    }
    let new = wanted.iter().find(|(key, _)| !saved.contains_key(*key))?;
    Some(format!("`{}` was not set, now it is {}", inner(new.0), new.1))
}

/// The result of a folder whose training is finished as it is wanted; none where there is more to do.
pub fn finished(folder: &RunFolder, config: &TrainConfig, setup: &Setup) -> Result<Option<Results>, Failure> {
    let Some(text) = folder.read(RESULT)? else { return Ok(None) };
    let file: ResultFile = serde_json::from_str(&text).map_err(|error| {
        Failure::failed(format!(
            "{}: not a result of this version: {error}. Start afresh without --resume.",
            folder.path().join(RESULT).display()
        ))
    })?;
    let seeds: Vec<u64> = file.results.seeds.iter().map(|seed| seed.seed).collect();
    if seeds != config.seeds || file.iterations != config.train.iterations {
        return Ok(None);
    }
    // The robot counts as what it is, wherever its file lies.
    let of = |inputs: &Inputs| Inputs { files: Default::default(), ..inputs.clone() };
    match of(&setup.inputs).difference(&of(&file.inputs)) {
        None => Ok(Some(file.results)),
        Some(difference) => Err(Failure::usage(format!(
            "{} is finished, and {difference} since. Start afresh without --resume.",
            folder.path().display()
        ))),
    }
}

/// Writes what is known before the training.
pub fn begin(folder: &RunFolder, config: &TrainConfig, setup: &Setup, begun: &str) -> Result<(), Failure> {
    folder.write(CONFIG, resolved(config)?.as_bytes())?;
    manifest::write(folder, &config.seeds, &setup.inputs, begun, None)
}

fn resolved(config: &TrainConfig) -> Result<String, Failure> {
    toml::to_string_pretty(config).map_err(|error| Failure::failed(format!("cannot write {CONFIG}: {error}")))
}

/// What a trained seed leaves for the report.
pub struct Trained {
    /// Its result.
    pub result: SeedResult,
    /// All its metrics.
    pub metrics: Vec<Metric>,
    /// Its policy at work.
    pub shown: Shown,
}

/// Shows the policies and writes what was found. The result comes last: a folder that has it has everything.
pub fn finish(
    folder: &RunFolder,
    config: &TrainConfig,
    setup: &Setup,
    begun: &str,
) -> Result<Results, Failure> {
    let mut trained = Vec::with_capacity(config.seeds.len());
    for &seed in &config.seeds {
        trained.push(seed_results(folder, config, setup, seed)?);
    }
    let results = Results {
        name: folder.name(),
        robot: setup.model.name.clone(),
        task: config.task.base.name().to_owned(),
        environments: config.train.environments,
        steps: config.train.steps,
        configuration_hash: setup.inputs.settings.clone(),
        seeds: trained.iter().map(|seed| seed.result.clone()).collect(),
        run_folder: folder.path().display().to_string(),
        wall_seconds: trained.iter().map(|seed| seed.result.wall_seconds).sum(),
    };
    let page = report::page(&resolved(config)?, setup, &results, &trained)?;
    folder.write("report.html", page.as_bytes())?;
    manifest::write(folder, &config.seeds, &setup.inputs, begun, Some(now()))?;
    let iterations = config.train.iterations;
    folder.write_json(
        RESULT,
        &ResultFile { inputs: setup.inputs.clone(), iterations, results: results.clone() },
    )?;
    Ok(results)
}

fn seed_results(
    folder: &RunFolder,
    config: &TrainConfig,
    setup: &Setup,
    seed: u64,
) -> Result<Trained, Failure> {
    let files = Files::of(seed);
    let path = folder.path().join(&files.policy);
    let bytes = folder.read_bytes(&files.policy)?.unwrap_or_default();
    let policy =
        weights::read(&bytes).map_err(|error| Failure::failed(format!("{}: {error}", path.display())))?;
    let metrics = metrics::read(folder, &files.metrics, policy.provenance.iteration)?;
    if metrics.len() != policy.provenance.iteration as usize {
        note(&format!(
            "note: {} has {} of {} iterations: the results and curves leave the others out",
            folder.path().join(&files.metrics).display(),
            metrics.len(),
            policy.provenance.iteration
        ));
    }
    let shown = show::show(config, setup, &policy, &format!("{}, seed {seed}", folder.name()))?;
    folder.write(&files.replay, shown.html.as_bytes())?;
    let result = SeedResult::new(seed, &metrics, shown.summary.clone(), folder.path());
    Ok(Trained { result, metrics, shown })
}
