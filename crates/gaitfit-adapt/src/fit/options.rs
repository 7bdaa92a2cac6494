//! Settings of a fit.

use super::least_squares::MAX_ENTRIES;
use super::{FallPenalty, FitError};
use crate::cmaes::{BoundHandling, CovarianceKind};
use crate::cost::Cost;
use crate::{Resets, Theta};
use gaitfit_random::{Purpose, derive_seed};
use serde::{Deserialize, Serialize};

/// Settings of a fit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitOptions {
    /// How runs search.
    #[serde(default)]
    pub method: Method,
    /// Candidates a generation; 0 takes 4 + ⌊3 ln n⌋.
    pub population: usize,
    /// Generations of every start.
    pub generations: usize,
    /// Starts after the first, each once the one before has ended, with twice its population.
    pub restarts: u32,
    /// Seeds: one run for each and each cost.
    pub seeds: Vec<u64>,
    /// Covariance model.
    pub covariance: CovarianceKind,
    /// The treatment of draws outside the bounds. A start or an optimum on bounds (dry friction of 0) is common,
    /// and wants [`BoundHandling::Reflect`].
    pub bounds: BoundHandling,
    /// A run of CMA-ES stops once the smallest costs of this many generations hardly change: the means of their
    /// halves differ by less than a fiftieth, standard error included; 0 never. 1 to 3 count as 4, because a half of
    /// one generation has no standard error.
    #[serde(default)]
    pub patience: usize,
    /// A run stops once the largest standard deviation of any parameter, or its next step of least squares, fell to
    /// this part of its initial deviation; 0 never stops early.
    pub tolerance: f64,
    /// The charge for falls.
    pub falls: FallPenalty,
    /// Candidates that share random draws. A simulator without randomness ignores it.
    pub random_numbers: RandomNumbers,
}

impl Default for FitOptions {
    /// 200 generations of one seed, with the population and covariance of Hansen's tutorial.
    fn default() -> Self {
        Self {
            method: Method::Auto,
            population: 0,
            generations: 200,
            restarts: 0,
            seeds: vec![1],
            covariance: CovarianceKind::Full,
            bounds: BoundHandling::Reflect,
            patience: 0,
            tolerance: 1e-4,
            falls: FallPenalty::default(),
            random_numbers: RandomNumbers::default(),
        }
    }
}

impl FitOptions {
    /// The most generations that a seed can take, restarts among them.
    pub fn max_generations(&self) -> usize {
        self.generations.saturating_mul(self.restarts as usize + 1)
    }
}

/// How a run searches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Least squares for costs of short predictions ([`Resets::Sensors`]) over θ without regularisation, CMA-ES for
    /// all others.
    #[default]
    Auto,
    /// Candidates drawn around a mean that moves to the better ones.
    CmaEs,
    /// Steps along derivatives, for costs that compare sample by sample.
    LeastSquares,
}

impl Method {
    /// Whether runs of `cost` over `theta` are least squares.
    ///
    /// # Errors
    /// [`FitError::Distributions`], [`FitError::Regularised`], [`FitError::TooManyEntries`] where they were asked to be
    /// and cannot.
    pub fn least_squares(self, cost: &dyn Cost, theta: &Theta) -> Result<bool, FitError> {
        // The price of values as large as the deviations shows whether there is any regularisation.
        let deviations: Vec<f64> = theta.entries().iter().map(|entry| entry.deviation).collect();
        let refused = if cost.differences().is_none() {
            FitError::Distributions(cost.name().to_owned())
        } else if theta.regularisation(&deviations) > 0.0 {
            FitError::Regularised
        } else if theta.len() > MAX_ENTRIES {
            FitError::TooManyEntries { count: theta.len(), max: MAX_ENTRIES }
        } else {
            return Ok(match self {
                Self::Auto => matches!(cost.resets(), Resets::Sensors(_)),
                Self::CmaEs => false,
                Self::LeastSquares => true,
            });
        };
        // Only a user who asked for least squares must learn why there is none.
        if self == Self::LeastSquares { Err(refused) } else { Ok(false) }
    }
}

/// Candidates that share random draws (torque noise, observation noise). Each seed has draws of its own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RandomNumbers {
    /// The candidates of a generation (common random numbers); the next generation sees new ones. Candidates are
    /// compared on equal terms and none can adapt to one set of draws.
    #[default]
    Generation,
    /// All candidates of a run: its cost is a fixed function of θ.
    Run,
    /// None: each has its own, as in the paper.
    Candidate,
}

impl RandomNumbers {
    /// The draw of a candidate, by its address.
    pub(super) fn draw(self, seed: u64, generation: u32, candidate: usize) -> u64 {
        let noise = Purpose::TORQUE_NOISE;
        let generation = derive_seed(seed, noise, generation);
        match self {
            // These are the draws of generation 0, in all generations.
            Self::Run => derive_seed(seed, noise, 0),
            Self::Generation => generation,
            Self::Candidate => derive_seed(generation, noise, u32::try_from(candidate).unwrap_or(u32::MAX)),
        }
    }
}
