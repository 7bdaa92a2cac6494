//! `gaitfit fit` on the demo: the document, the files, checks, and what must not change the result.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, json, quick_demo, root, run};
use serde_json::Value;
use std::path::Path;

fn adapt(runs: &Path, more: &[&str]) -> Value {
    let output = run(&quick_demo(runs, more));
    assert_eq!(output.status.code(), Some(0), "{}", errors(&output));
    json(&output)
}

#[test]
fn the_document_and_the_run_folder_are_complete() {
    let runs = tempfile::tempdir().unwrap();
    let report = adapt(runs.path(), &["--set", "costs=[\"matcho\", \"wass\"]"]);
    let parameters = report["parameters"].as_array().unwrap();
    assert_eq!(parameters.len(), 10);
    for parameter in parameters {
        let number = |key: &str| parameter[key].as_f64().unwrap();
        assert!(number("lower") <= number("value") && number("value") <= number("upper"), "{parameter}");
        assert!(parameter["name"].is_string() && parameter["unit"].is_string(), "{parameter}");
        assert!(parameter["at_bound"].is_boolean() && number("spread") >= 0.0, "{parameter}");
        let [lower, upper] = [0, 1].map(|end| parameter["interval"][end].as_f64().unwrap());
        assert!(lower <= number("value") && number("value") <= upper, "{parameter}");
        assert!(parameter["identified"].is_boolean() && parameter["truth"].is_f64(), "{parameter}");
    }
    let cost = report["cost"].as_f64().unwrap();
    let baselines = report["baselines"].as_array().unwrap();
    assert_eq!(baselines.len(), 3);
    assert!(baselines.iter().all(|baseline| baseline["cost"].as_f64().unwrap() > cost), "{report}");
    let validation = &report["validation"][0];
    assert_eq!(validation["file"], "examples/go2-demo/validate.csv");
    let per_joint = validation["rmse_per_joint"].as_object().unwrap();
    assert_eq!(per_joint.len(), 12);
    let square: f64 = per_joint.values().map(|error| error.as_f64().unwrap().powi(2)).sum::<f64>() / 12.0;
    assert!((square.sqrt() - validation["rmse_rad"].as_f64().unwrap()).abs() < 1e-9);
    assert!(report["wall_seconds"].as_f64().unwrap() > 0.0);
    assert_eq!(report["fits"].as_array().unwrap().len(), 2);
    for key in ["parameters", "cost", "cost_name", "nominal_cost", "validation", "converged"] {
        assert_eq!(report[key], report["fits"][0][key], "what stands at the top is the first fit's: {key}");
    }
    let comparison = report["fits"][1]["comparison"].as_array().unwrap();
    assert_eq!(comparison.len(), 10);
    assert!(
        comparison.iter().all(|one| (one["agrees"] == false) == one["reason"].is_string()),
        "{comparison:?}"
    );

    let folder = runs.path().join("go2-demo");
    for file in
        ["config.toml", "manifest.json", "theta.toml", "validation.json", "result.json", "report.html"]
    {
        assert!(folder.join(file).metadata().unwrap().len() > 0, "{file}");
    }
    let metrics = std::fs::read_to_string(folder.join("metrics.jsonl")).unwrap();
    assert_eq!(metrics.lines().count(), 6 * 2 * 2, "generations × seeds × costs");
    let theta: toml::Table = std::fs::read_to_string(folder.join("theta.toml")).unwrap().parse().unwrap();
    let saved = theta["parameter"].as_array().unwrap();
    for (saved, parameter) in saved.iter().zip(parameters) {
        assert_eq!(saved["name"].as_str(), parameter["name"].as_str());
        assert_eq!(saved["value"].as_float(), parameter["value"].as_f64());
        assert_eq!(saved.get("identified").and_then(toml::Value::as_bool), parameter["identified"].as_bool());
        let ends =
            |end: usize| saved.get("interval").and_then(|ends| ends.get(end)).and_then(toml::Value::as_float);
        assert_eq!(ends(1), parameter["interval"][1].as_f64());
    }
    let resolved: toml::Table = std::fs::read_to_string(folder.join("config.toml")).unwrap().parse().unwrap();
    assert_eq!(resolved["parameter"][1]["deviation"].as_float(), Some(0.05), "defaults are written out");
    // The resolved configuration gives the same fit.
    let resolved = folder.join("config.toml");
    let output = run(&["adapt", resolved.to_str().unwrap(), "--json"]);
    assert_eq!(json(&output)["parameters"], report["parameters"], "{}", errors(&output));
    assert!(runs.path().join("go2-demo-2").is_dir(), "a new run takes a new folder");
}

#[test]
fn threads_do_not_change_the_result_and_seeds_do() {
    let runs = tempfile::tempdir().unwrap();
    let one = adapt(runs.path(), &["--threads", "1"]);
    let three = adapt(runs.path(), &["--threads", "3"]);
    assert_eq!(one["parameters"], three["parameters"]);
    assert_eq!(one["validation"], three["validation"]);
    let other = adapt(runs.path(), &["--set", "optimizer.seed=50"]);
    assert_ne!(one["parameters"], other["parameters"]);
}

#[test]
fn gains_of_validation_logs_can_be_stated() {
    let runs = tempfile::tempdir().unwrap();
    let own = adapt(runs.path(), &[]);
    let gains = "validate_gains=[{ files = [\"validate.csv\"], kp = 20, kd = 2 }]";
    // With gains that the robot did not have, a guess predicts the log better, which ends with 3.
    let output = run(&quick_demo(runs.path(), &["--set", gains]));
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    let stated = json(&output);
    assert!(errors(&output).contains("do not use this fit: worse than a guess"), "{}", errors(&output));
    assert_eq!(own["parameters"], stated["parameters"], "validation takes no part in the fit");
    assert_ne!(own["validation"][0]["rmse_rad"], stated["validation"][0]["rmse_rad"]);
}

#[test]
fn a_check_that_fails_ends_with_3_after_the_result() {
    let runs = tempfile::tempdir().unwrap();
    let output = run(&quick_demo(runs.path(), &["--set", "check.rmse_rad=1e-6"]));
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    assert_eq!(json(&output)["checks"][0]["passed"], false);
    assert!(errors(&output).contains("rmse_rad"), "{}", errors(&output));
}

#[test]
fn a_fit_without_the_delay_that_the_robot_has_ends_with_3_and_names_it() {
    let runs = tempfile::tempdir().unwrap();
    let three = "parameter=[{kind=\"frictionloss\",upper=1.5},{kind=\"armature\"},{kind=\"damping\"}]";
    let output = run(&quick_demo(runs.path(), &["--set", three, "--set", "truth={}"]));
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    let report = json(&output);
    assert!(report["headline"].as_str().unwrap().contains("kind \"delay\""), "{}", report["headline"]);
    let delay = &report["fits"][0]["leftover"]["suspect"]["values"][0];
    assert!((delay[1].as_f64().unwrap() - 0.007).abs() < 5e-4, "{delay}");
    assert!(runs.path().join("go2-demo/theta.toml").exists(), "everything is saved");
    assert!(errors(&output).contains("misfit. All results are in"), "{}", errors(&output));
}

#[test]
fn the_table_shows_value_truth_and_baselines() {
    let runs = tempfile::tempdir().unwrap();
    let args: Vec<String> =
        quick_demo(runs.path(), &[]).into_iter().filter(|argument| argument != "--json").collect();
    let output = run(&args);
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    for word in
        ["frictionloss_hip", "truth", "0.2100", "best pure delay", "echo of the target", "nominal model"]
    {
        assert!(text.contains(word), "`{word}` is not in:\n{text}");
    }
}

#[test]
#[ignore = "needs recordings of real robots and reference numbers in ../shared"]
fn long_shared_the_real_robots_logs_are_fitted() {
    let runs = tempfile::tempdir().unwrap();
    let set = format!("runs={}", runs.path().display());
    let mut args = vec!["adapt", "experiments/go2-air.toml", "--json", "--set", &set];
    for set in [
        "optimizer.generations=12",
        "optimizer.seeds=1",
        "optimizer.replicates=0",
        "logs=[\"../shared/data/go2_air/run_0.csv\"]",
    ] {
        args.extend(["--set", set]);
    }
    let output = run(&args);
    let report = json(&output);
    let rmse = |index: usize| report["validation"][index]["rmse_rad"].as_f64().unwrap();
    assert!(rmse(0) < 0.02 && rmse(1) < 0.02, "{}", report["validation"]);
    let delay = report["baselines"][2]["rmse_validation_rad"].as_f64().unwrap();
    assert!((delay - 0.0426).abs() < 0.001, "the data's own description says 0.0426, found {delay}");
}

#[test]
fn a_search_that_had_not_converged_says_so_first_and_fails_where_asked() {
    let runs = tempfile::tempdir().unwrap();
    let report = adapt(runs.path(), &[]);
    assert_eq!((&report["converged"], &report["better_than_nominal"]), (&false.into(), &true.into()));
    assert!(report["headline"].as_str().unwrap().starts_with("Not converged: "), "{}", report["headline"]);
    assert_eq!(report["fits"][0]["doubts"][0]["kind"], "not_converged");
    let page = std::fs::read_to_string(runs.path().join("go2-demo/report.html")).unwrap();
    assert!(page.contains("Not converged"), "the page says it too");

    let plain = |set: &str| {
        let args = quick_demo(runs.path(), &["--set", set]);
        run(&args.into_iter().filter(|argument| argument != "--json").collect::<Vec<_>>())
    };
    let output = plain("check.converged=true");
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    assert!(text.starts_with("Not converged: ") && text.contains("FAILED: not converged"), "{text}");
    assert!(errors(&output).contains("a check failed: not converged: "), "{}", errors(&output));
    assert!(!errors(&output).contains("Not converged"), "it says so twice: {}", errors(&output));
    let output = plain("check.better_than_nominal=true");
    assert_eq!(output.status.code(), Some(0), "{}", errors(&output));
}

#[test]
fn a_fit_that_is_no_better_than_the_nominal_robot_says_so_first() {
    let runs = tempfile::tempdir().unwrap();
    // Targets that reach the motors half a second late: any fit is worse than none.
    let wrong = "parameter=[{ kind = \"delay\", per = \"all\", lower = 0.5, upper = 0.6, start = 0.55 }]";
    let more = ["--set", wrong, "--set", "check.better_than_nominal=true", "--set", "truth={}"];
    let output = run(&quick_demo(runs.path(), &more));
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    let report = json(&output);
    assert_eq!(report["better_than_nominal"], false);
    assert!(report["cost"].as_f64().unwrap() > report["nominal_cost"].as_f64().unwrap());
    // A guess that needs no simulator is better too, which is worse still.
    let headline = report["headline"].as_str().unwrap();
    assert!(
        headline.starts_with("Worse than a guess") && headline.contains("Worse than the nominal robot"),
        "{headline}"
    );
    assert_eq!(
        (report["doubts"][0]["kind"].as_str(), report["standing"].as_str()),
        (Some("trivial"), Some("doubtful"))
    );
    assert_eq!(report["checks"][0]["passed"], false);
}

#[test]
#[ignore = "needs recordings of real robots and reference numbers in ../shared"]
fn shared_a_real_go2s_walks_are_explained_by_policy_and_logs_alone() {
    let folder = tempfile::tempdir().unwrap();
    let archive = root().join("../shared/data/go2_walk.tar.xz");
    let mut tar = std::process::Command::new("tar");
    assert!(tar.arg("xJf").arg(&archive).arg("-C").arg(folder.path()).status().unwrap().success());
    let logs = |trial: &str| -> Vec<String> {
        let entries = std::fs::read_dir(folder.path().join("go2_walk/real")).unwrap();
        let mut paths: Vec<String> = entries.map(|one| one.unwrap().path().display().to_string()).collect();
        paths.retain(|path| path.ends_with(&format!("{trial}.csv")));
        paths.sort();
        paths
    };
    let config = folder.path().join("real.toml");
    let policy = folder.path().join("go2_walk/rsl_flat_noise.toml");
    let text = format!(
        "policy = {policy:?}\nlogs = {:?}\nvalidate = {:?}\nruns = {:?}\n",
        // Every third walk: backwards, forwards, turning and sideways. Intervals take most of the time, in proportion to the
        // logs.
        logs("trial1").into_iter().step_by(3).collect::<Vec<_>>(),
        logs("trial2"),
        folder.path()
    );
    std::fs::write(&config, text).unwrap();
    // A hundredth of the default search, which ends at 0.06 to 0.09.
    // Simulated robots for the intervals would take as long again.
    let less = ["optimizer.generations=6", "simulation.starts=2", "optimizer.replicates=0"];
    let less = less.map(|set| ["--set", set]).concat();
    let output = run(&[&["adapt", config.to_str().unwrap(), "--json"], &less[..]].concat());
    let report = json(&output);
    let held = &report["held_out"];
    let (cost, nominal) = (held["cost"].as_f64().unwrap(), held["nominal_cost"].as_f64().unwrap());
    assert!(cost < 0.13 && nominal > 0.3 && held["falls"] == 0, "{cost} {nominal} {}", held["falls"]);
    let validation = report["validation"].as_array().unwrap();
    let nearer = |log: &&serde_json::Value| log["cost"].as_f64() < log["nominal_cost"].as_f64();
    assert_eq!(validation.iter().filter(nearer).count(), 12);
    assert_ne!(report["standing"], "contradicted");
}

#[test]
fn checks_of_costs_hold_or_fail() {
    let runs = tempfile::tempdir().unwrap();
    let report = adapt(runs.path(), &["--set", "check.cost=10", "--set", "check.validation_cost=10"]);
    let checks = report["checks"].as_array().unwrap();
    assert!(checks.len() == 2 && checks.iter().all(|check| check["passed"] == true), "{checks:?}");
    let output = run(&quick_demo(runs.path(), &["--set", "check.validation_cost=1e-6"]));
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
}

#[test]
fn what_is_known_of_a_clamped_robot_comes_before_what_is_fitted() {
    let runs = tempfile::tempdir().unwrap();
    let known = runs.path().join("known.toml");
    let text = |value: f64| {
        format!(
            "format = 2\nrobot = \"go2\"\ncost_name = \"none\"\n[[parameter]]\nname = \"damping\"\nkind = \"damping\"\n\
             joints = [\"FL_hip_joint\"]\nvalue = {value}\nunit = \"N·m·s/rad\"\n"
        )
    };
    std::fs::write(&known, text(0.0)).unwrap();
    let set = format!("known={}", known.display());
    let plain = adapt(runs.path(), &["--set", &set]);
    std::fs::write(&known, text(1.5)).unwrap();
    let damped = adapt(runs.path(), &["--set", &set]);
    assert_ne!(plain["nominal_cost"], damped["nominal_cost"], "the robot before the fit has what is known");
    assert_eq!(
        plain["parameters"], damped["parameters"],
        "what is fitted replaces what is known of the same kind"
    );
}

#[test]
fn settings_out_of_range_are_named_by_their_key() {
    let runs = tempfile::tempdir().unwrap();
    for (set, key) in [
        ("optimizer.seed=9223372036854775807", "`optimizer.seed`"),
        ("optimizer.seeds=[18446744073709551615]", "optimizer.seeds"),
        ("optimizer.seeds=18446744073709551615", "`optimizer.seeds`"),
        ("simulation.skip_seconds=1e300", "`simulation.skip_seconds`"),
        ("check.cost=-1", "`check.cost`"),
        ("check.validation_cost=nan", "`check.validation_cost`"),
    ] {
        let output = run(&quick_demo(runs.path(), &["--set", set]));
        assert_eq!(output.status.code(), Some(2), "{set}: {}", errors(&output));
        assert!(errors(&output).contains(key), "{set}: {}", errors(&output));
    }
}
