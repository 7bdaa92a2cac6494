//! One entry of θ as found.

use gaitfit_adapt::Prior;
use gaitfit_adapt::fit::ParameterOutcome;
use serde::{Deserialize, Serialize};

/// Standard errors between a fit and what was known before that are a disagreement.
pub(super) const APART: f64 = 3.0;

/// A parameter whose interval is narrower than this part of its bounds is identified, as in `gaitfit-adapt`.
const NARROW: f64 = 0.5;

/// The found value of one entry of θ, with its prior and its true value if they are known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// Value, unit, spread, bounds, and how its interval was measured.
    #[serde(flatten)]
    pub found: ParameterOutcome,
    /// The values that fit as well, all others held: lower and upper end; absent where it was not measured.
    pub interval: Option<[f64; 2]>,
    /// Whether the logs determine it; absent where it was not measured.
    pub identified: Option<bool>,
    /// True value, from the configuration's `[truth]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub truth: Option<f64>,
    /// Published values, [smallest, largest], from the configuration's `[published]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub published: Option<[f64; 2]>,
    /// Its prior, from the configuration's `[prior]` or from legs in the air.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prior: Option<Prior>,
}

impl Parameter {
    /// Its standard error by the interval; 0 without one.
    pub fn error(&self) -> f64 {
        // A 95 % interval is about four standard errors wide.
        self.interval.map_or(0.0, |[low, high]| (high - low) / 4.0)
    }

    /// The longer side of its interval, which stands after ±; absent where it was not measured.
    pub fn half(&self) -> Option<f64> {
        self.interval.map(|[lower, upper]| (self.found.value - lower).max(upper - self.found.value).max(0.0))
    }

    /// Extends the interval to `value`, within the bounds.
    pub(super) fn reach(&mut self, value: f64) {
        if let Some([lower, upper]) = self.interval {
            let value = value.clamp(self.found.lower, self.found.upper);
            self.take([lower.min(value), upper.max(value)]);
        }
    }

    /// Widens the interval by errors up to `reach`, as independent of those that it has.
    pub(super) fn blur(&mut self, reach: f64) {
        let Some([lower, upper]) = self.interval else { return };
        let value = self.found.value;
        self.take([
            // Squares of independent errors add.
            (value - (value - lower).hypot(reach)).max(self.found.lower),
            (value + (upper - value).hypot(reach)).min(self.found.upper),
        ]);
    }

    /// Replaces the interval by two standard errors around the prior, if the fit agrees with the prior. Intervals from
    /// whole walks move one parameter while the others stay. If such an interval is narrower than the prior's, it is
    /// too narrow; if it is wider, legs in the air determine the value better.
    pub(super) fn combine(&mut self) {
        let agrees = |prior: &Prior| prior.away(self.found.value).abs() <= APART;
        let Some(prior) = self.prior.filter(agrees).filter(|_| self.interval.is_some()) else { return };
        let (value, reach) = (self.found.value, 2.0 * prior.deviation);
        let within = |end: f64| end.clamp(self.found.lower, self.found.upper);
        self.take([within(prior.value - reach).min(value), within(prior.value + reach).max(value)]);
    }

    /// Takes another interval.
    fn take(&mut self, ends: [f64; 2]) {
        if self.interval.is_some_and(|interval| interval != ends) {
            self.interval = Some(ends);
            self.identified = Some(ends[1] - ends[0] < NARROW * (self.found.upper - self.found.lower));
        }
    }

    /// Widens the interval by `factor`, within the bounds, and to what was known before where that is far away.
    pub(super) fn widen(&mut self, factor: f64) {
        let (Some([lower, upper]), value) = (self.interval, self.found.value) else { return };
        let known =
            self.prior.filter(|prior| prior.away(value).abs() > APART).map_or(value, |prior| prior.value);
        // Whatever the factor, the interval keeps all that it covers.
        let ends = [
            (value - factor * (value - lower)).min(known).max(self.found.lower).min(lower),
            (value + factor * (upper - value)).max(known).min(self.found.upper).max(upper),
        ];
        self.take(ends);
    }
}

/// A parameter for tests, with one run.
#[cfg(test)]
pub(super) fn example(name: &str, value: f64, [lower, upper]: [f64; 2], interval: [f64; 2]) -> Parameter {
    let found = ParameterOutcome {
        name: name.to_owned(),
        unit: "N·m".to_owned(),
        value,
        uncorrected: None,
        spread: None,
        lower,
        upper,
        start: 0.0,
        at_bound: value <= lower || value >= upper,
        per_run: vec![value],
        identification: None,
    };
    let (interval, identified) = (Some(interval), Some(true));
    Parameter { found, interval, identified, truth: None, published: None, prior: None }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn friction(value: f64, interval: [f64; 2], prior: Prior) -> Parameter {
        Parameter {
            identified: Some(false),
            prior: Some(prior),
            ..example("frictionloss_calf", value, [0.0, 2.0], interval)
        }
    }

    #[test]
    fn what_is_known_is_the_interval_where_the_fit_agrees() {
        let known = Prior::new(0.6, 0.05);
        let mut one = friction(0.64, [0.1, 2.0], known);
        one.combine();
        let [lower, upper] = one.interval.unwrap_or_default();
        assert!((lower - 0.5).abs() < 1e-12 && (upper - 0.7).abs() < 1e-12, "{lower} {upper}");
        assert_eq!(one.identified, Some(true));
        // Walks that are surer look at one parameter at a time.
        let mut sure = friction(0.64, [0.62, 0.66], known);
        sure.combine();
        let [lower, upper] = sure.interval.unwrap_or_default();
        assert!((lower - 0.5).abs() < 1e-12 && (upper - 0.7).abs() < 1e-12, "{lower} {upper}");
        // Walks that ask for something else keep what they say.
        let mut other = friction(1.3, [1.1, 1.4], known);
        other.combine();
        assert_eq!(other.interval, Some([1.1, 1.4]));
    }
}
