//! An effect of joints, ground or inertial unit that a model lacks, as logs show it.

use gaitfit_log::Estimate;
use serde::{Deserialize, Serialize};

/// Kind of an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EffectKind {
    /// Dry friction grows with the motor's torque; N·m for each N·m.
    LoadFriction,
    /// A joint has other dry friction than the same joints of other legs, N·m.
    OddFriction,
    /// A joint has a spring that the same joints of other legs do not have, N·m/rad.
    OddSpring,
    /// A joint's motor gives more (positive) or less than its commands ask for, unlike the same joints of other legs; part.
    OddStrength,
    /// Links respond to their motors more (positive) or less than their masses imply; part of the torque. Play, twist and weak
    /// motors look so.
    Strength,
    /// The joint twists between motor and link, rad for each N·m.
    Elasticity,
    /// The joint has play between motor and link, rad.
    Backlash,
    /// Feet that stand together are not at one height, m, root mean square: ground that gives way, steps.
    UnevenGround,
}

/// An effect as the logs show it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Effect {
    /// Its kind.
    pub kind: EffectKind,
    /// The joint group or joint that has it; empty of the ground.
    pub of: String,
    /// Its size in the logs, and its standard error. If it is compared, the logs are at the policy's rate.
    pub size: Estimate,
    /// Mean and standard deviation of the same estimate in logs of simulated robots without the effect; absent if there is no
    /// comparison.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub without: Option<Estimate>,
    /// The part of what is left unexplained, in the signal that shows it, that goes with it, 0 to 1.
    pub share: f64,
    /// Rest angle of a spring, rad; absent for other effects.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rest: Option<f64>,
}

impl Effect {
    /// An effect that is no spring.
    pub fn new(kind: EffectKind, of: &str, size: Estimate, share: f64) -> Self {
        Self { kind, of: of.to_owned(), size, without: None, share, rest: None }
    }

    /// Whether both are of one kind and joint or group.
    pub fn is_same(&self, other: &Self) -> bool {
        (self.kind, &self.of) == (other.kind, &other.of)
    }

    /// The size beyond that of simulated robots without the effect, and its standard error.
    pub fn beyond(&self) -> Estimate {
        let Estimate { value, error } = self.size;
        match self.without {
            Some(without) => Estimate { value: value - without.value, error: error.hypot(without.error) },
            None => self.size,
        }
    }

    /// How many standard errors [`Self::beyond`] is from 0.
    pub fn sure(&self) -> f64 {
        let Estimate { value, error } = self.beyond();
        if error > 0.0 { value.abs() / error } else { 0.0 }
    }
}
