//! `gaitfit adapt`: fits the simulator's parameters to logs of a robot.

mod air_table;
mod walk_table;

use super::run_name;
use crate::cli;
use crate::exit::{Exit, Failure};
use crate::progress::Lines;
use crate::watcher::watched;
use crate::{interrupt, output};
use gaitfit::run::RunFolder;
use gaitfit::settings::{self, AdaptConfig, Base};
use gaitfit::walk::setup::Ground;
use gaitfit::watch::Watch;
use gaitfit::{air, walk};
use std::path::Path;

/// Runs or continues a fit and reports what it found.
pub fn run(args: &cli::Adapt) -> Result<(), Failure> {
    let mut config: AdaptConfig = settings::load(Some(&args.config), &args.run.set)?;
    let name = run_name(args.run.name.as_ref(), config.name.as_ref(), Some(&args.config)).unwrap_or_default();
    config.name = Some(name.clone());
    // The folder keeps every default, these too.
    config.parameter.iter_mut().for_each(gaitfit_adapt::ParameterRule::resolve);
    config.number.iter_mut().for_each(gaitfit_adapt::RobotRule::resolve);
    let threads = args.run.threads.map(std::num::NonZeroUsize::get);
    watched(Lines::Seconds(5), |watch| match config.base {
        Base::Free => walk(args, &config, &name, threads, watch),
        Base::Fixed => air(args, &config, &name, threads, watch),
    })
}

fn walk(
    args: &cli::Adapt,
    config: &AdaptConfig,
    name: &str,
    threads: Option<usize>,
    watch: &Watch<'_>,
) -> Result<(), Failure> {
    let ground = Ground::open(config, &args.config, threads)?;
    let folder = RunFolder::begin(Path::new(&config.runs), name, args.run.resume, watch)?;
    interrupt::listen()?;
    let results = walk::fit::fit(config, &ground, &folder, watch)?;
    if args.run.json {
        output::print_json(&results)
    } else {
        output::print(&walk_table::text(&results, &ground.warnings))
    }
}

fn air(
    args: &cli::Adapt,
    config: &AdaptConfig,
    name: &str,
    threads: Option<usize>,
    watch: &Watch<'_>,
) -> Result<(), Failure> {
    let setup = air::setup(config, &args.config, threads)?;
    let folder = RunFolder::begin(Path::new(&config.runs), name, args.run.resume, watch)?;
    interrupt::listen()?;
    let results = air::fit(config, &setup, &folder, watch)?;
    if args.run.json {
        output::print_json(&results)?;
    } else {
        output::print(&air_table::text(&results, &setup.warnings))?;
    }
    let failed: Vec<String> =
        results.checks.iter().filter(|check| !check.passed).map(air::results::Check::text).collect();
    if failed.is_empty() {
        return Ok(());
    }
    Err(Failure { exit: Exit::Check, message: format!("a check failed: {}", failed.join("; ")) })
}
