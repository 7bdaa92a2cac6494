//! Running the program from the repository root.
#![allow(
    clippy::unwrap_used,
    dead_code,
    reason = "a failed unwrap is a failed test; no test uses all helpers"
)]

pub mod loops;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The repository root.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

/// The program, in the repository root.
pub fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gaitfit"));
    command.current_dir(root());
    command
}

/// Runs the program to its end.
pub fn run<S: AsRef<std::ffi::OsStr>>(args: &[S]) -> Output {
    program().args(args).output().unwrap()
}

/// What a run printed on standard error.
pub fn errors(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// The one JSON document a run printed.
pub fn json(output: &Output) -> serde_json::Value {
    serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|error| panic!("no JSON document: {error}\n{}", errors(output)))
}

/// A policy that stands, trained into `runs`: one iteration of a tiny network.
pub fn standing_policy(runs: &Path) -> PathBuf {
    let sets = [
        &format!("runs={}", runs.display()),
        "train.iterations=1",
        "train.environments=8",
        "ppo.actor_hidden=[8]",
        "ppo.critic_hidden=[8]",
    ];
    let mut args = vec!["train", "--name", "p"];
    args.extend(sets.into_iter().flat_map(|set| ["--set", set]));
    let output = run(&args);
    assert!(output.status.success(), "{}", errors(&output));
    runs.join("p/seed-1/policy.safetensors")
}

/// Arguments of a quick fit of the demo: few generations of few seeds, few simulated robots, coarse steps, results under `runs`.
pub fn quick_demo(runs: &Path, more: &[&str]) -> Vec<String> {
    let mut args = vec!["adapt".to_owned(), "examples/go2-demo/adapt.toml".to_owned(), "--json".to_owned()];
    let runs = format!("runs={}", runs.display());
    for set in [
        runs.as_str(),
        "optimizer.generations=6",
        "optimizer.seeds=2",
        "optimizer.replicates=1",
        "simulation.timestep=0.005",
    ] {
        args.extend(["--set".to_owned(), set.to_owned()]);
    }
    // The demo states a check that six generations do not meet.
    args.extend(["--set".to_owned(), "check={}".to_owned()]);
    args.extend(more.iter().map(|&argument| argument.to_owned()));
    args
}
