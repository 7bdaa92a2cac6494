//! What is known of a number before the fit, from elsewhere.

use super::{Theta, ThetaError};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Smallest and largest deviation of a prior's search, as parts of the entry's range: below, steps vanish in rounding;
/// above, the prior says nothing.
const STEPS: [f64; 2] = [1e-4, 0.3];

/// An estimate of an entry that was made without the fit, with its standard error: legs in the air, a data sheet, a test
/// bench. The search begins there, with steps of that size, and pays for going away: see [`Theta::prior_cost`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prior {
    /// The estimate, in the entry's unit.
    pub value: f64,
    /// Its standard error, in the same unit.
    pub deviation: f64,
}

impl Prior {
    /// How many standard errors `value` is away from the estimate; negative below it.
    pub fn away(&self, value: f64) -> f64 {
        (value - self.value) / self.deviation
    }
}

impl Theta {
    /// θ whose entries start at what is known of them. `priors`: by the entries' names. A prior outside the bounds
    /// starts at the nearer bound and still pulls towards its value. `weight`: what a distance of one standard error
    /// adds to the cost, see [`Self::prior_cost`].
    ///
    /// # Errors
    /// [`ThetaError::Prior`] of an entry that θ does not have, and of numbers that are not finite or a deviation that is
    /// not positive.
    pub fn with_priors(mut self, priors: &BTreeMap<String, Prior>, weight: f64) -> Result<Self, ThetaError> {
        let mut found = vec![None; self.entries.len()];
        for (name, prior) in priors {
            let refused = |why: &str| ThetaError::Prior { name: name.clone(), why: why.to_owned() };
            let Some(at) = self.entries.iter().position(|entry| entry.name == *name) else {
                let names: Vec<&str> = self.entries.iter().map(|entry| entry.name.as_str()).collect();
                return Err(refused(&format!("is not fitted; fitted are {}", names.join(", "))));
            };
            if !(prior.value.is_finite() && prior.deviation.is_finite() && prior.deviation > 0.0) {
                return Err(refused("needs a finite `value` and a `deviation` above 0"));
            }
            let entry = &mut self.entries[at];
            let range = entry.upper - entry.lower;
            entry.start = prior.value.clamp(entry.lower, entry.upper);
            entry.deviation = prior.deviation.clamp(STEPS[0] * range, STEPS[1] * range).min(entry.deviation);
            found[at] = Some(*prior);
        }
        self.priors = found;
        self.prior_weight = weight;
        Ok(self)
    }

    /// What is known of each entry before the fit.
    pub fn priors(&self) -> impl Iterator<Item = Option<&Prior>> {
        (0..self.entries.len()).map(|at| self.prior(at))
    }

    /// The same of entry number `at`.
    pub fn prior(&self, at: usize) -> Option<&Prior> {
        self.priors.get(at)?.as_ref()
    }

    /// What one standard error from a prior adds to the cost.
    pub fn prior_weight(&self) -> f64 {
        self.prior_weight
    }

    /// What the priors add to the cost of `values`: weight · Σ ((value − estimate) / standard error)². It is the negative
    /// logarithm of independent normal densities up to a constant, in units in which the cost's own noise is the weight.
    pub fn prior_cost(&self, values: &[f64]) -> f64 {
        let squares = self
            .priors
            .iter()
            .zip(values)
            .filter_map(|(prior, value)| Some(prior.as_ref()?.away(*value).powi(2)));
        self.prior_weight * squares.sum::<f64>()
    }
}
