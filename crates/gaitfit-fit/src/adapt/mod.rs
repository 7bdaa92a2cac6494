//! Fits of a robot's simulator to its logs, and their validation on others.
//!
//! How the logs are simulated is a [`Method`]: the logs of a clamped robot are replayed, those of a walking one are
//! walked again by its policy. All else is one path.

mod alternatives;
mod audit;
mod check;
mod cost_fit;
mod cost_result;
mod doubts;
mod files;
mod held_out;
mod ignored;
mod inputs;
mod known;
mod leftover;
mod limit;
mod log_set;
mod method;
mod odd;
mod opening;
mod outliers;
mod parameter;
mod read_setup;
mod replicas;
#[cfg(feature = "report")]
mod report;
pub mod results;
mod robots;
mod scan;
mod score;
mod search;
mod sensitivity;
mod setup;
mod share;
#[cfg(feature = "report")]
mod signals;
mod springs;
mod standing;
mod swing;
mod swing_correction;
mod trust;
mod validate;

pub use alternatives::Alternatives;
pub use audit::Audit;
pub use check::Check;
pub use cost_result::CostFit;
pub use held_out::{Distance, Floor, HeldOut, Trials, Verdict};
pub use inputs::{Robot, ValidationLogs, method as simulated, validation as read_logs};
pub use known::priors;
pub use leftover::{Leftover, Suspect};
pub use limit::Limit;
pub use log_set::LogSet;
pub use method::Method;
pub use odd::{JointSpring, OddJoints};
pub use opening::Opening;
pub use parameter::Parameter;
#[cfg(feature = "report")]
pub use report::{held_out_shown, round};
pub use results::{AdaptResults, MAX_SHOWN};
pub use score::{Score, Validation};
pub use search::{METRICS, metrics};
pub use sensitivity::{ParameterSensitivity, SensitivityResults, sensitivity};
pub use sensitivity::{identifies, known_values, sensitivities};
pub use setup::Setup;
pub use share::{Crew, Done, Helper, Shares};
pub use springs::FoundSpring;
pub use standing::refusal;
pub use standing::{CONTRADICTED, Standing};
pub use validate::{ValidateRequest, ValidateResults, validate};

use crate::Error;
use crate::run::RunFolder;
use crate::watch::Watch;

/// Fits in `folder`, or resumes its fit, or returns its result if it has ended. With `odd_joints` it first finds the joints
/// that differ from their siblings; `setup` then has springs on them.
///
/// # Errors
/// A fit that cannot continue; a folder of other inputs; an interruption.
pub fn fit(setup: &mut Setup, folder: &RunFolder, watch: &Watch<'_>) -> Result<AdaptResults, Error> {
    for warning in &setup.warnings {
        watch.note(warning);
    }
    let protocol = files::protocol(folder, setup)?;
    limit::reopen(&protocol, folder, setup)?;
    let results = protocol.run(watch, || {
        let odd = match setup.config.odd_joints {
            true => Some(odd::find(setup, folder, &protocol.inputs, watch)?),
            false => None,
        };
        if let Some(odd) = &odd {
            setup.take(odd)?;
        }
        let setup = &*setup;
        // The scope lets the thread borrow `setup`; it ends before the results are returned.
        std::thread::scope(|scope| {
            // While a GPU searches, processors are free for it.
            let early = (setup.devices.are_gpus() && setup.swings.is_none())
                .then(|| scope.spawn(|| swing::findings(&setup.method, &setup.fit.logs, watch)));
            let (outcomes, seconds) = search::fit(setup, folder, &protocol.inputs, watch)?;
            let metrics = search::metrics(folder)?;
            let swings = || match early {
                // A panic of that thread is passed on, as if it had happened here.
                Some(early) => early.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)),
                None => swing::findings(&setup.method, &setup.fit.logs, watch),
            };
            let done = results::Searched { outcomes: &outcomes, course: &metrics, odd_joints: odd, seconds };
            let results = results::results(setup, done, swings, folder, watch)?;
            files::write(folder, setup, &results)?;
            #[cfg(feature = "report")]
            folder.write("report.html", report::page(setup, &results, &metrics)?.as_bytes())?;
            Ok::<_, Error>(results)
        })
    })?;
    // A result that was read from the folder did not pass through the closure above.
    if let Some(odd) = &results.odd_joints {
        setup.take(odd)?;
    }
    Ok(results)
}
