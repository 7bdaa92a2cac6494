//! Fits of logs of a clamped robot, whose legs are in the air: the logs' targets are replayed.

mod files;
mod inputs;
pub mod logs;
mod report;
pub mod results;
mod setup;

pub use results::Results;
pub use setup::{Setup, setup};

use crate::Error;
use crate::run::RunFolder;
use crate::search;
use crate::settings::AdaptConfig;
use crate::watch::Watch;

/// Fits in `folder`, or goes on where it was left, or gives what it found. `config` is as it was read, with the run's
/// name.
pub fn fit(
    config: &AdaptConfig,
    setup: &Setup,
    folder: &RunFolder,
    watch: &Watch<'_>,
) -> Result<Results, Error> {
    for warning in &setup.warnings {
        watch.note(warning);
    }
    let inputs = inputs::inputs(config, setup)?;
    if let Some(results) = files::finished(folder, &inputs)? {
        watch.note(&format!("{} is finished; this is its result", folder.path().display()));
        return Ok(results);
    }
    let begun = crate::machine::now();
    files::begin(folder, config, setup, &inputs, &begun)?;
    let (outcomes, seconds) = search::fit(&setup.fitting(config), folder, &inputs, watch)?;
    let results = results::results(config, setup, &outcomes, folder, seconds)?;
    files::finish(folder, config, setup, &inputs, &results, &begun)?;
    Ok(results)
}
