//! A physics step that is too long for the robot: a shorter one then explains the errors that a fit leaves.

use super::suspects::{STEPS, Suspect, TOLERANCE};
use crate::Error;
use crate::adapt::method::Method;
use crate::adapt::setup::Setup;
use gaitfit_adapt::fit::{Problem, descend};

/// Number of shorter steps that replace one. The error is of first order in the step, so a quarter of it remains.
const PARTS: usize = 4;

/// The errors that the fit would leave with shorter physics steps: it is continued with these from `values`. `None` if they
/// cannot be simulated.
pub(super) fn finer(setup: &Setup, problem: Problem<'_>, values: &[f64]) -> Result<Option<Suspect>, Error> {
    let Method::Replay(clamped) = &setup.method else { return Ok(None) };
    let logs = &setup.fit.logs;
    // A sample has a largest number of steps. Beyond it a shorter step cannot be tried.
    let Ok(simulator) = clamped.finer(setup.base.clone(), logs, PARTS) else { return Ok(None) };
    let step = clamped.step(logs) / PARTS as f64;
    let minimum = descend(Problem { simulator: &simulator, ..problem }, values, STEPS, TOLERANCE);
    Ok(minimum.map_err(Error::failed)?.map(|(moved, cost)| Suspect {
        what: format!("physics steps of {:.2} ms", 1e3 * step),
        remedy: format!(
            "the fit's steps of {:.2} ms are too long for this robot; set simulation.timestep = {}",
            1e3 * step * PARTS as f64,
            gaitfit_model::significant(step, 4)
        ),
        values: Vec::new(),
        cost,
        moved,
    }))
}
