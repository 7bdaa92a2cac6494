//! Why a run ends.

use serde::{Deserialize, Serialize};

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stop {
    /// It did its generations.
    Generations,
    /// Its deviations shrank to the tolerance.
    Tolerance,
    /// The smallest costs of its generations hardly changed, see [`super::FitOptions::patience`].
    Patience,
    /// The optimiser's own criteria: nothing changes any more.
    Converged,
    /// The optimiser's own criteria: it cannot continue (steps without bound, degenerate covariance).
    Degenerate,
}
