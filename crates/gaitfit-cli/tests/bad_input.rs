//! Broken input: one paragraph that says what, where and what to do; exit code 1 or 2; nothing else touched.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, program, quick_demo, root, run};
use std::path::Path;
use std::process::Output;

/// The error of a run: a single paragraph on standard error, nothing on standard output.
fn refused(output: &Output, code: i32, words: &[&str]) {
    let text = errors(output);
    assert_eq!(output.status.code(), Some(code), "{text}");
    assert!(output.stdout.is_empty());
    assert_eq!(text.matches("error: ").count(), 1, "{text}");
    assert!(!text.contains("panicked"), "{text}");
    for word in words {
        assert!(text.contains(word), "`{word}` is not in: {text}");
    }
}

fn adapt(runs: &Path, more: &[&str]) -> Output {
    run(&quick_demo(runs, more))
}

/// The demo's log with its lines changed.
fn changed_log(folder: &Path, change: impl Fn(&mut Vec<String>)) -> String {
    let text = std::fs::read_to_string(root().join("examples/go2-demo/fit.csv")).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    change(&mut lines);
    let path = folder.join("log.csv");
    std::fs::write(&path, lines.join("\n") + "\n").unwrap();
    format!("logs=[{:?}]", path)
}

#[test]
fn settings() {
    let runs = tempfile::tempdir().unwrap();
    for (set, words) in [
        ("optimizer.generatons=3", &["generatons", "Did you mean `generations`?"][..]),
        ("parameter.0.upper=-1", &["frictionloss_hip", "lower 0", "upper -1"]),
        ("parameter.0.lower=-1", &["frictionloss_hip", "has no meaning"]),
        ("parameter.0.joints=[\"*_wheel\"]", &["matches no joint", "FL_hip"]),
        ("parameter.1.kind=frictionloss", &["two rules give `frictionloss_hip`"]),
        ("logs=[\"nowhere.csv\"]", &["nowhere.csv", "does not exist", "--set"]),
        ("robot=nothing.xml", &["nothing.xml", "does not exist"]),
        ("costs=[\"wassr\"]", &["take wass, matcho"]),
        ("costs=[\"matchr1\"]", &["if the robot walked, add base = \"free\" and `policy`"]),
        ("costs=[\"matchs20\"]", &["if the robot walked add base = \"free\" and `policy`"]),
        ("logs=[]", &["`logs` names no log"]),
        ("optimizer.seeds=1001", &["`optimizer.seeds`"]),
        ("name=../up", &["cannot name a run folder"]),
        ("runs=\"\"", &["`runs` names no folder"]),
        ("check.rmse_rad=nan", &["`check.rmse_rad`"]),
        ("simulation.timestep=1e-6", &["`simulation.timestep`", "raise it"]),
        ("parameter.3.upper=10", &["`delay`", "bounds 0 to 10 reach beyond 1;"]),
        ("gains.kp=-1", &["`gains.kp` has -1", "not negative"]),
        ("gains.kd={ FL_hip = nan }", &["`gains.kd` has NaN"]),
        ("validate_gains=[{ files = [\"*\"], kp = 1, kd = -2 }]", &["`validate_gains.0.kd` has -2"]),
        (
            "optimizer.generations=-1",
            &["--set optimizer.generations=-1", "expected a whole number, 0 or more"],
        ),
        ("=", &["--set =", "write it as key=value"]),
    ] {
        refused(&adapt(runs.path(), &["--set", set]), 2, words);
    }
    assert_eq!(std::fs::read_dir(runs.path()).unwrap().count(), 0, "a refused run leaves no folder");
}

#[test]
fn a_configuration_names_file_line_and_column() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.toml");
    std::fs::write(&path, "robot = \"a\"\n\n[simulation]\ntimestp = 1\n").unwrap();
    refused(&run(&["adapt", path.to_str().unwrap()]), 2, &["mine.toml:4:1", "Did you mean `timestep`?"]);
    std::fs::write(&path, "robot = \n").unwrap();
    refused(&run(&["adapt", path.to_str().unwrap()]), 2, &["mine.toml:1:"]);
    refused(&run(&["adapt", "no/such.toml"]), 2, &["no/such.toml", "gaitfit config"]);
}

#[test]
fn advised_commands_keep_a_path_with_spaces_whole() {
    refused(&run(&["export", "my walk.csv"]), 2, &["gaitfit export 'my walk.csv' --out log.mcap"]);
}

#[test]
fn lengths_of_a_view() {
    for (option, value, bound) in
        [("--seconds", "0", "above 0"), ("--seconds", "inf", "above 0"), ("--from", "inf", "not below 0")]
    {
        refused(&run(&["view", "examples/go2-demo/fit.csv", option, value]), 2, &[option, value, bound]);
    }
}

#[test]
fn a_view_replaces_no_file_that_it_was_not_told() {
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("fit.html");
    std::fs::write(&page, "mine").unwrap();
    let log = root().join("examples/go2-demo/fit.csv");
    let output = program().current_dir(folder.path()).arg("view").arg(log).output().unwrap();
    refused(&output, 2, &["fit.html exists already", "--out"]);
    assert_eq!(std::fs::read_to_string(page).unwrap(), "mine");
}

#[cfg(unix)]
#[test]
fn arguments_that_are_not_utf_8() {
    use std::os::unix::ffi::OsStrExt;
    let file = std::ffi::OsStr::from_bytes(b"\xff.toml");
    let mut command = common::program();
    // With this variable the program looks at its arguments again after a refusal.
    command.env("GAITFIT_ISA", "avx2").arg("fit").arg(file).args(["--device", "bad"]);
    refused(&command.output().unwrap(), 2, &["--device", "bad"]);
}

#[test]
fn logs() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs");
    let set = changed_log(folder.path(), |lines| lines[6].truncate(40));
    refused(&adapt(&runs, &["--set", &set]), 1, &["log.csv:7", "cells"]);

    let set = changed_log(folder.path(), |lines| {
        for line in lines.iter_mut() {
            *line = line.replace("FL_hip", "XX_hip");
        }
    });
    refused(&adapt(&runs, &["--set", &set]), 1, &["log.csv", "XX_hip", "robot lacks"]);

    let set = changed_log(folder.path(), |lines| lines.retain(|line| !line.starts_with("# k")));
    refused(&adapt(&runs, &["--set", &set]), 2, &["log.csv", "PD gains", "gains.kp"]);

    let set = changed_log(folder.path(), |lines| {
        let cell = lines[9].split(',').nth(1).unwrap().to_owned();
        lines[9] = lines[9].replacen(&cell, "nan", 1);
    });
    refused(&adapt(&runs, &["--set", &set]), 1, &["log.csv", "FL_hip"]);

    // Another rate than the log states: the replay would take the time column's word.
    let set = changed_log(folder.path(), |lines| {
        for (index, line) in lines.iter_mut().skip(6).enumerate() {
            if let Some((_, rest)) = line.split_once(',') {
                *line = format!("{},{rest}", 0.01 * index as f64);
            }
        }
    });
    refused(&adapt(&runs, &["--set", &set]), 1, &["log.csv", "rate-mismatch"]);

    // Nothing moves, in one log of two; and a log of two rows.
    let still = |name: &str| {
        let text = std::fs::read_to_string(root().join("examples/go2-demo/fit.csv")).unwrap();
        let row = |line: &str| match line.split_once(',') {
            Some((time, rest)) if time.parse::<f64>().is_ok() => {
                format!("{time}{}\n", ",1e38".repeat(rest.split(',').count()))
            }
            _ => format!("{line}\n"),
        };
        let path = folder.path().join(name);
        std::fs::write(&path, text.lines().map(row).collect::<String>()).unwrap();
        path.display().to_string()
    };
    let set = format!("logs=[{:?}, {:?}]", still("still.csv"), still("stiller.csv"));
    refused(
        &adapt(&runs, &["--set", &set]),
        1,
        &["still.csv: beyond-position-limit", "allow = [\"beyond-position-limit\"]"],
    );
    let allow = r#"allow=["beyond-position-limit", "beyond-velocity-limit", "constant-signal"]"#;
    let arguments = ["--set", &set, "--set", allow];
    refused(&adapt(&runs, &arguments), 1, &["still.csv, ", "stiller.csv: recorded", "constant"]);
    let set = changed_log(folder.path(), |lines| lines.truncate(8));
    refused(&adapt(&runs, &["--set", &set]), 1, &["log.csv: 2 samples are too few", "at least 20"]);

    // A damaged last time stays a short message.
    let set = changed_log(folder.path(), |lines| {
        if let Some((_, rest)) = lines.pop().as_deref().and_then(|line| line.split_once(',')) {
            lines.push(format!("1e300,{rest}"));
        }
    });
    let output = adapt(&runs, &["--set", &set]);
    refused(&output, 1, &["time-gap"]);
    assert!(errors(&output).len() < 600, "{}", errors(&output));
    assert!(!runs.exists());
}

#[test]
fn a_huge_checkpoint_interval_is_only_long() {
    let runs = tempfile::tempdir().unwrap();
    let more = ["--set", "checkpoint_seconds=1e308", "--set", "optimizer.generations=1"];
    assert_eq!(adapt(runs.path(), &more).status.code(), Some(0));
}

#[test]
fn a_fit_that_is_stopped_by_its_limit_notes_so_once() {
    let runs = tempfile::tempdir().unwrap();
    let output = adapt(runs.path(), &["--set", "optimizer.max_seconds=1e-9"]);
    let said = errors(&output);
    assert!(output.status.success(), "{said}");
    let notes: Vec<&str> = said.lines().filter(|line| line.contains("optimizer.max_seconds")).collect();
    assert!(matches!(notes[..], [note] if note.starts_with("note: stopped after")), "{said}");
}

#[cfg(unix)]
#[test]
fn devices_are_neither_read_nor_replaced() {
    refused(&run(&["adapt", "/dev/zero"]), 2, &["/dev/zero", "not a regular file"]);
    refused(&run(&["inspect", "/dev/zero"]), 2, &["/dev/zero"]);
    // A socket stands in for a device here: replacing /dev/null itself would break the machine.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out");
    let _socket = std::os::unix::net::UnixListener::bind(&path).unwrap();
    let path = path.to_str().unwrap();
    refused(&run(&["forward", "assets/go2.xml", "states.npz", path]), 2, &[path, "not a regular file"]);
    // A pipe would be waited for for ever.
    let pipe = folder.path().join("theta.toml");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let pipe = pipe.to_str().unwrap();
    let policy = "assets/go2-walk.safetensors";
    for command in ["evaluate", "finetune"] {
        refused(&run(&[command, policy, "--theta", pipe]), 1, &["theta.toml: not a regular file"]);
    }
    refused(
        &run(&["validate", pipe, "a.csv", "--config", "examples/go2-demo/adapt.toml"]),
        1,
        &["theta.toml"],
    );
}

#[test]
fn robots() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("robot.xml");
    std::fs::write(&path, "<mujoco><worldbody><body><joint type=\"ball\"/></body></worldbody></mujoco>")
        .unwrap();
    refused(&run(&["inspect", path.to_str().unwrap()]), 1, &["robot.xml:1:"]);
    std::fs::write(&path, "<mujoco").unwrap();
    refused(&run(&["inspect", path.to_str().unwrap()]), 1, &["robot.xml:1:"]);
}

#[test]
fn a_run_folder_that_cannot_be_made_leaves_the_rest_alone() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("results");
    std::fs::write(&file, "earlier").unwrap();
    refused(&adapt(&file, &[]), 1, &["results", "--set runs=", "intact"]);
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "earlier");
}
