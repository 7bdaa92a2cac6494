//! The files of a fit's run folder besides metrics and checkpoint.

use super::report;
use super::results::{AdaptResults, Parameter};
use super::score::Validation;
use super::setup::Setup;
use crate::Error;
use crate::machine::now;
use crate::run::RunFolder;
use crate::run::inputs::Inputs;
use crate::run::manifest;
use gaitfit_adapt::fit::RunGeneration;
use gaitfit_adapt::{Found, ThetaFile};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The settings of a fit, with every default.
pub const CONFIG: &str = "config.toml";
const RESULT: &str = "result.json";

/// `result.json`: the results, and the inputs they belong to.
#[derive(Serialize, Deserialize)]
struct ResultFile {
    inputs: Inputs,
    results: AdaptResults,
}

/// What a fit's result depends on: the files it reads, the robot, and the settings.
pub fn inputs(setup: &Setup) -> Result<Inputs, Error> {
    // Where results go, how often they are saved and on how many threads they are found changes nothing.
    let mut settings = setup.config.clone();
    settings.name = None;
    settings.runs = String::new();
    settings.checkpoint_seconds = 0.0;
    settings.simulation.threads = 0;
    settings.optimizer.max_seconds = 0.0;
    Inputs::new(setup.files.iter().map(PathBuf::as_path), setup.method.model(), &settings)
}

/// The result of a folder whose fit is finished; an error if its inputs have changed since.
pub fn finished(folder: &RunFolder, inputs: &Inputs) -> Result<Option<AdaptResults>, Error> {
    let Some(text) = folder.read(RESULT)? else { return Ok(None) };
    let shown = folder.path().join(RESULT);
    let file: ResultFile = serde_json::from_str(&text).map_err(|error| {
        Error::failed(format!(
            "{}: not a result of this version: {error}. Start afresh without --resume.",
            shown.display()
        ))
    })?;
    match inputs.difference(&file.inputs) {
        None => Ok(Some(file.results)),
        Some(difference) => Err(Error::settings(format!(
            "{} is finished, and {difference} since. Start afresh without --resume.",
            folder.path().display()
        ))),
    }
}

/// Writes what is known before the fit.
pub fn begin(folder: &RunFolder, setup: &Setup, inputs: &Inputs, begun: &str) -> Result<(), Error> {
    let resolved = toml::to_string_pretty(&setup.config)
        .map_err(|error| Error::failed(format!("cannot write {CONFIG}: {error}")))?;
    folder.write(CONFIG, resolved.as_bytes())?;
    manifest::write(folder, &setup.options.seeds, inputs, begun, None)
}

/// Writes what was found. The result comes last: a folder that has it has everything.
pub fn finish(
    folder: &RunFolder,
    setup: &Setup,
    inputs: &Inputs,
    results: &AdaptResults,
    metrics: &[RunGeneration],
    begun: &str,
) -> Result<(), Error> {
    let theta = theta(setup, results)
        .to_toml()
        .map_err(|error| Error::failed(format!("cannot write theta.toml: {error}")))?;
    folder.write("theta.toml", theta.as_bytes())?;
    folder.write_json::<Vec<Validation>>("validation.json", &results.validation)?;
    let page = report::page(setup, results, metrics)?;
    folder.write("report.html", page.as_bytes())?;
    manifest::write(folder, &setup.options.seeds, inputs, begun, Some(now()))?;
    folder.write_json(RESULT, &ResultFile { inputs: inputs.clone(), results: results.clone() })
}

fn theta(setup: &Setup, results: &AdaptResults) -> ThetaFile {
    let found =
        |parameter: &Parameter| Found { value: parameter.found.value, spread: parameter.found.spread };
    let found: Vec<Found> = results.parameters.iter().map(found).collect();
    ThetaFile {
        physics_step: setup.method.physics_step(),
        ..ThetaFile::new(&setup.theta, &found, &results.robot, &results.cost_name, results.cost)
    }
}
