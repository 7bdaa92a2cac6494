//! A clamped robot, and the simulator that replays its logs.

use super::logs;
use crate::Error;
use crate::log::{self, Log};
use crate::settings::AdaptConfig;
use gaitfit_adapt::{JointParameter, ReplaySimulator, Theta};
use gaitfit_model::Model;
use gaitfit_sim::{Candidate, MAX_SUBSTEPS, ReplayOptions};

/// Longest delay of a robot whose delay is not fitted, s: a fit tries whether one would explain its errors.
const SUSPECTED_DELAY: f64 = 0.05;

/// Longest interval between samples, s.
fn longest(logs: &[Log]) -> f64 {
    logs.iter().map(|log| log.trajectory.dt()).fold(0.0, f64::max)
}

/// A clamped robot.
pub struct Clamped {
    /// The robot.
    pub model: Model,
    /// Largest physics step, s.
    timestep: f64,
    preset: gaitfit_physics::Preset,
    /// Longest delay that a candidate may have, s.
    max_delay: f64,
    /// Threads.
    pub threads: usize,
    /// The GPUs that simulate, instead of the CPU; none for the CPU.
    pub gpus: Vec<crate::device::Gpu>,
}

impl Clamped {
    /// The robot of `model`. Candidates may have the delays of `base` and `theta`.
    pub fn new(config: &AdaptConfig, model: Model, theta: &Theta, base: &Candidate, threads: usize) -> Self {
        let searched = theta.largest(JointParameter::Delay).unwrap_or(SUSPECTED_DELAY);
        let max_delay = base.robot.delay.iter().fold(searched, |max, &delay| max.max(delay));
        let (timestep, preset) = (config.simulation.timestep, config.simulation.preset);
        Self { model, timestep, preset, max_delay, threads, gpus: Vec::new() }
    }

    /// Replays `logs`, which share a sample rate, on candidates. `base`: the robot that θ changes.
    ///
    /// # Errors
    /// Logs whose rates differ; a physics step too small for them.
    pub fn simulator(&self, base: Candidate, logs: &[Log]) -> Result<ReplaySimulator, Error> {
        self.finer(base, logs, 1)
    }

    /// Physics step of a replay of `logs`, s.
    pub fn step(&self, logs: &[Log]) -> f64 {
        longest(logs) / self.substeps(logs) as f64
    }

    /// Physics steps of a sample.
    fn substeps(&self, logs: &[Log]) -> usize {
        // A log at 5.001 ms and a step of 5 ms mean one step a sample: a percent is clock error, not a finer rate.
        (longest(logs) / self.timestep - 0.01).ceil().max(1.0) as usize
    }

    /// Does what [`Clamped::simulator`] does, with `parts` physics steps instead of one.
    ///
    /// # Errors
    /// The errors of [`Clamped::simulator`].
    pub fn finer(&self, base: Candidate, logs: &[Log], parts: usize) -> Result<ReplaySimulator, Error> {
        let (longest, substeps) = (longest(logs), self.substeps(logs).saturating_mul(parts));
        if substeps > MAX_SUBSTEPS {
            return Err(Error::settings(format!(
                "`simulation.timestep` {} s splits a sample of {longest} s into {substeps} steps, more than \
                 {MAX_SUBSTEPS}; raise it (for example --set simulation.timestep=0.001)",
                self.timestep
            )));
        }
        let lead = log::lead(logs.iter().map(|log| &log.trajectory));
        // A delay counts from the stamp of a target. With a lead the target acts later after its row by as
        // much.
        let max_delay = self.max_delay + lead.max(0.0);
        let options = ReplayOptions { substeps, preset: self.preset, max_delay, isa: None };
        let recordings =
            logs.iter().map(|log| logs::recording(&log.trajectory, &log.path)).collect::<Result<_, _>>()?;
        let names = || logs.iter().map(|log| log.name.as_str()).collect::<Vec<_>>().join(", ");
        ReplaySimulator::new(&self.model, recordings, options, self.threads)
            .map(|simulator| simulator.changing(base).late(lead))
            .map_err(|error| Error::failed(format!("{}: {error}.", names())))
    }
}
