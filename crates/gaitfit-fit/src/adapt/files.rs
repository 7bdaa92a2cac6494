//! The files of a fit's run folder besides metrics and checkpoint.

use super::parameter::Parameter;
use super::results::AdaptResults;
use super::score::Validation;
use super::setup::Setup;
use super::standing::Standing;
use crate::Error;
use crate::run::{Inputs, Protocol, RunFolder};
use gaitfit_adapt::fit::Uncertainty;
use gaitfit_adapt::{Found, ThetaFile};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

pub use crate::run::protocol::CONFIG;

/// Draws of θ from the joint interval.
pub const DRAWS: &str = "draws.csv";

/// Settings that change nothing: where results go, how often they are saved, on how many threads they are found.
const FREE: [&str; 6] = [
    "name",
    "runs",
    "checkpoint_seconds",
    "simulation.threads",
    "optimizer.max_seconds",
    "optimizer.generations",
];

/// Extent of a search. A fit that is resumed with more generations continues.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Extent {
    /// `optimizer.generations`.
    generations: usize,
}

/// The run of a fit in its folder.
///
/// # Errors
/// Inputs that cannot be read, settings that cannot be written.
pub fn protocol<'a>(folder: &'a RunFolder, setup: &Setup) -> Result<Protocol<'a, Extent>, Error> {
    let settings = toml::Table::try_from(&setup.config)
        .map_err(|error| Error::failed(format!("cannot write {CONFIG}: {error}")))?;
    Ok(Protocol {
        folder,
        settings,
        free: &FREE,
        inputs: inputs(setup)?,
        same_files: true,
        seeds: setup.options.seeds.clone(),
        devices: setup.devices.to_string(),
        asked: Extent { generations: setup.config.optimizer.generations },
    })
}

/// The inputs of a fit: the files that it reads, the robot, and the settings.
fn inputs(setup: &Setup) -> Result<Inputs, Error> {
    // Those that are free are put away.
    let mut settings = setup.config.clone();
    settings.name = None;
    settings.runs = String::new();
    settings.checkpoint_seconds = 0.0;
    settings.simulation.threads = 0;
    settings.optimizer.max_seconds = 0.0;
    settings.optimizer.generations = 0;
    Ok(Inputs::new(setup.files.iter().map(PathBuf::as_path), setup.method.model(), &settings)?)
}

/// Writes what was found, but for the result itself.
///
/// # Errors
/// Files that cannot be written.
pub fn write(folder: &RunFolder, setup: &Setup, results: &AdaptResults) -> Result<(), Error> {
    let text = theta(setup, results).to_toml();
    let text = text.map_err(|error| Error::failed(format!("cannot write theta.toml: {error}")))?;
    folder.write("theta.toml", text.as_bytes())?;
    if let Some(uncertainty) = results.fits.first().and_then(|fit| fit.uncertainty.as_ref()) {
        folder.write(DRAWS, draws(results, uncertainty).as_bytes())?;
    }
    Ok(folder.write_json::<Vec<Validation>>("validation.json", &results.validation)?)
}

/// Draws of θ as a table: a header with the parameters' names, then a row a draw, in their units.
fn draws(results: &AdaptResults, uncertainty: &Uncertainty) -> String {
    let names: Vec<&str> = results.parameters.iter().map(|parameter| parameter.found.name.as_str()).collect();
    let row = |draw: &Vec<f64>| draw.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    let rows: Vec<String> = uncertainty.draws.iter().map(row).collect();
    format!("{}\n{}\n", names.join(","), rows.join("\n"))
}

fn theta(setup: &Setup, results: &AdaptResults) -> ThetaFile {
    let estimate =
        |parameter: &Parameter| Found { value: parameter.found.value, spread: parameter.found.spread };
    let estimates: Vec<Found> = results.parameters.iter().map(estimate).collect();
    // Trainings read this file, and refuse a fit that walks contradict.
    let held = results.held_out.as_ref().filter(|_| results.standing == Standing::Contradicted);
    let mut file = ThetaFile {
        physics_step: setup.method.physics_step(),
        self_contact: setup.method.self_contact(),
        contradicted: held.map(super::held_out::HeldOut::sentence),
        ..ThetaFile::new(&setup.theta, &estimates, &results.robot, &results.cost_name, results.cost)
    };
    for saved in &mut file.parameter {
        if let Some(known) = results.parameters.iter().find(|known| known.found.name == saved.name) {
            // An interval without an end says nothing, so it is left out.
            saved.interval = known.interval.filter(|ends| ends.iter().all(|end| end.is_finite()));
            saved.identified = known.identified;
        }
    }
    file
}
