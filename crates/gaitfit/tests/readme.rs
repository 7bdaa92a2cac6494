//! Every command of the README runs: `gaitfit …` lines as they stand in a folder that mirrors the repository,
//! `cargo …` lines as far as a test can.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod common;

use common::{errors, root};
use std::path::Path;
use std::process::Command;

/// The lines of all `sh` blocks.
fn commands() -> Vec<String> {
    let text = std::fs::read_to_string(root().join("README.md")).unwrap();
    let mut commands = Vec::new();
    let mut inside = false;
    for line in text.lines() {
        match line.trim() {
            "```sh" => inside = true,
            "```" => inside = false,
            line if inside && !line.is_empty() => commands.push(line.to_owned()),
            _ => {}
        }
    }
    commands
}

/// Runs a line in a shell in `folder`, with `gaitfit` on the path.
fn run(line: &str, folder: &Path) {
    let program = Path::new(env!("CARGO_BIN_EXE_gaitfit")).parent().unwrap();
    let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap());
    let output =
        Command::new("sh").args(["-c", line]).env("PATH", path).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{line}: {}\n{}", output.status, errors(&output));
}

#[test]
fn every_command_runs() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["assets", "examples"] {
        std::os::unix::fs::symlink(root().join(name), folder.path().join(name)).unwrap();
    }
    let commands = commands();
    assert!(commands.len() >= 6, "{commands:?}");
    for line in &commands {
        // The program is built already, and these tests are what the test command runs.
        if line == "cargo test --workspace" {
            continue;
        }
        let line = match line.strip_prefix("cargo run --release -- ") {
            // The demo as it stands, with fewer generations and without the check that they would not meet.
            Some(rest) => format!(
                "gaitfit {rest} --set optimizer.generations=10 --set optimizer.seeds=1 \
                 --set simulation.timestep=0.005 --set 'check={{}}'"
            ),
            None if line.contains(" train ") => {
                format!("{line} --set train.environments=32 --set train.iterations=2")
            }
            None if line.contains(" evaluate ") => format!("{line} --trajectories 64 --drift 2"),
            None if line.contains(" adapt ") => {
                format!("{line} --set simulation.timestep=0.005 --set 'check={{}}'")
            }
            None => line.clone(),
        };
        assert!(line.starts_with("gaitfit "), "{line}: a command this test does not know");
        run(&line, folder.path());
    }
    for made in ["log.svg", "my-robot.toml", "runs/go2-demo/report.html"] {
        assert!(folder.path().join(made).metadata().unwrap().len() > 0, "{made}");
    }
}
