//! `gaitfit train`: files, resuming to the bit, refusals. Trainings are tiny; that they learn is shown elsewhere.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod common;

use common::{errors, json, program, root, run};
use serde_json::Value;
use std::path::Path;
use std::process::{Child, Output, Stdio};
use std::time::{Duration, Instant};

/// A training of few robots and steps called `t`, results under `runs`.
fn args(runs: &Path, more: &[&str]) -> Vec<String> {
    let runs = format!("runs={}", runs.display());
    let mut args = vec!["train", "--name", "t", "--json"];
    for set in [&runs, "train.environments=40", "train.steps=8", "train.iterations=4", "checkpoint_seconds=0"]
    {
        args.extend(["--set", set]);
    }
    args.extend(more);
    args.into_iter().map(str::to_owned).collect()
}

fn train(runs: &Path, more: &[&str]) -> Value {
    let output = run(&args(runs, more));
    assert_eq!(output.status.code(), Some(0), "{}", errors(&output));
    json(&output)
}

/// Ended with `code`, one error that holds all `words`, nothing on standard output.
fn refused(output: &Output, code: i32, words: &[&str]) {
    let text = errors(output);
    assert_eq!(output.status.code(), Some(code), "{text}");
    assert!(output.stdout.is_empty());
    assert_eq!(text.matches("error: ").count(), 1, "{text}");
    for word in words {
        assert!(text.contains(word), "`{word}` is not in: {text}");
    }
}

/// The metrics of a seed, without times.
fn metrics(run: &Path) -> Vec<Value> {
    let text = std::fs::read_to_string(run.join("metrics.jsonl")).unwrap();
    let parse = |line: &str| {
        let mut line: Value = serde_json::from_str(line).unwrap();
        for time in ["rollout_seconds", "update_seconds", "samples_per_second", "wall_seconds"] {
            assert!(line[time].as_f64().unwrap() > 0.0, "{time}");
            line[time] = Value::Null;
        }
        line
    };
    text.lines().map(parse).collect()
}

/// Two runs of a seed came to the same bits.
fn same(a: &Path, b: &Path) {
    let policy = |run: &Path| std::fs::read(run.join("policy.safetensors")).unwrap();
    assert!(policy(a) == policy(b), "the policies differ");
    assert_eq!(metrics(a), metrics(b));
}

#[test]
fn a_run_of_two_seeds_is_complete() {
    let runs = tempfile::tempdir().unwrap();
    let found = train(runs.path(), &["--seeds", "2"]);
    let folder = runs.path().join("t");
    assert_eq!(found["run_folder"].as_str().map(Path::new), Some(folder.as_path()));
    let seeds = found["seeds"].as_array().unwrap();
    assert_eq!(seeds.len(), 2);
    for (seed, number) in seeds.iter().zip(1..) {
        assert_eq!((&seed["seed"], &seed["iterations"]), (&number.into(), &4.into()));
        assert_eq!(seed["samples"], 4 * 40 * 8);
        for key in ["reward", "linear_velocity_error", "angular_velocity_error", "samples_per_second"] {
            assert!(seed[key].as_f64().unwrap().is_finite(), "{key}");
        }
        assert!(seed["gait"]["action_rate"].as_f64().unwrap() >= 0.0);
        let of_seed = folder.join(format!("seed-{number}"));
        for file in ["checkpoint.safetensors", "policy.safetensors", "events.out.tfevents.0.gaitfit"] {
            assert!(of_seed.join(file).metadata().unwrap().len() > 100, "{file}");
        }
        assert!(
            std::fs::read_to_string(of_seed.join("replay.html")).unwrap().contains("4 iterations; standing")
        );
        let lines = metrics(&of_seed);
        assert_eq!(lines.len(), 4);
        for (line, iteration) in lines.iter().zip(1..) {
            assert_eq!(line["iteration"], iteration);
            for key in [
                "reward",
                "kl",
                "approx_kl_k1",
                "approx_kl_k3",
                "clip_fraction",
                "explained_variance",
                "entropy",
                "mean_std",
                "learning_rate",
                "policy_loss",
                "value_loss",
                "gradient_norm",
            ] {
                assert!(line[key].is_f64(), "{key}: {line}");
            }
            // The terms, a second, sum to the reward of a step of 0.02 s.
            let terms = line["rewards"].as_object().unwrap().values();
            let sum: f64 = terms.map(|term| term.as_f64().unwrap()).sum();
            assert!((0.02 * sum - line["reward"].as_f64().unwrap()).abs() < 1e-5, "{line}");
        }
    }
    for file in ["config.toml", "manifest.json", "result.json"] {
        assert!(folder.join(file).metadata().unwrap().len() > 0, "{file}");
    }
    let page = std::fs::read_to_string(folder.join("report.html")).unwrap();
    for word in ["Watch seed 2", "track linear velocity", "seed 2", "explained variance"] {
        assert!(page.contains(word), "`{word}` is not in the report");
    }
    // The policy is one for the other commands, and remembers where it comes from.
    let policy = folder.join("seed-2/policy.safetensors");
    let shown = json(&run(&["export", policy.to_str().unwrap(), "--json"])).to_string();
    assert!(shown.contains(found["configuration_hash"].as_str().unwrap()), "{shown}");

    // The resolved configuration is the same training; a finished run is reported again, a new one gets its folder.
    let config = folder.join("config.toml");
    let again = json(&run(&["train", config.to_str().unwrap(), "--json"]));
    assert_eq!(again["run_folder"].as_str().map(Path::new), Some(runs.path().join("t-2").as_path()));
    for seed in ["seed-1", "seed-2"] {
        same(&folder.join(seed), &runs.path().join("t-2").join(seed));
    }
    let output = run(&["train", config.to_str().unwrap(), "--resume"]);
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    assert!(errors(&output).contains("is finished"), "{}", errors(&output));
    for word in ["error m/s", "falls", "samples/s", "report.html", "seed-2/policy.safetensors"] {
        assert!(text.contains(word), "`{word}` is not in:\n{text}");
    }
}

#[cfg(unix)]
mod resuming {
    use super::*;

    fn start(runs: &Path, more: &[&str]) -> Child {
        let mut command = program();
        command.args(args(runs, more)).stdout(Stdio::null()).stderr(Stdio::piped());
        command.spawn().unwrap()
    }

    fn wait_for(file: &Path, lines: usize, child: &mut Child) {
        let begun = Instant::now();
        while std::fs::read_to_string(file).unwrap_or_default().lines().count() < lines {
            assert!(child.try_wait().unwrap().is_none(), "the training ended before it was disturbed");
            assert!(begun.elapsed() < Duration::from_secs(60), "no progress");
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    #[test]
    fn killed_interrupted_and_torn_it_ends_as_undisturbed() {
        let whole = tempfile::tempdir().unwrap();
        let longer = ["--set", "train.iterations=30", "--threads"];
        train(whole.path(), &[&longer[..], &["1"]].concat());

        let runs = tempfile::tempdir().unwrap();
        let seed = runs.path().join("t/seed-1");
        let file = seed.join("metrics.jsonl");
        let resumed = [&longer[..], &["2", "--resume"]].concat();
        // Killed again and again, each time at another moment of an iteration or a checkpoint.
        for (lines, more) in [(1, 0), (3, 3), (6, 7), (9, 11), (13, 17)] {
            let mut child = start(runs.path(), &resumed);
            wait_for(&file, lines, &mut child);
            std::thread::sleep(Duration::from_millis(more));
            child.kill().unwrap();
            child.wait().unwrap();
        }
        // Lines torn by a crash of the machine are mended.
        for torn in ["metrics.jsonl", "events.out.tfevents.0.gaitfit"] {
            let mut bytes = std::fs::read(seed.join(torn)).unwrap();
            bytes.extend(b"{\"iteration\": 3, \"rew");
            std::fs::write(seed.join(torn), bytes).unwrap();
        }
        let mut child = start(runs.path(), &resumed);
        wait_for(&file, 18, &mut child);
        let pid = child.id().to_string();
        assert!(std::process::Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
        let output = child.wait_with_output().unwrap();
        refused(&output, 130, &["interrupted after iteration", "--resume continues"]);
        train(runs.path(), &resumed);
        same(&whole.path().join("t/seed-1"), &seed);
        assert!(!runs.path().join("t-2").exists());
    }

    #[test]
    fn more_iterations_and_seeds_continue_on_any_number_of_threads() {
        let straight = tempfile::tempdir().unwrap();
        let goal = ["--seeds", "2", "--set", "train.environments=300", "--set", "train.iterations=4"];
        train(straight.path(), &[&goal[..], &["--threads", "3"]].concat());
        let grown = tempfile::tempdir().unwrap();
        for iterations in ["1", "2", "3"] {
            let set = format!("train.iterations={iterations}");
            let more = ["--set", "train.environments=300", "--resume", "--threads", "1", "--set", &set];
            train(grown.path(), &more);
        }
        train(grown.path(), &[&goal[..], &["--threads", "2", "--resume"]].concat());
        for seed in ["seed-1", "seed-2"] {
            same(&straight.path().join("t").join(seed), &grown.path().join("t").join(seed));
        }
    }
}

#[test]
fn a_checkpoint_of_something_else_is_refused_by_name() {
    let runs = tempfile::tempdir().unwrap();
    train(runs.path(), &["--seeds", "2", "--set", "train.iterations=1"]);
    let resume = |more: &[&str]| {
        run(&args(
            runs.path(),
            &[&["--seeds", "2", "--resume", "--set", "train.iterations=2"], more].concat(),
        ))
    };
    let changed = resume(&["--set", "ppo.gamma=0.98"]);
    refused(&changed, 2, &["`ppo.gamma` was 0.99, now it is 0.98", "config.toml", "without --resume"]);
    refused(&resume(&["--set", "task.rewards.gait=9"]), 2, &["`task.rewards.gait`", "now it is 9"]);
    refused(&resume(&["--set", "train.environments=41"]), 2, &["`train.environments` was 40"]);

    let folder = tempfile::tempdir().unwrap();
    let go2 = std::fs::read_to_string(root().join("assets/go2.xml")).unwrap();
    let with = |old: &str, new: &str| {
        assert!(go2.contains(old), "{old}");
        let path = folder.path().join("robot.xml");
        std::fs::write(&path, go2.replacen(old, new, 1)).unwrap();
        resume(&["--set", &format!("robot={}", path.display())])
    };
    let words = ["seed-1/checkpoint.safetensors", "another training"];
    refused(&with("model=\"go2\"", "model=\"a1\""), 1, &[&words[..], &["`go2`", "`a1`"]].concat());
    refused(&with("armature=\"", "armature=\"0.1"), 1, &[&words[..], &["has changed"]].concat());

    let [first, second] =
        [1, 2].map(|seed| runs.path().join(format!("t/seed-{seed}/checkpoint.safetensors")));
    let bytes = std::fs::read(&first).unwrap();
    std::fs::copy(&second, &first).unwrap();
    refused(&resume(&[]), 1, &[&words[..], &["it is of seed 2"]].concat());
    for length in [0, 7, 100, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(&first, &bytes[..length]).unwrap();
        refused(&resume(&[]), 1, &["seed-1/checkpoint.safetensors", "cut short or damaged", "--resume"]);
    }
    std::fs::copy(runs.path().join("t/seed-1/policy.safetensors"), &first).unwrap();
    refused(&resume(&[]), 1, &["seed-1/checkpoint.safetensors", "not a checkpoint's"]);
    // Back in its place, it goes on.
    std::fs::write(&first, &bytes).unwrap();
    assert_eq!(resume(&[]).status.code(), Some(0));
}

#[test]
fn settings_that_cannot_be_are_refused_before_anything_is_written() {
    let runs = tempfile::tempdir().unwrap();
    for (set, words) in [
        ("train.environments=0", &["train.environments is 0", "gaitfit config train"][..]),
        ("train.steps=0", &["train.steps is 0"]),
        ("train.iterations=0", &["`train.iterations`"]),
        ("train.enviroments=5", &["Did you mean `environments`?"]),
        ("task.rewards.speed=1", &["`speed`", "track_linear_velocity"]),
        ("task.rewards.gait=\"fast\"", &["invalid type"]),
        ("task.base=hop", &["unknown variant `hop`"]),
        ("task.command.x=[1.0, -1.0]", &["task.command.x"]),
        ("task.feet=[\"FL_foot\", \"FX_foot\"]", &["FX_foot"]),
        ("task.policy.observation=[{ quantity = \"sonar\" }]", &["`sonar`"]),
        ("task.policy.observation=[]", &["task.policy", "the observation has no terms"]),
        ("task.policy.critic_observation=[]", &["critic_observation has no terms"]),
        ("ppo.gamma=2", &["[ppo] `gamma` is 2"]),
        ("ppo.minibatches=1000", &["minibatches"]),
        ("ppo.actor_hidden=[0]", &["`actor_hidden`"]),
        ("seeds=[]", &["`seeds`"]),
        ("seeds=[1, 1]", &["`seeds` has 1 twice"]),
        ("checkpoint_seconds=nan", &["`checkpoint_seconds`"]),
        ("robot=nothing.xml", &["nothing.xml", "does not exist"]),
        ("name=../up", &["cannot name a run folder"]),
        ("preset=slow", &["unknown variant `slow`"]),
    ] {
        let mut args = args(runs.path(), &["--set", set]);
        if set.starts_with("name") {
            args.retain(|argument| argument != "--name" && argument != "t");
        }
        refused(&run(&args), 2, words);
    }
    assert_eq!(run(&["train", "--seeds", "0"]).status.code(), Some(2));
    assert_eq!(run(&["train", "--seeds", "a,b"]).status.code(), Some(2));
    refused(&run(&["train", "no/such.toml"]), 2, &["no/such.toml", "gaitfit config train"]);
    assert_eq!(std::fs::read_dir(runs.path()).unwrap().count(), 0, "a refused run leaves no folder");
}

#[test]
fn a_number_that_is_not_finite_stops_the_run_and_keeps_the_checkpoint() {
    let runs = tempfile::tempdir().unwrap();
    let more = ["--set", "ppo.schedule=fixed", "--set", "ppo.learning_rate=1e30"];
    let output = run(&args(runs.path(), &more));
    refused(
        &output,
        1,
        &["seed 1, iteration", "not finite", "Kept from iteration 0", "checkpoint.safetensors"],
    );
    assert!(runs.path().join("t/seed-1/checkpoint.safetensors").exists());
}

#[test]
fn printed_settings_are_a_configuration_to_start_from() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.toml");
    for task in ["velocity", "biped"] {
        std::fs::write(&path, run(&["config", "train", "--task", task]).stdout).unwrap();
        let mut args = args(folder.path(), &["--set", "train.iterations=1"]);
        args.insert(1, path.to_str().unwrap().to_owned());
        let output = run(&args);
        assert_eq!(json(&output)["task"], task, "{}", errors(&output));
    }
}

#[test]
fn bench_prints_what_it_measured() {
    let args = ["bench", "train", "--environments", "64", "--iterations", "3", "--threads", "1", "--json"];
    let found = json(&run(&args));
    let number = |key: &str| found[key].as_f64().unwrap();
    let parts = number("rollout_seconds") + number("update_seconds");
    assert!((parts / number("iteration_seconds") - 1.0).abs() < 0.5, "{found}");
    assert!(number("samples_per_second") > 0.0 && number("rollout_seconds") > 0.0);
    assert_eq!(
        (&found["environments"], &found["threads"], &found["iterations"]),
        (&64.into(), &1.into(), &3.into())
    );
    #[cfg(target_os = "linux")]
    assert!(number("peak_memory_bytes") > 1e6);
    assert_eq!(run(&["bench", "train", "--environments", "0"]).status.code(), Some(2));
}
