//! Runs as a page that compares them.

use super::{Kind, Run};
use crate::{Error, files, machine};
use gaitfit_view::runs::{Curve, Fit, Parameter, Run as Shown, RunsReport, Training};
use gaitfit_view::runs_html;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Learning curves: the key of `metrics.jsonl`, what a chart calls it, and its unit.
const CURVES: [(&str, &str, &str); 4] = [
    ("episode_return", "episode return", ""),
    ("linear_velocity_error", "linear velocity error", "m/s"),
    ("angular_velocity_error", "angular velocity error", "rad/s"),
    ("fall_rate", "falls", "share of episodes"),
];
/// Folders within a run in which a training's seeds may be: the run's own, and that of a loop's rounds.
const MAX_ROUNDS: usize = 100;
/// Seeds of a training that are read at most.
const MAX_SEEDS: usize = 100;

/// The page of `runs` in `folder`, to be written to `page`: links lead to reports that are beside or below it.
///
/// # Errors
/// A page that cannot be filled in. A metrics file that is damaged leaves its curves out.
pub fn page(folder: &Path, page: &Path, runs: &[Run]) -> Result<String, Error> {
    let report = RunsReport {
        title: folder.display().to_string(),
        created: machine::now(),
        runs: runs.iter().map(|run| shown(run, page)).collect(),
        fits: runs.iter().filter(|run| !run.parameters.is_empty()).map(fit).collect(),
        trainings: runs.iter().filter_map(training).collect(),
    };
    Ok(runs_html(&report)?)
}

/// A run's name: that of its folder.
fn name(run: &Run) -> String {
    let folder = Path::new(&run.folder);
    folder.file_name().unwrap_or(folder.as_os_str()).to_string_lossy().into_owned()
}

fn shown(run: &Run, page: &Path) -> Shown {
    Shown {
        name: name(run),
        report: relative(&Path::new(&run.folder).join("report.html"), page).unwrap_or_default(),
        command: run.kind.name().to_owned(),
        begun: run.begun.get(..16).unwrap_or(&run.begun).replace('T', " "),
        wall_seconds: run.wall_seconds.unwrap_or(f64::NAN),
        robot: run.robot.clone().unwrap_or_default(),
        summary: run.summary.clone(),
    }
}

/// `file` as seen from the folder of `page`, if it is there and is in that folder or below.
fn relative(file: &Path, page: &Path) -> Option<String> {
    let folder = page.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // Both without links and `..`, so that one can be a prefix of the other.
    let (file, folder) = (file.canonicalize().ok()?, folder.canonicalize().ok()?);
    let parts = file.strip_prefix(folder).ok()?.iter();
    Some(parts.map(|part| part.to_string_lossy()).collect::<Vec<_>>().join("/"))
}

fn fit(run: &Run) -> Fit {
    let (cost_name, before, after) = run.cost.clone().unwrap_or((String::new(), f64::NAN, f64::NAN));
    let parameter = |one: &super::Fitted| Parameter {
        name: one.name.clone(),
        // Results write `-` for a number without a unit.
        unit: if one.unit == "-" { String::new() } else { one.unit.clone() },
        value: one.value,
        interval: one.interval,
    };
    let parameters = run.parameters.iter().map(parameter).collect();
    Fit { name: name(run), cost_name, cost: vec![before, after], parameters }
}

/// The learning curves of a training, or of a loop's last round; `None` without any.
fn training(run: &Run) -> Option<Training> {
    let folder = Path::new(&run.folder);
    let places: Vec<PathBuf> = match run.kind {
        Kind::Train => vec![folder.to_owned()],
        Kind::Loop => (1..=MAX_ROUNDS)
            .map(|round| folder.join(format!("round-{round}/finetune")))
            .take_while(|place| place.is_dir())
            .collect(),
        Kind::Fit | Kind::Other => Vec::new(),
    };
    let place = places.last()?;
    let mut seeds: Vec<PathBuf> = std::fs::read_dir(place)
        .ok()?
        .filter_map(|entry| Some(entry.ok()?.path().join("metrics.jsonl")))
        .filter(|file| file.is_file())
        .collect();
    // The sums of f64 below depend on the order, and a folder lists its files in any.
    seeds.sort();
    seeds.truncate(MAX_SEEDS);
    let metrics: Vec<Vec<Value>> = seeds.iter().map(|file| lines(file)).collect();
    let curve = |(key, name, unit): (&str, &str, &str)| {
        // Sum and number of the seeds that have a value there.
        let mut sums: BTreeMap<u64, (f64, f64)> = BTreeMap::new();
        for line in metrics.iter().flatten() {
            if let (Some(iteration), Some(value)) = (line["iteration"].as_u64(), line[key].as_f64()) {
                let (sum, count) = sums.entry(iteration).or_default();
                (*sum, *count) = (*sum + value, *count + 1.0);
            }
        }
        Curve {
            name: name.to_owned(),
            unit: unit.to_owned(),
            iteration: sums.keys().map(|&iteration| iteration as f64).collect(),
            value: sums.values().map(|(sum, count)| sum / count).collect(),
        }
    };
    let curves: Vec<Curve> = CURVES.into_iter().map(curve).filter(|curve| !curve.value.is_empty()).collect();
    (!curves.is_empty()).then(|| Training { name: name(run), curves })
}

/// The lines of a metrics file that can be read; the last one of a run that still writes may be cut.
fn lines(file: &Path) -> Vec<Value> {
    let text = files::read_text(file, files::MAX_BYTES).unwrap_or_default();
    text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::runs::list;
    use serde_json::json;
    use std::fs;

    #[test]
    fn fits_stand_side_by_side_and_trainings_share_charts() {
        let folder = tempfile::tempdir().unwrap();
        let run = |name: &str, begun: &str, results: Value| {
            let place = folder.path().join(name);
            fs::create_dir_all(&place).unwrap();
            let manifest = json!({ "begun": begun, "command": ["gaitfit"] });
            fs::write(place.join("manifest.json"), manifest.to_string()).unwrap();
            fs::write(place.join("result.json"), json!({ "results": results }).to_string()).unwrap();
            place
        };
        for (name, friction) in [("one", 0.25), ("two", 0.5)] {
            let fit = json!({
                "robot": "go2", "cost_name": "wass", "cost": 0.0625, "nominal_cost": 0.75,
                "parameters": [{ "name": "friction", "value": friction, "unit": "N·m",
                                 "interval": [friction - 0.03, friction + 0.04] }],
            });
            let place = run(name, "2026-01-01T00:00:00Z", fit);
            fs::write(place.join("report.html"), "x").unwrap();
        }
        for (name, error) in [("slow", 0.4), ("fast", 0.2)] {
            let place = run(name, "2026-01-02T00:00:00Z", json!({ "environments": 8, "seeds": [] }));
            for seed in [1, 2] {
                fs::create_dir_all(place.join(format!("seed-{seed}"))).unwrap();
                let line = |iteration: u32| {
                    json!({ "iteration": iteration, "linear_velocity_error": error + 0.1 * f64::from(seed) })
                        .to_string()
                };
                let text = format!("{}\n{}\n{{\"cut", line(1), line(2));
                fs::write(place.join(format!("seed-{seed}/metrics.jsonl")), text).unwrap();
            }
        }
        let runs = list(folder.path()).unwrap();
        let html = page(folder.path(), &folder.path().join("all.html"), &runs).unwrap();
        for shown in [
            "0.250 ± 0.040",
            "0.500 ± 0.040",
            "wass 0.750 → 0.0625",
            "href=\"one&#x2f;report.html\"",
            "differ",
        ] {
            assert!(html.contains(shown), "{shown}");
        }
        assert_eq!(html.matches("linear velocity error over iterations").count(), 1, "one chart for both");
        let drawn = training(runs.iter().find(|run| run.folder.ends_with("fast")).unwrap()).unwrap();
        assert_eq!(drawn.curves[0].iteration, [1.0, 2.0]);
        assert!((drawn.curves[0].value[0] - 0.35).abs() < 1e-12, "the mean of two seeds: {drawn:?}");
        let elsewhere = tempfile::tempdir().unwrap();
        let html = page(folder.path(), &elsewhere.path().join("all.html"), &runs).unwrap();
        assert!(!html.contains("href=\"one"), "a report that is not below the page has no link");
    }
}
