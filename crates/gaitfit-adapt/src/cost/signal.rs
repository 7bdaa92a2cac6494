//! The signals that costs compare.

use super::{CostError, Target};
use serde::{Deserialize, Serialize};
use std::fmt;

/// One of the three groups of joint signals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Signal {
    /// Joint position, rad.
    Position,
    /// Joint velocity, rad/s.
    Velocity,
    /// Policy action, unitless.
    Action,
}

impl Signal {
    /// All signals, in the order costs sum them.
    pub const ALL: [Self; 3] = [Self::Position, Self::Velocity, Self::Action];
}

impl fmt::Display for Signal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Action => "action",
        })
    }
}

/// Simulated signals of one candidate on one recording: `samples × joints`, row-major, the target's joint order,
/// pre-roll included.
#[derive(Clone, Copy, Debug)]
pub struct Simulated<'a> {
    /// Joint positions, rad.
    pub position: &'a [f32],
    /// Joint velocities, rad/s.
    pub velocity: &'a [f32],
    /// Policy actions; absent when the log's own targets are replayed.
    pub action: Option<&'a [f32]>,
}

impl<'a> Simulated<'a> {
    /// The matrix of `signal`, if there is one.
    pub fn get(&self, signal: Signal) -> Option<&'a [f32]> {
        match signal {
            Signal::Position => Some(self.position),
            Signal::Velocity => Some(self.velocity),
            Signal::Action => self.action,
        }
    }
}

/// Factor of each signal group in the sum; 0 leaves the group out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weights {
    /// Of joint position.
    pub position: f64,
    /// Of joint velocity.
    pub velocity: f64,
    /// Of the policy action.
    pub action: f64,
}

impl Weights {
    /// Weight 1 for every signal that `target` has: the costs as the paper defines them.
    pub fn of(target: &Target) -> Self {
        let present = |signal| if target.has(signal) { 1.0 } else { 0.0 };
        Self { position: 1.0, velocity: 1.0, action: present(Signal::Action) }
    }

    /// Joint position alone.
    pub const POSITION: Self = Self { position: 1.0, velocity: 0.0, action: 0.0 };

    /// The weight of `signal`.
    pub fn get(&self, signal: Signal) -> f64 {
        match signal {
            Signal::Position => self.position,
            Signal::Velocity => self.velocity,
            Signal::Action => self.action,
        }
    }

    /// Checks the weights against what `target` can offer.
    ///
    /// # Errors
    /// [`CostError::Weights`], [`CostError::MissingSignal`], [`CostError::AllConstant`].
    pub fn check(&self, target: &Target) -> Result<(), CostError> {
        let all = Signal::ALL.map(|signal| self.get(signal));
        if all.iter().any(|weight| !weight.is_finite() || *weight < 0.0)
            || all.iter().all(|weight| *weight == 0.0)
        {
            return Err(CostError::Weights(all));
        }
        for signal in Signal::ALL.into_iter().filter(|signal| self.get(*signal) > 0.0) {
            let dimensions = target
                .dimensions(signal)
                .ok_or_else(|| CostError::MissingSignal { signal, side: "the robot's log".into() })?;
            if dimensions.iter().all(|dimension| dimension.scale.is_none()) {
                return Err(CostError::AllConstant(signal));
            }
        }
        Ok(())
    }
}
