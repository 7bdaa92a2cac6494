//! The cost of falls.

use crate::cost::Cost;
use serde::{Deserialize, Serialize};

/// Max number of falls that chance explains: the `expected` number plus two standard deviations (Poisson). The expected number
/// is estimated from `observed` falls of the robot, whose number is due to chance too: the variances of both add.
pub fn max_falls_by_chance(expected: f64, observed: usize) -> usize {
    // A robot that never fell has an expected number of 0, so the 1 in place of `observed` does not matter.
    // The first part is the chance in these recordings. The second one is that of the rate, which is known from
    // `observed` falls alone.
    let variance = expected + expected * expected / observed.max(1) as f64;
    (expected + 2.0 * variance.sqrt()).ceil() as usize
}

/// What a candidate pays for its falls, in addition to the samples that it loses (each counts as off by the robot's whole
/// range). A simulator in which the robot falls can match a bad log. Because of this charge it does not win.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FallPenalty {
    /// The price of falling in all recordings. A candidate pays it times the share of the recordings in which it fell, without
    /// the falls that chance explains ([`max_falls_by_chance`]). With `None` the price depends on the robot. If the robot never
    /// fell, each fall adds the cost of losing all samples ([`Cost::lost`]), so a candidate that falls never beats one that
    /// stands and stays within the robot's ranges. Otherwise [`Cost::lost`] is the price, because the true simulator falls now
    /// and then too.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub penalty: Option<f64>,
    /// Part of the recordings in which the robot itself would fall, 0 to 1. A part and not a number: a search may simulate each
    /// recording several times.
    pub robot_rate: f64,
    /// Number of the robot's falls from which this part is estimated.
    pub robot_falls: usize,
    /// Whether torque noise or starts are drawn, so that chance decides whether the same values fall. If so, and if no penalty
    /// is stated and the robot never fell, candidates also pay for the falls that are expected of them.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub random: bool,
}

impl FallPenalty {
    /// No charge beyond the samples lost.
    pub const NONE: Self = Self { penalty: Some(0.0), robot_rate: 0.0, robot_falls: 0, random: false };

    /// The charge for a candidate that fell in `fallen` of `recordings` recordings. It is added to the cost.
    pub fn charge(&self, cost: &dyn Cost, fallen: usize, recordings: usize) -> f64 {
        let expected = self.robot_rate * recordings as f64;
        let excess = fallen.saturating_sub(max_falls_by_chance(expected, self.robot_falls));
        if excess == 0 {
            return 0.0;
        }
        let share = excess as f64 / recordings as f64;
        match self.penalty {
            Some(penalty) => penalty * share,
            // The robot never fell, so each fall costs as much as losing all recordings.
            None if self.robot_rate == 0.0 => cost.lost() * excess as f64,
            None => cost.lost() * share,
        }
    }

    /// What a candidate pays for each expected fall ([`super::fall_risk`]): the cost of losing all samples, divided by the
    /// number of `recordings`. `None` if only observed falls count.
    pub(super) fn risk_price(&self, cost: &dyn Cost, recordings: usize) -> Option<f64> {
        let chosen = self.random && self.penalty.is_none() && self.robot_rate == 0.0 && recordings > 0;
        chosen.then(|| cost.lost() / recordings as f64)
    }
}
