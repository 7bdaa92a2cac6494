//! The files of a run folder besides metrics and checkpoint.

use super::report;
use super::results::{Parameter, Results, Validation};
use super::setup::Setup;
use crate::Error;
use crate::machine::now;
use crate::run::RunFolder;
use crate::run::inputs::Inputs;
use crate::run::manifest;
use crate::settings::AdaptConfig;
use gaitfit_adapt::{Found, ThetaFile};
use serde::{Deserialize, Serialize};

const CONFIG: &str = "config.toml";
const RESULT: &str = "result.json";

/// `result.json`: the results, and the inputs they belong to.
#[derive(Serialize, Deserialize)]
struct ResultFile {
    inputs: Inputs,
    results: Results,
}

/// The result of a folder whose fit is finished; an error if its inputs have changed since.
pub fn finished(folder: &RunFolder, inputs: &Inputs) -> Result<Option<Results>, Error> {
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
pub fn begin(
    folder: &RunFolder,
    config: &AdaptConfig,
    setup: &Setup,
    inputs: &Inputs,
    begun: &str,
) -> Result<(), Error> {
    let resolved = toml::to_string_pretty(config)
        .map_err(|error| Error::failed(format!("cannot write {CONFIG}: {error}")))?;
    folder.write(CONFIG, resolved.as_bytes())?;
    manifest::write(folder, &setup.options.seeds, inputs, begun, None)
}

/// Writes what was found. The result comes last: a folder that has it has everything.
pub fn finish(
    folder: &RunFolder,
    config: &AdaptConfig,
    setup: &Setup,
    inputs: &Inputs,
    results: &Results,
    begun: &str,
) -> Result<(), Error> {
    let theta = theta(setup, results)
        .to_toml()
        .map_err(|error| Error::failed(format!("cannot write theta.toml: {error}")))?;
    folder.write("theta.toml", theta.as_bytes())?;
    folder.write_json::<Vec<Validation>>("validation.json", &results.validation)?;
    let metrics = folder.read(crate::search::METRICS)?.unwrap_or_default();
    let page = report::page(config, setup, results, &metrics)?;
    folder.write("report.html", page.as_bytes())?;
    manifest::write(folder, &setup.options.seeds, inputs, begun, Some(now()))?;
    folder.write_json(RESULT, &ResultFile { inputs: inputs.clone(), results: results.clone() })
}

fn theta(setup: &Setup, results: &Results) -> ThetaFile {
    let found =
        |parameter: &Parameter| Found { value: parameter.found.value, spread: parameter.found.spread };
    let found: Vec<Found> = results.parameters.iter().map(found).collect();
    ThetaFile::new(&setup.theta, &found, &results.robot, &results.cost_name, results.cost)
}
