//! The project's own engine behind [`Simulator`]: logs replayed on a clamped robot.

use crate::{Cancel, Consume, Identity, Resets, Rollout, Signals, Simulator, SimulatorError, Theta};
use gaitfit_model::Model;
use gaitfit_physics::{Preset, Robot};
use gaitfit_sim::{Candidate, Cpu, Direction, Engine, JointSignals, Recording, Replay, ReplayOptions};

/// How far apart the robots are that say how a robot's numbers change with θ, in an entry's deviations. Most numbers
/// change in proportion; what joints and bodies seem to weigh at a contact or limit does so nearly.
const APART: f64 = 1e-5;

/// Replays recordings on a [`gaitfit_sim::Engine`].
pub struct ReplaySimulator {
    identity: Identity,
    replay: Replay,
    base: Candidate,
    /// How long after the samples the recordings' targets were sent, s.
    lead: f64,
    engine: Box<dyn Engine>,
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
        let joints = model.joints.iter().map(|joint| joint.name.clone()).collect();
        let identity = Identity::new(joints, recordings.len());
        let replay = Replay::new(model, recordings, options).map_err(SimulatorError::failed)?;
        Ok(Self {
            identity,
            replay,
            base: Candidate::nominal(model),
            lead: 0.0,
            engine: Box::new(Cpu { threads }),
            threads,
        })
    }

    /// The same replay of a robot that differs from the model: θ changes `base`.
    #[must_use]
    pub fn changing(self, base: Candidate) -> Self {
        Self { base, ..self }
    }

    /// The same replay of targets that were sent `lead` seconds after their samples: delays count from there.
    #[must_use]
    pub fn late(self, lead: f64) -> Self {
        Self { lead, ..self }
    }

    /// The same on another engine than the processor.
    pub fn on(self, engine: Box<dyn Engine>) -> Self {
        Self { engine, ..self }
    }

    /// The recordings and the robot that they are replayed on.
    pub fn replay(&self) -> &Replay {
        &self.replay
    }

    /// The robot with the values of θ; what θ does not name stays as it is.
    pub fn candidate(&self, theta: &Theta, values: &[f64]) -> Candidate {
        let mut candidate = self.base.clone();
        theta.apply(values, &self.identity.joints, &mut candidate);
        if self.lead != 0.0 {
            // The replay keeps only so many sent targets, and refuses longer delays.
            let max = self.replay.options().max_delay;
            let late = |delay: &mut f64| *delay = (*delay + self.lead).clamp(0.0, max);
            candidate.robot.delay.iter_mut().for_each(late);
        }
        candidate
    }

    /// The direction in which entry number `at` of θ changes the robot of `values`; `None` if its bounds leave no room.
    fn direction(
        &self,
        theta: &Theta,
        values: &[f64],
        at: usize,
    ) -> Result<Option<Direction>, SimulatorError> {
        let entry = &theta.entries()[at];
        let moved = |by: f64| {
            let mut moved = values.to_vec();
            moved[at] = (values[at] + by * entry.deviation).clamp(entry.lower, entry.upper);
            moved
        };
        // Both neighbours are clamped, so at a bound the difference is one-sided and `distance` is what is left.
        let (ahead, behind) = (moved(APART), moved(-APART));
        let distance = ahead[at] - behind[at];
        if distance.is_nan() || distance <= 0.0 {
            return Ok(None);
        }
        let robot = |values: &[f64]| self.robot(theta, values);
        Ok(Some(Direction {
            robot: robot(values)?,
            ahead: robot(&ahead)?,
            behind: robot(&behind)?,
            distance,
        }))
    }

    /// As [`Self::candidate`], refusing what a replay does not simulate.
    fn robot(&self, theta: &Theta, values: &[f64]) -> Result<Robot, SimulatorError> {
        let candidate = self.candidate(theta, values);
        if !candidate.networks.is_empty() || candidate.torque_noise != 0.0 {
            return Err(SimulatorError::failed(
                "a replay of a clamped robot has neither networks nor torque noise: fit them to logs of a walking \
                 robot, or remove them from what is fitted",
            ));
        }
        Ok(candidate.robot)
    }
}

impl Simulator for ReplaySimulator {
    fn identity(&self) -> &Identity {
        &self.identity
    }

    fn threads(&self) -> usize {
        self.threads
    }

    fn simulate(
        &self,
        theta: &Theta,
        candidates: &[Rollout],
        consume: &Consume<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<(), SimulatorError> {
        if candidates.iter().any(|candidate| candidate.resets != Resets::Never) {
            return Err(SimulatorError::failed(
                "a replay of a clamped robot cannot be reset to the log's state on its way: take the cost matcho or \
                 wass",
            ));
        }
        let robots: Vec<Robot> =
            candidates.iter().map(|one| self.robot(theta, &one.values)).collect::<Result<_, _>>()?;
        let pass = |candidate: usize, recording: usize, signals: &JointSignals| {
            consume(candidate, recording, Signals::of_joints(&signals.position, &signals.velocity));
        };
        self.engine.replay(&self.replay, &robots, &pass, cancel).map_err(SimulatorError::failed)?;
        // The engine returns without an error if it was cancelled.
        if cancel() { Err(SimulatorError::Cancelled) } else { Ok(()) }
    }

    /// Legs in the air touch nothing that would make derivatives jump. With the preset `converged` there are none: the
    /// solver's line searches go on where steps are as small as rounding, and in single precision their derivatives are
    /// noise.
    fn differentiate(
        &self,
        theta: &Theta,
        candidate: &Rollout,
        consume: &Consume<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<bool, SimulatorError> {
        // In single precision rounding spoils the derivatives of this preset (see `Dual`).
        let exact = self.replay.options().preset != Preset::Converged;
        let whole = candidate.values.len() == theta.len() && !theta.is_empty();
        // Resets make a new start inside a log, which the engine's derivatives do not follow.
        if candidate.resets != Resets::Never || !exact || !whole {
            return Ok(false);
        }
        // Without a direction for some entry the derivatives would not be whole, and differences replace them
        // all.
        let mut directions = Vec::with_capacity(theta.len());
        for at in 0..theta.len() {
            match self.direction(theta, &candidate.values, at)? {
                Some(direction) => directions.push(direction),
                None => return Ok(false),
            }
        }
        let pass = |entry: usize, recording: usize, slopes: &JointSignals| {
            consume(entry, recording, Signals::of_joints(&slopes.position, &slopes.velocity));
        };
        self.engine.replay_along(&self.replay, &directions, &pass, cancel).map_err(SimulatorError::failed)?;
        if cancel() { Err(SimulatorError::Cancelled) } else { Ok(true) }
    }
}
