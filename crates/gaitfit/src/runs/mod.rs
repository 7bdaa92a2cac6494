//! Lists of run folders with their results, to compare at a glance.

#[cfg(feature = "report")]
mod page;

#[cfg(feature = "report")]
pub use page::page;

use crate::{Error, files};
use gaitfit_view::Doubt;
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use std::path::Path;

/// Max folders that are looked into.
const MAX_FOLDERS: usize = 10_000;

/// Kind of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// A fit.
    Fit,
    /// A training, from nothing or of a policy.
    Train,
    /// A loop.
    Loop,
    /// Something else, or a run without a result whose command does not say.
    Other,
}

impl Kind {
    /// As a table shows it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fit => "fit",
            Self::Train => "train",
            Self::Loop => "loop",
            Self::Other => "–",
        }
    }
}

/// A fitted parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Fitted {
    /// Its name.
    pub name: String,
    /// Its value, in `unit`.
    pub value: f64,
    /// Its 95 % interval, if it has one.
    pub interval: Option<[f64; 2]>,
    /// The unit.
    pub unit: String,
}

/// One run folder.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Run {
    /// The folder.
    pub folder: String,
    /// What it computed.
    pub kind: Kind,
    /// When it began, in UTC.
    pub begun: String,
    /// Whether it has a result; without one it was interrupted or is still running.
    pub done: bool,
    /// How long it took, s.
    pub wall_seconds: Option<f64>,
    /// The robot's name.
    pub robot: Option<String>,
    /// The cost and its value of the robot before the fit and of the fitted one.
    pub cost: Option<(String, f64, f64)>,
    /// Fitted parameters; of a loop those of its last round.
    pub parameters: Vec<Fitted>,
    /// Linear-velocity error, m/s: of the policy before (loops alone) and after.
    pub linear_velocity_error: [Option<f64>; 2],
    /// The result in one sentence.
    pub summary: String,
}

/// The runs in `folder`, in the order in which they began; `folder` may be a run folder itself.
///
/// # Errors
/// A folder that cannot be read. A damaged run is listed, with what is wrong with it.
pub fn list(folder: &Path) -> Result<Vec<Run>, Error> {
    // `gaitfit runs RUN` shows one run.
    if is_run(folder) {
        return Ok(vec![read(folder)]);
    }
    if !folder.exists() {
        return Err(Error::settings(format!(
            "{}: there is no such folder, so nothing has run here yet; `gaitfit fit`, `train`, `finetune` and `loop` write runs. \
             If they are elsewhere, name their folder: gaitfit runs FOLDER",
            folder.display()
        )));
    }
    let unreadable = |source| Error::unreadable(folder, source);
    let mut runs = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)?.take(MAX_FOLDERS) {
        let path = entry.map_err(unreadable)?.path();
        if is_run(&path) {
            runs.push(read(&path));
        }
    }
    // Times in RFC 3339 and in UTC sort as text. A damaged run has none and comes first.
    runs.sort_by(|a, b| a.begun.cmp(&b.begun).then_with(|| a.folder.cmp(&b.folder)));
    Ok(runs)
}

fn is_run(folder: &Path) -> bool {
    folder.join("manifest.json").is_file()
}

/// A JSON file of a run; in words, what is wrong with it.
fn json(path: &Path) -> Result<Value, String> {
    let text = files::read_text(path, files::MAX_BYTES)
        .map_err(|error| format!("cannot read {}: {error}", path.display()))?;
    serde_json::from_str(&text).map_err(|error| format!("{} is damaged: {error}", path.display()))
}

fn read(folder: &Path) -> Run {
    let mut run = Run {
        folder: folder.display().to_string(),
        kind: Kind::Other,
        begun: String::new(),
        done: false,
        wall_seconds: None,
        robot: None,
        cost: None,
        parameters: Vec::new(),
        linear_velocity_error: [None, None],
        summary: String::new(),
    };
    // The manifest is written first, so it tells kind and time even of a run without a result.
    match json(&folder.join("manifest.json")) {
        Ok(manifest) => {
            run.begun = text(&manifest["begun"]).unwrap_or_default();
            run.kind = asked(&manifest["command"]);
        }
        Err(problem) => {
            run.summary = problem;
            return run;
        }
    }
    let path = folder.join("result.json");
    if !path.is_file() {
        run.summary = "no result: interrupted or still running".to_owned();
        return run;
    }
    match json(&path) {
        Ok(result) => result_of(&result["results"], &mut run),
        Err(problem) => run.summary = problem,
    }
    run
}

/// Kind of run that a command line asks for.
fn asked(command: &Value) -> Kind {
    let words = command.as_array().into_iter().flatten().filter_map(Value::as_str);
    words
        // The first word is the program, which may have any name.
        .skip(1)
        .find_map(|word| match word {
            "fit" | "adapt" => Some(Kind::Fit),
            "train" | "finetune" => Some(Kind::Train),
            "loop" => Some(Kind::Loop),
            _ => None,
        })
        .unwrap_or(Kind::Other)
}

fn result_of(results: &Value, run: &mut Run) {
    run.done = true;
    run.robot = text(&results["robot"]);
    run.wall_seconds = results["wall_seconds"].as_f64();
    // Results say by their fields what they are. A loop's hold a fit's, so the loop is asked for first.
    if let Some(rounds) = results["rounds"].as_array() {
        run.kind = Kind::Loop;
        if let Some(round) = rounds.last() {
            fitted(&round["adapt"], run);
        }
        walked(results, run);
    } else if results["environments"].is_number() {
        run.kind = Kind::Train;
        trained(results, run);
    } else if results["cost_name"].is_string() {
        run.kind = Kind::Fit;
        fitted(results, run);
        run.summary = fit_summary(results, run);
    } else {
        run.summary = "a result of another kind".to_owned();
    }
}

/// First how firmly the fit stands, then how much smaller the cost became, and whether the search converged.
fn fit_summary(results: &Value, run: &Run) -> String {
    let change = match &run.cost {
        // A cost of 0 has no factor.
        Some((_, before, after)) if *after > 0.0 && after < before => {
            format!("cost {:.1} times smaller", before / after)
        }
        Some((_, before, after)) if after >= before => "no closer than the robot file".to_owned(),
        _ => "fitted".to_owned(),
    };
    let state = match results["converged"].as_bool() {
        Some(true) => ", converged",
        Some(false) => ", not converged",
        None => "",
    };
    let standing = match refused(&results["doubts"]) {
        // A table has little room.
        Some(refusal) => format!("{}; ", refusal.replacen(" this fit", "", 1)),
        None => match results["standing"].as_str() {
            Some("contradicted") => "contradicted by other walks; ".to_owned(),
            Some("doubtful") => "doubtful; ".to_owned(),
            _ => String::new(),
        },
    };
    format!("{standing}{change}{state}")
}

/// Why a fit with these doubts must not be used. Doubts of another version are not read.
fn refused(doubts: &Value) -> Option<String> {
    let doubts: Vec<Doubt> = serde_json::from_value(doubts.clone()).ok()?;
    crate::adapt::refusal(&doubts)
}

fn fitted(results: &Value, run: &mut Run) {
    let numbers = (text(&results["cost_name"]), results["nominal_cost"].as_f64(), results["cost"].as_f64());
    if let (Some(name), Some(before), Some(after)) = numbers {
        run.cost = Some((name, before, after));
    }
    run.parameters = results["parameters"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(|one| {
            // JSON has no numbers that are not finite; they are null.
            let end = |at: usize| one["interval"][at].as_f64();
            Some(Fitted {
                name: text(&one["name"])?,
                value: one["value"].as_f64()?,
                interval: end(0).zip(end(1)).map(|(low, high)| [low, high]),
                unit: text(&one["unit"]).unwrap_or_default(),
            })
        })
        .collect();
}

/// Errors of a loop's policies where they were measured: on the target, or else in the fitted simulator.
fn walked(results: &Value, run: &mut Run) {
    let evaluations: Vec<&Value> = results["evaluations"].as_array().into_iter().flatten().collect();
    // The robot itself counts more than any simulator.
    let place = match evaluations.iter().any(|one| one["on"] == "target") {
        true => Some("target"),
        false => evaluations.last().and_then(|one| one["on"].as_str()),
    };
    let error = |policy: &Value| {
        let evaluation =
            evaluations.iter().find(|one| one["policy"] == *policy && one["on"].as_str() == place)?;
        evaluation["linear_velocity_error"]["mean"].as_f64()
    };
    run.linear_velocity_error = [error(&results["before"]), error(&results["after"])];
    run.summary = match run.linear_velocity_error {
        [Some(before), Some(after)] => {
            let place = match place {
                Some("target") => "on the robot",
                _ => "in the fitted simulator",
            };
            format!("velocity error {before:.3} → {after:.3} m/s {place}")
        }
        _ => text(&results["stopped_because"]).unwrap_or_default(),
    };
}

fn trained(results: &Value, run: &mut Run) {
    let seeds: Vec<&Value> = results["seeds"].as_array().into_iter().flatten().collect();
    let mean = |key: &str| {
        let values: Vec<f64> = seeds.iter().filter_map(|seed| seed[key].as_f64()).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    };
    run.linear_velocity_error[1] = mean("linear_velocity_error");
    if let Some(error) = run.linear_velocity_error[1] {
        run.summary = format!("velocity error {error:.3} m/s");
    }
    if let Some(falls) = mean("fall_rate") {
        let _ = write!(run.summary, ", falls {:.1} %", 100.0 * falls);
    }
    let _ = write!(run.summary, ", {} seed{}", seeds.len(), if seeds.len() == 1 { "" } else { "s" });
}

fn text(value: &Value) -> Option<String> {
    value.as_str().map(str::to_owned)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use serde_json::json;

    fn run(within: &Path, name: &str, begun: &str, command: &str, result: Option<Value>) {
        let folder = within.join(name);
        std::fs::create_dir_all(&folder).unwrap();
        let manifest = json!({ "begun": begun, "command": ["gaitfit", command, "a.toml"] });
        std::fs::write(folder.join("manifest.json"), manifest.to_string()).unwrap();
        if let Some(result) = result {
            let result = json!({ "inputs": {}, "results": result });
            std::fs::write(folder.join("result.json"), result.to_string()).unwrap();
        }
    }

    #[test]
    fn runs_are_listed_by_time_with_their_numbers() {
        let folder = tempfile::tempdir().unwrap();
        let fit = json!({
            "robot": "go2", "converged": false, "cost_name": "matcho", "cost": 0.1,
            "nominal_cost": 0.9, "wall_seconds": 12.5,
            "parameters": [{ "name": "delay", "value": 0.01, "unit": "s", "interval": [0.009, 0.011] }],
        });
        let evaluation = |on: &str, policy: &str, error: f64| json!({ "on": on, "policy": policy, "linear_velocity_error": { "mean": error } });
        let whole = json!({
            "robot": "go2", "rounds": [{ "adapt": fit.clone() }], "before": "π₀", "after": "π₁",
            "evaluations": [evaluation("target", "π₀", 0.25), evaluation("target", "π₁", 0.125),
                            evaluation("adapted", "π₁", 0.5)],
        });
        let training = json!({
            "robot": "go2", "environments": 4096,
            "seeds": [{ "linear_velocity_error": 0.2, "fall_rate": 0.01 },
                      { "linear_velocity_error": 0.3, "fall_rate": 0.03 }],
        });
        run(folder.path(), "b", "2026-01-02T00:00:00Z", "adapt", Some(fit));
        run(folder.path(), "a", "2026-01-03T00:00:00Z", "loop", Some(whole));
        run(folder.path(), "c", "2026-01-01T00:00:00Z", "train", Some(training));
        run(folder.path(), "d", "2026-01-04T00:00:00Z", "fit", None);
        std::fs::create_dir(folder.path().join("no-run")).unwrap();
        let runs = list(folder.path()).unwrap();
        let kinds: Vec<Kind> = runs.iter().map(|run| run.kind).collect();
        assert_eq!(kinds, [Kind::Train, Kind::Fit, Kind::Loop, Kind::Fit]);
        assert_eq!(runs[0].summary, "velocity error 0.250 m/s, falls 2.0 %, 2 seeds");
        assert_eq!(runs[1].cost, Some(("matcho".to_owned(), 0.9, 0.1)));
        assert_eq!(runs[1].summary, "cost 9.0 times smaller, not converged");
        assert_eq!(runs[1].parameters[0].interval, Some([0.009, 0.011]));
        assert_eq!(runs[2].linear_velocity_error, [Some(0.25), Some(0.125)]);
        assert!(runs[2].summary.ends_with("m/s on the robot"), "{}", runs[2].summary);
        assert!(!runs[3].done && runs[3].summary.contains("interrupted"), "{:?}", runs[3]);
        let one = list(&folder.path().join("b")).unwrap();
        assert_eq!(one, [runs[1].clone()]);
    }

    #[test]
    fn parameters_without_an_interval_are_listed() {
        let folder = tempfile::tempdir().unwrap();
        let parameter =
            |interval: Value| json!({ "name": "delay", "value": 0.01, "unit": "s", "interval": interval });
        let parameters = [json!(null), json!([null, 0.1]), json!([0.009, 0.011])].map(parameter);
        run(folder.path(), "a", "a", "fit", Some(json!({ "cost_name": "matcho", "parameters": parameters })));
        let runs = list(folder.path()).unwrap();
        let intervals: Vec<_> = runs[0].parameters.iter().map(|one| one.interval).collect();
        assert_eq!(intervals, [None, None, Some([0.009, 0.011])]);
    }

    #[test]
    fn what_must_not_be_used_is_stated_first() {
        let runs = tempfile::tempdir().unwrap();
        let fit = |standing: &str, doubts: Value| {
            json!({"cost_name": "matcho", "cost": 0.1, "nominal_cost": 0.2, "converged": true,
                "standing": standing, "doubts": doubts})
        };
        let misfit = json!([{"kind": "misfit", "text": "why"}]);
        let weak = json!([{"kind": "unexplained", "text": "why"}]);
        let all = [("a", "doubtful", misfit), ("b", "doubtful", weak), ("c", "sound", json!([]))];
        for (name, standing, doubts) in all {
            run(runs.path(), name, name, "fit", Some(fit(standing, doubts)));
        }
        let summaries: Vec<String> = list(runs.path()).unwrap().into_iter().map(|run| run.summary).collect();
        let plain = "cost 2.0 times smaller, converged";
        assert_eq!(
            summaries,
            [format!("do not use: misfit; {plain}"), format!("doubtful; {plain}"), plain.to_owned()]
        );
    }

    #[test]
    fn a_damaged_run_is_listed_with_its_fault() {
        let folder = tempfile::tempdir().unwrap();
        run(folder.path(), "a", "2026-01-01T00:00:00Z", "fit", None);
        std::fs::write(folder.path().join("a/result.json"), "{").unwrap();
        let runs = list(folder.path()).unwrap();
        assert!(!runs[0].done && runs[0].summary.contains("result.json is damaged"), "{:?}", runs[0]);
        let missing = list(&folder.path().join("none")).unwrap_err().to_string();
        assert!(missing.contains("none"), "{missing}");
    }
}
