//! The whole method: collect, adapt, fine-tune, evaluate, repeated while it helps.

pub(crate) mod controls;
mod fallback;
pub mod files;
pub mod fit_alone;
mod presence;
#[cfg(feature = "report")]
mod report;
pub mod results;
pub mod rounds;
pub(crate) mod settled;
pub mod setup;
pub mod stages;
pub mod training_robot;
pub mod walked;

pub use results::Results;
pub use setup::Setup;

use crate::Error;
use crate::run::RunFolder;
use crate::watch::Watch;
use std::path::Path;

/// Runs the loop called `name` in a new run folder, or with `resume` continues the latest one of that name.
pub fn run(setup: &Setup, name: &str, resume: bool, watch: &Watch<'_>) -> Result<Results, Error> {
    // Before the folder: a GPU that is missing must leave no empty run behind.
    setup.devices.check()?;
    setup.warnings.iter().for_each(|warning| watch.note(warning));
    let folder = RunFolder::begin(Path::new(&setup.config.runs), name, resume)?;
    let protocol = files::protocol(&folder, setup)?;
    files::check_policy(&protocol, setup)?;
    protocol.run(watch, || {
        files::begin(&folder, setup)?;
        let done = rounds::run(setup, &folder, watch)?;
        #[cfg(feature = "report")]
        report::write(setup, &folder, &done)?;
        Ok(done.results)
    })
}
