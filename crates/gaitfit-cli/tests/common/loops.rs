//! Small loops.

use super::standing_policy;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A policy that stands, trained once.
pub fn policy() -> &'static Path {
    static POLICY: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let (_, path) = POLICY.get_or_init(|| {
        let runs = tempfile::tempdir().unwrap();
        let path = standing_policy(runs.path());
        (runs, path)
    });
    path
}

pub const SIMULATED: &str = r#"
[target]
kind = "simulated"
trajectories = 6
seconds = 2.0
spring = ["RR_calf_joint=20"]
torque_noise = 0.5
[[target.parameter]]
kind = "frictionloss"
joints = ["*_hip*"]
value = 0.2
"#;

pub const COMMAND: &str = "[target]\nkind = \"command\"\ncollect = [\"true\", \"{folder}\"]\n";

pub const SMALL: &str = r#"
checkpoint_seconds = 0.0
[adapt]
simulation = { timestep = 0.01, skip_seconds = 0.0 }
falls.margin_seconds = 0.1
optimizer = { generations = 2, seeds = 1, replicates = 0 }
# Intervals of all parameters take most of the time of a fit this short.
[[adapt.parameter]]
kind = "frictionloss"
[finetune]
train = { environments = 8, iterations = 1 }
ppo.critic_warmup = 0
[evaluate]
trajectories = 8
seconds = 0.5
drift = 1
[controls]
nominal = false
randomised = false
"#;

/// Writes a small loop's configuration into `folder`, which its runs go to, and gives the command's arguments.
pub fn args(folder: &Path, target: &str, more: &[&str]) -> Vec<String> {
    let config = folder.join("l.toml");
    let head =
        format!("policy = {:?}\nruns = {:?}\n", policy().display().to_string(), folder.display().to_string());
    // In TOML, keys behind the head of a table belong to it, so the first keys must stand before `target`.
    let (top, tables) = SMALL.split_once("[adapt]").unwrap();
    fs::write(&config, format!("{head}{top}{target}\n[adapt]{tables}")).unwrap();
    let mut args = vec!["loop".to_owned(), config.display().to_string(), "--json".to_owned()];
    args.extend(more.iter().map(|&argument| argument.to_owned()));
    args
}

/// What continues a loop in `folder` if it was begun.
pub fn begun(folder: &Path) -> &'static [&'static str] {
    if folder.join("l").exists() { &["--resume"] } else { &[] }
}
