//! `gaitfit train`: trains a policy by PPO.

mod table;

use super::run_name;
use crate::cli;
use crate::exit::Failure;
use crate::progress::Lines;
use crate::watcher::watched;
use crate::{interrupt, output, viewer};
use gaitfit::settings::{self, TrainConfig};
use gaitfit::train::{self, Results};
use gaitfit_model::argument;
use std::path::Path;

/// Plain lines of progress over a training.
pub const LINES: Lines = Lines::Parts(10);

/// Trains all seeds, or continues them, and reports what came out.
pub fn run(args: &cli::Train) -> Result<(), Failure> {
    let mut config: TrainConfig = settings::load(args.config.as_deref(), &args.run.set)?;
    let name = run_name(args.run.name.as_ref(), config.name.as_ref(), args.config.as_deref());
    let name = name.unwrap_or_else(|| config.task.base.name().to_owned());
    config.name = Some(name.clone());
    if let Some(seeds) = &args.seeds {
        config.seeds = seeds.0.clone();
    }
    let threads = args.run.threads();
    if let Some(robot) = &args.robot {
        config.robot = Some(robot.display().to_string());
    }
    let devices = args.run.devices(args.device.as_ref(), &config.runs, &name);
    let setup = train::setup(&config, &name, args.config.as_deref(), threads, &devices)?;
    output::devices(&setup.devices);
    interrupt::listen()?;
    print(&watched(LINES, |watch| train::train(&setup, args.run.resume, watch))?, &args.run)
}

/// Prints what came out, and opens the page if that was asked.
pub fn print(results: &Results, run: &cli::RunArgs) -> Result<(), Failure> {
    if run.json {
        output::print_json(results)?;
    } else {
        output::print(&table::text(results))?;
        // If all updates taught the critic alone, the policy is still the one that the training began with.
        if let Some(seed) = results.seeds.first().filter(|_| results.trained) {
            let policy = argument(Path::new(&seed.policy));
            output::next(&[format!("gaitfit evaluate {policy} --report evaluation.html")])?;
        }
    }
    viewer::report(run.open, &results.run_folder);
    Ok(())
}
