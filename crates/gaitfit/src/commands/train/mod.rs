//! `gaitfit train`: trains a policy by PPO. `gaitfit finetune` goes the same way from a policy that exists.

mod files;
mod metrics;
mod report;
mod results;
mod seed;
mod setup;
mod show;
mod table;

pub use files::difference;
pub use results::{Parent, Results, SeedResult};
pub use setup::{Plan, Setup, Start, advice, refused, table as configuration};

use crate::cli;
use crate::config::{self, TrainConfig};
use crate::exit::Failure;
use crate::output::{self, note};
use crate::run_folder::RunFolder;
use crate::{interrupt, machine};
use gaitfit_view::training::SeedCurve;
use std::path::Path;

/// Trains all seeds, or continues them, and reports what came out.
pub fn run(args: &cli::Train) -> Result<(), Failure> {
    let mut config: TrainConfig = config::load(args.config.as_deref(), &args.set)?;
    let name = name(args.name.as_ref(), config.name.as_ref(), args.config.as_deref());
    let name = name.unwrap_or_else(|| config.task.base.name().to_owned());
    config.name = Some(name.clone());
    if let Some(seeds) = &args.seeds {
        config.seeds = seeds.0.clone();
    }
    let threads = args.threads.map_or_else(machine::threads, std::num::NonZeroUsize::get);
    let setup = setup::setup(&config, &name, args.config.as_deref(), threads)?;
    interrupt::listen()?;
    print(&train(&setup, args.resume)?, args.json)
}

/// The name of a run: as asked for, as configured, or the configuration file's stem.
pub fn name(asked: Option<&String>, configured: Option<&String>, path: Option<&Path>) -> Option<String> {
    let stem = || Some(path?.file_stem()?.to_string_lossy().into_owned());
    asked.or(configured).cloned().or_else(stem)
}

/// Trains all seeds in a run folder of their own, or continues the latest one of that name. Ctrl-C ends it cleanly once
/// [`interrupt::listen`] was called.
pub fn train(setup: &Setup, resume: bool) -> Result<Results, Failure> {
    let (name, runs) = (&setup.plan.name, Path::new(&setup.plan.runs));
    let earlier = if resume { RunFolder::latest(runs, name)? } else { None };
    let folder = match earlier {
        Some(folder) => folder,
        None => {
            if resume {
                note(&format!("note: there is no run called {name} in {}; starting one", runs.display()));
            }
            RunFolder::fresh(runs, name)?
        }
    };
    train_in(setup, &folder)
}

/// Trains all seeds in this folder, or continues what it holds.
pub fn train_in(setup: &Setup, folder: &RunFolder) -> Result<Results, Failure> {
    files::check_same(folder, &setup.plan)?;
    if let Some(results) = files::finished(folder, setup)? {
        note(&format!("note: {} is finished; this is its result", folder.path().display()));
        return Ok(results);
    }
    let begun = machine::now();
    files::begin(folder, setup, &begun)?;
    for &seed in &setup.plan.seeds {
        seed::train(setup, folder, seed)?;
    }
    files::finish(folder, setup, &begun)
}

/// The learning curves of a finished run.
pub fn curves(folder: &RunFolder, results: &Results) -> Result<Vec<SeedCurve>, Failure> {
    let curve = |seed: &SeedResult| {
        let metrics = metrics::read(folder, &seed::Files::of(seed.seed).metrics, seed.iterations)?;
        Ok(report::curve(seed, &metrics))
    };
    results.seeds.iter().map(curve).collect()
}

/// Prints what came out.
pub fn print(results: &Results, json: bool) -> Result<(), Failure> {
    if json { output::print_json(results) } else { output::print(&table::text(results)) }
}
