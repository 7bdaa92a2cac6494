//! A policy with a memory along the commands: trained, resumed, looked at, evaluated, exported, trained further.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, json, run};
use std::path::Path;

const MEMORY: &str = "ppo.memory={ cell = \"lstm\", width = 8, layers = 2 }";

fn args(command: &[&str], runs: &Path, sets: &[&str]) -> Vec<String> {
    let runs = format!("runs={}", runs.display());
    let mut args: Vec<String> = command.iter().map(|&word| word.to_owned()).collect();
    args.extend(["--json", "--device", "cpu"].map(str::to_owned));
    for set in [runs.as_str(), "train.environments=40", "checkpoint_seconds=0.001"].iter().chain(sets) {
        args.extend(["--set".to_owned(), (*set).to_owned()]);
    }
    args
}

fn train(runs: &Path, iterations: u32, more: &[&str]) -> Vec<String> {
    let iterations = format!("train.iterations={iterations}");
    let sets = [MEMORY, "ppo.actor_hidden=[8]", "ppo.critic_hidden=[8]", &iterations];
    let mut all = args(&["train", "--name", "t"], runs, &sets);
    all.extend(more.iter().map(|&argument| argument.to_owned()));
    all
}

#[test]
fn a_policy_with_a_memory_goes_through_all_commands() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let [whole, parts] = folders.each_ref().map(|folder| folder.path());
    let policy = |runs: &Path| runs.join("t/seed-1/policy.safetensors");
    let done = |args: &[String]| {
        let output = run(args);
        // A policy that does not walk ends with a warning.
        assert!(matches!(output.status.code(), Some(0 | 3)), "{args:?}: {}", errors(&output));
        json(&output)
    };
    done(&train(whole, 4, &["--threads", "2"]));
    // Cut in the middle and on another number of threads: neither may change a bit.
    done(&train(parts, 2, &["--threads", "1"]));
    done(&train(parts, 4, &["--resume", "--threads", "1"]));
    let bytes = std::fs::read(policy(whole)).unwrap();
    assert!(bytes == std::fs::read(policy(parts)).unwrap(), "a run in two parts ends elsewhere");

    let path = policy(whole).display().to_string();
    let words = |line: &str| -> Vec<String> { line.split_whitespace().map(str::to_owned).collect() };
    assert_eq!(done(&words(&format!("export {path} --json")))["before_actor"], "lstm of 8, 8 units");
    let onnx = whole.join("p.onnx").display().to_string();
    done(&words(&format!("export {path} --json --onnx {onnx}")));
    let few = "--device cpu --trajectories 4 --seconds 1 --json";
    let evaluation = done(&words(&format!("evaluate {path} {few}")));
    let of_onnx = done(&words(&format!("evaluate {onnx} {few}")));
    assert!(evaluation["reward"].is_number() || evaluation.is_object());
    assert_eq!(evaluation["trajectories"], of_onnx["trajectories"]);

    let iterations = ["train.iterations=1", "ppo.critic_warmup=0"];
    // With the policy's critic, and from ONNX with a new one.
    for (number, from) in [&path, &onnx].into_iter().enumerate() {
        let name = format!("f{number}");
        done(&args(&["finetune", from, "--name", &name], whole, &iterations));
        let after =
            gaitfit_policy_files::read(&whole.join(format!("{name}/seed-1/policy.safetensors"))).unwrap();
        assert!(after.is_recurrent() && after.critic_memory.is_some());
        assert_ne!(after.front, gaitfit_policy_files::read(Path::new(&path)).unwrap().front);
    }
    let refused = |sets: &[&str], word: &str| {
        let output =
            run(&args(&["finetune", &path, "--name", "r"], whole, &[&iterations[..], sets].concat()));
        assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
        assert!(errors(&output).contains(word), "{word}: {}", errors(&output));
    };
    refused(
        &["ppo.memory={ width = 9 }"],
        "`ppo.memory` is 1 × gru of 9 units, and the policy has 2 × lstm of 8 units",
    );
    refused(&["ppo.memory={ wide = 9 }"], "wide");
    refused(&["ppo.minibatches=50"], "train.environments is 40; it must be at least ppo.minibatches, 50");
    refused(&["train.steps=5000"], "train.steps is 5000; it must be at most 4096");
}
