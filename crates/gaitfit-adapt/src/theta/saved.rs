//! The tables of `theta.toml`.

use super::NetworkName;
use gaitfit_model::SelfContact;
use serde::{Deserialize, Serialize};

/// Version of the format. 1 had no networks.
pub(super) const FORMAT: u32 = 2;

/// The result of a fit: a file that can be written, read and applied to a robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThetaFile {
    /// Version of the format.
    pub format: u32,
    /// The checksum in a text that is being read; `None` everywhere else: [`Self::to_toml`] computes it.
    #[serde(default, skip_serializing)]
    pub checksum: Option<String>,
    /// Robot name.
    #[serde(default)]
    pub robot: String,
    /// The cost it minimises.
    #[serde(default)]
    pub cost_name: String,
    /// Its value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cost: Option<f64>,
    /// Physics step of the fit, s. What `resid_act` remembers is in steps, so another step gives another network.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub physics_step: Option<f64>,
    /// Contacts between parts of the robot that the fit simulated; absent if there were none.
    #[serde(default, skip_serializing_if = "SelfContact::is_off")]
    pub self_contact: SelfContact,
    /// Why walks that were not fitted contradict the fit, in words; absent if they do not, or there were none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contradicted: Option<String>,
    /// Single numbers.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameter: Vec<SavedParameter>,
    /// Networks, one a joint.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub network: Vec<SavedNetwork>,
}

/// A number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedParameter {
    /// Name.
    pub name: String,
    /// The quantity that it changes, for example `frictionloss`.
    pub kind: String,
    /// The joints it covers, by name or, in a file written by hand, by pattern (`*_hip*`, `{FL,FR}_*`); empty for what is not a joint's.
    #[serde(default)]
    pub joints: Vec<String>,
    /// Value.
    pub value: f64,
    /// Unit.
    #[serde(default)]
    pub unit: String,
    /// Standard deviation over seeds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spread: Option<f64>,
    /// Lower bound of the search.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lower: Option<f64>,
    /// Upper bound of the search.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub upper: Option<f64>,
    /// Whether the value rests on one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_bound: Option<bool>,
    /// The values that fit as well: lower and upper end; absent where it was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interval: Option<[f64; 2]>,
    /// Whether the logs determine it; absent where it was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub identified: Option<bool>,
}

/// A joint's network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedNetwork {
    /// Name, for example `resid_act_RR_calf`.
    pub name: String,
    /// The quantity that the network corrects.
    pub kind: NetworkName,
    /// The joint.
    pub joint: String,
    /// Angle at which the position inputs are 0, rad.
    pub rest: f64,
    /// Factor on the joint's angle, 1/rad.
    pub position_scale: f64,
    /// Factor on the joint's velocity, s/rad.
    pub velocity_scale: f64,
    /// Output for a last layer of weight 1, rad or N·m.
    pub output_scale: f64,
    /// Weights: layer by layer (6 × 8, 8 × 4, 4 × 1), `inputs × outputs` row-major, then biases.
    pub weights: Vec<f64>,
}

/// Largest value of any number: beyond it no robot is meant, and single precision may overflow.
pub(super) const MAX_VALUE: f64 = 1e6;

impl ThetaFile {
    /// The file of a robot as it is, without any number of a fit.
    pub fn nominal() -> Self {
        Self {
            format: FORMAT,
            checksum: None,
            robot: String::new(),
            cost_name: String::new(),
            cost: None,
            physics_step: None,
            self_contact: SelfContact::Off,
            contradicted: None,
            parameter: Vec::new(),
            network: Vec::new(),
        }
    }
}
