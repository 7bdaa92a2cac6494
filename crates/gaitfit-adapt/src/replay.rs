//! The project's own engine behind [`Simulator`]: logs replayed on a clamped robot.

use crate::{Consume, Signals, Simulator, SimulatorError, Theta};
use gaitfit_model::Model;
use gaitfit_sim::{JointSignals, Recording, Replay, ReplayOptions, RobotParams};

/// Replays recordings with [`gaitfit_sim::Replay`].
pub struct ReplaySimulator {
    replay: Replay,
    nominal: RobotParams,
    joints: Vec<String>,
    recordings: usize,
    threads: usize,
}

impl ReplaySimulator {
    /// A simulator of `recordings` (joints in the model's order) on `threads` threads.
    pub fn new(
        model: &Model,
        recordings: Vec<Recording>,
        options: ReplayOptions,
        threads: usize,
    ) -> Result<Self, SimulatorError> {
        let count = recordings.len();
        let replay =
            Replay::new(model, recordings, options).map_err(|error| SimulatorError(error.to_string()))?;
        Ok(Self {
            replay,
            nominal: RobotParams::nominal(model),
            joints: model.joints.iter().map(|joint| joint.name.clone()).collect(),
            recordings: count,
            threads,
        })
    }

    /// The robot with the values of θ; what θ does not name stays as the model says.
    pub fn robot(&self, theta: &Theta, values: &[f64]) -> RobotParams {
        let mut robot = self.nominal.clone();
        theta.apply(values, &self.joints, |quantity, joint, value| {
            quantity.of_joints(&mut robot)[joint] = value;
        });
        robot
    }
}

impl Simulator for ReplaySimulator {
    fn joints(&self) -> &[String] {
        &self.joints
    }

    fn recordings(&self) -> usize {
        self.recordings
    }

    fn simulate(
        &self,
        theta: &Theta,
        candidates: &[Vec<f64>],
        consume: &Consume<'_>,
    ) -> Result<(), SimulatorError> {
        let robots: Vec<RobotParams> = candidates.iter().map(|values| self.robot(theta, values)).collect();
        let pass = |candidate: usize, recording: usize, signals: &JointSignals| {
            consume(
                candidate,
                recording,
                Signals { position: &signals.position, velocity: &signals.velocity },
            );
        };
        self.replay.run(&robots, self.threads, &pass).map_err(|error| SimulatorError(error.to_string()))
    }
}
