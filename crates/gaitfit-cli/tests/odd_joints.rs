//! The joint that is not like the others is found without a word about which one it is.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use crate::common;

use common::{errors, json, run};
use std::path::Path;

/// Walks of the robot of `truth.toml` with springs, and a configuration that looks for odd joints.
fn walks(folder: &Path, springs: &[&str], cost: &str) -> String {
    let out = folder.join("logs");
    let mut args =
        vec!["collect", "assets/go2-robust.safetensors", "--theta", "examples/go2-ground/truth.toml"];
    args.extend(["--out", out.to_str().unwrap(), "--trajectories", "7", "--seconds", "2"]);
    args.extend(springs.iter().flat_map(|spring| ["--spring", spring]));
    let collected = run(&args);
    assert_eq!(collected.status.code(), Some(0), "{}", errors(&collected));
    let path = folder.join("odd.toml");
    let text = format!(
        "name = \"odd\"\nbase = \"free\"\npolicy = \"assets/go2-robust.safetensors\"\nlogs = [{:?}]\ncosts = [\"{cost}\"]\n\
         odd_joints = true\nruns = {:?}\n[[parameter]]\nkind = \"frictionloss\"\n[[parameter]]\nkind = \"armature\"\n\
         [[parameter]]\nkind = \"delay\"\nper = \"all\"\nupper = 0.02\n[optimizer]\nseeds = 1\n\
         replicates = 1\n[simulation]\npreset = \"fast\"\n",
        out.display(),
        folder.display()
    );
    std::fs::write(&path, text).unwrap();
    path.display().to_string()
}

#[test]
#[ignore = "takes long: `.ci/run long` runs it"]
fn long_a_spring_with_any_rest_angle_is_found_on_its_joint() {
    let folder = tempfile::tempdir().unwrap();
    let path = walks(folder.path(), &["RR_calf_joint=40@-1.2"], "matchr1");
    let output = run(&["adapt", &path, "--json"]);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{}", errors(&output));
    let report = json(&output);
    assert_eq!(report["odd_joints"]["odd"], serde_json::json!(["RR_calf_joint"]), "{}", report["odd_joints"]);
    let spring = &report["springs"][0];
    assert!((spring["stiffness"].as_f64().unwrap() / 40.0 - 1.0).abs() < 0.05, "{spring}");
    assert!((spring["rest"].as_f64().unwrap() + 1.2).abs() < 0.05, "{spring}");
    assert_eq!(report["springs"].as_array().unwrap().len(), 1);
    let names: Vec<&str> =
        report["parameters"].as_array().unwrap().iter().map(|one| one["name"].as_str().unwrap()).collect();
    assert!(names.ends_with(&["stiffness_RR_calf", "spring_torque_RR_calf"]), "{names:?}");
    // The finished folder says the same, in words.
    let again = run(&["adapt", &path, "--resume"]);
    let text = String::from_utf8(again.stdout.clone()).unwrap();
    assert!(
        text.contains("RR_calf_joint has a spring that no other joint has: "),
        "{text}{}",
        errors(&again)
    );
    let theta = std::fs::read_to_string(folder.path().join("odd/theta.toml")).unwrap();
    assert!(theta.contains("kind = \"stiffness\"\njoints = [\"RR_calf_joint\"]"), "{theta}");
}

#[test]
fn a_healthy_robot_has_none() {
    let folder = tempfile::tempdir().unwrap();
    let path = walks(folder.path(), &[], "matchr1");
    let output = run(&["adapt", &path, "--set", "optimizer.population=20"]);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{}", errors(&output));
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    assert!(text.contains("no joint differs from its siblings") && !text.contains("stiffness"), "{text}");
    let said = format!("{text}{}", errors(&output));
    assert!(said.contains("least squares, which ignores optimizer.population"), "{said}");
}

#[test]
fn a_cost_without_single_samples_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = walks(folder.path(), &[], "wass");
    let refused = run(&["adapt", &path, "--set", "simulation.skip_seconds=0.1"]);
    assert!(matches!(refused.status.code(), Some(1 | 2)), "{:?}", refused.status);
    assert!(
        errors(&refused).contains("`odd_joints`") && errors(&refused).contains("matchr1"),
        "{}",
        errors(&refused)
    );
}
