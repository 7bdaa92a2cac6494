//! Parts of a description: terms, numbers over joints, and where safetensors hold what stands before the actor.

use crate::error::invalid;
use crate::network::Cell;
use crate::{AnchorJoint, PolicyError, Quantity, Reference, Term};
use gaitfit_log::{ReadOptions, read_csv};
use serde::Deserialize;
use std::path::Path;

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
            Quantity::Constant if by_term => (0..history.min(MAX_REPEATED)).flat_map(|_| each(1)).collect(),
            _ => each(history).collect(),
        }
    }
}

/// Where the motion is that a policy follows.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(untagged, expecting = "give the motion's file, or a table with `file` and `anchor`")]
pub enum ReferenceSource {
    /// A log, relative to the description.
    File(String),
    /// A log, and the joints between the base and the body whose orientations it holds.
    Anchored {
        /// The log, relative to the description.
        file: String,
        /// The joints, from the base on.
        anchor: Vec<AnchorJoint>,
    },
    /// The motion itself.
    Motion(Reference),
}

impl ReferenceSource {
    /// The file's name, where there is one.
    pub(super) fn file(&self) -> Option<&str> {
        match self {
            Self::File(file) | Self::Anchored { file, .. } => Some(file),
            Self::Motion(_) => None,
        }
    }

    /// The motion of `joints`; files are relative to `folder`.
    pub(super) fn read(&self, folder: &Path, joints: &[String]) -> Result<Reference, PolicyError> {
        let (file, anchor) = match self {
            Self::Motion(reference) => return Ok(reference.clone()),
            Self::File(file) => (file, Vec::new()),
            Self::Anchored { file, anchor } => (file, anchor.clone()),
        };
        let path = folder.join(file);
        let inside = |source| PolicyError::In { path: path.clone(), source: Box::new(source) };
        let log = read_csv(&path, &ReadOptions::default())
            .map_err(|error| invalid(format!("the reference motion does not read: {error}")))?;
        Reference::from_log(&log, joints, anchor).map_err(|error| inside(error.into()))
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
    0.01
}
