//! How the past frames of an observation lie in a row.

use serde::{Deserialize, Serialize};

/// How the frames of terms with a history lie in a row, and what stands for frames before an episode's start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct History {
    /// Which number follows which.
    pub order: FrameOrder,
    /// What the frames before an episode's first observation hold.
    pub start: HistoryStart,
}

impl History {
    /// Whether it is what Isaac Lab does, which files need not say.
    pub(crate) fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// Which number follows which in a row with past frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FrameOrder {
    /// Term after term, and within a term frame after frame, the oldest first: Isaac Lab's flattened history.
    #[default]
    Terms,
    /// Frame after frame, the oldest first, each with all terms: a stack of whole observations as legged_gym's
    /// descendants keep it, for example walk-these-ways.
    Frames,
    /// As `Frames`, with the newest frame first.
    NewestFirst,
}

/// What the frames before an episode's first observation hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HistoryStart {
    /// The first observation, as in Isaac Lab.
    #[default]
    First,
    /// Zeros.
    Zeros,
}
