//! The files of a fit's run folder besides metrics and checkpoint.

use super::parameter::Parameter;
use super::report;
use super::results::AdaptResults;
use super::score::Validation;
use super::setup::Setup;
use super::standing::Standing;
use crate::Error;
use crate::run::{Inputs, Protocol, RunFolder};
use gaitfit_adapt::fit::{RunGeneration, Uncertainty};
use gaitfit_adapt::{Found, ThetaFile};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

pub use crate::run::protocol::CONFIG;

/// The values that robots simulated with a regression's values give, if a training with them is worth a try.
pub const ROBOTS: &str = "theta-robots.toml";
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

/// How long a fit may search. One that is resumed with more generations continues.
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

/// What a fit's result depends on: the files it reads, the robot, and the settings.
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
pub fn write(
    folder: &RunFolder,
    setup: &Setup,
    results: &AdaptResults,
    metrics: &[RunGeneration],
) -> Result<(), Error> {
    let write = |name: &str, theta: ThetaFile| -> Result<(), Error> {
        let text = theta.to_toml().map_err(|error| Error::failed(format!("cannot write {name}: {error}")))?;
        Ok(folder.write(name, text.as_bytes())?)
    };
    write("theta.toml", theta(setup, results))?;
    let regression = results.fits.first().and_then(|fit| fit.regression.as_ref());
    if let Some((regression, cost)) = regression.and_then(|one| Some((one, one.worth_trying?))) {
        write(ROBOTS, with_values(theta(setup, results), &results.parameters, &regression.corrected, cost))?;
    }
    if let Some(uncertainty) = results.fits.first().and_then(|fit| fit.uncertainty.as_ref()) {
        folder.write(DRAWS, draws(results, uncertainty).as_bytes())?;
    }
    folder.write_json::<Vec<Validation>>("validation.json", &results.validation)?;
    let page = report::page(setup, results, metrics)?;
    Ok(folder.write("report.html", page.as_bytes())?)
}

/// Draws of θ as a table: a header with the parameters' names, then a row a draw, in their units.
fn draws(results: &AdaptResults, uncertainty: &Uncertainty) -> String {
    let names: Vec<&str> = results.parameters.iter().map(|parameter| parameter.found.name.as_str()).collect();
    let row = |draw: &Vec<f64>| draw.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    let rows: Vec<String> = uncertainty.draws.iter().map(row).collect();
    format!("{}\n{}\n", names.join(","), rows.join("\n"))
}

/// `file` with `values` of the parameters, in their order, whose cost is `cost`.
fn with_values(mut file: ThetaFile, parameters: &[Parameter], values: &[f64], cost: f64) -> ThetaFile {
    file.cost = Some(cost);
    for (parameter, &value) in parameters.iter().zip(values) {
        for saved in file.parameter.iter_mut().filter(|saved| saved.name == parameter.found.name) {
            saved.value = value;
            saved.at_bound = Some(saved.lower == Some(value) || saved.upper == Some(value));
        }
    }
    file
}

fn theta(setup: &Setup, results: &AdaptResults) -> ThetaFile {
    let found =
        |parameter: &Parameter| Found { value: parameter.found.value, spread: parameter.found.spread };
    let found: Vec<Found> = results.parameters.iter().map(found).collect();
    let held = results.held_out.as_ref().filter(|_| results.standing == Standing::Contradicted);
    let mut file = ThetaFile {
        physics_step: setup.method.physics_step(),
        contradicted: held.map(super::held_out::HeldOut::sentence),
        ..ThetaFile::new(&setup.theta, &found, &results.robot, &results.cost_name, results.cost)
    };
    for saved in &mut file.parameter {
        if let Some(known) = results.parameters.iter().find(|known| known.found.name == saved.name) {
            saved.interval = known.interval.filter(|ends| ends.iter().all(|end| end.is_finite()));
            saved.identified = known.identified;
        }
    }
    file
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::super::parameter::example;
    use super::*;

    #[test]
    fn a_file_takes_the_values_of_simulated_robots() {
        let text = "format = 2\ncost = 0.1\n[[parameter]]\nname = \"delay\"\nkind = \"delay\"\nvalue = 0.005\nupper = 0.02\n\
                    [[parameter]]\nname = \"damping\"\nkind = \"damping\"\njoints = [\"*\"]\nvalue = 0.3\n";
        let file = ThetaFile::parse(text).unwrap();
        let parameters = [
            example("damping", 0.3, [0.0, 1.0], [0.1, 0.5]),
            example("delay", 0.005, [0.0, 0.02], [0.0, 0.01]),
        ];
        let found = with_values(file, &parameters, &[0.4, 0.02], 0.2);
        let values: Vec<f64> = found.parameter.iter().map(|saved| saved.value).collect();
        assert_eq!((values, found.cost), (vec![0.02, 0.4], Some(0.2)));
        assert_eq!((found.parameter[0].at_bound, found.parameter[1].at_bound), (Some(true), Some(false)));
    }
}
