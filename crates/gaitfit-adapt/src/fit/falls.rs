//! What a fall costs.

use crate::cost::Cost;
use serde::{Deserialize, Serialize};

/// What a candidate pays for falling, on top of the samples it loses (each of which counts as off by the robot's whole
/// range). A simulator in which the robot falls can match a bad log; this keeps such optima from winning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FallPenalty {
    /// Added to the cost times the share of the recordings in which the candidate fell, those counted in `robot` not
    /// counted. `None` chooses: if the robot never fell, every single fall adds the cost of losing all samples
    /// ([`Cost::lost`]), so that a candidate that falls never beats one that stands and stays within the robot's
    /// ranges; otherwise the share alone is charged at that price, since the true simulator falls now and then too.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub penalty: Option<f64>,
    /// Recordings in which the robot itself fell (and which are cut there).
    pub robot: usize,
    /// Whether the same values may fall or not, by the draws of torque noise or starts. If no penalty is stated and the robot
    /// never fell, candidates then also pay for the falls that are expected of them.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub random: bool,
}

impl FallPenalty {
    /// No charge beyond the samples lost.
    pub const NONE: Self = Self { penalty: Some(0.0), robot: 0, random: false };

    /// What is added to the cost of a candidate that fell in `fallen` of `recordings` recordings.
    pub fn charge(&self, cost: &dyn Cost, fallen: usize, recordings: usize) -> f64 {
        let excess = fallen.saturating_sub(self.robot);
        if excess == 0 {
            return 0.0;
        }
        let share = excess as f64 / recordings as f64;
        match self.penalty {
            Some(penalty) => penalty * share,
            None if self.robot == 0 => cost.lost() * excess as f64,
            None => cost.lost() * share,
        }
    }

    /// What a candidate pays for each fall that is expected of it ([`super::fall_risk`]) out of `recordings`: the share of
    /// all samples that a recording is, at the price of losing all. `None` if only falls that were seen count.
    pub(super) fn risk_price(&self, cost: &dyn Cost, recordings: usize) -> Option<f64> {
        let chosen = self.random && self.penalty.is_none() && self.robot == 0 && recordings > 0;
        chosen.then(|| cost.lost() / recordings as f64)
    }
}
