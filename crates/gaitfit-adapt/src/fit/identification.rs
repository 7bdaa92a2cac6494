//! How well the data identify a parameter.

use crate::Entry;
use serde::{Deserialize, Serialize};

/// A parameter whose interval is this part of its bounds or more is not identified.
pub const MAX_IDENTIFIED_SHARE: f64 = 0.5;

/// Whether an interval says something of an entry.
pub(super) fn narrow(entry: &Entry, lower: f64, upper: f64) -> bool {
    upper - lower < MAX_IDENTIFIED_SHARE * (entry.upper - entry.lower)
}

/// Source of the noise of a cost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NoiseSource {
    /// Jackknife over groups of recordings.
    Recordings,
    /// The cost's standard deviation over random draws of the simulation: there is one recording only.
    Draws,
    /// Not known: one recording, no randomness. Five percent of the cost are taken.
    Assumed,
    /// Joint: the values that fits of other logs and other simulators would have ([`super::Uncertainty`]).
    Refits,
    /// Errors of the estimates for simulated robots whose values are known ([`super::Regression`]).
    Robots,
}

/// How well the data identify a parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Identification {
    /// Lower end of the interval: where the cost rises as much as its noise, or as far as all parameters together and
    /// other simulators allow; a bound where it reaches so far.
    pub lower: f64,
    /// Upper end.
    pub upper: f64,
    /// The rise at the ends that counts as noise; of the larger end. Costs are in units where the robot's range is 2.
    /// 0 where refits or simulated robots give the interval.
    pub rise: f64,
    /// Source of the noise or of the interval.
    pub noise: NoiseSource,
    /// Whether the interval is less than half as wide as the bounds.
    pub identified: bool,
    /// A value at which the cost is lower than at the best values by three standard errors or more: the search had not
    /// ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub better: Option<f64>,
}

impl Identification {
    /// Extends the interval to `half` on both sides of `value`.
    pub(super) fn widen(&mut self, entry: &Entry, value: f64, half: f64) {
        // An interval only grows, and it stays within the bounds.
        self.lower = self.lower.min(value - half).max(entry.lower);
        self.upper = self.upper.max(value + half).min(entry.upper);
        self.identified = narrow(entry, self.lower, self.upper);
    }

    /// Extends the interval to `other`, a value that fits as well.
    pub fn reach(&mut self, entry: &Entry, other: f64) {
        let other = other.clamp(entry.lower, entry.upper);
        (self.lower, self.upper) = (self.lower.min(other), self.upper.max(other));
        self.identified = narrow(entry, self.lower, self.upper);
    }

    /// How well the logs identify an entry whose 95 % interval is `interval`. `noise`: the source of the interval.
    pub(super) fn of_interval(entry: &Entry, interval: [f64; 2], noise: NoiseSource) -> Self {
        let [lower, upper] = interval.map(|end| end.clamp(entry.lower, entry.upper));
        let identified = narrow(entry, lower, upper);
        Self { lower, upper, rise: 0.0, noise, identified, better: None }
    }
}
