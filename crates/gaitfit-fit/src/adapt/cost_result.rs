//! The result of the fit of one cost.

use super::audit::Audit;
use super::leftover::Leftover;
use super::parameter::Parameter;
use super::score::Validation;
use gaitfit_adapt::fit::{Agreement, Correction, Redrawn, Regression, RunOutcome, Uncertainty};
use gaitfit_view::Doubt;
use serde::{Deserialize, Serialize};

/// The fit of one cost.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct CostFit {
    /// Cost name.
    pub cost_name: String,
    /// Its value of the parameters: the smallest, or that of corrected ones.
    pub cost: f64,
    /// Its value of the robot before the fit; absent if that diverged.
    pub nominal_cost: Option<f64>,
    /// Whether the search came to its end.
    pub converged: bool,
    /// Whether the fitted robot is closer to the logs than the robot before the fit.
    pub better_than_nominal: bool,
    /// Why the fit must not be taken as it stands, the worst first.
    pub doubts: Vec<Doubt>,
    /// Falls of the fitted simulator's robots.
    pub falls: usize,
    /// Falls before the fit.
    pub nominal_falls: usize,
    /// θ as found.
    pub parameters: Vec<Parameter>,
    /// Mean over the parameters with a known truth of |value / truth − 1|, percent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean_error_percent: Option<f64>,
    /// The runs, in seed order.
    pub runs: Vec<RunOutcome>,
    /// Prediction of logs that were not fitted.
    pub validation: Vec<Validation>,
    /// Joint uncertainty of the parameters, where least squares found them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertainty: Option<Uncertainty>,
    /// Correction of the values by simulated logs, where there was one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correction: Option<Correction>,
    /// Correction of the values by simulated robots, where there was one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub regression: Option<Regression>,
    /// Simulated walks of the fitted robot with random draws that the search did not use; `None` without this comparison.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub redrawn: Option<Redrawn>,
    /// The quantities on which its errors depend, if it predicts single samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub audit: Option<Audit>,
    /// The unexplained part of its errors; absent for walks, and if samples are not compared one by one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub leftover: Option<Leftover>,
    /// Each parameter beside the first cost's; empty of the first cost.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub comparison: Vec<Agreement>,
}

impl CostFit {
    /// θ as found.
    pub fn values(&self) -> Vec<f64> {
        self.parameters.iter().map(|parameter| parameter.found.value).collect()
    }

    /// The fit in a sentence, its `doubts` first.
    pub(super) fn headline(&self, doubts: &[Doubt]) -> String {
        if !doubts.is_empty() {
            // Doubts are in the order of their kinds, and a kind is named once.
            let sentence =
                |(at, doubt): (usize, &Doubt)| match at.checked_sub(1).map(|before| doubts[before].kind) {
                    Some(kind) if kind == doubt.kind => doubt.text.clone(),
                    _ => format!("{}: {}", doubt.kind.headline(), doubt.text),
                };
            return doubts.iter().enumerate().map(sentence).collect::<Vec<_>>().join(" ");
        }
        let cost = format!("{} {:.5}", self.cost_name, self.cost);
        match self.nominal_cost {
            Some(nominal) if nominal > 0.0 => {
                let share = 100.0 * (1.0 - self.cost / nominal);
                format!(
                    "{cost}, {share:.0} % below the robot before the fit ({nominal:.5}); the search converged."
                )
            }
            // A share of a cost of 0 is no number.
            Some(nominal) => {
                format!("{cost}; the robot before the fit has {nominal:.5}; the search converged.")
            }
            None => format!("{cost}; the robot before the fit diverges; the search converged."),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn a_robot_before_the_fit_without_cost_does_not_diverge() {
        let headline = |nominal: Option<f64>| {
            let document = serde_json::json!({
                "cost_name": "wass", "cost": 0.25, "nominal_cost": nominal, "converged": true,
                "better_than_nominal": true, "doubts": [], "falls": 0, "nominal_falls": 0, "parameters": [], "runs": [], "validation": [],
            });
            serde_json::from_value::<CostFit>(document).unwrap().headline(&[])
        };
        assert_eq!(
            headline(Some(0.0)),
            "wass 0.25000; the robot before the fit has 0.00000; the search converged."
        );
        assert!(headline(Some(0.5)).contains("50 % below the robot before the fit"));
        assert!(headline(None).contains("diverges"));
    }
}
