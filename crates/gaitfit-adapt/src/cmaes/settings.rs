//! The user's choices.

use super::{CmaError, Tolerances, default_population};
use serde::{Deserialize, Serialize};

/// Largest magnitude of a scaled coordinate, as the `cmaes` package.
pub(crate) const MEAN_MAX: f64 = 1e32;

/// Form of the covariance matrix.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CovarianceKind {
    /// n × n, with active (negative-weight) update: O(n²) memory, O(n³) a generation.
    #[default]
    Full,
    /// Diagonal (Ros and Hansen 2008): linear memory and time, for n of 500 and more.
    Separable,
}

/// The treatment of draws outside the bounds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BoundHandling {
    /// Draw again, up to `max_resampling` times, then clip: the `cmaes` package. When the optimum lies on several
    /// bounds at once the mean is pressed into the corner, p_σ never settles and σ may grow without bound; the
    /// best candidate stays a little off the corner.
    #[default]
    Resample,
    /// Mirror at the bounds, as often as needed: the distribution is unbounded, the cost seen by it is periodic and
    /// even about every bound, and an optimum on bounds is an ordinary optimum. No draw is wasted. Prefer it where
    /// optima on bounds are likely.
    Reflect,
}

/// Settings of one run. All vectors have one entry a coordinate and are in the problem's own units.
///
/// Coordinates are divided by `deviation` inside: with u = x / deviation, the algorithm runs on u with the scalar
/// step size `sigma` and an identity covariance, so candidates are x = mean + σ · deviation ⊙ y, y ~ N(0, C). With
/// all deviations 1 this is the `cmaes` package itself, otherwise the package on u.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Initial mean.
    pub start: Vec<f64>,
    /// Scale of each coordinate; its initial standard deviation is `sigma · deviation`.
    pub deviation: Vec<f64>,
    /// Initial step size in units of `deviation`; default 1.
    pub sigma: f64,
    /// Lower bounds; −∞ for none (default).
    pub lower: Vec<f64>,
    /// Upper bounds; +∞ for none (default).
    pub upper: Vec<f64>,
    /// Treatment of draws outside the bounds; default resampling.
    pub bound_handling: BoundHandling,
    /// Full or separable; default full.
    pub covariance: CovarianceKind,
    /// Candidates a generation; default 4 + ⌊3 ln n⌋ (eq. 48), at least 2.
    pub population: usize,
    /// Seed of all draws.
    pub seed: u64,
    /// Draws of a candidate outside the bounds before one is clipped to them; default 100.
    pub max_resampling: u32,
    /// When to stop.
    pub tolerances: Tolerances,
}

impl Settings {
    /// Defaults for a start, initial standard deviations and a seed.
    pub fn new(start: Vec<f64>, deviation: Vec<f64>, seed: u64) -> Self {
        let n = start.len();
        Self {
            lower: vec![f64::NEG_INFINITY; n],
            upper: vec![f64::INFINITY; n],
            // `deviation` has the scale of each coordinate already.
            sigma: 1.0,
            bound_handling: BoundHandling::Resample,
            covariance: CovarianceKind::Full,
            population: default_population(n),
            seed,
            // As the `cmaes` package.
            max_resampling: 100,
            tolerances: Tolerances::default(),
            start,
            deviation,
        }
    }

    /// The same with box bounds.
    pub fn with_bounds(self, lower: Vec<f64>, upper: Vec<f64>) -> Self {
        Self { lower, upper, ..self }
    }

    /// Checks every value.
    ///
    /// # Errors
    /// Names the first setting that is wrong.
    pub fn check(&self) -> Result<(), CmaError> {
        let n = self.start.len();
        if n == 0 {
            return Err(CmaError::NoCoordinates);
        }
        for (what, vector) in
            [("deviation", &self.deviation), ("lower bounds", &self.lower), ("upper bounds", &self.upper)]
        {
            if vector.len() != n {
                return Err(CmaError::Length { what, len: vector.len(), expected: n });
            }
        }
        for index in 0..n {
            let (start, deviation) = (self.start[index], self.deviation[index]);
            let (lower, upper) = (self.lower[index], self.upper[index]);
            if !(deviation.is_finite() && deviation > 0.0) {
                let requirement = "finite and above 0";
                return Err(CmaError::Coordinate { what: "deviation", index, value: deviation, requirement });
            }
            // NaN in start or bounds fails the comparisons.
            if !(lower <= start && start <= upper) {
                return Err(CmaError::StartOutsideBounds { index, start, lower, upper });
            }
            // Beyond this the update counts as a numerical failure, so such a start could never move.
            if (start / deviation).abs() >= MEAN_MAX {
                let requirement = "below 1e32 deviations in magnitude";
                return Err(CmaError::Coordinate { what: "start", index, value: start, requirement });
            }
        }
        if !(self.sigma.is_finite() && self.sigma > 0.0) {
            let requirement = "finite and above 0";
            return Err(CmaError::Setting { what: "sigma", value: self.sigma, requirement });
        }
        // With one candidate there is no parent: μ = ⌊λ/2⌋.
        if self.population < 2 {
            let value = self.population as f64;
            return Err(CmaError::Setting { what: "population", value, requirement: "at least 2" });
        }
        Ok(())
    }
}
