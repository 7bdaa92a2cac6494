//! Estimates of a number from before the fit, from another source.

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
    /// By how much the estimate rises if the motors' strength (`torque_scale` of the entry's joints) rises by 1. Legs in the
    /// air show the joints' resistance relative to the motors' torque. So the estimate assumes motors with a strength of 1.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub by_strength: f64,
    /// By how much the estimate falls if the friction under load (`load_friction` of the entry's joints) rises by 1: with a load
    /// friction of c the estimate is lower by c times this. Legs in the air show only the sum of both frictions.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub by_load: f64,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl Prior {
    /// An estimate and its standard error.
    pub fn new(value: f64, deviation: f64) -> Self {
        Self { value, deviation, by_strength: 0.0, by_load: 0.0 }
    }

    /// The estimate for motors whose strength is not 1; `error`: the standard error of that strength.
    pub fn with_strength(&self, strength: f64, error: f64) -> Self {
        Self {
            value: self.value + self.by_strength * (strength - 1.0),
            // Both errors are independent, so their squares add.
            deviation: self.deviation.hypot(self.by_strength * error),
            by_strength: 0.0,
            ..*self
        }
    }

    /// The estimate for a joint with friction under load; `error`: the standard error of that friction.
    pub fn with_load(&self, load: f64, error: f64) -> Self {
        Self {
            value: self.value - self.by_load * load,
            deviation: self.deviation.hypot(self.by_load * error),
            by_load: 0.0,
            ..*self
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
        // Priors are kept in the order of the entries, so that a cost needs no look-up by name.
        let mut of_entries = vec![None; self.entries.len()];
        for (name, prior) in priors {
            let refused = |why: &str| ThetaError::Prior { name: name.clone(), why: why.to_owned() };
            let Some(at) = self.entries.iter().position(|entry| entry.name == *name) else {
                let names: Vec<&str> = self.entries.iter().map(|entry| entry.name.as_str()).collect();
                return Err(refused(&format!("is not fitted; fitted are {}", names.join(", "))));
            };
            let numbers = [prior.value, prior.deviation, prior.by_strength, prior.by_load];
            let finite = numbers.iter().all(|one| one.is_finite());
            if !finite || prior.deviation <= 0.0 {
                return Err(refused(
                    "needs a finite `value`, a `deviation` above 0 and, if given, finite `by_strength` and `by_load`",
                ));
            }
            let entry = &mut self.entries[at];
            let range = entry.upper - entry.lower;
            entry.start = prior.value.clamp(entry.lower, entry.upper);
            // A prior narrows the first steps of a search and never widens them.
            entry.deviation = prior.deviation.clamp(STEPS[0] * range, STEPS[1] * range).min(entry.deviation);
            of_entries[at] = Some(*prior);
        }
        // The links to strength and load are found once here; they are asked for in each evaluation.
        self.strengths = (0..self.entries.len()).map(|at| self.strength(at)).collect();
        self.loads = (0..self.entries.len()).map(|at| self.load(at)).collect();
        self.priors = of_entries;
        // The search begins at the estimates for the strength and the friction under load with which it begins.
        let starts: Vec<f64> = self.entries.iter().map(|entry| entry.start).collect();
        for at in 0..self.entries.len() {
            let Some(prior) = self.prior_beside(at, &starts) else { continue };
            let entry = &mut self.entries[at];
            entry.start = prior.value.clamp(entry.lower, entry.upper);
        }
        self.prior_weight = weight;
        Ok(self)
    }

    /// The prior of each entry.
    pub fn priors(&self) -> impl Iterator<Item = Option<&Prior>> {
        (0..self.entries.len()).map(|at| self.prior(at))
    }

    /// The same of entry number `at`.
    pub fn prior(&self, at: usize) -> Option<&Prior> {
        self.priors.get(at)?.as_ref()
    }

    /// The entry that is the strength of the motors of entry number `at`, if one entry covers all of its joints.
    pub fn strength(&self, at: usize) -> Option<usize> {
        self.covering(at, JointParameter::TorqueScale)
    }

    /// The entry that is the friction under load of the joints of entry number `at`, if one entry covers all of them.
    pub fn load(&self, at: usize) -> Option<usize> {
        self.covering(at, JointParameter::LoadFriction)
    }

    /// The entry of this kind that covers all joints of entry number `at`.
    fn covering(&self, at: usize, kind: JointParameter) -> Option<usize> {
        let joints = &self.entries.get(at)?.joints;
        self.entries.iter().position(|entry| {
            let covered = joints.iter().all(|joint| entry.joints.contains(joint));
            // Numbers of the whole robot have no joints, and `all` of nothing is true.
            entry.kind == kind.name() && covered && !joints.is_empty()
        })
    }

    /// The prior of entry number `at`, if the other entries have these values.
    fn prior_beside(&self, at: usize, values: &[f64]) -> Option<Prior> {
        let mut prior = *self.prior(at)?;
        let value =
            |places: &[Option<usize>]| places.get(at).copied().flatten().and_then(|at| values.get(at));
        // Strength and load are numbers of the search here, without an error of their own.
        if let Some(strength) = value(&self.strengths) {
            prior = prior.with_strength(*strength, 0.0);
        }
        if let Some(load) = value(&self.loads) {
            prior = prior.with_load(*load, 0.0);
        }
        Some(prior)
    }

    /// Cost of one standard error from a prior.
    pub fn prior_weight(&self) -> f64 {
        self.prior_weight
    }

    /// The amount that the priors add to the cost of `values`: weight · Σ ((value − estimate) / standard error)². It is the negative
    /// logarithm of independent normal densities up to a constant, in units in which the cost's own noise is the weight.
    pub fn prior_cost(&self, values: &[f64]) -> f64 {
        let squares = values
            .iter()
            .enumerate()
            .filter_map(|(at, value)| Some(self.prior_beside(at, values)?.away(*value).powi(2)));
        self.prior_weight * squares.sum::<f64>()
    }
}
