//! `gaitfit adapt`: fits the simulator's parameters to logs of a robot.

mod files;
pub mod ground;
mod inputs;
mod logs;
mod report;
mod results;
mod setup;
mod table;

use crate::cli;
use crate::config;
use crate::exit::{Exit, Failure};
use crate::fitting;
use crate::ground::setup::Ground;
use crate::output::{self, note};
use crate::run_folder::RunFolder;
use results::Results;
use std::path::Path;

/// Runs or continues a fit and reports what it found.
pub fn run(args: &cli::Adapt) -> Result<(), Failure> {
    let mut config: config::AdaptConfig = config::load(Some(&args.config), &args.set)?;
    let stem = || args.config.file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let name = args.name.clone().or_else(|| config.name.clone()).or_else(stem).unwrap_or_default();
    config.name = Some(name.clone());
    // The folder keeps every default, these too.
    config.parameter.iter_mut().for_each(gaitfit_adapt::ParameterRule::resolve);
    config.number.iter_mut().for_each(gaitfit_adapt::RobotRule::resolve);
    let threads = args.threads.map(std::num::NonZeroUsize::get);
    if config.base == config::Base::Free {
        let ground = Ground::open(&config, &args.config, threads)?;
        let folder = folder(&config.runs, &name, args.resume)?;
        let results = ground::fit(&config, &ground, &folder)?;
        return ground::print(&results, &ground, args.json);
    }
    let setup = setup::setup(&config, &args.config, threads)?;
    for warning in &setup.warnings {
        note(&format!("note: {warning}"));
    }
    let folder = folder(&config.runs, &name, args.resume)?;
    let inputs = inputs::inputs(&config, &setup)?;
    let results = match files::finished(&folder, &inputs)? {
        Some(results) => {
            note(&format!("note: {} is finished; this is its result", folder.path().display()));
            results
        }
        None => {
            let begun = crate::machine::now();
            files::begin(&folder, &config, &setup, &inputs, &begun)?;
            let (outcomes, seconds) = fitting::fit(&setup.fitting(&config), &folder, &inputs)?;
            let results = results::results(&config, &setup, &outcomes, &folder, seconds)?;
            files::finish(&folder, &config, &setup, &inputs, &results, &begun)?;
            results
        }
    };
    report(&results, &setup.warnings, args.json)
}

/// The folder of a new run, or the latest of that name.
fn folder(runs: &str, name: &str, resume: bool) -> Result<RunFolder, Failure> {
    let runs = Path::new(runs);
    if resume {
        if let Some(folder) = RunFolder::latest(runs, name)? {
            return Ok(folder);
        }
        note(&format!("note: there is no run called {name} in {}; starting one", runs.display()));
    }
    RunFolder::fresh(runs, name)
}

/// Prints the result, less the warnings that were `said`; a check that failed decides the exit code.
fn report(results: &Results, said: &[String], json: bool) -> Result<(), Failure> {
    if json {
        output::print_json(results)?;
    } else {
        output::print(&table::text(results, said))?;
    }
    let failed: Vec<String> = results.checks.iter().filter(|check| !check.passed).map(table::check).collect();
    if failed.is_empty() {
        return Ok(());
    }
    Err(Failure { exit: Exit::Check, message: format!("a check failed: {}", failed.join("; ")) })
}
