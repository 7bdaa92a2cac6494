//! A fit of walking logs in its run folder.

use crate::Error;
use crate::machine::now;
use crate::run::RunFolder;
use crate::run::inputs::Inputs;
use crate::run::manifest;
use crate::search::{self, Fitting};
use crate::settings::AdaptConfig;
use crate::walk::report;
use crate::walk::results::{GroundResults, results};
use crate::walk::setup::Ground;
use crate::watch::Watch;
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
pub fn fit(
    config: &AdaptConfig,
    ground: &Ground,
    folder: &RunFolder,
    watch: &Watch<'_>,
) -> Result<GroundResults, Error> {
    for warning in &ground.warnings {
        watch.note(warning);
    }
    let inputs = inputs(config, ground)?;
    if let Some(text) = folder.read(RESULT)? {
        return finished(folder, &text, &inputs, watch);
    }
    let begun = now();
    let resolved = toml::to_string_pretty(config)
        .map_err(|error| Error::failed(format!("cannot write config.toml: {error}")))?;
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
    let (outcomes, seconds) = search::fit(&fitting, folder, &inputs, watch)?;
    let name = config.name.clone().unwrap_or_default();
    let names = [name, folder.path().display().to_string()];
    let results = results(config, ground, &simulator, &costs, &outcomes, names, seconds, watch)?;
    let theta = theta_text(ground, &results)?;
    folder.write("theta.toml", theta.as_bytes())?;
    let metrics = folder.read(search::METRICS)?.unwrap_or_default();
    let page = report::page(config, ground, &simulator, &results, &metrics)?;
    folder.write("report.html", page.as_bytes())?;
    manifest::write(folder, &ground.options.seeds, &inputs, &begun, Some(now()))?;
    folder.write_json(RESULT, &ResultFile { inputs, results: results.clone() })?;
    Ok(results)
}

fn finished(
    folder: &RunFolder,
    text: &str,
    inputs: &Inputs,
    watch: &Watch<'_>,
) -> Result<GroundResults, Error> {
    let shown = folder.path().join(RESULT);
    let file: ResultFile = serde_json::from_str(text).map_err(|error| {
        Error::failed(format!(
            "{}: not a result of this version: {error}. Start afresh without --resume.",
            shown.display()
        ))
    })?;
    if let Some(difference) = inputs.difference(&file.inputs) {
        return Err(Error::settings(format!(
            "{} is finished, and {difference} since. Start afresh without --resume.",
            folder.path().display()
        )));
    }
    watch.note(&format!("{} is finished; this is its result", folder.path().display()));
    Ok(file.results)
}

fn theta_text(ground: &Ground, results: &GroundResults) -> Result<String, Error> {
    let Some(first) = results.fits.first() else {
        return Err(Error::failed("the fit found nothing to write"));
    };
    let found: Vec<Found> = first
        .parameters
        .iter()
        .map(|parameter| Found { value: parameter.found.value, spread: parameter.found.spread })
        .collect();
    let step = Some(ground.scene.walker.physics_step());
    ThetaFile {
        physics_step: step,
        ..ThetaFile::new(&ground.theta, &found, &results.robot, &first.cost_name, first.cost)
    }
    .to_toml()
    .map_err(|error| Error::failed(format!("cannot write theta.toml: {error}")))
}

/// What the fit depends on.
fn inputs(config: &AdaptConfig, ground: &Ground) -> Result<Inputs, Error> {
    // Where results go, how often they are saved and on how many threads they are found changes nothing.
    let mut settings = config.clone();
    settings.name = None;
    settings.runs = String::new();
    settings.checkpoint_seconds = 0.0;
    settings.simulation.threads = 0;
    settings.optimizer.max_seconds = 0.0;
    Inputs::new(
        ground.files.iter().map(std::path::PathBuf::as_path),
        ground.scene.walker.batch.model(),
        &settings,
    )
}
