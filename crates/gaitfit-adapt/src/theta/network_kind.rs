//! Kinds of networks, and the shape that all of them have.

use gaitfit_sim::NetworkKind;
use serde::{Deserialize, Serialize};

/// Layers as (inputs, outputs); weights lie layer by layer, `inputs × outputs` row-major, then biases.
pub const NETWORK_LAYERS: [(usize, usize); 3] = [(6, 8), (8, 4), (4, 1)];
/// Weights of the last layer: 4 and a bias.
pub(super) const OUTPUT_WEIGHTS: usize = 5;

/// The quantity that the networks of a rule correct.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NetworkName {
    /// Position targets, rad, at the policy's rate.
    ActionDelta,
    /// Torques, N·m, at every physics step.
    ResidAct,
}

impl NetworkName {
    /// Every one.
    pub const ALL: [Self; 2] = [Self::ActionDelta, Self::ResidAct];

    /// Name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::ActionDelta => "action_delta",
            Self::ResidAct => "resid_act",
        }
    }

    /// The simulator's word for it.
    pub fn kind(self) -> NetworkKind {
        match self {
            Self::ActionDelta => NetworkKind::ActionDelta,
            Self::ResidAct => NetworkKind::ResidAct,
        }
    }
}
