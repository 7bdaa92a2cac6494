//! `gaitfit loop`: collect, adapt, fine-tune, evaluate, repeated while it helps.

pub mod files;
mod presence;
mod report;
pub mod results;
pub mod rounds;
pub mod setup;
pub mod stages;
mod table;

use crate::cli;
use crate::config::{self, LoopConfig};
use crate::exit::Failure;
use crate::interrupt;
use crate::machine;
use crate::output::{self, note};
use crate::run_folder::RunFolder;
use results::Results;
use setup::Setup;
use std::path::Path;

/// Runs or continues a loop and reports what came out.
pub fn run(args: &cli::Loop) -> Result<(), Failure> {
    let mut config: LoopConfig = config::load(Some(&args.config), &args.set)?;
    let name = super::train::name(args.name.as_ref(), config.name.as_ref(), Some(&args.config));
    let name = name.unwrap_or_else(|| "loop".to_owned());
    config.name = Some(name.clone());
    config.check(&args.config)?;
    let threads = args.threads.map_or_else(machine::threads, std::num::NonZeroUsize::get);
    let setup = Setup::open(config, &args.config, threads)?;
    interrupt::listen()?;
    let folder = folder(&setup.config.runs, &name, args.resume)?;
    files::check_same(&folder, &setup)?;
    let results = match files::finished(&folder, &setup)? {
        Some(results) => {
            note(&format!("note: {} is finished; this is its result", folder.path().display()));
            results
        }
        None => {
            let begun = machine::now();
            files::begin(&folder, &setup, &begun)?;
            let done = rounds::run(&setup, &folder)?;
            report::write(&setup, &folder, &done)?;
            files::finish(&folder, &setup, &begun, done.results)?
        }
    };
    print(&results, args.json)
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

fn print(results: &Results, json: bool) -> Result<(), Failure> {
    if json { output::print_json(results) } else { output::print(&table::text(results)) }
}
