//! The programs in `examples/` run and do what they say.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use std::path::{Path, PathBuf};

#[path = "../examples/fit_clamped_logs.rs"]
mod fit_clamped_logs;
#[path = "../examples/own_cost.rs"]
mod own_cost;
#[path = "../examples/own_modification.rs"]
mod own_modification;
#[path = "../examples/own_reward_term.rs"]
mod own_reward_term;
#[path = "../examples/own_simulator.rs"]
mod own_simulator;
#[path = "../examples/walking_loop.rs"]
mod walking_loop;

/// The repository, which is also made the current directory: that is where the examples are run from.
fn root() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    std::env::set_current_dir(&root).unwrap();
    root
}

#[test]
fn clamped_logs_are_fitted() {
    let runs = tempfile::tempdir().unwrap();
    let changes = ["optimizer.seeds=1", "optimizer.generations=8", "simulation.timestep=0.005", "check={}"];
    let cost = fit_clamped_logs::fit(&root(), runs.path(), &changes).unwrap();
    assert!(cost > 0.0 && cost < 1.0, "{cost}");
    assert!(runs.path().join("example/report.html").exists());
}

#[test]
fn the_loop_ends_with_a_policy() {
    let runs = tempfile::tempdir().unwrap();
    let folder = format!("runs={}", runs.path().display());
    let changes = [
        folder.as_str(),
        "adapt.optimizer.generations=2",
        "adapt.simulation.timestep=0.01",
        "finetune.train.environments=32",
        "finetune.train.iterations=1",
        "finetune.ppo.critic_warmup=0",
        "evaluate.trajectories=16",
        "evaluate.drift=1",
        "target.probe=[\"false\"]",
    ];
    let policy = walking_loop::run(&root(), &changes).unwrap();
    assert!(gaitfit_policy::read(Path::new(&policy)).is_ok(), "{policy}");
}

#[test]
fn an_own_simulator_is_fitted() {
    own_simulator::main().unwrap();
}

#[test]
fn an_own_cost_falls() {
    root();
    own_cost::main().unwrap();
}

#[test]
fn an_own_modification_is_found() {
    root();
    own_modification::main().unwrap();
}

#[test]
fn an_own_reward_term_pays() {
    let paid = own_reward_term::train(16, 2).unwrap();
    // A weight of 2 pays at most 2 a second.
    assert!(paid > 0.0 && paid <= 2.0, "{paid}");
}
