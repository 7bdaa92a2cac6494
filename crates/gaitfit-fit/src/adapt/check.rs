//! Checks that a configuration states.

use super::cost_result::CostFit;
use super::score::{Score, Validation, mean};
use super::setup::Setup;
use crate::settings::CheckConfig;
use gaitfit_view::{Doubt, DoubtKind};
use serde::{Deserialize, Serialize};

/// A check the configuration states.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Check {
    /// The checked property.
    pub name: String,
    /// The limit; absent of what either holds or does not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<f64>,
    /// The measured value; absent for checks without a number, and if the simulation diverged.
    pub value: Option<f64>,
    /// Whether it holds.
    pub passed: bool,
    /// The result, if the check failed.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub found: String,
}

impl Check {
    /// A check that a number is at most `limit`.
    pub fn at_most(name: &str, limit: f64, value: Option<f64>) -> Self {
        // A simulation that diverged has no number, and fails the check.
        let passed = value.is_some_and(|value| value <= limit);
        Self { name: name.to_owned(), limit: Some(limit), value, passed, found: String::new() }
    }

    /// A check that something holds; `found`: the result otherwise.
    pub fn holds(name: &str, passed: bool, found: &str) -> Self {
        let found = if passed { String::new() } else { found.to_owned() };
        Self { name: name.to_owned(), limit: None, value: None, passed, found }
    }

    /// The check in words.
    pub fn text(&self) -> String {
        match self.limit {
            Some(limit) => {
                let value = self.value.map_or_else(|| "diverged".to_owned(), |value| format!("{value:.5}"));
                format!("{} is {value}, limit {limit}", self.name)
            }
            None if self.passed => self.name.clone(),
            None => format!("not {}: {}", self.name, self.found),
        }
    }
}

/// The evidence of doubts of a kind.
fn evidence_of(doubts: &[Doubt], kind: DoubtKind) -> String {
    let of_kind = doubts.iter().filter(|doubt| doubt.kind == kind);
    of_kind.map(|doubt| doubt.text.as_str()).collect::<Vec<_>>().join(" ")
}

/// The checks that the configuration states.
pub(super) fn checks(setup: &Setup, first: &CostFit, doubts: &[Doubt], fitted: &Score) -> Vec<Check> {
    // All checks are about the fit whose θ is kept.
    let check = &setup.config.check;
    let mut checks = Vec::new();
    if check.better_than_nominal {
        let evidence = evidence_of(doubts, DoubtKind::WorseThanNominal);
        checks.push(Check::holds("better than the nominal robot", evidence.is_empty(), &evidence));
    }
    if check.converged {
        let evidence = evidence_of(doubts, DoubtKind::NotConverged);
        checks.push(Check::holds("converged", first.converged, &evidence));
    }
    if check.sound {
        let texts = doubts.iter().map(|doubt| format!("{}: {}", doubt.kind.headline(), doubt.text));
        let evidence = texts.collect::<Vec<_>>().join(" ");
        checks.push(Check::holds("sound", doubts.is_empty(), &evidence));
    }
    if let Some(limit) = check.cost {
        checks.push(Check::at_most("cost", limit, Some(first.cost)));
    }
    checks.extend(validation_checks(check, &first.validation, fitted.cost_validation));
    checks
}

/// The checks on validation logs that the configuration states.
pub(super) fn validation_checks(
    check: &CheckConfig,
    validation: &[Validation],
    cost: Option<f64>,
) -> Vec<Check> {
    let mut checks = Vec::new();
    if let Some(limit) = check.validation_cost {
        checks.push(Check::at_most("validation_cost", limit, cost));
    }
    if let Some(limit) = check.rmse_rad {
        let value = mean(validation.iter().map(|log| log.rmse_rad));
        checks.push(Check::at_most("rmse_rad (mean over validation logs)", limit, value));
    }
    checks
}

/// The checks that failed, in words; `None` if all hold.
pub fn failed(checks: &[Check]) -> Option<String> {
    let failed: Vec<String> = checks.iter().filter(|check| !check.passed).map(Check::text).collect();
    (!failed.is_empty()).then(|| format!("a check failed: {}", failed.join("; ")))
}
