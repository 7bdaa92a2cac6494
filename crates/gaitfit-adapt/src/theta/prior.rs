//! What is known of a number before the fit, from elsewhere.

use super::{JointParameter, Theta, ThetaError};
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
    /// How the estimate changes with the motors' strength (`torque_scale` of the entry's joints), per 1. Legs in the air
    /// show the joints' resistance relative to the motors' torque, so the estimate assumes motors with a strength of 1.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub by_strength: f64,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl Prior {
    /// An estimate and its standard error.
    pub fn new(value: f64, deviation: f64) -> Self {
        Self { value, deviation, by_strength: 0.0 }
    }

    /// The estimate for motors whose strength is not 1; `error`: the standard error of that strength.
    pub fn with_strength(&self, strength: f64, error: f64) -> Self {
        Self {
            value: self.value + self.by_strength * (strength - 1.0),
            deviation: self.deviation.hypot(self.by_strength * error),
            by_strength: 0.0,
        }
    }

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
            let finite = [prior.value, prior.deviation, prior.by_strength].iter().all(|one| one.is_finite());
            if !finite || prior.deviation <= 0.0 {
                return Err(refused(
                    "needs a finite `value`, a `deviation` above 0 and, if given, a finite `by_strength`",
                ));
            }
            let entry = &mut self.entries[at];
            let range = entry.upper - entry.lower;
            entry.start = prior.value.clamp(entry.lower, entry.upper);
            entry.deviation = prior.deviation.clamp(STEPS[0] * range, STEPS[1] * range).min(entry.deviation);
            found[at] = Some(*prior);
        }
        self.strengths = (0..self.entries.len()).map(|at| self.strength(at)).collect();
        // The search begins at the estimates for the strength with which it begins.
        for (at, strength) in self.strengths.iter().enumerate() {
            if let (Some(prior), Some(strength)) = (found[at], strength) {
                let value = prior.with_strength(self.entries[*strength].start, 0.0).value;
                let entry = &mut self.entries[at];
                entry.start = value.clamp(entry.lower, entry.upper);
            }
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

    /// The entry that is the strength of the motors of entry number `at`, if one entry covers all of its joints.
    pub fn strength(&self, at: usize) -> Option<usize> {
        let joints = &self.entries.get(at)?.joints;
        self.entries.iter().position(|entry| {
            let covered = joints.iter().all(|joint| entry.joints.contains(joint));
            entry.kind == JointParameter::TorqueScale.name() && covered && !joints.is_empty()
        })
    }

    /// What one standard error from a prior adds to the cost.
    pub fn prior_weight(&self) -> f64 {
        self.prior_weight
    }

    /// What the priors add to the cost of `values`: weight · Σ ((value − estimate) / standard error)². It is the negative
    /// logarithm of independent normal densities up to a constant, in units in which the cost's own noise is the weight.
    pub fn prior_cost(&self, values: &[f64]) -> f64 {
        let squares = self.priors.iter().zip(values).enumerate().filter_map(|(at, (prior, value))| {
            let prior = prior.as_ref()?;
            let strength = self.strengths.get(at).copied().flatten().and_then(|at| values.get(at));
            Some(strength.map_or(*prior, |one| prior.with_strength(*one, 0.0)).away(*value).powi(2))
        });
        self.prior_weight * squares.sum::<f64>()
    }
}
