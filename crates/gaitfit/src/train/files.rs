//! The files of a run folder besides those of its seeds.

use super::metrics::{self, Metric};
use super::report;
use super::results::{Results, SeedResult};
use super::seed::Files;
use super::setup::{Plan, Setup};
use super::show::{self, Shown};
use crate::Error;
use crate::machine::now;
use crate::run::RunFolder;
use crate::run::inputs::Inputs;
use crate::run::manifest;
use crate::watch::Watch;
use gaitfit_policy::weights;
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

/// Settings that do not change what an iteration does; files count as what they are, not by their names.
const FREE: [&str; 8] =
    ["name", "runs", "seeds", "checkpoint_seconds", "robot", "lenient", "policy", "theta"];

/// Refuses to continue a run of other settings, naming one that differs.
pub fn check_same(folder: &RunFolder, plan: &Plan) -> Result<(), Error> {
    let Some(text) = folder.read(CONFIG)? else { return Ok(()) };
    let shown = folder.path().join(CONFIG);
    let saved: Table = toml::from_str(&text).map_err(|_| {
        Error::failed(format!(
            "{}: not a configuration ({} bytes). Restore it, or start afresh without --resume.",
            shown.display(),
            text.len()
        ))
    })?;
    if let Some(less) = shrunk(&saved, plan) {
        return Err(Error::settings(format!(
            "{} cannot be continued: {less}, or start afresh without --resume",
            folder.path().display()
        )));
    }
    match difference("", &bound(saved), &bound(plan.configuration.clone())) {
        None => Ok(()),
        Some(difference) => Err(Error::settings(format!(
            "{} cannot be continued: {difference}. Give the run's own settings (--resume with {}), or start afresh \
             without --resume.",
            folder.path().display(),
            shown.display()
        ))),
    }
}

/// What the run has more of than is asked for now, and how to ask for it.
fn shrunk(saved: &Table, plan: &Plan) -> Option<String> {
    let iterations = saved.get("train")?.get("iterations")?.as_integer()?;
    if i64::from(plan.train.iterations) < iterations {
        let now = plan.train.iterations;
        return Some(format!(
            "`train.iterations` was {iterations}, now it is {now}, and it may only grow: give --set \
             train.iterations={iterations}"
        ));
    }
    let seeds = saved.get("seeds")?.as_array()?.iter().filter_map(Value::as_integer);
    let gone =
        seeds.into_iter().find(|&seed| !plan.seeds.iter().any(|&kept| i64::try_from(kept) == Ok(seed)))?;
    Some(format!(
        "`seeds` had {gone} and now lacks it, and the list may only grow: give all of the run's seeds"
    ))
}

/// What a run is bound to of its settings.
fn bound(mut settings: Table) -> Value {
    settings.retain(|key, _| !FREE.contains(&key));
    if let Some(Value::Table(train)) = settings.get_mut("train") {
        train.remove("iterations");
    }
    Value::Table(settings)
}

/// The first setting that differs, in words; `path`: where the values are.
pub fn difference(path: &str, saved: &Value, wanted: &Value) -> Option<String> {
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
pub fn finished(folder: &RunFolder, setup: &Setup) -> Result<Option<Results>, Error> {
    let Some(text) = folder.read(RESULT)? else { return Ok(None) };
    let file: ResultFile = serde_json::from_str(&text).map_err(|error| {
        Error::failed(format!(
            "{}: not a result of this version: {error}. Start afresh without --resume.",
            folder.path().join(RESULT).display()
        ))
    })?;
    let seeds: Vec<u64> = file.results.seeds.iter().map(|seed| seed.seed).collect();
    if seeds != setup.plan.seeds || file.iterations != setup.plan.train.iterations {
        return Ok(None);
    }
    // The robot counts as what it is, wherever its file lies.
    let of = |inputs: &Inputs| Inputs { files: Default::default(), ..inputs.clone() };
    match of(&setup.inputs).difference(&of(&file.inputs)) {
        None => Ok(Some(file.results)),
        Some(difference) => Err(Error::settings(format!(
            "{} is finished, and {difference} since. Start afresh without --resume.",
            folder.path().display()
        ))),
    }
}

/// Writes what is known before the training.
pub fn begin(folder: &RunFolder, setup: &Setup, begun: &str) -> Result<(), Error> {
    folder.write(CONFIG, resolved(&setup.plan)?.as_bytes())?;
    manifest::write(folder, &setup.plan.seeds, &setup.inputs, begun, None)
}

fn resolved(plan: &Plan) -> Result<String, Error> {
    toml::to_string_pretty(&plan.configuration)
        .map_err(|error| Error::failed(format!("cannot write {CONFIG}: {error}")))
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
pub fn finish(folder: &RunFolder, setup: &Setup, begun: &str, watch: &Watch<'_>) -> Result<Results, Error> {
    let plan = &setup.plan;
    let mut trained = Vec::with_capacity(plan.seeds.len());
    for &seed in &plan.seeds {
        trained.push(seed_results(folder, setup, seed, watch)?);
    }
    let results = Results {
        name: folder.name(),
        robot: setup.model.name.clone(),
        task: plan.task.clone(),
        environments: plan.train.environments,
        steps: plan.train.steps,
        parent: setup.start.as_ref().map(|start| start.parent.clone()),
        configuration_hash: setup.inputs.settings.clone(),
        seeds: trained.iter().map(|seed| seed.result.clone()).collect(),
        run_folder: folder.path().display().to_string(),
        wall_seconds: trained.iter().map(|seed| seed.result.wall_seconds).sum(),
    };
    let page = report::page(&resolved(plan)?, setup, &results, &trained)?;
    folder.write("report.html", page.as_bytes())?;
    manifest::write(folder, &plan.seeds, &setup.inputs, begun, Some(now()))?;
    let iterations = plan.train.iterations;
    folder.write_json(
        RESULT,
        &ResultFile { inputs: setup.inputs.clone(), iterations, results: results.clone() },
    )?;
    Ok(results)
}

fn seed_results(folder: &RunFolder, setup: &Setup, seed: u64, watch: &Watch<'_>) -> Result<Trained, Error> {
    let files = Files::of(seed);
    let path = folder.path().join(&files.policy);
    let bytes = folder.read_bytes(&files.policy)?.unwrap_or_default();
    let policy =
        weights::read(&bytes).map_err(|error| Error::failed(format!("{}: {error}", path.display())))?;
    let metrics = metrics::read(folder, &files.metrics, policy.provenance.iteration)?;
    if metrics.len() != policy.provenance.iteration as usize {
        watch.note(&format!(
            "{} has {} of {} iterations: the results and curves leave the others out",
            folder.path().join(&files.metrics).display(),
            metrics.len(),
            policy.provenance.iteration
        ));
    }
    let shown = show::show(setup, &policy, &format!("{}, seed {seed}", folder.name()))?;
    folder.write(&files.replay, shown.html.as_bytes())?;
    let result = SeedResult::new(seed, &metrics, shown.summary.clone(), folder.path());
    Ok(Trained { result, metrics, shown })
}
