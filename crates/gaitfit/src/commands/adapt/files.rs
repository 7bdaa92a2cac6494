//! The files of a run folder besides metrics and checkpoint.

use super::inputs::Inputs;
use super::report;
use super::results::{Parameter, Results, Validation};
use super::setup::Setup;
use crate::config::AdaptConfig;
use crate::exit::Failure;
use crate::machine::{Machine, machine, now};
use crate::run_folder::RunFolder;
use serde::{Deserialize, Serialize};

const CONFIG: &str = "config.toml";
const MANIFEST: &str = "manifest.json";
const RESULT: &str = "result.json";

/// `manifest.json`: what made the run.
#[derive(Serialize)]
struct Manifest<'a> {
    gaitfit: &'static str,
    command: Vec<String>,
    folder: String,
    begun: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    ended: Option<String>,
    seeds: &'a [u64],
    machine: Machine,
    inputs: &'a Inputs,
}

/// `theta.toml`: the parameters alone, for programs that use them.
#[derive(Serialize)]
struct ThetaFile<'a> {
    format: u32,
    robot: &'a str,
    cost_name: &'a str,
    cost: f64,
    parameter: Vec<ThetaEntry<'a>>,
}

#[derive(Serialize)]
struct ThetaEntry<'a> {
    name: &'a str,
    kind: &'static str,
    joints: &'a [String],
    value: f64,
    unit: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    spread: Option<f64>,
    lower: f64,
    upper: f64,
    at_bound: bool,
}

/// `result.json`: the results, and the inputs they belong to.
#[derive(Serialize, Deserialize)]
struct ResultFile {
    inputs: Inputs,
    results: Results,
}

/// The result of a folder whose fit is finished; an error if its inputs have changed since.
pub fn finished(folder: &RunFolder, inputs: &Inputs) -> Result<Option<Results>, Failure> {
    let Some(text) = folder.read(RESULT)? else { return Ok(None) };
    let shown = folder.path().join(RESULT);
    let file: ResultFile = serde_json::from_str(&text).map_err(|error| {
        Failure::failed(format!(
            "{}: not a result of this version: {error}. Start afresh without --resume.",
            shown.display()
        ))
    })?;
    match inputs.difference(&file.inputs) {
        None => Ok(Some(file.results)),
        Some(difference) => Err(Failure::usage(format!(
            "{} is finished, and {difference} since. Start afresh without --resume.",
            folder.path().display()
        ))),
    }
}

/// Writes what is known before the fit.
pub fn begin(
    folder: &RunFolder,
    config: &AdaptConfig,
    setup: &Setup,
    inputs: &Inputs,
    begun: &str,
) -> Result<(), Failure> {
    let resolved = toml::to_string_pretty(config)
        .map_err(|error| Failure::failed(format!("cannot write {CONFIG}: {error}")))?;
    folder.write(CONFIG, resolved.as_bytes())?;
    manifest(folder, setup, inputs, begun, None)
}

fn manifest(
    folder: &RunFolder,
    setup: &Setup,
    inputs: &Inputs,
    begun: &str,
    ended: Option<String>,
) -> Result<(), Failure> {
    let manifest = Manifest {
        gaitfit: env!("CARGO_PKG_VERSION"),
        command: std::env::args_os().map(|argument| argument.to_string_lossy().into_owned()).collect(),
        folder: std::env::current_dir().map(|folder| folder.display().to_string()).unwrap_or_default(),
        begun,
        ended,
        seeds: &setup.options.seeds,
        machine: machine(),
        inputs,
    };
    json(folder, MANIFEST, &manifest)
}

/// Writes what was found. The result comes last: a folder that has it has everything.
pub fn finish(
    folder: &RunFolder,
    config: &AdaptConfig,
    setup: &Setup,
    inputs: &Inputs,
    results: &Results,
    begun: &str,
) -> Result<(), Failure> {
    let theta = toml::to_string(&theta(setup, results))
        .map_err(|error| Failure::failed(format!("cannot write theta.toml: {error}")))?;
    folder.write("theta.toml", theta.as_bytes())?;
    json::<Vec<Validation>>(folder, "validation.json", &results.validation)?;
    let metrics = folder.read(super::fitting::METRICS)?.unwrap_or_default();
    let page = report::page(config, setup, results, &metrics)?;
    folder.write("report.html", page.as_bytes())?;
    manifest(folder, setup, inputs, begun, Some(now()))?;
    json(folder, RESULT, &ResultFile { inputs: inputs.clone(), results: results.clone() })
}

fn theta<'a>(setup: &'a Setup, results: &'a Results) -> ThetaFile<'a> {
    let entry = |(entry, parameter): (&'a gaitfit_adapt::Entry, &'a Parameter)| ThetaEntry {
        name: &entry.name,
        kind: entry.quantity.name(),
        joints: &entry.joints,
        value: parameter.found.value,
        unit: &entry.unit,
        spread: parameter.found.spread,
        lower: entry.lower,
        upper: entry.upper,
        at_bound: parameter.found.at_bound,
    };
    ThetaFile {
        format: 1,
        robot: &results.robot,
        cost_name: &results.cost_name,
        cost: results.cost,
        parameter: setup.theta.entries.iter().zip(&results.parameters).map(entry).collect(),
    }
}

fn json<T: Serialize>(folder: &RunFolder, name: &str, value: &T) -> Result<(), Failure> {
    let mut text = serde_json::to_string_pretty(value)
        .map_err(|error| Failure::failed(format!("cannot write {name}: {error}")))?;
    text.push('\n');
    folder.write(name, text.as_bytes())
}
