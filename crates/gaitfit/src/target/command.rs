//! A robot that another program runs.

use super::PolicyFiles;
use super::probe::with_python;
use super::process::{ProcessError, Program};
use crate::Error;
use crate::evaluate::{Evaluation, Plan};
use crate::log_folder::check_recorded;
use crate::settings::TargetConfig;
use crate::watch::Watch;
use gaitfit_log::csv_files;
use gaitfit_model::escaped;
use std::path::Path;

/// Programs that record and measure, as lists of words with places to fill in.
pub struct Command {
    collect: Vec<String>,
    evaluate: Vec<String>,
    trajectories: usize,
    seconds: f64,
    timeout_seconds: f64,
}

/// Max number of characters of a wrong document, and of a program's words, that a message repeats.
const MAX_SHOWN: usize = 200;
const MAX_WORDS: usize = 1000;

impl Command {
    /// The programs of a target. `python`: what `{python}` is, where that is known already.
    ///
    /// # Errors
    /// In words: a place to fill in that there is not.
    pub fn new(target: &TargetConfig, python: Option<&str>) -> Result<Self, String> {
        let TargetConfig { probe, collect, evaluate, .. } = target;
        for (words, name, known) in [
            (probe, "probe", &["python"][..]),
            (collect, "collect", &COLLECT[..]),
            (evaluate, "evaluate", &EVALUATE[..]),
        ] {
            for word in words {
                // A misspelt place would reach the program as it is written.
                if let Some(unknown) = places(word).find(|place| !known.contains(place)) {
                    return Err(format!(
                        "`target.{name}` has {{{unknown}}}; there are {{{}}}",
                        known.join("}, {")
                    ));
                }
            }
        }
        if !collect.iter().any(|word| word.contains("{folder}")) {
            return Err(
                "`target.collect` has no {folder}: the program needs the folder for its logs".to_owned()
            );
        }
        let words =
            |words: &[String]| python.map_or_else(|| words.to_vec(), |python| with_python(words, python));
        Ok(Self {
            collect: words(collect),
            evaluate: words(evaluate),
            trajectories: target.trajectories,
            seconds: target.seconds,
            timeout_seconds: target.timeout_seconds,
        })
    }

    /// Refuses programs that are not installed: found now, not when a later round asks for them.
    ///
    /// # Errors
    /// As it says, by setting.
    pub fn check_programs(&self) -> Result<(), Error> {
        for (setting, words) in [("target.collect", &self.collect), ("target.evaluate", &self.evaluate)] {
            // A place in braces, such as {python}, is filled later.
            let missing = words.first().is_some_and(|program| !program.contains('{') && !installed(program));
            if missing {
                let problem = "cannot be started: there is no such program; is it installed and on the path?";
                return Err(Error::Missing(program_error(setting, words, problem.to_owned()).to_string()));
            }
        }
        Ok(())
    }

    /// Has the program record logs of the policy into `folder`.
    ///
    /// # Errors
    /// A program that cannot be run, fails or writes no log.
    pub fn collect(
        &self,
        policy: &PolicyFiles,
        seed: u64,
        folder: &Path,
        watch: &Watch<'_>,
    ) -> Result<(), Error> {
        let words = fill(
            &self.collect,
            policy,
            &[
                ("folder", folder.display().to_string()),
                ("trajectories", self.trajectories.to_string()),
                ("seconds", self.seconds.to_string()),
                ("seed", seed.to_string()),
            ],
        );
        run(&words, "target.collect", self.timeout_seconds, watch)?;
        // The program is foreign: what it left is looked at before anything is read.
        let wrong = |problem: String| program_error("target.collect", &words, problem);
        check_recorded(folder).map_err(wrong)?;
        if csv_files(folder)?.is_empty() {
            return Err(wrong("it ended well and wrote no .csv into {folder}".to_owned()));
        }
        Ok(())
    }

    /// Has the program measure the policy, if there is one that does.
    ///
    /// # Errors
    /// A program that cannot be run, fails or prints something else.
    pub fn evaluate(
        &self,
        policy: &PolicyFiles,
        plan: &Plan,
        watch: &Watch<'_>,
    ) -> Result<Option<Evaluation>, Error> {
        if !self.measures() {
            return Ok(None);
        }
        let words = fill(
            &self.evaluate,
            policy,
            &[
                ("trajectories", plan.trajectories.to_string()),
                ("seconds", plan.seconds.to_string()),
                ("drift", plan.drift.to_string()),
                ("drift_speeds", speeds(plan.drift_speeds)),
                ("seed", plan.seed.to_string()),
            ],
        );
        let out = run(&words, "target.evaluate", self.timeout_seconds, watch)?;
        let mut evaluation: Evaluation = serde_json::from_slice(&out).map_err(|error| {
            // A character has up to four bytes.
            let start = String::from_utf8_lossy(&out[..out.len().min(4 * MAX_SHOWN)]);
            let problem = format!(
                "it printed no document such as `gaitfit evaluate --json` does: {error}. It begins: {}",
                escaped(start.trim_end(), MAX_SHOWN)
            );
            program_error("target.evaluate", &words, problem)
        })?;
        // The document may be any program's, so numbers that cannot be are refused.
        if let Some(wrong) = evaluation.wrong() {
            return Err(program_error("target.evaluate", &words, format!("{wrong}, which cannot be")));
        }
        // The program knows the policy by its file; the loop compares names.
        evaluation.policy = policy.name.clone();
        Ok(Some(evaluation))
    }

    /// Whether there is a program that measures.
    pub fn measures(&self) -> bool {
        !self.evaluate.is_empty()
    }

    /// The program.
    pub fn description(&self) -> String {
        // The program and its first words name the robot; later words are long paths.
        let words = self.collect.iter().take(3).take_while(|word| !word.contains('{'));
        format!("the robot of `{}`", words.cloned().collect::<Vec<_>>().join(" "))
    }
}

const COLLECT: [&str; 7] = ["python", "onnx", "policy", "folder", "trajectories", "seconds", "seed"];
const EVALUATE: [&str; 8] =
    ["python", "onnx", "policy", "trajectories", "seconds", "drift", "drift_speeds", "seed"];

/// Speeds of drift trials as a program is told them: `half` of its greatest commands, or three numbers.
fn speeds(speeds: Option<[f64; 3]>) -> String {
    speeds.map_or_else(|| "half".to_owned(), |[x, y, yaw]| format!("{x},{y},{yaw}"))
}

/// Names in braces; braces around anything else are left alone.
fn places(word: &str) -> impl Iterator<Item = &str> {
    // What stands before the first brace has no name.
    let inner = word.split('{').skip(1).filter_map(|rest| rest.split_once('}')).map(|(name, _)| name);
    inner.filter(|name| {
        !name.is_empty() && name.chars().all(|letter| letter.is_ascii_lowercase() || letter == '_')
    })
}

/// The words with values in the places of `{onnx}`, `{policy}` and the names of `values`.
fn fill(words: &[String], policy: &PolicyFiles, values: &[(&str, String)]) -> Vec<String> {
    let files =
        [("onnx", policy.onnx.display().to_string()), ("policy", policy.safetensors.display().to_string())];
    let all: Vec<&(&str, String)> = files.iter().chain(values).collect();
    words.iter().map(|word| filled(word, &all)).collect()
}

/// `word` with values in the places of names in braces. Braces within a value stay as they are: a path may have some.
fn filled(word: &str, values: &[&(&str, String)]) -> String {
    let (mut text, mut rest) = (String::with_capacity(word.len()), word);
    while let Some(at) = rest.find('{') {
        let (before, from) = rest.split_at(at);
        text.push_str(before);
        let known = values.iter().find_map(|(name, value)| {
            let after = from.strip_prefix('{')?.strip_prefix(name)?.strip_prefix('}')?;
            Some((value.as_str(), after))
        });
        // An unknown name keeps its brace; the search continues behind it. A brace is one byte.
        let (value, after) = known.unwrap_or_else(|| from.split_at(1));
        text.push_str(value);
        rest = after;
    }
    text + rest
}

/// Runs a program to its end and gives what it printed; its standard error is passed on.
fn run(
    words: &[String],
    setting: &'static str,
    timeout_seconds: f64,
    watch: &Watch<'_>,
) -> Result<Vec<u8>, Error> {
    let failed = |problem: String| program_error(setting, words, problem);
    let output = match (Program { words, timeout_seconds, heard: true }).run(watch) {
        Ok(output) => output,
        Err(ProcessError::Interrupted) => return Err(interrupted(setting)),
        Err(error) if error.is_missing() => {
            return Err(Error::Missing(failed(error.to_string()).to_string()));
        }
        Err(error) => return Err(failed(error.to_string())),
    };
    // A program that was asked to stop may have ended by itself just then.
    if watch.stop() {
        return Err(interrupted(setting));
    }
    if !output.status.success() {
        let said =
            if output.last.is_empty() { "it said nothing on standard error".to_owned() } else { output.last };
        return Err(failed(format!("{}. {said}", output.status)));
    }
    Ok(output.out)
}

/// Whether there is a program of that name or path; where the system looks for others too, it is not known.
fn installed(program: &str) -> bool {
    if cfg!(not(unix)) {
        return true;
    }
    if program.contains('/') {
        return Path::new(program).exists();
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).any(|place| place.join(program).is_file())
}

fn interrupted(setting: &str) -> Error {
    let message = format!("interrupted in {setting}; --resume runs it again");
    Error::interrupted_with_nothing(message)
}

fn program_error(setting: &'static str, words: &[String], problem: String) -> Error {
    Error::Program { setting, command: escaped(&words.join(" "), MAX_WORDS), problem }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn braces_within_a_value_stay() {
        let values = [("policy", "/runs/{seed}/walk".to_owned()), ("seed", "7".to_owned())];
        let all: Vec<&(&str, String)> = values.iter().collect();
        assert_eq!(filled("{policy}", &all), "/runs/{seed}/walk");
        assert_eq!(filled("--seed={seed},{seed}{other}{", &all), "--seed=7,7{other}{");
    }
}
