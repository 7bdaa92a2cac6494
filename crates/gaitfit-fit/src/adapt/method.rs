//! How logs are simulated.

use crate::Error;
use crate::air::Clamped;
use crate::device::Gpu;
#[cfg(feature = "cuda")]
use crate::gpu::{GpuSimulator, OnGpu};
use crate::log::Log;
use crate::settings::AdaptConfig;
use crate::walk::walking::Walking;
use gaitfit_adapt::SharedSimulator;
use gaitfit_model::{Model, SelfContact};
use gaitfit_sim::Candidate;
use std::sync::Arc;

/// The simulator on these GPUs, if there are some.
#[cfg(feature = "cuda")]
fn on<S: OnGpu + Send + Sync + 'static>(
    simulator: S,
    gpus: &[Gpu],
    threads: usize,
) -> Result<Box<SharedSimulator>, Error> {
    Ok(match gpus {
        [] => Box::new(simulator),
        gpus => Box::new(GpuSimulator::new(simulator, gpus, threads).map_err(crate::device::fit_error)?),
    })
}

/// The simulator: a build without the feature `cuda` has no GPUs.
#[cfg(not(feature = "cuda"))]
fn on<S: gaitfit_adapt::Simulator + Send + Sync + 'static>(
    simulator: S,
    _: &[Gpu],
    _: usize,
) -> Result<Box<SharedSimulator>, Error> {
    Ok(Box::new(simulator))
}

/// The way in which logs are simulated.
pub enum Method {
    /// The robot was clamped: the logs' targets are replayed.
    Replay(Box<Clamped>),
    /// The robot walked: its policy walks again under the logs' commands.
    Walk(Arc<Walking>),
}

impl Method {
    /// The same method on these GPUs, if there are some.
    #[must_use]
    pub fn on(self, gpus: Vec<Gpu>) -> Self {
        match self {
            Self::Replay(mut clamped) => {
                clamped.gpus = gpus;
                Self::Replay(clamped)
            }
            Self::Walk(walking) => match Arc::try_unwrap(walking) {
                Ok(walking) => Self::Walk(Arc::new(Walking { gpus, ..walking })),
                // Someone else has it already, and its simulators.
                Err(walking) => Self::Walk(walking),
            },
        }
    }

    /// The robot.
    pub fn model(&self) -> &Model {
        match self {
            Self::Replay(clamped) => &clamped.model,
            Self::Walk(walking) => walking.task.walker.batch.model(),
        }
    }

    /// Names of the joints whose signals are compared, in the signals' order.
    pub fn joints(&self) -> Vec<String> {
        match self {
            Self::Replay(clamped) => clamped.model.joints.iter().map(|joint| joint.name.clone()).collect(),
            Self::Walk(walking) => walking.joints(),
        }
    }

    /// Simulates `logs`. `base`: the robot that θ changes.
    ///
    /// # Errors
    /// Logs that cannot be simulated together.
    pub fn simulator(&self, base: Candidate, logs: &[Log]) -> Result<Box<SharedSimulator>, Error> {
        Ok(match self {
            Self::Replay(clamped) => on(clamped.simulator(base, logs)?, &clamped.gpus, clamped.threads)?,
            Self::Walk(walking) => on(walking.simulator(base, logs), &walking.gpus, walking.threads)?,
        })
    }

    /// Simulates `logs` as the search of `config` does: each from one start, or from several.
    ///
    /// # Errors
    /// As [`Method::simulator`].
    pub(super) fn searched(
        &self,
        config: &AdaptConfig,
        base: Candidate,
        logs: &[Log],
    ) -> Result<Box<SharedSimulator>, Error> {
        match config.starts() {
            0 | 1 => self.simulator(base, logs),
            starts => self.simulator_from_near(base, &vec![logs; starts].concat(), logs.len()),
        }
    }

    /// Does what [`Method::simulator`] does; the first `once` of `logs` start as their robots did, the others near
    /// there.
    ///
    /// # Errors
    /// The errors of [`Method::simulator`].
    fn simulator_from_near(
        &self,
        base: Candidate,
        logs: &[Log],
        once: usize,
    ) -> Result<Box<SharedSimulator>, Error> {
        Ok(match self {
            // Settings refuse several starts for a clamped robot, so here all logs are to start as they did.
            Self::Replay(_) => self.simulator(base, logs)?,
            Self::Walk(walking) => {
                let simulator = walking.simulator(base, logs).with_starts_near(once);
                on(simulator, &walking.gpus, walking.threads)?
            }
        })
    }

    /// Samples of `logs` that make up `seconds`.
    pub fn samples(&self, seconds: f64, logs: &[Log]) -> usize {
        let period = match self {
            // The slowest log counts, so that the same number of samples is never longer than `seconds`.
            Self::Replay(_) => logs.iter().map(|log| log.trajectory.dt()).fold(0.0, f64::max),
            Self::Walk(walking) => walking.task.walker.interface.control_dt,
        };
        (seconds / period).round() as usize
    }

    /// The physics step at which networks that act at every step are fitted, s; none of a clamped robot, whose step
    /// follows its logs.
    pub fn physics_step(&self) -> Option<f64> {
        match self {
            Self::Replay(_) => None,
            Self::Walk(walking) => Some(walking.task.walker.physics_step()),
        }
    }

    /// The pairs of the robot's parts whose contact walks simulate; off for a clamped robot.
    pub fn self_contact(&self) -> SelfContact {
        self.walking().map_or_else(SelfContact::default, |walking| walking.task.settings.self_contact.clone())
    }

    /// The policy on its robot, of a walking one.
    pub fn walking(&self) -> Option<&Walking> {
        match self {
            Self::Replay(_) => None,
            Self::Walk(walking) => Some(walking),
        }
    }
}
