//! `gaitfit train`: what it leaves, resuming to the same bits, and what it refuses.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, json, program, run};
use std::path::Path;

fn args(runs: &Path, iterations: u32, more: &[&str]) -> Vec<String> {
    let (runs, iterations) = (format!("runs={}", runs.display()), format!("train.iterations={iterations}"));
    let mut args = vec!["train".to_owned(), "--json".to_owned(), "--name".to_owned(), "t".to_owned()];
    for set in [runs.as_str(), iterations.as_str(), "train.environments=300", "checkpoint_seconds=0.001"] {
        args.extend(["--set".to_owned(), set.to_owned()]);
    }
    args.extend(more.iter().map(|&argument| argument.to_owned()));
    args
}

fn policy(runs: &Path) -> Vec<u8> {
    std::fs::read(runs.join("t/seed-1/policy.safetensors")).unwrap()
}

/// The metrics without what depends on the clock.
fn metrics(runs: &Path) -> Vec<serde_json::Value> {
    let text = std::fs::read_to_string(runs.join("t/seed-1/metrics.jsonl")).unwrap();
    let timeless = |line: &str| {
        let mut metric: serde_json::Value = serde_json::from_str(line).unwrap();
        let object = metric.as_object_mut().unwrap();
        object.retain(|key, _| !key.ends_with("_seconds") && key != "samples_per_second");
        metric
    };
    text.lines().map(timeless).collect()
}

#[test]
fn stopped_or_killed_and_resumed_it_ends_with_the_same_bits() {
    let folders: Vec<_> = (0..3).map(|_| tempfile::tempdir().unwrap()).collect();
    let output = run(&args(folders[0].path(), 8, &["--threads", "2"]));
    assert!(output.status.success(), "{}", errors(&output));
    let whole = policy(folders[0].path());
    assert_eq!(metrics(folders[0].path()).len(), 8);
    for file in
        ["report.html", "config.toml", "manifest.json", "seed-1/replay.html", "seed-1/checkpoint.safetensors"]
    {
        assert!(folders[0].path().join("t").join(file).exists(), "{file}");
    }
    assert_eq!(json(&output)["seeds"][0]["iterations"], 8);
    let manifest = std::fs::read_to_string(folders[0].path().join("t/manifest.json")).unwrap();
    let manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    let device = format!("device {}", manifest["device"].as_str().unwrap());
    assert!(errors(&output).lines().any(|line| line.starts_with(&device)), "{}", errors(&output));

    // In two parts, on another number of threads.
    for (iterations, more) in [(3, &["--threads", "1"][..]), (8, &["--resume", "--threads", "1"])] {
        let output = run(&args(folders[1].path(), iterations, more));
        assert!(output.status.success(), "{}", errors(&output));
    }
    // Though numbers before it are missing, the latest run is the one that goes on.
    std::fs::rename(folders[1].path().join("t"), folders[1].path().join("t-3")).unwrap();
    let output = run(&args(folders[1].path(), 8, &["--resume", "--threads", "1"]));
    assert!(errors(&output).contains("t-3 is finished"), "{}", errors(&output));
    std::fs::rename(folders[1].path().join("t-3"), folders[1].path().join("t")).unwrap();
    assert!(policy(folders[1].path()) == whole, "a run in two parts ends elsewhere");
    assert_eq!(metrics(folders[1].path()), metrics(folders[0].path()));

    // Killed without warning.
    let mut child =
        program().args(args(folders[2].path(), 8, &[])).stderr(std::process::Stdio::null()).spawn().unwrap();
    std::thread::sleep(std::time::Duration::from_millis(400));
    child.kill().unwrap();
    child.wait().unwrap();
    let begun = folders[2].path().join("t").exists();
    let output = run(&args(folders[2].path(), 8, if begun { &["--resume"] } else { &[] }));
    assert!(output.status.success(), "{}", errors(&output));
    assert!(policy(folders[2].path()) == whole, "a killed run ends elsewhere");
    assert_eq!(metrics(folders[2].path()), metrics(folders[0].path()));
}

#[test]
fn what_cannot_be_trained_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    for (set, word) in [
        ("train.environments=0", "environments"),
        ("train.steps=0", "steps"),
        ("ppo.minibatches=0", "minibatches"),
        ("task.rewards.walk=1", "walk"),
        ("task.command.x=[1, -1]", "command.x"),
        ("ppo.gama=1", "gamma"),
        ("task.feet=[\"paw\"]", "paw"),
        ("ppo.actor_hidden=[9223372036854775807]", "actor_hidden"),
        ("ppo.epochs=100000000000", "epochs"),
        ("task.control_dt=1e-9", "control_dt"),
        ("task.start.pitch=nan", "start.pitch"),
        ("task.height=inf", "height"),
        ("seeds=[18446744073709551615]", "`seeds` has 18446744073709551615"),
    ] {
        let output = run(&args(folder.path(), 1, &["--set", set]));
        assert!(matches!(output.status.code(), Some(1 | 2)), "{set}: {}", output.status);
        assert!(errors(&output).contains(word), "{set}: {}", errors(&output));
    }
}

#[test]
fn a_cut_checkpoint_is_named() {
    let folder = tempfile::tempdir().unwrap();
    assert!(run(&args(folder.path(), 1, &[])).status.success());
    let path = folder.path().join("t/seed-1/checkpoint.safetensors");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let output = run(&args(folder.path(), 2, &["--resume"]));
    assert_eq!(output.status.code(), Some(1));
    assert!(errors(&output).contains("checkpoint.safetensors"), "{}", errors(&output));
}

#[test]
fn a_resumed_training_may_not_shrink_nor_have_lost_its_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let small = ["--set", "train.environments=8", "--set", "train.steps=4"];
    let output = run(&args(folder.path(), 2, &small));
    assert!(output.status.success(), "{}", errors(&output));
    let trained = policy(folder.path());
    let resumed = |iterations: u32, more: &[&str]| {
        let output = run(&args(folder.path(), iterations, &[&small, more, &["--resume"]].concat()));
        assert!(!output.status.success());
        errors(&output)
    };
    assert!(resumed(1, &[]).contains("`train.iterations` was 2, now it is 1"));
    assert!(resumed(2, &["--seeds", "7,"]).contains("`seeds` had 1"));
    let checkpoint = folder.path().join("t/seed-1/checkpoint.safetensors");
    std::fs::remove_file(checkpoint).unwrap();
    assert!(resumed(3, &[]).contains("checkpoint.safetensors is missing"));
    assert!(policy(folder.path()) == trained, "the policy is where it was");
}
