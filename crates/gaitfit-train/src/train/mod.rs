//! Trains a policy by PPO: from nothing, or from a policy that exists (see [`crate::finetune`]).

mod files;
mod metrics;
#[cfg(feature = "report")]
mod report;
mod results;
mod seed;
mod setup;
mod show;

pub use results::{LAST, Parent, Results, SeedResult};
pub use setup::{Plan, Setup, Start, advice, refused, setup, table as configuration};

use crate::Error;
use crate::crew::together;
use crate::run::RunFolder;
use crate::watch::Watch;
#[cfg(feature = "report")]
use gaitfit_view::training::SeedCurve;
use std::path::Path;

/// Trains all seeds in a run folder of their own, or continues the latest one of that name.
pub fn train(setup: &Setup, resume: bool, watch: &Watch<'_>) -> Result<Results, Error> {
    let folder = RunFolder::begin(Path::new(&setup.plan.runs), &setup.plan.name, resume)?;
    train_in(setup, &folder, watch)
}

/// Trains all seeds in this folder, or continues what it holds.
pub fn train_in(setup: &Setup, folder: &RunFolder, watch: &Watch<'_>) -> Result<Results, Error> {
    let protocol = files::protocol(folder, setup);
    // Checked apart: iterations and seeds are free settings, so the protocol would let fewer of them pass.
    files::check_grown(&protocol, &setup.plan)?;
    setup.warnings.iter().for_each(|warning| watch.note(warning));
    protocol.run(watch, || {
        seeds(setup, folder, watch)?;
        files::results(folder, setup, watch)
    })
}

/// Trains the seeds one after the other, or as many at a time as there are groups of GPUs.
fn seeds(setup: &Setup, folder: &RunFolder, watch: &Watch<'_>) -> Result<(), Error> {
    let seeds = &setup.plan.seeds;
    // A single group trains one seed after the other, on all devices that it has.
    let groups = setup.devices.groups(seeds.len());
    if let [all] = &groups[..] {
        return seeds.iter().try_for_each(|&seed| seed::train(setup, folder, seed, all, watch));
    }
    let names: Vec<String> = seeds.iter().map(|seed| format!("seed {seed}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let train = |number: usize, worker: usize, watch: &Watch<'_>| {
        seed::train(setup, folder, seeds[number], &groups[worker % groups.len()], watch)
    };
    together(&names, groups.len(), watch, &train).map(drop)
}

/// The learning curves of a finished run.
#[cfg(feature = "report")]
pub fn curves(folder: &RunFolder, results: &Results) -> Result<Vec<SeedCurve>, Error> {
    let curve = |seed: &SeedResult| {
        let metrics = metrics::read(folder, &seed::Files::new(seed.seed).metrics, seed.iterations)?;
        Ok(report::curve(seed, &metrics))
    };
    results.seeds.iter().map(curve).collect()
}
