//! Killed or interrupted at any moment, `--resume` ends with the result of an undisturbed run.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, json, program, quick_demo, run};
use serde_json::Value;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

fn args(runs: &Path, more: &[&str]) -> Vec<String> {
    let longer = ["--set", "optimizer.generations=40", "--set", "checkpoint_seconds=0"];
    quick_demo(runs, &[&longer[..], more].concat())
}

fn start(runs: &Path) -> Child {
    program().args(args(runs, &[])).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Waits until `generations` generations are in the metrics.
fn wait_for(runs: &Path, generations: usize, child: &mut Child) {
    let metrics = runs.join("go2-demo/metrics.jsonl");
    let begun = Instant::now();
    loop {
        let lines = std::fs::read_to_string(&metrics).unwrap_or_default().lines().count();
        if lines >= 2 * generations {
            return;
        }
        assert!(child.try_wait().unwrap().is_none(), "the fit ended before it was disturbed");
        assert!(begun.elapsed() < Duration::from_secs(60), "no progress");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn same(a: &Value, b: &Value) {
    for key in ["parameters", "cost", "baselines", "validation", "fits"] {
        assert!(!a[key].is_null(), "{key}");
        assert_eq!(a[key], b[key], "{key}");
    }
}

#[test]
fn killed_interrupted_and_resumed_is_as_undisturbed() {
    let whole_runs = tempfile::tempdir().unwrap();
    let whole = json(&run(&args(whole_runs.path(), &[])));

    let runs = tempfile::tempdir().unwrap();
    let mut child = start(runs.path());
    wait_for(runs.path(), 5, &mut child);
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!runs.path().join("go2-demo/result.json").exists());

    // Resumed, then interrupted as by Ctrl-C.
    let mut child = program()
        .args(args(runs.path(), &["--resume"]))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    wait_for(runs.path(), 12, &mut child);
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", errors(&output));
    assert!(errors(&output).contains("--resume"), "{}", errors(&output));
    assert!(output.stdout.is_empty());

    let resumed = json(&run(&args(runs.path(), &["--resume"])));
    same(&resumed, &whole);
    assert!(!runs.path().join("go2-demo-2").exists());
    let lines = |runs: &Path| {
        let text = std::fs::read_to_string(runs.join("go2-demo/metrics.jsonl")).unwrap();
        let parsed = text.lines().map(|line| {
            let mut line: Value = serde_json::from_str(line).unwrap();
            line["wall_seconds"] = Value::Null;
            line
        });
        parsed.collect::<Vec<Value>>()
    };
    assert_eq!(lines(runs.path()), lines(whole_runs.path()), "no generation is missing or told twice");

    // A finished run is reported again, and a changed setting is not passed off as it.
    same(&json(&run(&args(runs.path(), &["--resume"]))), &whole);
    let output = run(&args(runs.path(), &["--resume", "--set", "parameter.0.upper=1.4"]));
    assert_eq!(output.status.code(), Some(2));
    assert!(errors(&output).contains("`parameter.0.upper` was"), "{}", errors(&output));
}

#[test]
fn what_cannot_be_resumed_is_named_and_nothing_is_begun() {
    let runs = tempfile::tempdir().unwrap();
    let resumed = |name: &str| {
        let more = ["--resume", "--name", name, "--set", "optimizer.generations=2"];
        let output = run(&quick_demo(runs.path(), &more));
        (output.status.code(), errors(&output))
    };
    let (code, error) = resumed("go2-demo");
    assert!(code == Some(2) && error.contains("no run called `go2-demo`"), "{error}");
    assert_eq!(std::fs::read_dir(runs.path()).unwrap().count(), 0);
    // A pipe where the checkpoint was: opening it would wait for ever.
    let folder = runs.path().join("go2-demo");
    std::fs::create_dir(&folder).unwrap();
    assert!(Command::new("mkfifo").arg(folder.join("checkpoint.json")).status().unwrap().success());
    let (code, error) = resumed("go2-demo");
    assert!(code == Some(1) && error.contains("checkpoint.json: not a regular file; restore it"), "{error}");
    std::fs::rename(&folder, runs.path().join("copy")).unwrap();
    let (code, error) = resumed("copy");
    assert!(code == Some(2) && error.contains("holds a run called `go2-demo`"), "{error}");
}
