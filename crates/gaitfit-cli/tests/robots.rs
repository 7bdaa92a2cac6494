//! Fits of walking logs by distributions, corrected by simulated robots.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use crate::common;

use common::{errors, json, root, run};
use serde_json::Value;
use std::path::Path;

/// Walks of the robot of `truth.toml`, and a search of three generations, which ends far from it.
fn config(folder: &Path) -> String {
    let logs = folder.join("logs");
    let output = run(&[
        "collect",
        "assets/go2-walk.safetensors",
        "--theta",
        "examples/go2-ground/truth.toml",
        "--out",
        logs.to_str().unwrap(),
        "--trajectories",
        "8",
        "--seconds",
        "3",
        "--log-shift",
        "0.02",
        "0.1",
        "--seed",
        "1",
    ]);
    assert_eq!(output.status.code(), Some(0), "{}", errors(&output));
    let path = folder.join("walk.toml");
    let text = format!(
        "base = \"free\"\npolicy = \"assets/go2-walk.safetensors\"\nlogs = [{logs:?}]\ncosts = [\"wass\"]\nruns = \"{}\"\n\
         [[parameter]]\nkind = \"frictionloss\"\n[[parameter]]\nkind = \"armature\"\n[[parameter]]\nkind = \"delay\"\n\
         per = \"all\"\nupper = 0.02\n[optimizer]\ngenerations = 3\nseeds = 1\nreplicates = 2\n[simulation]\npreset = \"fast\"\n",
        folder.display()
    );
    std::fs::write(&path, text).unwrap();
    path.display().to_string()
}

fn fitted(path: &str, more: &[&str]) -> Value {
    let output = run(&[&["adapt", path, "--json", "--device", "cpu"], more].concat());
    assert!(matches!(output.status.code(), Some(0 | 3)), "{}", errors(&output));
    json(&output)
}

/// Distance of armatures from the truth, kg·m², of the values under `key`.
fn off(report: &Value, key: &str) -> f64 {
    let truth = std::fs::read_to_string(root().join("examples/go2-ground/truth.toml")).unwrap();
    let truth: toml::Table = toml::from_str(&truth).unwrap();
    let known = truth["parameter"].as_array().unwrap().iter();
    let armatures = known.filter(|one| one["kind"].as_str() == Some("armature"));
    let errors = armatures.map(|one| {
        let parameters = report["parameters"].as_array().unwrap();
        let fitted = parameters.iter().find(|other| other["name"] == one["name"].as_str().unwrap()).unwrap();
        (fitted[key].as_f64().unwrap() - one["value"].as_float().unwrap()).abs()
    });
    errors.sum()
}

#[test]
#[ignore = "takes long: `.ci/run long` runs it"]
fn long_simulated_robots_correct_a_search_that_ended_early_and_the_same_after_a_kill() {
    let folder = tempfile::tempdir().unwrap();
    let path = config(folder.path());
    let report = fitted(&path, &["--name", "one", "--threads", "1"]);
    assert!(off(&report, "value") < 0.5 * off(&report, "uncorrected"), "{report}");
    let regression = &report["fits"][0]["regression"];
    let rounds = regression["rounds"].as_array().unwrap().len();
    assert!((3..=6).contains(&rounds), "{rounds}");
    // 40 robots a round, 24 with each of the two sets of values, and 48 with errors.
    let robots = 40 * rounds as u64 + 96;
    assert_eq!(regression["robots"].as_u64(), Some(robots));
    for parameter in report["parameters"].as_array().unwrap() {
        assert_eq!(parameter["identification"]["noise"], "robots", "{parameter}");
        let [low, high] = [0, 1].map(|end| parameter["interval"][end].as_f64().unwrap());
        let value = parameter["value"].as_f64().unwrap();
        assert!(low <= value && value <= high && low < high, "{parameter}");
    }
    let said =
        |report: &Value| report["warnings"].to_string().contains(&format!("{robots} simulated robots"));
    assert!(said(&report), "{}", report["warnings"]);
    // As if it had been killed after the search.
    std::fs::remove_file(folder.path().join("one/result.json")).unwrap();
    let resumed = fitted(&path, &["--name", "one", "--threads", "3", "--resume"]);
    for key in ["parameters", "fits", "cost"] {
        let plain = |report: &Value| report[key].clone();
        assert_eq!(plain(&report), plain(&resumed), "{key}");
    }
    // Without robots the values are those found, with the cost's own intervals.
    let plain = fitted(&path, &["--name", "plain", "--set", "optimizer.replicates=0"]);
    assert!(plain["fits"][0].get("regression").is_none() && !said(&plain));
    let both = plain["parameters"].as_array().unwrap().iter().zip(report["parameters"].as_array().unwrap());
    for (plain, corrected) in both {
        assert_eq!(plain["value"], corrected["uncorrected"]);
        assert_eq!(plain["identification"]["noise"], "recordings");
    }
}
