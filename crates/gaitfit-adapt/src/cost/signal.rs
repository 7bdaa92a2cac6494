//! The signals that costs compare.

use super::{CostError, Reference};
use crate::Simulator;
use serde::{Deserialize, Serialize};
use std::fmt;

/// A group of signals that costs compare.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Signal {
    /// Joint position, rad.
    Position,
    /// Joint velocity, rad/s.
    Velocity,
    /// Policy action, unitless.
    Action,
    /// Base position, m, world frame: privileged, a robot alone does not log it.
    BasePosition,
    /// Base linear velocity, m/s, world frame: privileged.
    BaseVelocity,
}

/// Names of the base's dimensions.
const AXES: [&str; 3] = ["x", "y", "z"];

impl Signal {
    /// All signals, in the order costs sum them.
    pub const ALL: [Self; 5] =
        [Self::Position, Self::Velocity, Self::Action, Self::BasePosition, Self::BaseVelocity];

    /// Whether it is measured outside the robot's joints.
    pub fn is_privileged(self) -> bool {
        matches!(self, Self::BasePosition | Self::BaseVelocity)
    }

    /// Columns of its matrices on a robot of `joints` joints.
    pub fn width(self, joints: usize) -> usize {
        if self.is_privileged() { AXES.len() } else { joints }
    }

    /// Name of a column: the joint's, or the axis of the base.
    pub fn column(self, joints: &[String], column: usize) -> &str {
        if self.is_privileged() { AXES[column] } else { &joints[column] }
    }

    /// The name of a column in messages.
    pub(crate) fn label(self, joints: &[String], column: usize) -> String {
        let name = self.column(joints, column);
        if self.is_privileged() { format!("axis {name}") } else { format!("joint {name}") }
    }
}

impl fmt::Display for Signal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Action => "action",
            Self::BasePosition => "base position",
            Self::BaseVelocity => "base velocity",
        })
    }
}

/// Factor of each signal group in the sum; 0 leaves the group out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Weights {
    /// Weight of joint position.
    pub position: f64,
    /// Weight of joint velocity.
    pub velocity: f64,
    /// Weight of the policy action.
    pub action: f64,
    /// Weight of the base's position.
    pub base_position: f64,
    /// Weight of the base's velocity.
    pub base_velocity: f64,
}

impl Weights {
    /// Joint position alone.
    pub const POSITION: Self =
        Self { position: 1.0, velocity: 0.0, action: 0.0, base_position: 0.0, base_velocity: 0.0 };

    /// Joint position and velocity.
    pub const JOINTS: Self = Self { velocity: 1.0, ..Self::POSITION };

    /// Joint position and velocity, base position and velocity: what [`super::TimeAligned::match_s`] compares.
    pub const PRIVILEGED: Self = Self { base_position: 1.0, base_velocity: 1.0, ..Self::JOINTS };

    /// Weight 1 for every joint signal that `reference` has: Wass and MatchO as the paper defines them.
    pub fn from_reference(reference: &Reference) -> Self {
        Self { action: f64::from(reference.has(Signal::Action)), ..Self::JOINTS }
    }

    /// [`Self::from_reference`], but for the action only if `simulator` has it too: a replay sends the log's own targets, so
    /// that both sides act the same.
    pub fn shared(reference: &Reference, simulator: &dyn Simulator) -> Self {
        if simulator.provides(Signal::Action) { Self::from_reference(reference) } else { Self::JOINTS }
    }

    /// The weight of `signal`.
    pub fn get(&self, signal: Signal) -> f64 {
        match signal {
            Signal::Position => self.position,
            Signal::Velocity => self.velocity,
            Signal::Action => self.action,
            Signal::BasePosition => self.base_position,
            Signal::BaseVelocity => self.base_velocity,
        }
    }

    /// The signals with a positive weight, in the order costs sum them.
    pub fn signals(&self) -> impl Iterator<Item = Signal> + use<> {
        // A copy lets the iterator live longer than the borrow of `self`.
        let weights = *self;
        Signal::ALL.into_iter().filter(move |signal| weights.get(*signal) > 0.0)
    }

    /// The sum over all signals.
    pub fn sum(&self) -> f64 {
        Signal::ALL.iter().map(|signal| self.get(*signal)).sum()
    }

    /// Checks the weights against what `reference` can offer.
    ///
    /// # Errors
    /// [`CostError::Weights`], [`CostError::MissingSignal`], [`CostError::AllConstant`].
    pub fn check(&self, reference: &Reference) -> Result<(), CostError> {
        let all = Signal::ALL.map(|signal| self.get(signal));
        // If all are 0, nothing is compared.
        if all.iter().any(|weight| !weight.is_finite() || *weight < 0.0)
            || all.iter().all(|weight| *weight == 0.0)
        {
            return Err(CostError::Weights(all));
        }
        for signal in self.signals() {
            let dimensions = reference
                .dimensions(signal)
                .ok_or_else(|| CostError::MissingSignal { signal, side: "the robot's log".into() })?;
            if dimensions.iter().all(|dimension| dimension.scale.is_none()) {
                return Err(CostError::AllConstant(signal));
            }
        }
        Ok(())
    }
}
