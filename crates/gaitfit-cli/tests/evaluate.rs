//! `gaitfit evaluate`: what it prints and writes for a policy that only stands.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, json, run};
use gaitfit_policy::network::{Activation, Network, Shape};
use gaitfit_policy_files::weights;
use std::path::Path;

const FOREIGN: &str = "crates/gaitfit-policy-files/tests/fixtures/policies/foreign.toml";

/// A policy that counts as trained here: for others that do not walk, other orders of the joints are tried, which takes long.
fn trained() -> gaitfit_policy::Policy {
    let mut policy = gaitfit_policy_files::read(&common::root().join(FOREIGN)).unwrap();
    policy.provenance.iteration = 1;
    policy
}

/// A policy of zeros: it holds the default pose.
fn standing(folder: &Path) -> String {
    let mut policy = trained();
    policy.actor.parameters.fill(0.0);
    let path = folder.join("standing.safetensors");
    std::fs::write(&path, weights::write(&policy).unwrap()).unwrap();
    path.display().to_string()
}

#[test]
fn a_standing_policy_neither_falls_nor_follows() {
    let folder = tempfile::tempdir().unwrap();
    let policy = standing(folder.path());
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (page, replay) = (path("page.html"), path("replay.html"));
    let shared = ["evaluate", &policy, "--trajectories", "8", "--seconds", "1", "--json"];
    let measure_with = |drift: &'static str, more: &[&str]| {
        let args: Vec<&str> = shared.iter().chain(&["--drift", drift]).chain(more).copied().collect();
        let output = run(&args);
        assert!(output.status.success(), "{}", errors(&output));
        let mut document = json(&output);
        assert!(document.as_object_mut().unwrap().remove("wall_seconds").unwrap().as_f64().unwrap() > 0.0);
        document
    };
    let measure = |more: &[&str]| measure_with("0", more);
    let evaluation = measure_with("2", &["--threads", "1", "--report", &page, "--replay", &replay]);
    assert_eq!(evaluation["trajectories"], 8);
    assert_eq!(evaluation["fall_rate"]["mean"], 0.0);
    for key in ["reward", "linear_velocity_error", "angular_velocity_error", "fall_rate"] {
        assert!(
            evaluation[key]["mean"].is_f64() && evaluation[key]["ci95"].as_f64().unwrap() > 0.0,
            "{key}: {evaluation}"
        );
    }
    // Commands of ±1 m/s along two axes: 0.765 m/s on average.
    let error = evaluation["linear_velocity_error"]["mean"].as_f64().unwrap();
    assert!((0.4..1.1).contains(&error), "{error}");
    let drift = evaluation["drift"].as_array().unwrap();
    assert_eq!(drift.len(), 7);
    for trial in drift {
        // It settles by centimetres.
        for (axis, key) in ["x", "y", "yaw"].into_iter().enumerate() {
            let wanted = -4.0 * trial["command"][axis].as_f64().unwrap();
            let mean = trial[key]["mean"].as_f64().unwrap();
            assert!((mean - wanted).abs() < 0.05, "{}, {key}: {mean}, not {wanted}", trial["name"]);
        }
    }
    assert_eq!(evaluation["gait"]["step_frequency"], 0.0);
    for file in [&page, &replay] {
        let html = std::fs::read_to_string(file).unwrap();
        assert!(html.trim_start().to_lowercase().starts_with("<!doctype html>"), "{file}");
    }
    assert_eq!(measure_with("2", &["--threads", "2"]), evaluation, "threads change results");
    assert!(measure(&["--seed", "7"])["reward"] != evaluation["reward"]);
    // A spring that is stiffer than the motors bends the leg it is on.
    let sprung = measure(&["--spring", "RR_calf_joint=75@-2.2"]);
    assert!(sprung["gait"]["torque"].as_f64().unwrap() > evaluation["gait"]["torque"].as_f64().unwrap());
    assert!(sprung["simulator"].as_str().unwrap().contains("spring 75"), "{sprung}");
}

/// Weights so large that the actions are no numbers.
#[test]
fn robots_that_diverge_are_said_first_and_end_with_3() {
    let folder = tempfile::tempdir().unwrap();
    let mut policy = trained();
    // The greatest number, its square, which is infinite, and that times 0.
    let shape = Shape { inputs: 45, hidden: vec![1, 1], outputs: 12, activation: Activation::Relu };
    let mut parameters = vec![0.0; shape.parameters()];
    (parameters[45], parameters[46]) = (f32::MAX, f32::MAX);
    policy.actor = Network::new(shape, &parameters).unwrap();
    let path = folder.path().join("wild.safetensors");
    std::fs::write(&path, weights::write(&policy).unwrap()).unwrap();
    let page = folder.path().join("page.html").display().to_string();
    let shared =
        ["evaluate", path.to_str().unwrap(), "--trajectories", "4", "--seconds", "0.2", "--drift", "2"];
    let output = run(&shared.iter().copied().chain(["--report", &page]).collect::<Vec<_>>());
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    assert!(errors(&output).contains("4 of 4 trajectories and 14 robots of the drift trials diverged"));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.starts_with("DIVERGED: 4 of 4") && text.contains("100.00 ±"), "{text}");
    assert!(text.contains("DOES NOT WALK: 100.00 % of the trajectories end in a fall or diverge"), "{text}");
    assert!(!text.contains("NaN"), "{text}");
    assert!(std::fs::read_to_string(&page).unwrap().contains("Diverged"));
    let output = run(&shared.iter().copied().chain(["--json"]).collect::<Vec<_>>());
    assert_eq!(output.status.code(), Some(3));
    let evaluation = json(&output);
    assert_eq!((&evaluation["diverged"], &evaluation["fall_rate"]["mean"]), (&4.into(), &1.0.into()));
    assert!(evaluation["verdict"].as_str().unwrap().contains("diverge"), "{evaluation}");
    for key in ["reward", "linear_velocity_error", "action_rate"] {
        assert!(
            evaluation[key]["mean"].is_null() && evaluation[key]["ci95"].is_null(),
            "{key}: {evaluation}"
        );
    }
}

#[test]
fn a_policy_that_stands_on_joints_in_a_wrong_order_is_put_right() {
    let folder = tempfile::tempdir().unwrap();
    let mut policy = gaitfit_policy_files::read(&common::root().join("assets/go2-walk.safetensors")).unwrap();
    // As a policy that was trained elsewhere, its joints named breadth first. Its robots hardly fall and go nowhere.
    policy.provenance = Default::default();
    let own = policy.interface.joints.clone();
    let breadth = [0, 3, 6, 9, 1, 4, 7, 10, 2, 5, 8, 11];
    policy.interface.joints = breadth.map(|joint| own[joint].clone()).to_vec();
    let path = folder.path().join("walk.safetensors");
    std::fs::write(&path, weights::write(&policy).unwrap()).unwrap();
    let output =
        run(&["evaluate", path.to_str().unwrap(), "--trajectories", "16", "--seconds", "3", "--json"]);
    let evaluation = json(&output);
    assert!(evaluation["fall_rate"]["mean"].as_f64().unwrap() < 0.5, "{evaluation}");
    let setting = evaluation["diagnosis"]["settings"][0].as_str().unwrap();
    let listed: Vec<String> = own.iter().map(|name| format!("{name:?}")).collect();
    assert!(setting.starts_with(&format!("`joints = [{}]`", listed.join(", "))), "{setting}");
}

#[test]
fn what_cannot_be_evaluated_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    let low = file("low.toml", "height = -1e300\n");
    let parameter = "[[parameter]]\nname = \"armature\"\nkind = \"armature\"\njoints = [\"FL_hip\"]\n";
    let wide = file("wide.toml", &format!("format = 2\n{parameter}value = 0.5\nlower = 0.0\nupper = 0.1\n"));
    let other = file(
        "other.toml",
        &format!("format = 2\nrobot = \"cat\"\n{parameter}value = 0.5\n").replace("hip", "tail"),
    );
    let page = file("page.html", "earlier");
    let dotted = folder.path().join("./page.html").display().to_string();
    let nowhere = folder.path().join("none/page.html").display().to_string();
    let cases = [
        (vec!["--report", &page, "--replay", &dotted], 2, "--report and --replay are the same file"),
        (vec!["--report", &nowhere], 1, "--report needs a folder that exists"),
        (vec!["--task", &low], 2, "low.toml: task.height is -1e300; it must be from 0 to 10000"),
        (
            vec!["--theta", &wide],
            1,
            "wide.toml: `armature` is 0.5, which is not between its `lower` 0 and `upper` 0.1",
        ),
        (vec!["--theta", &other], 1, "other.toml: go2 has no joint `FL_tail`"),
        (vec!["--report", "page.txt"], 2, "ends in .html"),
        (vec!["--replay", "/dev/null.html/a.html"], 1, "cannot write"),
        (vec!["--seconds", "0"], 2, "from 0.02 s, one control period"),
        (vec!["--seconds", "1e-9"], 2, "`seconds` (--seconds) is 1e-9"),
        (vec!["--seconds", "1e9"], 2, "at most"),
        (vec!["--trajectories", "0"], 2, "--trajectories"),
        (vec!["--task", "swim"], 2, "velocity"),
        (vec!["--robot", "crates/gaitfit-model/tests/robots/biped.xml"], 1, "robot `biped` has no joint"),
    ];
    for (more, code, message) in cases {
        let quick = ["evaluate", FOREIGN, "--drift", "0"].into_iter();
        let small = ["--trajectories", "1", "--seconds", "0.1"].into_iter().filter(|_| more[0] == "--replay");
        let args: Vec<&str> = quick.chain(small).chain(more.iter().copied()).collect();
        let output = run(&args);
        let error = errors(&output);
        assert_eq!(output.status.code(), Some(code), "{args:?}: {error}");
        assert!(error.contains(message), "`{message}` is not in `{error}`");
    }
    assert_eq!(std::fs::read_to_string(page).unwrap(), "earlier");
    // The same joints under another robot's name: it may be the same robot.
    let same = file("same.toml", &format!("format = 2\nrobot = \"cat\"\n{parameter}value = 0.05\n"));
    let small = ["--trajectories", "1", "--seconds", "0.1", "--drift", "0"];
    let output = run(&[&["evaluate", FOREIGN, "--theta", &same], &small[..]].concat());
    assert!(output.status.success(), "{}", errors(&output));
    assert!(errors(&output).contains("fitted to the robot `cat`, and this is `go2`"), "{}", errors(&output));
}

/// A policy of another robot than the built-in one, without the robot's file.
#[test]
fn a_policy_of_another_robot_asks_for_the_robot() {
    let folder = tempfile::tempdir().unwrap();
    let text = std::fs::read_to_string(common::root().join(FOREIGN)).unwrap();
    let network = common::root().join(FOREIGN).with_file_name("foreign.onnx");
    let text = text.replace("foreign.onnx", &network.display().to_string()).replace("FL_hip_joint", "Waist");
    let policy = folder.path().join("humanoid.toml");
    std::fs::write(&policy, text).unwrap();
    let output = run(&["evaluate", &policy.display().to_string(), "--drift", "0"]);
    let error = errors(&output);
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert!(
        error.contains("has no joint `Waist`") && error.contains("name its file with --robot"),
        "{error}"
    );
}

/// Ground that cannot be names the file that it is from.
#[test]
fn a_wrong_ground_names_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let policy = standing(folder.path());
    let ground = folder.path().join("ground.toml");
    let refused = |text: &str| {
        std::fs::write(&ground, text).unwrap();
        let output = run(&["evaluate", &policy, "--terrain", &ground.display().to_string()]);
        assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
        errors(&output)
    };
    let error = refused("[terrain]\nkind = \"rough\"\ncell = 1.0\n");
    assert!(error.contains("ground.toml") && error.contains("terrain.rough_distance"), "{error}");
    let error = refused("[terrain]\nkind = \"lava\"\n");
    assert!(error.contains("ground.toml") && error.contains("`lava`"), "{error}");
}
