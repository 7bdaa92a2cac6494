//! Whether a command's robot is there, and which Python `{python}` is.

use super::process::Program;
use crate::watch::Watch;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Names the Python of `{python}`, and no other is tried.
const VARIABLE: &str = "GAITFIT_PYTHON";
/// Where a project keeps its own, seen from the current directory.
const VENV_PYTHON: &str = ".venv/bin/python";
/// Programs that are tried after that.
const COMMON: [&str; 2] = ["python3", "python"];
/// The place to fill in.
const PLACE: &str = "{python}";

/// Whether a loop found its robot when it began. The loop ends as it began.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Presence {
    /// Whether the robot is there.
    pub there: bool,
    /// If it is not, why, in words.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub why: String,
}

/// Whether words ask for a Python.
pub fn asks_for_python(words: &[String]) -> bool {
    words.iter().any(|word| word.contains(PLACE))
}

/// Words with the Python filled in.
pub fn with_python(words: &[String], python: &str) -> Vec<String> {
    words.iter().map(|word| word.replace(PLACE, python)).collect()
}

/// The first Python with which the words end well; for words without one, nothing. Each may take `timeout_seconds`.
///
/// # Errors
/// In words, why it ends well with none.
pub fn probe(words: &[String], timeout_seconds: f64, watch: &Watch<'_>) -> Result<Option<String>, String> {
    let run = |words: &[String]| run(words, timeout_seconds, watch);
    if !asks_for_python(words) {
        return run(words).map(|()| None);
    }
    let mut failures = Vec::new();
    for python in pythons() {
        match run(&with_python(words, &python)) {
            Ok(()) => return Ok(Some(python)),
            Err(why) => failures.push(format!("`{python}`: {why}")),
        }
    }
    Err(failures.join("; "))
}

/// The Python to try, in this order.
fn pythons() -> Vec<String> {
    if let Some(named) = std::env::var(VARIABLE).ok().filter(|named| !named.is_empty()) {
        return vec![named];
    }
    // The project's own Python first: it is the one that has the project's packages.
    let venv = Path::new(VENV_PYTHON).exists().then(|| VENV_PYTHON.to_owned());
    venv.into_iter().chain(COMMON.map(str::to_owned)).collect()
}

/// Runs a program for its exit status alone; fails with the last thing it said.
fn run(words: &[String], timeout_seconds: f64, watch: &Watch<'_>) -> Result<(), String> {
    let program = Program { words, timeout_seconds, heard: false };
    let output = program.run(watch).map_err(|error| error.to_string())?;
    if output.status.success() {
        return Ok(());
    }
    // Programs often end their complaint with an empty line.
    let last = output.last.lines().map(str::trim).rfind(|line| !line.is_empty());
    Err(last.map_or_else(|| output.status.to_string(), str::to_owned))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    fn probe(words: &[String]) -> Result<Option<String>, String> {
        super::probe(words, 60.0, &Watch::silent())
    }

    fn words(words: &[&str]) -> Vec<String> {
        words.iter().map(|&word| word.to_owned()).collect()
    }

    #[test]
    fn a_program_that_ends_well_is_there() {
        assert_eq!(probe(&words(&["true"])), Ok(None));
        let why = probe(&words(&["sh", "-c", "echo no robot >&2; echo >&2; exit 3"])).unwrap_err();
        assert_eq!(why, "no robot");
        assert!(probe(&words(&["false"])).unwrap_err().contains("exit status: 1"));
        assert!(probe(&words(&["no-such-program"])).unwrap_err().contains("cannot be started"));
    }

    #[test]
    fn every_python_that_was_tried_is_named() {
        // Whatever interpreters there are, none of them has this.
        let why = probe(&words(&[PLACE, "no-such-file.py"])).unwrap_err();
        for python in pythons() {
            assert!(why.contains(&format!("`{python}`: ")), "{why}");
        }
        assert_eq!(with_python(&words(&["x", "{python} -c"]), "py"), words(&["x", "py -c"]));
    }
}
