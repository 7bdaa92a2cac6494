//! What is simulated, and where the physics keeps each number.

use gaitfit_model::Model;
use gaitfit_physics::trace::{Input, Report, Traced};
use gaitfit_physics::{Kept, Params, Parts, PhysicsError};
use gaitfit_policy::Policy;
use gaitfit_policy::walker::Walker;
use gaitfit_sim::{Candidate, NetworkKind, Replay, modifications};

use super::FitError;
use crate::emit::EmitOptions;
use crate::physics::{Period, PeriodOptions};
use crate::spots::{Spot, Spots, input_spots};

/// Threads of an environment. Always as many, so that signals do not depend on how many candidates there are; four, for
/// a fit has few environments.
const LANES: usize = 4;

/// Kind of simulation that candidates are compared in.
#[derive(Clone, Copy)]
pub enum Subject<'a> {
    /// A policy walks on them.
    Walk(&'a Walker, &'a Policy),
    /// They are given their logs' targets, and put right by what the logs' sensors read (`gaitfit_policy::predict`).
    Predict(&'a Walker),
    /// They are clamped, and given their logs' targets.
    Replay(&'a Replay),
}

/// The parts of candidates besides parameters of the robot. Candidates of one program share them.
#[derive(Clone, Debug, PartialEq)]
pub struct Structure {
    /// Kinds and joints of the networks.
    pub networks: Vec<(NetworkKind, Vec<usize>)>,
    /// Whether torques disturb the joints.
    pub disturbed: bool,
    /// Parameters that they keep from the model.
    pub kept: Kept,
}

impl Structure {
    /// The structure of a candidate.
    pub fn new(candidate: &Candidate) -> Self {
        let networks = candidate.networks.iter().map(|one| (one.kind, one.joints.clone())).collect();
        Self { networks, disturbed: candidate.torque_noise > 0.0, kept: Kept::from_robot(&candidate.robot) }
    }
}

/// The numbers of the candidates of each structure.
pub(super) fn by_structure<'a>(
    candidates: impl Iterator<Item = &'a Candidate>,
) -> Vec<(Structure, Vec<usize>)> {
    let mut groups: Vec<(Structure, Vec<usize>)> = Vec::new();
    for (number, candidate) in candidates.enumerate() {
        let structure = Structure::new(candidate);
        match groups.iter_mut().find(|(of, _)| *of == structure) {
            Some((_, own)) => own.push(number),
            None => groups.push((structure, vec![number])),
        }
    }
    groups
}

impl Subject<'_> {
    /// The robot.
    pub fn model(&self) -> &Model {
        match self {
            Self::Walk(walker, _) | Self::Predict(walker) => walker.model(),
            Self::Replay(replay) => replay.model(),
        }
    }

    /// Longest delay of a candidate, s.
    pub(super) fn max_delay(&self) -> f64 {
        match self {
            Self::Walk(walker, _) | Self::Predict(walker) => walker.batch.options().max_delay,
            Self::Replay(replay) => replay.options().max_delay,
        }
    }

    /// The robot that is not clamped.
    pub(super) fn walker(&self) -> Option<&Walker> {
        match self {
            Self::Walk(walker, _) | Self::Predict(walker) => Some(walker),
            Self::Replay(_) => None,
        }
    }

    /// Numbers of a sample's signals: positions, velocities, and of robots that walk actions, the base's position and its
    /// velocity.
    pub fn dimensions(&self) -> usize {
        match self {
            Self::Walk(walker, _) => 3 * walker.joints.len() + 6,
            Self::Predict(walker) => 2 * walker.joints.len(),
            Self::Replay(replay) => 2 * replay.model().joints.len(),
        }
    }

    /// Parameters of a candidate for the physics.
    ///
    /// # Errors
    /// A candidate that is no robot.
    pub(super) fn params(&self, candidate: &Candidate) -> Result<Params<f64>, PhysicsError> {
        match self {
            Self::Walk(walker, _) | Self::Predict(walker) => walker.robot(candidate).params(walker.model()),
            Self::Replay(replay) => candidate.robot.params(replay.model()),
        }
    }

    /// The physics of a control period of candidates of the same [`Structure`] as `candidate`.
    ///
    /// # Errors
    /// A robot that cannot be stepped; networks that do not fit it.
    pub fn period(&self, candidate: &Candidate) -> Result<Period, FitError> {
        let structure = Structure::new(candidate);
        let (settings, substeps, taps) = match self {
            Self::Walk(walker, _) | Self::Predict(walker) => {
                let batch = &walker.batch;
                (batch.settings(), batch.options().substeps, batch.taps())
            }
            Self::Replay(replay) => (replay.settings(), replay.options().substeps, replay.taps()),
        };
        let model = self.model();
        let options = PeriodOptions { substeps, taps, lanes: LANES, emit: EmitOptions::default() };
        // Only robots with a base that moves are judged by the forces on their feet.
        let forces = self.walker().is_some();
        // Clamped robots do not show when their inertial unit is late.
        let parts = Parts { late_imu: forces && structure.kept.parts.late_imu, ..structure.kept.parts };
        let networks = modifications::<Traced>(model, &candidate.networks, parts)?;
        // Numbers that no candidate of the structure changes become constants of the program.
        let fixed = structure.kept.numbers(&self.params(candidate)?);
        let report = Report { disturbed: structure.disturbed, forces, tracked: Vec::new(), fixed };
        Ok(Period::reporting(model, settings, options, &networks, &report)?)
    }
}

/// A subject as the kernels see it.
pub struct Scene<'a> {
    /// The subject of the simulation.
    pub subject: Subject<'a>,
    /// The physics of its control period.
    pub period: &'a Period,
    pub(super) spots: Spots,
    /// Places of all parameters.
    pub(super) params: Vec<Spot>,
}

impl<'a> Scene<'a> {
    /// On the physics of [`Subject::period`].
    pub fn new(subject: Subject<'a>, period: &'a Period) -> Self {
        Self {
            subject,
            period,
            spots: Spots::new(period),
            params: input_spots(period, |input| matches!(input, Input::Params(_))),
        }
    }

    /// Joints of the robot.
    pub(super) fn joints(&self) -> usize {
        self.subject.model().joints.len()
    }

    /// For each parameter of the physics: its place among the gains of a recording, if a replay sets it.
    pub(super) fn gains(&self) -> Vec<Option<usize>> {
        let joints = self.joints();
        let joint_slot = |input: &Input| {
            let Input::Params(slot) = input else { return None };
            let gaitfit_physics::Owner::Joint(joint) = slot.owner else { return Some(None) };
            Some(match slot.name {
                "kp" => Some(joint),
                "kd" => Some(joints + joint),
                _ => None,
            })
        };
        self.period.graph.inputs.iter().filter_map(joint_slot).collect()
    }
}
