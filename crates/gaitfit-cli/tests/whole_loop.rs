//! `gaitfit loop`: what it leaves, resuming to the same bits, policies to compare with, and what it refuses.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::loops::{COMMAND, SIMULATED, args, begun};
use common::{errors, json, program, run};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

/// Everything that must not depend on when a loop was killed.
fn bits(run: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    for folder in ["policies", "evaluations", "round-1/logs", "round-1/adapt"] {
        for entry in fs::read_dir(run.join(folder)).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            let kept = folder != "round-1/adapt" || name == "theta.toml";
            if kept && !name.starts_with('.') {
                files.insert(format!("{folder}/{name}"), fs::read(&path).unwrap());
            }
        }
    }
    files
}

#[test]
#[ignore = "takes long: `.ci/run long` runs it"]
fn long_of_several_trainings_the_policy_that_follows_best_is_taken() {
    let whole = tempfile::tempdir().unwrap();
    let output = run(&args(whole.path(), SIMULATED, &["--set", "finetune.seeds=[2, 1, 3]"]));
    assert!(output.status.success(), "{}", errors(&output));
    let said = errors(&output);
    let note = said.lines().find(|line| line.contains("round-1/finetune: the policy of seed")).unwrap();
    let each: Vec<(f64, u64)> = (note.rsplit_once("added): ").unwrap().1.split(", "))
        .map(|one| one.strip_prefix("seed ").unwrap().split_once(' ').unwrap())
        .map(|(seed, error)| (error.parse().unwrap(), seed.parse().unwrap()))
        .collect();
    assert_eq!(each.iter().map(|(_, seed)| *seed).collect::<Vec<_>>(), [2, 1, 3]);
    let best = each.iter().min_by(|a, b| a.0.total_cmp(&b.0)).unwrap().1;
    assert_eq!(json(&output)["rounds"][0]["seed"], best);
    let folder = whole.path().join("l");
    let taken = fs::read(folder.join("policies/policy-1.safetensors")).unwrap();
    for (_, seed) in each {
        let own = fs::read(folder.join(format!("round-1/finetune/seed-{seed}/policy.safetensors"))).unwrap();
        assert_eq!(own == taken, seed == best, "seed {seed}");
    }
}

#[test]
fn a_loop_runs_through_and_ends_with_the_same_bits_wherever_it_was_cut() {
    let whole = tempfile::tempdir().unwrap();
    let output = run(&args(whole.path(), SIMULATED, &[]));
    assert!(output.status.success(), "{}", errors(&output));
    let result = json(&output);
    let folder = whole.path().join("l");
    for file in ["config.toml", "manifest.json", "report.html", "result.json", "target.toml"] {
        assert!(folder.join(file).exists(), "{file}");
    }
    let rows: Vec<(&str, &str)> = result["evaluations"]
        .as_array()
        .unwrap()
        .iter()
        .map(|row| (row["policy"].as_str().unwrap(), row["on"].as_str().unwrap()))
        .collect();
    let wanted = [
        ("π₀", "target"),
        ("π₁", "target"),
        ("π₀", "adapted"),
        ("π₁", "adapted"),
        ("fine-tuned on the target", "target"),
    ];
    assert_eq!(rows, wanted);
    let parameters = result["rounds"][0]["adapt"]["fits"][0]["parameters"].as_array().unwrap();
    let hip = parameters.iter().find(|one| one["name"] == "frictionloss_hip").unwrap();
    assert_eq!(hip["truth"], 0.2, "a simulated target's truth is known");
    let undisturbed = bits(&folder);
    assert!(undisturbed["policies/policy-0.safetensors"] != undisturbed["policies/policy-1.safetensors"]);
    assert_eq!(undisturbed.keys().filter(|name| name.starts_with("round-1/logs/")).count(), 6);

    // The same loop cut after each stage: what comes later is not there yet, or is half written.
    fs::create_dir(folder.join("round-1/.writing-logs")).unwrap();
    let cuts: [&[&str]; 4] = [
        &["result.json", "report.html", "evaluations/reference-target.json"],
        &["reference", "policies/reference.onnx", "evaluations/policy-1-target.json"],
        &["round-1/finetune", "policies/policy-1.safetensors", "round-1/adapt/result.json"],
        &["round-1/logs", "round-1/adapt", "target.toml", "times.json", "evaluations"],
    ];
    for cut in cuts {
        for name in ["result.json"].iter().chain(cut) {
            let path = folder.join(name);
            let _ = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
        }
        let output = run(&args(whole.path(), SIMULATED, &["--resume"]));
        assert!(output.status.success(), "{}", errors(&output));
        assert!(bits(&folder) == undisturbed, "cut before {cut:?}, it ends elsewhere");
    }

    // Killed at some moments.
    let killed = tempfile::tempdir().unwrap();
    for milliseconds in [150, 400, 700] {
        let mut child = program()
            .args(args(killed.path(), SIMULATED, begun(killed.path())))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(milliseconds));
        child.kill().unwrap();
        child.wait().unwrap();
    }
    let output = run(&args(killed.path(), SIMULATED, begun(killed.path())));
    assert!(output.status.success(), "{}", errors(&output));
    assert!(bits(&killed.path().join("l")) == undisturbed, "a killed loop ends elsewhere");

    // Finished, it is reported again; a changed setting is refused by name.
    let output = run(&args(killed.path(), SIMULATED, &["--resume"]));
    assert!(errors(&output).contains("is finished"), "{}", errors(&output));
    let output = run(&args(killed.path(), SIMULATED, &["--resume", "--set", "evaluate.seed=9"]));
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
    assert!(errors(&output).contains("`evaluate.seed` was 0, now it is 9"), "{}", errors(&output));

    // A robot that another program runs: it hands out the logs, and one evaluation for all policies.
    let other = tempfile::tempdir().unwrap();
    // It says that robots diverged there.
    let mut measured: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.join("evaluations/policy-0-target.json")).unwrap()).unwrap();
    measured["diverged"] = 2.into();
    let measurement = other.path().join("measured.json");
    fs::write(&measurement, measured.to_string()).unwrap();
    let command = format!(
        "[target]\nkind = \"command\"\ncollect = [\"sh\", \"-c\", \"test -s {{onnx}} && cp {}/*.csv {{folder}}\"]\n\
         evaluate = [\"cat\", \"{}\"]\n",
        folder.join("round-1/logs").display(),
        measurement.display()
    );
    let output = run(&args(other.path(), &command, &[]));
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    assert!(
        errors(&output).contains("error: π₀ on target: 2 of 8 trajectories diverged"),
        "{}",
        errors(&output)
    );
    assert!(fs::read_to_string(other.path().join("l/report.html")).unwrap().contains("Diverged"));
    let again: Vec<String> = args(other.path(), &command, &["--resume"]);
    let output_in_words = run(&again.into_iter().filter(|one| one != "--json").collect::<Vec<_>>());
    let text = String::from_utf8(output_in_words.stdout).unwrap();
    assert!(text.starts_with("DIVERGED: before on target: 2 of 8 trajectories"), "{text}");
    assert_eq!(text.matches("diverged: their state").count(), 2, "once for each policy: {text}");
    let result = json(&output);
    assert!(result["warnings"][0].as_str().unwrap().starts_with("π₀ on target: 2 of 8"), "{result}");
    assert_eq!(result["evaluations"][0]["policy"], "π₀");
    assert_eq!(result["evaluations"][0]["reward"], result["evaluations"][1]["reward"]);

    // Logs alone: it ends in the adapted simulator, and says what to record next.
    let logs = format!("logs = [\"{}\"]\n", folder.join("round-1/logs").display());
    let alone = tempfile::tempdir().unwrap();
    let output = run(&args(alone.path(), &logs, &[]));
    assert!(output.status.success(), "{}", errors(&output));
    let result = json(&output);
    assert!(result["next"].as_str().unwrap().contains("policy-1.onnx"), "{}", result["next"]);
    assert_eq!(result["evaluations"].as_array().unwrap().len(), 2);
}

#[test]
#[ignore = "takes long: `.ci/run long` runs it"]
fn long_the_policy_is_compared_with_training_without_logs_and_chosen_by_other_trajectories() {
    let folder = tempfile::tempdir().unwrap();
    let sets = [
        "rounds=2",
        "improvement=0.0",
        "references=false",
        "controls.nominal=true",
        "controls.randomised=true",
        "target.trajectories=8",
    ];
    let more: Vec<&str> = sets.iter().flat_map(|set| ["--set", *set]).collect();
    let output = run(&args(folder.path(), SIMULATED, &more));
    assert!(output.status.success(), "{}", errors(&output));
    let result = json(&output);
    let folder = folder.path().join("l");
    let document = |name: &str| -> serde_json::Value {
        serde_json::from_slice(&fs::read(folder.join("evaluations").join(name)).unwrap()).unwrap()
    };
    // Chosen by other trajectories than those that are reported.
    let (choice, report) = (document("policy-1-choice.json"), document("policy-1-target.json"));
    assert_eq!((choice["seed"].as_u64(), report["seed"].as_u64()), (Some(1), Some(0)));
    assert_eq!(report["errors"].as_array().unwrap().len(), 8);
    let first = &result["evaluations"][0];
    assert!(first["policy"] == "π₀" && first.get("errors").is_none(), "single trajectories stand in files");

    // The same trajectories for all, pair by pair.
    let comparisons = result["comparisons"].as_array().unwrap();
    let against: Vec<&str> = comparisons.iter().map(|one| one["against"].as_str().unwrap()).collect();
    assert!(
        against.contains(&"π₀") && against.ends_with(&["fine-tuned, nominal", "fine-tuned, randomised"]),
        "{against:?}"
    );
    assert!(comparisons.iter().all(|one| one["paired"] == true && one["on"] == "target"), "{comparisons:?}");
    let difference = |file: &str| {
        let rows = document(file)["errors"].as_array().unwrap().clone();
        rows.iter().map(|row| row[0].as_f64().unwrap()).sum::<f64>() / rows.len() as f64
    };
    let after = if result["after"] == "π₁" { "policy-1-target.json" } else { "policy-2-target.json" };
    let wanted = difference(after) - difference("randomised-target.json");
    let mean = comparisons.last().unwrap()["linear_velocity_error"]["mean"].as_f64().unwrap();
    assert!((wanted - mean).abs() < 1e-9, "{wanted} {mean}");
    assert!(result["bought"].as_str().unwrap().contains("domain randomisation"), "{}", result["bought"]);

    // The randomised robots are those of the settings; the nominal ones have no fit.
    let settings = |control: &str| -> toml::Table {
        let file = folder.join(format!("controls/{control}/finetune.toml"));
        toml::from_str(&fs::read_to_string(file).unwrap()).unwrap()
    };
    let (nominal, randomised) = (settings("nominal"), settings("randomised"));
    let delay: toml::Value = vec![0.0, 0.02].into();
    assert_eq!(randomised["task"]["randomisation"]["delay"], delay);
    assert_eq!(randomised["torque_noise"].as_float(), Some(0.5));
    for control in [&nominal, &randomised] {
        assert!(control.get("theta").is_none(), "{control}");
    }
    assert!(nominal["task"].get("randomisation").is_none(), "{nominal}");
    let page = fs::read_to_string(folder.join("report.html")).unwrap();
    assert!(page.contains("fine-tuned, randomised") && page.contains("domain randomisation"));

    // Two of eight logs are held out.
    let round: toml::Table =
        toml::from_str(&fs::read_to_string(folder.join("round-1/adapt.toml")).unwrap()).unwrap();
    let named = |key: &str| round[key].as_array().unwrap().len();
    assert_eq!((named("logs"), named("validate")), (6, 2));
    assert_eq!(result["rounds"][0]["adapt"]["trajectories"], 6);
    assert_eq!(result["rounds"][0]["adapt"]["held_out"]["logs"], 2);
    assert!(page.contains("held-out logs"));
}

#[test]
fn wrong_settings_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let measuring = format!("{COMMAND}evaluate = [\"true\"]\n");
    for (target, set, words) in [
        (
            SIMULATED,
            "evaluate.drift_speeds=[1.0, -1.0, 0.1]",
            ["`evaluate.drift_speeds` has -1", "three speeds"],
        ),
        (&measuring, "evaluate.drift_speeds=[1.0, 1.0, 0.1]", ["`evaluate.drift_speeds`", "{drift_speeds}"]),
        ("", "rounds=1", ["`logs`", "[target]"]),
        (SIMULATED, "rounds=0", ["`rounds`", "1 to 100"]),
        (SIMULATED, "policy=missing.onnx", ["policy", "missing.onnx"]),
        (SIMULATED, "target.kind=real", ["real", "simulated"]),
        (SIMULATED, "target.parameter.0.joints=[\"*_wheel\"]", ["[target]", "*_wheel"]),
        (SIMULATED, "target.parameter.0.value=-1.0", ["[target]", "frictionloss"]),
        (SIMULATED, "target.spring=[\"wing=3\"]", ["[target] `spring`", "wing"]),
        (SIMULATED, "target.spring=[\"wing=1e300\"]", ["`spring`", "stiffness 1e300"]),
        (SIMULATED, "target.torque_noise=1e300", ["`target.torque_noise` is 1e300", "from 0 to 1000"]),
        (SIMULATED, "target.seconds=1e300", ["`target.seconds`", "at most 3600"]),
        (SIMULATED, "target.seed=18446744073709551615", ["`target.seed`", "18446744073709551615"]),
        (COMMAND, "target.timeout_seconds=0", ["`target.timeout_seconds`", "above 0"]),
        (SIMULATED, "target.trajektories=3", ["trajektories", "`trajectories`"]),
        (SIMULATED, "finetune.seeds=[]", ["`finetune.seeds`", "one or more"]),
        (SIMULATED, "adapt.costs=[]", ["[adapt]", "`costs`"]),
        (SIMULATED, "adapt.policy=x.onnx", ["adapt.policy", "the loop decides it"]),
        (SIMULATED, "held_out=1", ["`held_out`", "2 to 1000"]),
        (SIMULATED, "controls.delay=[0.0, 2.0]", ["`controls.delay`", "from 0 to 1"]),
        (SIMULATED, "controls.armature=[0.1, 0.0]", ["`controls.armature`", "[smallest, largest]"]),
        (SIMULATED, "controls.torque_noise=-1.0", ["`controls.torque_noise` is -1", "from 0 to 1000"]),
        (SIMULATED, "controls.draws=true", ["`controls.draws`", "matchr1"]),
        (SIMULATED, "controls.truth.theta=none.toml", ["controls.truth.theta", "none.toml"]),
        (SIMULATED, "controls.truth.thetta=none.toml", ["thetta", "`theta`"]),
        (SIMULATED, "finetune.task.randomisation.delay=[0.0, 0.9]", ["randomisation.delay", "at most 0.5"]),
        (SIMULATED, "evaluate.trajectories=0", ["`evaluate.trajectories`", "1 to"]),
        (SIMULATED, "finetune.ppo.gamma=nan", ["[finetune]", "`gamma` is NaN"]),
        (SIMULATED, "evaluate.seconds=1e-9", ["`evaluate.seconds` is 1e-9", "one control period"]),
        (SIMULATED, "target.seconds=1e-9", ["`target.seconds` is 1e-9", "at least one a trajectory"]),
        ("logs = [\"assets\"]\n", "rounds=2", ["`rounds`", "[target]"]),
        (SIMULATED, "target.collect=[\"true\"]", ["target.collect", "command"]),
        (SIMULATED, "target.probe=[\"true\"]", ["target.probe", "command"]),
        (COMMAND, "target.probe=[\"true\"]", ["target.probe", "`logs`"]),
    ] {
        let output = run(&args(folder.path(), target, &["--set", set]));
        assert_eq!(output.status.code(), Some(2), "{set}: {}", errors(&output));
        assert!(words.iter().all(|word| errors(&output).contains(word)), "{set}: {}", errors(&output));
    }
    let output = run(&args(folder.path(), SIMULATED, &["--set", "controls.truth.theta=Cargo.toml"]));
    assert!(!output.status.success() && errors(&output).contains("Cargo.toml"), "{}", errors(&output));
    let output = run(&args(folder.path(), SIMULATED, &["--device", "cuda:999"]));
    assert_eq!(output.status.code(), Some(4), "{}", errors(&output));
    assert!(!folder.path().join("l").exists(), "nothing is written before settings are right");
}

#[test]
fn a_robot_whose_numbers_are_known_shows_what_a_fit_could_do() {
    let folder = tempfile::tempdir().unwrap();
    let truth = folder.path().join("truth.toml");
    let number = |kind: &str, value: f64| {
        format!("[[parameter]]\nname = {kind:?}\nkind = {kind:?}\nvalue = {value}\nunit = \"-\"\n")
    };
    let numbers = [number("base_mass", 1.0), number("floor_friction", 0.8)].concat();
    let head = "format = 2\nrobot = \"go2\"\ncost_name = \"truth\"\ncost = 0.0\n";
    fs::write(&truth, format!("{head}{numbers}")).unwrap();
    let truth = format!("controls.truth.theta={:?}", truth.display().to_string());
    let sets = [
        "references=false",
        "controls.draws=true",
        "adapt.costs=[\"matchr1\"]",
        "adapt.optimizer.generations=2",
        truth.as_str(),
        "controls.truth.torque_noise=0.25",
    ];
    let more: Vec<&str> = sets.iter().flat_map(|set| ["--set", *set]).collect();
    let output = run(&args(folder.path(), SIMULATED, &more));
    assert!(output.status.success(), "{}", errors(&output));
    let result = json(&output);
    let against: Vec<&str> = result["comparisons"]
        .as_array()
        .unwrap()
        .iter()
        .map(|one| one["against"].as_str().unwrap())
        .collect();
    assert!(against.ends_with(&["fine-tuned, draws of the fit", "fine-tuned, known numbers"]), "{against:?}");
    let settings = |control: &str| -> toml::Table {
        let file = folder.path().join(format!("l/controls/{control}/finetune.toml"));
        toml::from_str(&fs::read_to_string(file).unwrap()).unwrap()
    };
    let (draws, known) = (settings("draws"), settings("truth"));
    assert_eq!(draws["randomise_theta"].as_bool(), Some(true));
    assert!(draws["theta"].as_str().unwrap().ends_with("round-1/adapt/theta.toml"), "{draws}");
    // What is known is not drawn at random.
    let draw = &known["task"]["randomisation"];
    assert_eq!(
        (&draw["base_mass"], &draw["floor_friction"]),
        (&vec![0.0, 0.0].into(), &vec![1.0, 1.0].into())
    );
    assert_eq!(known["torque_noise"].as_float(), Some(0.25));
    let page = fs::read_to_string(folder.path().join("l/report.html")).unwrap();
    assert!(page.contains("Training: fine-tuned, known numbers"), "no link");
}
