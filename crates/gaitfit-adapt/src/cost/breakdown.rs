//! A cost and its parts.

use super::Signal;
use serde::Serialize;

/// A cost with the parts it is the sum of.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Breakdown {
    /// Σ weight · value over the groups; smaller is closer, 0 is equal.
    pub total: f64,
    /// One entry a signal with a positive weight, in the order of [`Signal::ALL`].
    pub groups: Vec<GroupCost>,
}

/// The part of one signal, in units where the robot's range is 2 (−1 to 1).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GroupCost {
    /// The signal compared.
    pub signal: Signal,
    /// Its factor in the total.
    pub weight: f64,
    /// Unweighted cost of the group.
    pub value: f64,
    /// Cost of each dimension (joints in the reference's order, or x, y, z of the base); `None` for one that is constant
    /// on the robot and therefore left out.
    pub per_joint: Vec<Option<f64>>,
}

impl Breakdown {
    /// A cost without parts.
    pub fn of_total(total: f64) -> Self {
        Self { total, groups: Vec::new() }
    }

    /// Sums the groups.
    pub(crate) fn new(groups: Vec<GroupCost>) -> Self {
        Self { total: groups.iter().map(|group| group.weight * group.value).sum(), groups }
    }
}
