//! The function between two layers.

use serde::{Deserialize, Serialize};

/// Activation of every hidden layer; the last layer is linear.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Activation {
    /// x where x > 0, else eˣ − 1 (Clevert, Unterthiner, Hochreiter 2016, with α = 1).
    #[default]
    Elu,
    /// max(x, 0).
    Relu,
    /// Hyperbolic tangent.
    Tanh,
}

impl Activation {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Elu => "elu",
            Self::Relu => "relu",
            Self::Tanh => "tanh",
        }
    }
}
