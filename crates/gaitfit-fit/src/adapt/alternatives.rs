//! Simulators that could stand in for a fit's: what they would have found shows how far its own errors move the result.

use super::method::Method;
use crate::Error;
use crate::log::Log;
use crate::settings::{AdaptConfig, Preset};
use gaitfit_adapt::SharedSimulator;
use gaitfit_adapt::fit::Alternative;
use gaitfit_sim::Candidate;

const FEET: &str = "feet trusted fully";

/// Other simulators of the same logs.
pub type Alternatives = Vec<Other>;

/// Another simulator of the same logs.
pub struct Other {
    /// The difference, in words.
    what: String,
    simulator: Box<SharedSimulator>,
    /// Whether a correction by simulated logs removes the effect of this difference.
    pub corrected: bool,
}

impl Other {
    /// Whether it also gives another walk, and not only other short predictions, which start from sensor readings.
    pub fn walks(&self) -> bool {
        self.what != FEET
    }

    /// Replaces its simulator by the one that `share` returns for it.
    pub(super) fn with(self, share: impl FnOnce(Box<SharedSimulator>) -> Box<SharedSimulator>) -> Self {
        Self { simulator: share(self.simulator), ..self }
    }

    /// The simulator in the form in which a fit takes it.
    pub fn alternative(&self) -> Alternative<'_> {
        Alternative { what: self.what.clone(), simulator: self.simulator.as_ref() }
    }
}

/// Those of `logs` beside that of `method`, for walking logs. `of` makes the method of other settings.
pub fn alternatives(
    config: &AdaptConfig,
    method: &Method,
    of: &dyn Fn(&AdaptConfig) -> Result<Method, Error>,
    base: &Candidate,
    logs: &[Log],
) -> Result<Alternatives, Error> {
    let Method::Walk(walking) = method else { return Ok(Vec::new()) };
    let mut finer = config.clone();
    // The error of an integrator shrinks with its step. So what half of the step changes shows how large the
    // error is.
    finer.simulation.timestep *= 0.5;
    // Step and solver are changed one at a time, so that each shift has one cause.
    let mut solver = config.clone();
    solver.simulation.preset = match config.simulation.preset {
        Preset::Fast => Preset::Accurate,
        Preset::Accurate | Preset::Converged => Preset::Fast,
    };
    let other = |what: &str, simulator, corrected| Other { what: what.to_owned(), simulator, corrected };
    let preset = format!("preset {}", solver.simulation.preset.name());
    // The robots of a correction have it where the real one's step is known: see `Walking::robot`.
    let corrected =
        config.simulation.robot_timestep.is_some() && solver.simulation.preset == Preset::Accurate;
    let mut others = vec![
        other("half the step", of(&finer)?.searched(config, base.clone(), logs)?, true),
        other(&preset, of(&solver)?.searched(config, base.clone(), logs)?, corrected),
    ];
    if config.costs.iter().any(|cost| cost.needs_imu()) {
        let feet = walking.simulator(base.clone(), logs).with_feet_trust(1.0);
        others.push(other(FEET, Box::new(feet), false));
    }
    Ok(others)
}
