//! `gaitfit reproduce`: the list, one cell run and resumed, and what it refuses.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, json, program, run, standing_policy};
use std::fs;
use std::path::Path;

/// Arguments of a tiny run of a table.
fn args(table: &str, folder: &Path, policy: &str, more: &[&str]) -> Vec<String> {
    let mut args = vec!["reproduce".to_owned(), table.to_owned(), "--json".to_owned()];
    let sets = [
        format!("policy={policy}"),
        format!("runs={}", folder.display()),
        "target.trajectories=8".to_owned(),
        "target.seconds=2.0".to_owned(),
        "adapt.simulation.timestep=0.01".to_owned(),
        "adapt.falls.margin_seconds=0.1".to_owned(),
        "adapt.optimizer.generations=2".to_owned(),
        "adapt.optimizer.population=4".to_owned(),
        "finetune.train={environments=8, iterations=1}".to_owned(),
        "finetune.ppo.critic_warmup=0".to_owned(),
        "evaluate.trajectories=8".to_owned(),
        "evaluate.seconds=0.5".to_owned(),
    ];
    args.extend(sets.into_iter().flat_map(|set| ["--set".to_owned(), set]));
    args.extend(more.iter().map(|&argument| argument.to_owned()));
    args
}

/// Asserts that the first rows of two results have the same errors, but for the last digit of what went through a file.
fn assert_same(a: &serde_json::Value, b: &serde_json::Value) {
    let errors =
        |result: &serde_json::Value| result["rows"][0]["errors_percent"].as_object().unwrap().clone();
    let (a, b) = (errors(a), errors(b));
    assert_eq!(a.len(), b.len());
    for (name, error) in &a {
        let difference = error["mean"].as_f64().unwrap() - b[name]["mean"].as_f64().unwrap();
        assert!(difference.abs() < 1e-9, "{name}: {error} and {}", b[name]);
    }
}

#[test]
fn the_list_needs_no_files() {
    let empty = tempfile::tempdir().unwrap();
    let output = program().current_dir(empty.path()).args(["reproduce", "list"]).output().unwrap();
    assert!(output.status.success(), "{}", errors(&output));
    let text = String::from_utf8(output.stdout).unwrap();
    for table in ["parameters", "noise", "model-shift", "spring"] {
        assert!(text.contains(table), "{text}");
    }
    let output = program().current_dir(empty.path()).args(["reproduce", "noise"]).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(errors(&output).contains("experiments/noise-1-fricarm-matchs.toml"), "{}", errors(&output));
}

#[test]
fn a_cell_of_each_kind_is_run_and_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let policy = standing_policy(folder.path()).display().to_string();
    let whole = args("parameters", folder.path(), &policy, &["--only", "*-fricarm-wass"]);
    let output = run(&whole);
    assert!(output.status.success(), "{}", errors(&output));
    let first = json(&output);
    let rows = first["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 1);
    assert_eq!(rows[0]["cell"], "model-shift-fricarm-wass");
    let percents = rows[0]["errors_percent"].as_object().unwrap();
    assert_eq!(percents.len(), 6);
    let mean = percents.values().map(|error| error["mean"].as_f64().unwrap()).sum::<f64>() / 6.0;
    assert!((rows[0]["mean_error_percent"]["mean"].as_f64().unwrap() - mean).abs() < 1e-9);
    assert!((rows[0]["paper"]["mean_error_percent"].as_f64().unwrap() - 4.18).abs() < 0.01);
    assert!(rows[0]["seconds"].as_f64().unwrap() > 0.0 && rows[0]["cost_value"]["mean"].is_number());
    let made = folder.path().join("reproduce-parameters");
    for file in ["table.txt", "plot.svg", "result.json", "shared/model-shift/seed-1/logs"] {
        assert!(made.join(file).exists(), "{file}");
    }
    let log = fs::read_to_string(made.join("shared/model-shift/seed-1/logs/trajectory_00.csv")).unwrap();
    assert!(log.contains("base_pos_x"), "other cells of the table need the base's state");

    // Finished, it is not made again; cut before its end, it comes to the same; another cell takes the same logs.
    let output = run(&whole);
    assert!(errors(&output).contains("finished earlier"), "{}", errors(&output));
    assert_same(&json(&output), &first);
    let cell = made.join("cells/model-shift-fricarm-wass/seed-1");
    fs::remove_file(cell.join("seed.json")).unwrap();
    fs::remove_file(cell.join("round-1/adapt/result.json")).unwrap();
    assert_same(&json(&run(&whole)), &first);
    let log = made.join("shared/model-shift/seed-1/logs/trajectory_00.csv");
    let written = fs::metadata(&log).unwrap().modified().unwrap();
    let output = run(&args("parameters", folder.path(), &policy, &["--only", "*-matchs1", "--seeds", "2"]));
    assert!(output.status.success(), "{}", errors(&output));
    let row = json(&output)["rows"][0].clone();
    assert_eq!(row["seeds"].as_array().unwrap().len(), 2);
    assert!(row["mean_error_percent"]["ci95"].is_number(), "two seeds have an interval");
    assert_eq!(fs::metadata(&log).unwrap().modified().unwrap(), written);

    // Cells at the same time are the same cells.
    fs::remove_dir_all(made.join("cells")).unwrap();
    let two = ["--only", "*-fricarm-{wass,matchs1}", "--jobs", "2"];
    let output = run(&args("parameters", folder.path(), &policy, &two));
    assert!(output.status.success(), "{}", errors(&output));
    assert_same(&json(&output), &first);
    assert_eq!(json(&output)["rows"][1]["cell"], "model-shift-fricarm-matchs1");
    assert!(
        errors(&output).contains("model-shift-fricarm-matchs1: [2/2] model-shift"),
        "{}",
        errors(&output)
    );

    // Other settings are refused by name.
    let changed = args("parameters", folder.path(), &policy, &["--set", "target.seconds=1.2"]);
    let output = run(&changed);
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
    assert!(errors(&output).contains("target.seconds"), "{}", errors(&output));

    // Fine-tuning: both references come with the cell.
    let output = run(&args("spring", folder.path(), &policy, &["--only", "spring-residact-wass"]));
    assert!(output.status.success(), "{}", errors(&output));
    let result = json(&output);
    let rows = result["rows"].as_array().unwrap();
    let names: Vec<&str> = rows.iter().map(|row| row["cell"].as_str().unwrap()).collect();
    assert_eq!(
        names,
        ["spring-pi0", "spring-reference", "spring-nominal", "spring-randomised", "spring-residact-wass"]
    );
    for row in rows {
        for number in ["reward", "linear_velocity_error", "angular_velocity_error", "fall_rate"] {
            assert!(row[number]["mean"].is_number() && row[number]["ci95"].is_number(), "{number}: {row}");
        }
    }
    let plot = fs::read_to_string(folder.path().join("reproduce-spring/plot.svg")).unwrap();
    assert!(plot.starts_with("<svg") && plot.contains("spring-residact-wass"));
}

#[test]
fn what_is_wrong_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let cases: [(&str, &[&str], &[&str]); 5] = [
        ("nois", &[], &["`nois`", "Did you mean `noise`?"]),
        ("noise", &["--only", "*-annealing"], &["*-annealing", "noise-5-fricarm-wass"]),
        ("noise", &["--set", "adapt.optimizer.generation=3"], &["generation", "`generations`"]),
        (
            "noise",
            &["--only", "*-1-*-wass"],
            &["experiments/noise-1-fricarm-wass.toml", "missing.safetensors"],
        ),
        ("spring", &["--set", "rounds=2"], &["experiments/spring-fricarm-wass.toml", "`rounds`"]),
    ];
    for (table, more, words) in cases {
        let output = run(&args(table, folder.path(), "missing.safetensors", more));
        assert_eq!(output.status.code(), Some(2), "{more:?}: {}", errors(&output));
        assert!(words.iter().all(|word| errors(&output).contains(word)), "{more:?}: {}", errors(&output));
    }
}
