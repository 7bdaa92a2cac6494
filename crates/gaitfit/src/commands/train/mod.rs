//! `gaitfit train`: trains a policy by PPO.

mod files;
mod metrics;
mod report;
mod results;
mod seed;
mod setup;
mod show;
mod table;

use crate::cli;
use crate::config::{self, TrainConfig};
use crate::exit::Failure;
use crate::output::{self, note};
use crate::run_folder::RunFolder;
use crate::{interrupt, machine};
use std::path::Path;

/// Trains all seeds, or continues them, and reports what came out.
pub fn run(args: &cli::Train) -> Result<(), Failure> {
    let mut config: TrainConfig = config::load(args.config.as_deref(), &args.set)?;
    let stem =
        args.config.as_deref().and_then(Path::file_stem).map(|stem| stem.to_string_lossy().into_owned());
    let name = args.name.clone().or_else(|| config.name.clone()).or(stem);
    let name = name.unwrap_or_else(|| config.task.base.name().to_owned());
    config.name = Some(name.clone());
    if let Some(seeds) = &args.seeds {
        config.seeds = seeds.0.clone();
    }
    let threads = args.threads.map_or_else(machine::threads, std::num::NonZeroUsize::get);
    let setup = setup::setup(&config, args.config.as_deref(), threads)?;
    let runs = Path::new(&config.runs);
    let earlier = if args.resume { RunFolder::latest(runs, &name)? } else { None };
    let folder = match earlier {
        Some(folder) => {
            files::check_same(&folder, &config)?;
            folder
        }
        None => {
            if args.resume {
                note(&format!("note: there is no run called {name} in {}; starting one", runs.display()));
            }
            RunFolder::fresh(runs, &name)?
        }
    };
    let results = match files::finished(&folder, &config, &setup)? {
        Some(results) => {
            note(&format!("note: {} is finished; this is its result", folder.path().display()));
            results
        }
        None => {
            let begun = machine::now();
            files::begin(&folder, &config, &setup, &begun)?;
            interrupt::listen()?;
            for &seed in &config.seeds {
                seed::train(&config, &setup, &folder, seed)?;
            }
            files::finish(&folder, &config, &setup, &begun)?
        }
    };
    if args.json { output::print_json(&results) } else { output::print(&table::text(&results)) }
}
