//! What a generation of a fit did.

use super::stop::Stop;
use serde::{Deserialize, Serialize};

/// One generation of all runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Generation {
    /// Number, from 1.
    pub generation: usize,
    /// Candidates simulated on all recordings.
    pub evaluations: usize,
    /// The runs that took part.
    pub runs: Vec<RunGeneration>,
}

/// One generation of one run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunGeneration {
    /// Cost name.
    pub cost: String,
    /// Seed.
    pub seed: u64,
    /// Smallest cost of the generation.
    pub best: f64,
    /// Mean of its finite costs.
    pub mean: f64,
    /// CMA-ES step size; multiplies the entries' initial deviations.
    pub sigma: f64,
    /// Candidates whose simulation diverged.
    pub diverged: usize,
    /// Candidates that fell in at least one recording.
    #[serde(default)]
    pub fallen: usize,
    /// Falls of all candidates in all recordings.
    #[serde(default)]
    pub falls: usize,
    /// Smallest cost so far; of least squares that of the last step.
    pub best_so_far: f64,
    /// Its θ.
    pub best_values: Vec<f64>,
    /// Why the run ended, if this was its last generation.
    pub stop: Option<Stop>,
}
