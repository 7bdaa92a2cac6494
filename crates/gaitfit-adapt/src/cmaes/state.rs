//! Everything that changes during a run.

use super::stop::history_length;
use super::{Begun, CmaError, Covariance, Settings};
use serde::{Deserialize, Serialize};

/// The best candidate so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Best {
    /// Its cost, finite.
    pub cost: f64,
    /// Its coordinates, in the problem's units.
    pub x: Vec<f64>,
    /// Generation it was asked in, from 0.
    pub generation: u32,
}

/// State of a run; with the settings, all there is to save. It knows which settings it belongs to. Every number is finite, so JSON keeps it exactly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// The settings that the run was begun with.
    pub begun: Begun,
    /// Generations told.
    pub generation: u32,
    /// Mean in scaled coordinates.
    pub mean: Vec<f64>,
    /// Step size σ in scaled coordinates.
    pub sigma: f64,
    /// Evolution path of the step size p_σ.
    pub p_sigma: Vec<f64>,
    /// Evolution path of the rank-one update p_c.
    pub p_c: Vec<f64>,
    /// Covariance in scaled coordinates.
    pub covariance: Covariance,
    /// Smallest and largest cost of each of the last generations, a ring indexed by generation.
    pub history: Vec<[f64; 2]>,
    /// The best candidate so far.
    pub best: Option<Best>,
    /// Whether an update left the finite numbers and was dropped.
    pub numerical_failure: bool,
}

impl State {
    /// The state of a run at generation 0.
    pub(crate) fn new(settings: &Settings) -> Self {
        let mean: Vec<f64> = settings.start.iter().zip(&settings.deviation).map(|(x, s)| x / s).collect();
        let n = mean.len();
        Self {
            begun: Begun::new(settings),
            generation: 0,
            mean,
            sigma: settings.sigma,
            p_sigma: vec![0.0; n],
            p_c: vec![0.0; n],
            covariance: Covariance::identity(settings.covariance, n),
            // Zeros until the ring is full. No criterion reads it before.
            history: vec![[0.0; 2]; history_length(n, settings.population)],
            best: None,
            numerical_failure: false,
        }
    }

    /// Checks a state read from a file against the run it should continue.
    pub(crate) fn check(&self, settings: &Settings) -> Result<(), CmaError> {
        let (kind, n) = (settings.covariance, settings.start.len());
        let history = history_length(n, settings.population);
        let fail = |reason: String| Err(CmaError::State(reason));
        for (name, vector) in [("mean", &self.mean), ("p_sigma", &self.p_sigma), ("p_c", &self.p_c)] {
            if vector.len() != n {
                return fail(format!("{name} has {} entries for {n} coordinates", vector.len()));
            }
            if !vector.iter().all(|value| value.is_finite()) {
                return fail(format!("{name} is not finite"));
            }
        }
        if !(self.sigma.is_finite() && self.sigma > 0.0) {
            return fail(format!("sigma is {}", self.sigma));
        }
        if self.covariance.kind() != kind {
            return fail(format!(
                "its covariance is {:?}, the settings say {kind:?}",
                self.covariance.kind()
            ));
        }
        if !self.covariance.is_valid(n) {
            return fail(format!("its covariance is not a decomposed {n} × {n} matrix"));
        }
        // A ring of another length belongs to another population or number of coordinates.
        if self.history.len() != history || self.history.iter().flatten().any(|cost| !cost.is_finite()) {
            return fail(format!("its cost history does not hold {history} generations"));
        }
        if self.best.as_ref().is_some_and(|best| best.x.len() != n || !best.cost.is_finite()) {
            return fail(format!("its best candidate does not have {n} coordinates and a finite cost"));
        }
        // The numbers are whole. They must also be those of a run with these settings.
        self.begun.check(settings)
    }
}
