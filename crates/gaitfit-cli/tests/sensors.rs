//! Fits of walking logs that hold what an IMU measures.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use crate::common;

use common::{errors, json, root, run};
use std::path::Path;

/// Walks of the robot of `truth.toml`, begun anywhere in a walk; `more` are arguments of `collect`.
fn walks(folder: &Path, seed: &str, more: &[&str]) -> Vec<String> {
    let out = folder.join(format!("logs-{seed}"));
    let out = out.to_str().unwrap();
    let mut args = vec![
        "collect",
        "assets/go2-walk.safetensors",
        "--theta",
        "examples/go2-ground/truth.toml",
        "--out",
        out,
    ];
    args.extend(["--trajectories", "10", "--log-shift", "0.3", "1.5", "--seed", seed]);
    if !more.contains(&"--seconds") {
        args.extend(["--seconds", "2"]);
    }
    args.extend(more);
    let output = run(&args);
    assert_eq!(output.status.code(), Some(0), "{}", errors(&output));
    vec![out.to_owned()]
}

fn config(folder: &Path, logs: &[String], validate: &[String], more: &str) -> String {
    let path = folder.join("walk.toml");
    let text = format!(
        "name = \"walk\"\nbase = \"free\"\npolicy = \"assets/go2-walk.safetensors\"\nlogs = {logs:?}\n\
         validate = {validate:?}\ncosts = [\"matchr1\"]\nruns = \"{}\"\n{more}\n[[parameter]]\nkind = \"frictionloss\"\n\
         [[parameter]]\nkind = \"armature\"\n[[parameter]]\nkind = \"delay\"\nper = \"all\"\nupper = 0.02\n\
         [optimizer]\ngenerations = 150\npopulation = 20\nseeds = 1\n[simulation]\npreset = \"fast\"\n",
        folder.display()
    );
    std::fs::write(&path, text).unwrap();
    path.display().to_string()
}

#[test]
fn joints_and_imu_show_friction_and_inertia_anywhere_in_a_walk() {
    let folder = tempfile::tempdir().unwrap();
    let logs = walks(folder.path(), "1", &[]);
    let others = walks(folder.path(), "2", &[]);
    let path = config(folder.path(), &logs, &others, "");
    let output = run(&["adapt", &path, "--json", "--set", "optimizer.replicates=1"]);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{}", errors(&output));
    let report = json(&output);
    let truth: toml::Table =
        toml::from_str(&std::fs::read_to_string(root().join("examples/go2-ground/truth.toml")).unwrap())
            .unwrap();
    for one in truth["parameter"].as_array().unwrap() {
        let (name, value) = (one["name"].as_str().unwrap(), one["value"].as_float().unwrap());
        let parameters = report["parameters"].as_array().unwrap();
        let fitted =
            parameters.iter().find(|other| other["name"] == name).unwrap()["value"].as_f64().unwrap();
        assert!((fitted / value - 1.0).abs() < 0.1, "{name}: {fitted} for {value}");
    }
    // The cost on other logs is that of predictions too: less than a fifth of the nominal robot's.
    let after = report["fitted"]["cost_validation"].as_f64().unwrap();
    assert!(after < 0.2 * report["baselines"][0]["cost_validation"].as_f64().unwrap(), "{report}");
    let theta = folder.path().join("walk/theta.toml");
    let validated = json(&run(&["validate", theta.to_str().unwrap(), &others[0], "--json"]));
    assert_eq!(validated["cost"], report["fitted"]["cost_validation"]);
}

#[test]
#[ignore = "takes long: `.ci/run long` runs it"]
fn long_simulated_logs_correct_what_a_long_step_and_torque_noise_make_of_a_fit() {
    let folder = tempfile::tempdir().unwrap();
    let noise = ["--torque-noise", "2.5", "--seconds", "3"];
    let logs = walks(folder.path(), "1", &noise);
    // The robot's step is half of the fit's.
    let path = config(folder.path(), &logs, &[], "");
    let step = ["--set", "simulation.timestep=0.01", "--set", "simulation.robot_timestep=0.005"];
    let fitted = |more: &[&str]| {
        let output = run(&[&["adapt", path.as_str(), "--json"], step.as_slice(), more].concat());
        assert!(matches!(output.status.code(), Some(0 | 3)), "{}", errors(&output));
        json(&output)
    };
    let report = fitted(&[]);
    let truth = std::fs::read_to_string(root().join("examples/go2-ground/truth.toml")).unwrap();
    let truth: toml::Table = toml::from_str(&truth).unwrap();
    let off = |key: &str| -> f64 {
        let errors = truth["parameter"].as_array().unwrap().iter().map(|one| {
            let parameters = report["parameters"].as_array().unwrap();
            let fitted = parameters.iter().find(|other| other["name"] == one["name"].as_str().unwrap());
            (fitted.unwrap()[key].as_f64().unwrap() / one["value"].as_float().unwrap() - 1.0).abs()
        });
        errors.sum()
    };
    assert!(off("value") < 0.6 * off("uncorrected"), "{} of {}", off("value"), off("uncorrected"));
    let correction = &report["fits"][0]["correction"];
    let torque_noise = correction["torque_noise"].as_f64().unwrap();
    assert!((torque_noise - 2.5).abs() < 0.4, "{torque_noise}");
    let said = report["warnings"].as_array().unwrap().iter().any(|one| {
        let text = one.as_str().unwrap();
        text.contains("corrected by 8 sets of logs") && text.contains("N·m")
    });
    assert!(said, "{}", report["warnings"]);
    // theta.toml has the corrected values; the cost beside them is theirs, and above that of the values found.
    let theta = std::fs::read_to_string(folder.path().join("walk/theta.toml")).unwrap();
    let theta: toml::Table = toml::from_str(&theta).unwrap();
    assert_eq!(theta["parameter"][0]["value"].as_float(), report["parameters"][0]["value"].as_f64());
    let (cost, before) = (report["cost"].as_f64(), report["fits"][0]["runs"][0]["best_cost"].as_f64());
    assert!(cost.unwrap() > before.unwrap() && theta["cost"].as_float() == cost, "{cost:?} {before:?}");
    // Without simulated logs the values are those found.
    let plain = fitted(&["--set", "optimizer.replicates=0"]);
    assert!(plain["fits"][0].get("correction").is_none());
    for (plain, corrected) in
        plain["parameters"].as_array().unwrap().iter().zip(report["parameters"].as_array().unwrap())
    {
        assert_eq!(plain["value"], corrected["uncorrected"]);
    }
}

#[test]
fn logs_without_an_imu_and_settings_that_cannot_be_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let logs = walks(folder.path(), "3", &[]);
    for log in gaitfit_log::csv_files(Path::new(&logs[0])).unwrap() {
        let whole = gaitfit_log::read_csv(&log, &gaitfit_log::ReadOptions::default()).unwrap();
        gaitfit_log::write_csv(&log, &gaitfit_log::Trajectory { base: None, ..whole }).unwrap();
    }
    let path = config(folder.path(), &logs, &[], "");
    let output = run(&["adapt", &path]);
    assert_ne!(output.status.code(), Some(0));
    let message = errors(&output);
    assert!(
        message.contains("matchr1 needs what an IMU measures") && message.contains("wx, wy, wz"),
        "{message}"
    );
    assert!(message.contains("logs-3"), "{message}");
    for (set, wanted) in [
        ("number=[{ kind = \"torque_noise\" }]", "torque_noise"),
        ("simulation.robot_timestep=-1", "robot_timestep"),
        ("simulation.robot_timestep=0.5", "robot_timestep"),
        ("simulation.robot_timestep=nan", "robot_timestep"),
        ("costs=[\"matchr0\"]", "matchr0"),
        ("optimizer.replicates=101", "replicates"),
        ("optimizer.replicates=-1", "replicates"),
    ] {
        let output = run(&["adapt", &path, "--set", set]);
        assert!(matches!(output.status.code(), Some(1 | 2)), "{set}: {:?}", output.status);
        assert!(errors(&output).contains(wanted), "{set}: {}", errors(&output));
    }
}

/// The policy walks by encoders that are off, on legs that are heavier than the file says.
#[test]
#[ignore = "takes long: `.ci/run long` runs it"]
fn long_offsets_of_encoders_and_masses_of_links_are_found_in_walks() {
    let folder = tempfile::tempdir().unwrap();
    let truth = folder.path().join("truth.toml");
    let offsets = [("FL_thigh", 0.03), ("RR_calf", -0.04), ("FR_hip", 0.02)];
    let mut text = "format = 2\n".to_owned();
    let mut say = |kind: &str, joints: &str, value: f64| {
        text.push_str(&format!(
            "[[parameter]]\nname = \"{kind} {joints}\"\nkind = \"{kind}\"\njoints = [\"{joints}\"]\nvalue = {value:?}\n"
        ));
    };
    say("frictionloss", "*", 0.15);
    say("link_mass", "*_calf*", 1.4);
    offsets.iter().for_each(|(joint, value)| say("encoder_bias", &format!("{joint}*"), *value));
    std::fs::write(&truth, text).unwrap();
    let logs = folder.path().join("logs");
    let collected = run(&[
        "collect",
        "assets/go2-robust.safetensors",
        "--theta",
        truth.to_str().unwrap(),
        "--out",
        logs.to_str().unwrap(),
        "--trajectories",
        "8",
        "--seconds",
        "2",
    ]);
    assert_eq!(collected.status.code(), Some(0), "{}", errors(&collected));
    let path = folder.path().join("offsets.toml");
    let text = format!(
        "name = \"offsets\"\nbase = \"free\"\npolicy = \"assets/go2-robust.safetensors\"\nlogs = [{:?}]\n\
         costs = [\"matchr1\"]\nruns = {:?}\n[[parameter]]\nkind = \"frictionloss\"\nper = \"all\"\n[[parameter]]\n\
         kind = \"link_mass\"\njoints = [\"*_calf*\"]\n[[parameter]]\nkind = \"encoder_bias\"\nper = \"joint\"\n\
         [optimizer]\nseeds = 1\n[simulation]\npreset = \"fast\"\n[truth]\nlink_mass_calf = 1.4\n",
        logs.display(),
        folder.path().display()
    );
    std::fs::write(&path, text).unwrap();
    let output = run(&["adapt", path.to_str().unwrap(), "--json"]);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{}", errors(&output));
    let report = json(&output);
    let parameters = report["parameters"].as_array().unwrap();
    // One friction, one mass and twelve encoders.
    assert_eq!(parameters.len(), 14);
    for one in parameters {
        let (name, value) = (one["name"].as_str().unwrap(), one["value"].as_f64().unwrap());
        // Three encoders have an offset. The others must come out at 0.
        let (wanted, within) = match name.strip_prefix("encoder_bias_") {
            Some(joint) => (offsets.iter().find(|(own, _)| *own == joint).map_or(0.0, |one| one.1), 1e-3),
            None if name == "link_mass_calf" => (1.4, 0.02),
            None => (0.15, 0.01),
        };
        assert!((value - wanted).abs() < within, "{name}: {value} and not {wanted}");
    }
    let mass = parameters.iter().find(|one| one["name"] == "link_mass_calf").unwrap();
    assert_eq!(mass["truth"], 1.4);
    let told = run(&["sensitivity", path.to_str().unwrap(), "--json"]);
    assert_eq!(told.status.code(), Some(0), "{}", errors(&told));
    assert!(json(&told)["parameters"].as_array().unwrap().iter().all(|one| one["told"] == true));
}

/// A tilted, late unit with a biased gyro, and slow sensors of velocity change what the policy does, so whole walks show
/// them. The logs alone show them too; with `swings = true` those estimates are priors.
#[test]
#[ignore = "takes long: `.ci/run long` runs it"]
fn long_errors_of_sensors_are_found_in_walks() {
    let folder = tempfile::tempdir().unwrap();
    let truths = [
        ("imu_roll", 0.04, 0.012),
        ("imu_pitch", -0.03, 0.012),
        ("gyro_bias_x", 0.05, 0.03),
        ("gyro_bias_y", -0.04, 0.03),
        ("gyro_bias_z", 0.03, 0.03),
        ("velocity_lag", 0.006, 0.002),
        ("imu_delay", 0.012, 0.004),
    ];
    let (mut theta, mut fitted) = ("format = 2\n".to_owned(), String::new());
    for (kind, value, _) in truths {
        theta += &format!("[[parameter]]\nname = \"{kind}\"\nkind = \"{kind}\"\nvalue = {value}\n");
        fitted += &format!("[[number]]\nkind = \"{kind}\"\n");
    }
    let (truth, config) = (folder.path().join("truth.toml"), folder.path().join("walk.toml"));
    std::fs::write(&truth, theta).unwrap();
    let (truth, logs) = (truth.to_str().unwrap(), folder.path().join("logs"));
    let logs = logs.to_str().unwrap();
    let collect = ["collect", "assets/go2-walk.safetensors", "--theta", truth, "--out", logs, "--privileged"];
    let output = run(&[&collect[..], &["--trajectories", "8", "--seconds", "2", "--seed", "1"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", errors(&output));
    let text = format!(
        "name = \"walk\"\nbase = \"free\"\npolicy = \"assets/go2-walk.safetensors\"\nlogs = [{logs:?}]\ncosts = [\"wass\"]\n\
         parameter = []\nruns = \"{}\"\n{fitted}[optimizer]\nmethod = \"cma-es\"\npopulation = 16\ngenerations = 30\n\
         seeds = 1\n[simulation]\npreset = \"fast\"\nskip_seconds = 0.0\n",
        folder.path().display()
    );
    std::fs::write(&config, text).unwrap();
    let fit = |name: &str, more: &[&str]| {
        let name = format!("name={name}");
        let args = [&["adapt", config.to_str().unwrap(), "--json", "--set", &name][..], more].concat();
        let output = run(&args);
        assert!(matches!(output.status.code(), Some(0 | 3)), "{}", errors(&output));
        json(&output)
    };
    let off = |report: &serde_json::Value| -> Vec<f64> {
        let parameters = report["parameters"].as_array().unwrap();
        let apart = |(kind, truth, within): &(&str, f64, f64)| {
            let one = parameters.iter().find(|one| one["name"] == *kind).unwrap();
            (one["value"].as_f64().unwrap() - truth).abs() / within
        };
        truths.iter().map(apart).collect()
    };
    let report = fit("alone", &[]);
    assert!(off(&report).iter().all(|off| *off < 1.0), "{:?} {report}", off(&report));
    let cost = |one: &serde_json::Value| one["cost"].as_f64().unwrap();
    assert!(cost(&report["fitted"]) < 0.5 * cost(&report["baselines"][0]), "{report}");
    let tilts = |report: &serde_json::Value| {
        let doubts = report["doubts"].as_array().unwrap();
        doubts.iter().any(|one| one.to_string().contains("inertial unit is tilted"))
    };
    assert!(!tilts(&report), "what is fitted is no doubt: {}", report["doubts"]);
    // With the estimates from the logs alone as priors, few generations are enough.
    let short = ["--set", "swings=true", "--set", "optimizer.generations=3"];
    let report = fit("priors", &short);
    assert!(off(&report).iter().all(|off| *off < 0.5), "{:?} {report}", off(&report));
    let report = fit("without", &["--set", "number=[{ kind = \"base_mass\" }]", short[2], short[3]]);
    assert!(tilts(&report), "what is not fitted is a doubt: {}", report["doubts"]);
}
