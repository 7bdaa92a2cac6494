//! `gaitfit adapt` with walking logs.

use crate::config::AdaptConfig;
use crate::exit::Failure;
use crate::fitting::{self, Fitting};
use crate::ground::results::{GroundResults, results};
use crate::ground::setup::Ground;
use crate::ground::{report, table};
use crate::inputs::Inputs;
use crate::machine::now;
use crate::manifest;
use crate::output::{self, note};
use crate::run_folder::RunFolder;
use gaitfit_adapt::{Found, ThetaFile};
use serde::{Deserialize, Serialize};

const RESULT: &str = "result.json";

/// `result.json`: the results, and the inputs they belong to.
#[derive(Serialize, Deserialize)]
struct ResultFile {
    inputs: Inputs,
    results: GroundResults,
}

/// Fits in `folder`, or goes on where it was left, or gives what it found. `config` is as it was read, with the run's
/// name.
pub fn fit(config: &AdaptConfig, ground: &Ground, folder: &RunFolder) -> Result<GroundResults, Failure> {
    for warning in &ground.warnings {
        note(&format!("note: {warning}"));
    }
    let inputs = inputs(config, ground)?;
    if let Some(text) = folder.read(RESULT)? {
        return finished(folder, &text, &inputs);
    }
    let begun = now();
    let resolved = toml::to_string_pretty(config)
        .map_err(|error| Failure::failed(format!("cannot write config.toml: {error}")))?;
    folder.write("config.toml", resolved.as_bytes())?;
    manifest::write(folder, &ground.options.seeds, &inputs, &begun, None)?;
    let simulator = ground.simulator();
    let costs = ground.costs(config, &simulator)?;
    let fitting = Fitting {
        simulator: &simulator,
        theta: &ground.theta,
        costs: &costs,
        options: &ground.options,
        max_seconds: config.optimizer.max_seconds,
        checkpoint_seconds: config.checkpoint_seconds,
    };
    let (outcomes, seconds) = fitting::fit(&fitting, folder, &inputs)?;
    let name = config.name.clone().unwrap_or_default();
    let names = [name, folder.path().display().to_string()];
    let results = results(config, ground, &simulator, &costs, &outcomes, names, seconds)?;
    let theta = theta_text(ground, &results)?;
    folder.write("theta.toml", theta.as_bytes())?;
    let metrics = folder.read(fitting::METRICS)?.unwrap_or_default();
    let page = report::page(config, ground, &simulator, &results, &metrics)?;
    folder.write("report.html", page.as_bytes())?;
    manifest::write(folder, &ground.options.seeds, &inputs, &begun, Some(now()))?;
    folder.write_json(RESULT, &ResultFile { inputs, results: results.clone() })?;
    Ok(results)
}

/// Prints the result; what the logs' warnings are [`fit`] has said.
pub fn print(results: &GroundResults, ground: &Ground, json: bool) -> Result<(), Failure> {
    if json { output::print_json(results) } else { output::print(&table::text(results, &ground.warnings)) }
}

fn finished(folder: &RunFolder, text: &str, inputs: &Inputs) -> Result<GroundResults, Failure> {
    let shown = folder.path().join(RESULT);
    let file: ResultFile = serde_json::from_str(text).map_err(|error| {
        Failure::failed(format!(
            "{}: not a result of this version: {error}. Start afresh without --resume.",
            shown.display()
        ))
    })?;
    if let Some(difference) = inputs.difference(&file.inputs) {
        return Err(Failure::usage(format!(
            "{} is finished, and {difference} since. Start afresh without --resume.",
            folder.path().display()
        )));
    }
    note(&format!("note: {} is finished; this is its result", folder.path().display()));
    Ok(file.results)
}

fn theta_text(ground: &Ground, results: &GroundResults) -> Result<String, Failure> {
    let Some(first) = results.fits.first() else {
        return Err(Failure::failed("the fit found nothing to write"));
    };
    let found: Vec<Found> = first
        .parameters
        .iter()
        .map(|parameter| Found { value: parameter.found.value, spread: parameter.found.spread })
        .collect();
    let step = Some(ground.scene.physics_step());
    ThetaFile {
        physics_step: step,
        ..ThetaFile::new(&ground.theta, &found, &results.robot, &first.cost_name, first.cost)
    }
    .to_toml()
    .map_err(|error| Failure::failed(format!("cannot write theta.toml: {error}")))
}

/// What the fit depends on.
fn inputs(config: &AdaptConfig, ground: &Ground) -> Result<Inputs, Failure> {
    // Where results go, how often they are saved and on how many threads they are found changes nothing.
    let mut settings = config.clone();
    settings.name = None;
    settings.runs = String::new();
    settings.checkpoint_seconds = 0.0;
    settings.simulation.threads = 0;
    settings.optimizer.max_seconds = 0.0;
    Inputs::new(ground.files.iter().map(std::path::PathBuf::as_path), ground.scene.batch.model(), &settings)
}
