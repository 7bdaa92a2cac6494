//! Fits of a robot's simulator to its logs, and their validation on others.
//!
//! How the logs are simulated is a [`Method`]: the logs of a clamped robot are replayed, those of a walking one are
//! walked again by its policy. All else is one path.

mod alternatives;
mod check;
mod doubts;
mod files;
mod held_out;
mod method;
mod replicas;
mod report;
pub mod results;
mod scan;
mod score;
mod search;
mod setup;
mod signals;
mod validate;

pub use alternatives::Alternatives;
pub use check::Check;
pub use held_out::{Distance, Floor, HeldOut, Verdict};
pub use method::Method;
pub use report::round;
pub use results::{AdaptResults, CostFit, MOST_SHOWN, Parameter};
pub use score::{Score, Validation};
pub use search::{METRICS, metrics};
pub use setup::{LogSet, Setup};
pub use validate::{ValidateRequest, ValidateResults, validate};

use crate::Error;
use crate::run::RunFolder;
use crate::watch::Watch;

/// Fits in `folder`, or goes on where it was left, or gives what it found.
///
/// # Errors
/// A fit that cannot go on; a folder of other inputs; [`Error::Interrupted`].
pub fn fit(setup: &Setup, folder: &RunFolder, watch: &Watch<'_>) -> Result<AdaptResults, Error> {
    for warning in &setup.warnings {
        watch.note(warning);
    }
    let protocol = files::protocol(folder, setup)?;
    protocol.run(watch, || {
        let (outcomes, seconds) = search::fit(setup, folder, &protocol.inputs, watch)?;
        let metrics = search::metrics(folder)?;
        let results = results::results(setup, &outcomes, &metrics, folder, seconds, watch)?;
        files::write(folder, setup, &results, &metrics)?;
        Ok(results)
    })
}
