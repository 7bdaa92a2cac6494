//! Parts of a description: terms, numbers over joints, and where safetensors hold what stands before the actor.

use gaitfit_policy::network::Cell;
use gaitfit_policy::{AnchorJoint, Quantity, Reference, Term};
use serde::Deserialize;

/// One number for all joints, or one a joint.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(untagged, expecting = "give one number for all joints, or a list of one number a joint")]
pub enum PerJoint {
    /// The same for every joint.
    All(f64),
    /// One a joint.
    Each(Vec<f64>),
}

impl PerJoint {
    pub(super) fn spread(&self, joints: usize) -> Vec<f64> {
        match self {
            Self::All(value) => vec![*value; joints],
            Self::Each(values) => values.clone(),
        }
    }
}

/// One part of a described observation.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DescribedTerm {
    /// What is observed.
    pub quantity: Quantity,
    /// Factor on it; none is 1.
    pub scale: Option<PerJoint>,
    /// Frames: the present one and those before it.
    #[serde(default = "one")]
    pub history: usize,
    /// Control periods by which the reference motion is read ahead.
    #[serde(default)]
    pub ahead: usize,
}

impl DescribedTerm {
    /// The terms that it stands for: one for each number of a list of constants or of sines. `by_term`: whether rows hold term
    /// after term.
    pub(super) fn terms(&self, by_term: bool) -> Vec<Term> {
        let scale = match &self.scale {
            None => Vec::new(),
            Some(PerJoint::All(value)) => vec![*value as f32],
            Some(PerJoint::Each(values)) => values.iter().map(|&value| value as f32).collect(),
        };
        let Self { quantity, history, ahead, .. } = *self;
        let listed = matches!(quantity, Quantity::Constant | Quantity::GaitSine) && scale.len() > 1;
        if !listed {
            return vec![Term { quantity, scale, history, ahead }];
        }
        let each = |history: usize| {
            scale.iter().map(move |&one| Term { quantity, scale: vec![one], history, ahead })
        };
        // Frame after frame they are the same numbers.
        match quantity {
            // More terms than an interface may have: its check refuses them, and until then the bound limits
            // the memory.
            Quantity::Constant if by_term => (0..history.min(MAX_REPEATED)).flat_map(|_| each(1)).collect(),
            _ => each(history).collect(),
        }
    }
}

/// Where the motion is that a policy follows.
#[derive(Clone, Debug, PartialEq)]
pub enum ReferenceSource {
    /// A log, relative to the description.
    File(String),
    /// A log, and the joints between the base and the body whose orientations it holds.
    Anchored(Anchored),
    /// The motion itself.
    Motion(Reference),
}

/// A motion's file and the joints to its anchor.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Anchored {
    /// The log, relative to the description.
    pub file: String,
    /// The joints, from the base on; an empty list: the anchor is the base.
    pub anchor: Option<Vec<AnchorJoint>>,
}

impl<'de> Deserialize<'de> for ReferenceSource {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        use serde::de::Error as _;
        let message = |error: toml::de::Error| D::Error::custom(format!("reference: {}", error.message()));
        match toml::Value::deserialize(deserializer)? {
            toml::Value::String(file) => Ok(Self::File(file)),
            // What a policy's own file has.
            toml::Value::Table(table) if table.contains_key("position") => {
                table.try_into().map(Self::Motion).map_err(message)
            }
            toml::Value::Table(table) => table.try_into().map(Self::Anchored).map_err(message),
            _ => Err(D::Error::custom(
                "reference: give the motion's file, or a table with `file` and `anchor`",
            )),
        }
    }
}

/// Max number of frames of constants that are written out.
const MAX_REPEATED: usize = 1 << 10;

/// Where safetensors hold recurrent layers, as PyTorch's `nn.LSTM` and `nn.GRU` name their tensors.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MemoryTensors {
    /// Kind of the layers.
    pub cell: Cell,
    /// Prefix of the tensors: `memory_a.rnn` finds `memory_a.rnn.weight_ih_l0`.
    pub tensors: String,
}

/// Where safetensors hold a normaliser (x − mean) / (std + epsilon).
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NormaliserTensors {
    /// Name of the means' tensor.
    pub mean: String,
    /// Name of the standard deviations' tensor.
    pub std: String,
    /// Added to the standard deviation.
    #[serde(default = "hundredth")]
    pub epsilon: f64,
}

fn one() -> usize {
    1
}

fn hundredth() -> f64 {
    // The eps of rsl_rl's EmpiricalNormalization.
    0.01
}
