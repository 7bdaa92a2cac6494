//! Checks that a configuration states.

use serde::{Deserialize, Serialize};

/// A check the configuration states.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Check {
    /// What is checked.
    pub name: String,
    /// The limit; absent of what either holds or does not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<f64>,
    /// What was found; absent of what either holds or does not, and if the simulation diverged.
    pub value: Option<f64>,
    /// Whether it holds.
    pub passed: bool,
    /// What was found instead, where it does not hold.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub found: String,
}

impl Check {
    /// That a number is at most `limit`.
    pub fn at_most(name: &str, limit: f64, value: Option<f64>) -> Self {
        let passed = value.is_some_and(|value| value <= limit);
        Self { name: name.to_owned(), limit: Some(limit), value, passed, found: String::new() }
    }

    /// That something holds; `found`: what was found instead.
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

/// The checks that failed, in words; none if all hold.
pub fn failed(checks: &[Check]) -> Option<String> {
    let failed: Vec<String> = checks.iter().filter(|check| !check.passed).map(Check::text).collect();
    (!failed.is_empty()).then(|| format!("a check failed: {}", failed.join("; ")))
}
