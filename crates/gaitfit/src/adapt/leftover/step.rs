//! A physics step that is too long for the robot: then a finer one explains what a fit leaves.

use super::suspects::{STEPS, Suspect, TOLERANCE};
use crate::Error;
use crate::adapt::method::Method;
use crate::adapt::setup::Setup;
use gaitfit_adapt::fit::{Problem, descend};

/// Steps in the place of one. The error of a step is of first order in it, so a quarter remains.
const PARTS: usize = 4;

/// What the fit would leave with shorter physics steps: its values are fitted further there, from `values` on. `None` where
/// they cannot be simulated.
pub(super) fn finer(setup: &Setup, problem: Problem<'_>, values: &[f64]) -> Result<Option<Suspect>, Error> {
    let Method::Replay(clamped) = &setup.method else { return Ok(None) };
    let logs = &setup.fit.logs;
    let Ok(simulator) = clamped.finer(setup.base.clone(), logs, PARTS) else { return Ok(None) };
    let step = clamped.step(logs) / PARTS as f64;
    let found = descend(Problem { simulator: &simulator, ..problem }, values, STEPS, TOLERANCE);
    Ok(found.map_err(Error::failed)?.map(|(moved, cost)| Suspect {
        what: format!("physics steps of {:.2} ms", 1e3 * step),
        remedy: format!(
            "the fit's steps of {:.2} ms are too long for this robot; set simulation.timestep = {step:.3e}",
            1e3 * step * PARTS as f64
        ),
        values: Vec::new(),
        cost,
        moved,
    }))
}
