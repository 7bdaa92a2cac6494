//! Every command of the README and of the pages that start a reader runs: `gaitfit …` lines as they stand in a folder
//! that mirrors the repository, `cargo …` lines as far as a test can.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, root};
use std::path::Path;
use std::process::Command;

/// The lines of all `sh` blocks of a page.
fn commands(page: &str) -> Vec<String> {
    let text = std::fs::read_to_string(root().join(page)).unwrap();
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

/// Settings appended to commands that take minutes as they stand: less of everything, and no check that less would not
/// meet.
const SHORTER: [(&str, &str); 4] = [
    (
        "gaitfit loop examples/go2-ground/loop.toml",
        "--set 'logs=[\"examples/go2-ground/logs/trajectory_0[0-3].csv\"]' --set adapt.optimizer.generations=2 \
         --set adapt.optimizer.replicates=0 --set adapt.simulation.timestep=0.01 --set finetune.train.environments=32 \
         --set finetune.train.iterations=1 --set finetune.ppo.critic_warmup=0 \
         --set evaluate.trajectories=32 --set evaluate.drift=1",
    ),
    (
        "gaitfit fit ",
        "--set optimizer.generations=10 --set optimizer.seeds=1 --set optimizer.replicates=0 \
         --set simulation.timestep=0.005 --set 'check={}'",
    ),
    ("gaitfit train ", "--set train.environments=32 --set train.iterations=2"),
    ("gaitfit evaluate ", "--trajectories 64 --drift 2"),
];

/// Runs a line in a shell in `folder`, with `gaitfit` on the path, as on a machine with Rust alone.
fn run(line: &str, folder: &Path) {
    let program = Path::new(env!("CARGO_BIN_EXE_gaitfit")).parent().unwrap();
    let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap());
    let output = Command::new("sh")
        .args(["-c", line])
        .env("PATH", path)
        .env("GAITFIT_PYTHON", "no-python")
        .current_dir(folder)
        .output()
        .unwrap();
    assert!(output.status.success(), "{line}: {}\n{}", output.status, errors(&output));
}

/// The examples, with every twelfth of the walks and the first four: to examine all of them takes most of a minute.
fn examples(folder: &Path) {
    for one in std::fs::read_dir(root().join("examples")).unwrap() {
        let from = one.unwrap().path();
        let to = folder.join("examples").join(from.file_name().unwrap());
        std::fs::create_dir_all(&to).unwrap();
        for file in std::fs::read_dir(&from).unwrap().map(|file| file.unwrap().path()) {
            let to = to.join(file.file_name().unwrap());
            if file.is_file() {
                std::os::unix::fs::symlink(&file, &to).unwrap();
                continue;
            }
            std::fs::create_dir(&to).unwrap();
            let mut logs: Vec<_> = std::fs::read_dir(&file).unwrap().map(|log| log.unwrap().path()).collect();
            logs.sort();
            let is_walk = |log: &Path| log.extension().is_some_and(|ending| ending == "csv");
            let (walks, others): (Vec<_>, Vec<_>) = logs.into_iter().partition(|log| is_walk(log));
            for log in walks
                .iter()
                .enumerate()
                .filter(|(number, _)| number % 12 == 0 || *number < 4)
                .map(|(_, log)| log)
                .chain(&others)
            {
                std::os::unix::fs::symlink(log, to.join(log.file_name().unwrap())).unwrap();
            }
        }
    }
}

#[test]
fn every_command_runs() {
    let folder = tempfile::tempdir().unwrap();
    std::os::unix::fs::symlink(root().join("assets"), folder.path().join("assets")).unwrap();
    examples(folder.path());
    let readme = commands("README.md");
    assert!(readme[0].starts_with("cargo install --path crates/gaitfit-cli"), "it begins with installing");
    assert!(readme[1].starts_with("gaitfit loop "), "then comes the example");
    let pages = [readme, commands("docs/start-example.md"), commands("docs/start-own-robot.md")];
    assert_eq!(pages.each_ref().map(Vec::len), [5, 8, 15], "{pages:?}");
    let mut done: Vec<&String> = Vec::new();
    // Installing is the build that made this program, and the tests are this one.
    let cargo = ["cargo install --path crates/gaitfit-cli", "cargo test --workspace"];
    for line in pages.iter().flatten().filter(|line| !cargo.contains(&line.as_str())) {
        if done.contains(&line) {
            continue;
        }
        done.push(line);
        assert!(line.starts_with("gaitfit "), "{line}: a command this test does not know");
        let shorter = SHORTER.iter().find(|(command, _)| line.starts_with(command));
        run(&format!("{line} {}", shorter.map_or("", |(_, settings)| settings)), folder.path());
    }
    for made in [
        "my-robot.toml",
        "walks.toml",
        "all-settings-of-a-loop.toml",
        "log.svg",
        "view.html",
        "policy.onnx",
        "runs/go2-ground/report.html",
        "runs/go2-demo/report.html",
        "runs/my-robot/report.html",
    ] {
        assert!(folder.path().join(made).metadata().unwrap().len() > 0, "{made}");
    }
}

#[test]
fn the_readme_stays_short() {
    let text = std::fs::read_to_string(root().join("README.md")).unwrap();
    let words = text.split_whitespace().count();
    assert!(words <= 600, "{words} words");
}
