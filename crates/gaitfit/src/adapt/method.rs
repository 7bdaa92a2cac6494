//! How logs are simulated.

use crate::Error;
use crate::air::Clamped;
use crate::log::Log;
use crate::walk::walking::Walking;
use gaitfit_adapt::Simulator;
use gaitfit_model::Model;
use gaitfit_sim::Candidate;
use std::sync::Arc;

/// How logs are simulated.
pub enum Method {
    /// The robot was clamped: the logs' targets are replayed.
    Replay(Box<Clamped>),
    /// The robot walked: its policy walks again under the logs' commands.
    Walk(Arc<Walking>),
}

impl Method {
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
    pub fn simulator(&self, base: Candidate, logs: &[Log]) -> Result<Box<dyn Simulator>, Error> {
        Ok(match self {
            Self::Replay(clamped) => Box::new(clamped.simulator(base, logs)?),
            Self::Walk(walking) => Box::new(walking.simulator(base, logs)),
        })
    }

    /// Samples of `logs` that make up `seconds`.
    pub fn samples(&self, seconds: f64, logs: &[Log]) -> usize {
        let period = match self {
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

    /// The policy on its robot, of a walking one.
    pub fn walking(&self) -> Option<&Walking> {
        match self {
            Self::Replay(_) => None,
            Self::Walk(walking) => Some(walking),
        }
    }
}
