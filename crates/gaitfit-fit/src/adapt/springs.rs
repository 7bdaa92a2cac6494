//! Springs on joints as a fit found them: stiffness and rest angle, with intervals, in words.

use super::outliers;
use super::results::AdaptResults;
use gaitfit_adapt::fit::Uncertainty;
use gaitfit_adapt::{LinearSpring, Theta};
use gaitfit_model::JointKind;
use gaitfit_sim::stats;
use serde::{Deserialize, Serialize};

/// Half the width of a 95 % interval in standard deviations, for the two dozen pieces of logs that draws are made of.
/// Student's t with 23 degrees of freedom.
const HALF: f64 = 2.07;

/// A spring on a joint: torque = stiffness · (rest − angle).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FoundSpring {
    /// Joint name.
    pub joint: String,
    /// Whether it turns or slides; units below are those of hinges.
    #[serde(default, skip_serializing_if = "JointKind::is_hinge")]
    pub kind: JointKind,
    /// N·m/rad.
    pub stiffness: f64,
    /// Its 95 % interval, N·m/rad; none where it was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stiffness_interval: Option<[f64; 2]>,
    /// Angle without torque, rad; none where the stiffness may be 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rest: Option<f64>,
    /// Its 95 % interval, rad.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rest_interval: Option<[f64; 2]>,
}

impl FoundSpring {
    /// Those that `values` of `theta` put on joints.
    pub(super) fn all(theta: &Theta, values: &[f64], uncertainty: Option<&Uncertainty>) -> Vec<Self> {
        let draws = uncertainty.map(|uncertainty| uncertainty.draws.as_slice()).unwrap_or_default();
        let draws: Vec<Vec<LinearSpring>> = draws.iter().map(|draw| theta.springs(draw)).collect();
        let springs = theta.springs(values).into_iter().enumerate();
        springs.map(|(at, spring)| Self::with_draws(&spring, draws.iter().map(|draw| &draw[at]))).collect()
    }

    fn with_draws<'a>(spring: &LinearSpring, draws: impl Iterator<Item = &'a LinearSpring> + Clone) -> Self {
        let around = |value: f64, draws: Vec<f64>| {
            let half = HALF * stats::deviation(&draws)?;
            Some([value - half, value + half])
        };
        let stiffness_interval = around(spring.stiffness, draws.clone().map(|one| one.stiffness).collect());
        // The angle of rest is a torque divided by the stiffness. Where the stiffness may be 0, the angle may
        // be anything.
        let sure = match stiffness_interval {
            Some([low, high]) => low > 0.0 || high < 0.0,
            None => spring.stiffness != 0.0,
        };
        let rest = Some(spring.rest()).filter(|rest| sure && rest.is_finite());
        let rest_interval = rest.and_then(|rest| around(rest, draws.map(LinearSpring::rest).collect()));
        Self {
            joint: spring.joint.clone(),
            kind: spring.kind,
            stiffness: spring.stiffness,
            stiffness_interval,
            rest,
            rest_interval,
        }
    }

    /// Its numbers in words, for example `75.3 N·m/rad, at rest at -1.900 rad (95 %: 74.9 to 75.7 N·m/rad, …)`.
    pub fn text(&self) -> String {
        let (per, at) = (self.kind.unit("N·m/rad"), self.kind.unit("rad"));
        let mut text = format!("{:.2} {per}", self.stiffness);
        if let Some(rest) = self.rest {
            text += &format!(", at rest at {rest:.3} {at}");
        }
        let range = |[low, high]: [f64; 2], digits: usize, unit: &str| {
            format!("{low:.digits$} to {high:.digits$} {unit}")
        };
        let stiffness = self.stiffness_interval.map(|interval| range(interval, 2, per));
        let rest = self.rest_interval.map(|interval| range(interval, 3, at));
        let intervals: Vec<String> = stiffness.into_iter().chain(rest).collect();
        if !intervals.is_empty() {
            text += &format!(" (95 %: {})", intervals.join(", "));
        }
        text
    }
}

impl AdaptResults {
    /// Sentences about the springs of the fit.
    pub fn springs_in_words(&self) -> Vec<String> {
        if let Some(odd) = &self.odd_joints {
            // Where no spring is found, a joint that is predicted far worse is the better answer.
            let stands_out = self.fits.first().and_then(|fit| outliers::sentence(&fit.doubts));
            if let Some(sentence) = stands_out.filter(|_| odd.odd.is_empty()) {
                return vec![sentence];
            }
            return odd.sentences(&self.springs);
        }
        let sure = self.springs.iter().filter(|spring| spring.rest.is_some());
        sure.map(|spring| format!("{} has a spring of {}", spring.joint, spring.text())).collect()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    fn spring(stiffness: f64, torque: f64) -> LinearSpring {
        LinearSpring { joint: "RR_calf_joint".to_owned(), kind: JointKind::Hinge, stiffness, torque }
    }

    #[test]
    fn the_rest_angle_and_its_interval_follow_from_the_draws() {
        // Two draws each side: a standard deviation of 0.5 · √(8 / 3) N·m/rad about 75, all at rest at −1.9 rad.
        let draws: Vec<LinearSpring> =
            [74.5, 75.5, 74.0, 76.0].into_iter().map(|k: f64| spring(k, -1.9 * k)).collect();
        let spring = FoundSpring::with_draws(&spring(75.0, -142.5), draws.iter());
        let [low, high] = spring.stiffness_interval.unwrap();
        let half = HALF * (2.5f64 / 3.0).sqrt();
        assert!((low - (75.0 - half)).abs() < 1e-9 && (high - (75.0 + half)).abs() < 1e-9, "{low} {high}");
        assert!((spring.rest.unwrap() + 1.9).abs() < 1e-12);
        let text = spring.text();
        assert!(
            text.starts_with("75.00 N·m/rad, at rest at -1.900 rad (95 %: 73.11 to 76.89 N·m/rad, -1.9"),
            "{text}"
        );
    }

    #[test]
    fn a_spring_that_may_be_none_has_no_rest_angle() {
        let draws = [spring(-0.3, 0.1), spring(0.4, 0.2), spring(0.1, 0.0)];
        let uncertain = FoundSpring::with_draws(&spring(0.1, 0.1), draws.iter());
        assert_eq!((uncertain.rest, uncertain.rest_interval), (None, None));
        assert!(uncertain.text().starts_with("0.10 N·m/rad (95 %: "), "{}", uncertain.text());
        let unmeasured = FoundSpring::with_draws(&spring(10.0, 5.0), [].iter());
        assert_eq!(unmeasured.text(), "10.00 N·m/rad, at rest at 0.500 rad");
    }
}
