//! One number that a fit changes.

use super::saved::MAX_VALUE;
use super::{NetworkName, ThetaError};
use serde::Serialize;

/// One entry of θ: a number with unit, bounds, start and deviation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Entry {
    /// Name, for example `frictionloss_hip` or `resid_act_RR_calf_0`.
    pub name: String,
    /// The quantity that it changes, for example `frictionloss` or `resid_act`.
    pub kind: &'static str,
    /// Unit of the value; `-` for none.
    pub unit: String,
    /// The joints it covers, robot joint names; empty for what is not a joint's.
    pub joints: Vec<String>,
    /// Lower bound.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// First mean of the search; of entries that start at random, the mean over seeds.
    pub start: f64,
    /// First standard deviation of the search.
    pub deviation: f64,
}

impl Entry {
    /// Whether the numbers are in order and the bounds mean something; `min` is the smallest value with a
    /// meaning, `max` the largest that can be simulated.
    pub(super) fn check(&self, min: f64, max: f64) -> Result<(), ThetaError> {
        let Entry { lower, upper, start, deviation, .. } = *self;
        let finite = [lower, upper, start, deviation].iter().all(|value| value.is_finite());
        if !(finite && lower < upper && lower <= start && start <= upper && deviation > 0.0) {
            return Err(ThetaError::Order { name: self.name.clone(), lower, start, upper, deviation });
        }
        if lower < min {
            return Err(ThetaError::Meaningless { name: self.name.clone(), kind: self.kind, min, lower });
        }
        if lower < -MAX_VALUE || upper > max {
            return Err(ThetaError::Wide { name: self.name.clone(), lower, upper, max });
        }
        Ok(())
    }

    /// Whether the value means something else at another physics step: weights of networks that act at every step and
    /// see the steps before. Of networks with fixed features only the weight for inertia does.
    pub fn depends_on_step(&self) -> bool {
        let steady = ["friction", "damping", "stiffness", "offset"];
        self.kind == NetworkName::ResidAct.name()
            && !steady.iter().any(|feature| self.name.ends_with(&format!("_{feature}")))
    }

    /// Whether `value` lies on a bound: within a thousandth of the range of it.
    pub fn at_bound(&self, value: f64) -> bool {
        let near = 1e-3 * (self.upper - self.lower);
        value - self.lower < near || self.upper - value < near
    }
}
