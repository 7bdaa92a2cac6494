//! Parts of an interface for single joints, beside its vectors: joints that are held, and limits of actions.

use serde::{Deserialize, Serialize};

/// A joint that the policy does not move: a PD controller holds it at an angle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Held {
    /// Its name.
    pub joint: String,
    /// Where it is held, rad.
    pub position: f64,
    /// Position gain, N·m/rad.
    pub kp: f64,
    /// Velocity gain, N·m·s/rad.
    pub kd: f64,
}

/// Largest magnitude of an action, before scaling.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "give one number for all joints, or a list of one number a joint")]
pub enum ActionClip {
    /// The same for every joint.
    All(f64),
    /// One a joint, in the policy's order.
    Each(Vec<f64>),
}

impl ActionClip {
    /// Limit of the policy's joint `index`; infinite if it has none.
    pub fn limit(&self, index: usize) -> f64 {
        match self {
            Self::All(clip) => *clip,
            Self::Each(clips) => clips.get(index).copied().unwrap_or(f64::INFINITY),
        }
    }

    /// All its numbers.
    pub fn values(&self) -> &[f64] {
        match self {
            Self::All(clip) => std::slice::from_ref(clip),
            Self::Each(clips) => clips,
        }
    }
}
