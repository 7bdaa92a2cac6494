//! `gaitfit validate`: a finished fit on other logs, clamped and walking.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, json, quick_demo, root, run};
use std::path::Path;

const LOG: &str = "examples/go2-demo/validate.csv";

#[test]
fn it_gives_the_numbers_of_the_fits_own_validation() {
    let runs = tempfile::tempdir().unwrap();
    let fitted = json(&run(&quick_demo(runs.path(), &[])));
    let theta = runs.path().join("go2-demo/theta.toml");
    let theta = theta.to_str().unwrap();
    let output = run(&["validate", theta, LOG, "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", errors(&output));
    let report = json(&output);
    assert_eq!(report["validation"], fitted["validation"]);
    assert_eq!(report["cost"], fitted["fitted"]["cost_validation"]);
    assert_eq!(report["rmse_rad"], fitted["fitted"]["rmse_validation_rad"]);
    assert_eq!(report["nominal_rmse_rad"], fitted["baselines"][0]["rmse_validation_rad"]);
    assert_eq!(report["better_than_nominal"], true);

    let output = run(&["validate", theta, LOG, "--set", "check.rmse_rad=1e-6"]);
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    assert!(text.contains(LOG) && text.contains("FAILED: rmse_rad"), "{text}");
}

#[test]
fn a_fit_without_its_configuration_and_logs_that_are_not_there_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let theta = folder.path().join("theta.toml");
    std::fs::write(&theta, "format = 2\nrobot = \"go2\"\ncost_name = \"matcho\"\n").unwrap();
    let theta = theta.to_str().unwrap();
    let output = run(&["validate", theta, LOG]);
    assert_eq!(output.status.code(), Some(2));
    assert!(errors(&output).contains("--config"), "{}", errors(&output));
    let config = ["--config", "examples/go2-demo/adapt.toml"];
    let output = run(&[&["validate", theta, "no-such.csv"], &config[..]].concat());
    assert_eq!(output.status.code(), Some(2));
    assert!(errors(&output).contains("no-such.csv"), "{}", errors(&output));
    // Nothing fitted: the robot before the fit.
    let output = run(&[&["validate", theta, LOG, "--json"], &config[..]].concat());
    let report = json(&output);
    assert_eq!(report["cost"], report["nominal_cost"]);
    assert_eq!(report["better_than_nominal"], false, "{}", errors(&output));
}

/// A quick fit of the walking logs of the example: some of them fitted, others to validate on. Narrow bounds keep it from
/// robots that fall.
fn walking(runs: &Path) -> (Vec<String>, Vec<String>) {
    let mut logs: Vec<String> = std::fs::read_dir(root().join("examples/go2-ground/logs"))
        .unwrap()
        .map(|entry| format!("examples/go2-ground/logs/{}", entry.unwrap().file_name().to_string_lossy()))
        .filter(|name| name.ends_with(".csv"))
        .collect();
    logs.sort();
    logs.truncate(18);
    let (fit, other) = logs.split_at(logs.len() / 2);
    let quoted = |logs: &[String]| format!("{logs:?}");
    let config = format!(
        "name = \"walk\"\nrobot = \"assets/go2.xml\"\nbase = \"free\"\npolicy = \"assets/go2-walk.safetensors\"\n\
         logs = {}\nvalidate = {}\ncosts = [\"wass\"]\nruns = \"{}\"\n[optimizer]\ngenerations = 2\nseeds = 1\n\
         population = 4\nreplicates = 0\n[simulation]\ntimestep = 0.01\npreset = \"fast\"\n\
         [[parameter]]\nkind = \"frictionloss\"\nupper = 0.05\n[[parameter]]\nkind = \"armature\"\nupper = 0.01\n",
        quoted(fit),
        quoted(other),
        runs.display()
    );
    let path = runs.join("walk.toml");
    std::fs::write(&path, config).unwrap();
    (vec!["adapt".to_owned(), path.display().to_string(), "--json".to_owned()], other.to_vec())
}

#[test]
fn walking_logs_are_validated_too() {
    let runs = tempfile::tempdir().unwrap();
    let (args, other) = walking(runs.path());
    let output = run(&args);
    // Two generations explain little: a misfit, with all results saved.
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    assert!(errors(&output).contains("misfit"), "{}", errors(&output));
    let fitted = json(&output);
    let validation = fitted["validation"].as_array().unwrap();
    assert!(validation.len() > other.len() / 2, "{validation:?}");
    assert!(validation.iter().all(|log| log["cost"].is_f64() && log["rmse_rad"].is_null()), "{validation:?}");
    assert!(fitted["fitted"]["cost_validation"].is_f64());
    assert_eq!(
        fitted["baselines"].as_array().unwrap().len(),
        1,
        "no simulator repeats a walking robot's targets"
    );

    let held = &fitted["held_out"];
    assert!(
        held["logs"].as_u64().unwrap() > 8 && held["distances"].as_array().unwrap().len() == 36,
        "{held}"
    );
    let cost = |name: &str| held[name].as_f64().unwrap();
    let same = cost("cost") / fitted["fitted"]["cost_validation"].as_f64().unwrap();
    assert!((same - 1.0).abs() < 1e-4, "the same walks: {same}");
    assert!(cost("nominal_cost") > 0.0 && held["floor"]["mean"].as_f64().unwrap() > 0.0);
    let floor = |name: &str| held["floor"][name].as_f64().unwrap();
    assert!(floor("cost") > floor("mean") + floor("range95"), "two generations explain little: {held}");

    let theta = runs.path().join("walk/theta.toml");
    let mut args = vec!["validate".to_owned(), theta.display().to_string(), "--json".to_owned()];
    args.extend(other);
    let output = run(&args);
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    let report = json(&output);
    assert_eq!(&report["validation"], &fitted["validation"]);
    assert_eq!(report["cost"], fitted["held_out"]["cost"], "of all simulations");
    assert_eq!(report["held_out"], fitted["held_out"], "the same walks");
    let output = run(&args[..args.len()].iter().filter(|one| *one != "--json").collect::<Vec<_>>());
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(
        text.contains("RR_calf_joint") && text.contains("robot itself") && text.contains(" ± "),
        "{text}"
    );

    // Samples are compared one by one where a cost does so.
    args.extend(["--set".to_owned(), "costs=[\"matcho\"]".to_owned()]);
    let report = json(&run(&args));
    let validation = report["validation"].as_array().unwrap();
    assert!(
        validation.iter().any(|log| log["rmse_rad"].as_f64().is_some_and(|error| error > 0.0)),
        "{report}"
    );
}

/// What the demo's log can tell of its parameters, which is known there.
#[test]
fn a_log_says_which_parameters_it_can_tell() {
    let demo = ["sensitivity", "examples/go2-demo/adapt.toml"];
    let coarse = ["--set", "simulation.timestep=0.005"];
    let report = json(&run(&[&demo[..], &coarse, &["--json"]].concat()));
    let parameters = report["parameters"].as_array().unwrap();
    assert_eq!(parameters.len(), 10);
    for one in parameters {
        assert_eq!(one["told"], true, "{one}");
        let (all, alone) = (one["deviation"].as_f64().unwrap(), one["alone"].as_f64().unwrap());
        assert!(all >= alone && all < 0.1 * one["value"].as_f64().unwrap(), "{one}");
    }
    assert_eq!(parameters[0]["value"], 0.21, "the truth that the configuration states");
    // Twice the difference, twice the deviations.
    let difference = format!("{}", 2.0 * report["difference"].as_f64().unwrap());
    let twice = json(&run(&[&demo[..], &coarse, &["--json", "--difference", &difference]].concat()));
    let ratio =
        twice["parameters"][3]["deviation"].as_f64().unwrap() / parameters[3]["deviation"].as_f64().unwrap();
    assert!((ratio - 2.0).abs() < 1e-6, "{ratio}");
    let output = run(&[&demo[..], &coarse].concat());
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    assert!(text.contains("armature_calf") && text.contains("identified"), "{text}{}", errors(&output));
    let output = run(&[&demo[..], &["--set", "costs=[\"wass\"]"]].concat());
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
    let said = errors(&output);
    assert!(said.contains("`wass`") && said.contains("matcho") && !said.contains("CMA-ES"), "{said}");
    // Values that no search could find are named, not moved to the next bound.
    for (value, why) in [("7.5", "bounds"), ("nan", "finite")] {
        let set = format!("truth.frictionloss_hip={value}");
        let output = run(&[&demo[..], &coarse, &["--set", &set]].concat());
        assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
        let said = errors(&output).to_lowercase();
        assert!(said.contains("frictionloss_hip`") && said.contains(value) && said.contains(why), "{said}");
    }
    let output = run(&[&demo[..], &["--difference", "-1"]].concat());
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
    // A walk's log is no log of a clamped robot.
    let text = std::fs::read_to_string(common::root().join("examples/go2-demo/fit.csv")).unwrap();
    let row = |line: &str| match line.as_bytes().first() {
        Some(b'#') => format!("{line}\n"),
        Some(b't') => format!("{line},vx_cmd,vy_cmd,wz_cmd\n"),
        _ => format!("{line},0.5,0,0\n"),
    };
    let folder = tempfile::tempdir().unwrap();
    let walk = folder.path().join("walk.csv");
    std::fs::write(&walk, text.lines().map(row).collect::<String>()).unwrap();
    let report =
        json(&run(&[&demo[..], &coarse, &["--json", "--set", &format!("logs=[{walk:?}]")]].concat()));
    let warnings = report["warnings"].to_string();
    assert!(
        warnings.contains("walk.csv: the log has commands") && warnings.contains("add base = "),
        "{warnings}"
    );
}
