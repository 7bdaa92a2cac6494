//! One part of an observation.

use crate::Quantity;
use serde::{Deserialize, Serialize};

/// One part of an observation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Term {
    /// What is observed.
    pub quantity: Quantity,
    /// Factor on it: one number for all its elements, or one an element; none means 1.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub scale: Vec<f32>,
    /// Frames: the present one and those of the control periods before it. 1, the default, is the present alone.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub history: usize,
    /// Control periods by which the reference motion is read ahead; for quantities of the motion.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub ahead: usize,
}

impl Term {
    /// `quantity` as it is now, with a factor of 1.
    pub fn new(quantity: Quantity) -> Self {
        Self { quantity, scale: Vec::new(), history: 1, ahead: 0 }
    }

    /// With these factors.
    pub fn scaled(self, scale: &[f32]) -> Self {
        Self { scale: scale.to_vec(), ..self }
    }

    /// With so many frames.
    pub fn with_history(self, history: usize) -> Self {
        Self { history, ..self }
    }

    /// Numbers it takes for a robot of `joints` joints, all frames together.
    pub fn width(&self, joints: usize) -> usize {
        // Both may come from a file: a product that is too large saturates, and `Interface::check` refuses it.
        self.quantity.width(joints).saturating_mul(self.history)
    }
}

fn one() -> usize {
    1
}

fn is_one(history: &usize) -> bool {
    *history == 1
}

fn is_zero(ahead: &usize) -> bool {
    *ahead == 0
}

/// Numbers that `terms` take for a robot of `joints` joints.
pub(crate) fn width(terms: &[Term], joints: usize) -> usize {
    terms.iter().fold(0, |sum: usize, term| sum.saturating_add(term.width(joints)))
}
