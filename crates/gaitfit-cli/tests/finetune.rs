//! `gaitfit finetune`: where it starts, what it keeps, resuming to the same bits, and what it refuses.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, json, run};
use gaitfit_policy::Policy;
use gaitfit_policy_files::weights;
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

const SMALL: [&str; 4] =
    ["train.environments=48", "train.steps=8", "ppo.epochs=2", "checkpoint_seconds=0.001"];

fn with_sets(mut args: Vec<String>, sets: &[&str]) -> Vec<String> {
    for set in SMALL.iter().chain(sets) {
        args.extend(["--set".to_owned(), (*set).to_owned()]);
    }
    args
}

/// A barely trained policy of small networks.
fn parent(folder: &Path) -> PathBuf {
    let runs = format!("runs={}", folder.display());
    let args = ["train", "--name", "parent"].map(str::to_owned).to_vec();
    let sets = [&runs, "train.iterations=1", "ppo.actor_hidden=[16]", "ppo.critic_hidden=[12]"];
    let output = run(&with_sets(args, &sets));
    assert!(output.status.success(), "{}", errors(&output));
    folder.join("parent/seed-1/policy.safetensors")
}

/// Fitted parameters of every kind: a joint's, a delay, a network, a number of the robot.
fn theta(folder: &Path, joint: &str) -> PathBuf {
    let path = folder.join(format!("theta-{joint}.toml"));
    let weights: Vec<String> = (0..97).map(|index| format!("{:.3}", 0.01 * f64::from(index % 7))).collect();
    let text = format!(
        "format = 2\nrobot = \"go2\"\n\
         [[parameter]]\nname = \"armature\"\nkind = \"armature\"\njoints = [\"{joint}\"]\nvalue = 0.03\n\
         [[parameter]]\nname = \"delay\"\nkind = \"delay\"\njoints = [\"FL_calf_joint\"]\nvalue = 0.012\n\
         [[parameter]]\nname = \"base_mass\"\nkind = \"base_mass\"\nvalue = 0.5\n\
         [[network]]\nname = \"n\"\nkind = \"resid_act\"\njoint = \"RR_calf_joint\"\nrest = -1.5\n\
         position_scale = 1.0\nvelocity_scale = 0.1\noutput_scale = 1.0\nweights = [{}]\n",
        weights.join(", ")
    );
    std::fs::write(&path, text).unwrap();
    path
}

fn args(runs: &Path, policy: &Path, iterations: u32, more: &[&str]) -> Vec<String> {
    let mut args = ["finetune", "--json", "--name", "f"].map(str::to_owned).to_vec();
    args.push(policy.display().to_string());
    let sets = [format!("runs={}", runs.display()), format!("train.iterations={iterations}")];
    let mut args = with_sets(args, &[&sets[0], &sets[1]]);
    // The last setting of a key wins.
    args.extend(more.iter().map(|&argument| argument.to_owned()));
    args
}

/// The document of a run that ended. If the policy does not walk afterwards, the run warns and ends with exit code 3.
fn ended(output: &std::process::Output) -> serde_json::Value {
    let result = json(output);
    let doubted = result["doubts"].as_array().is_some_and(|doubts| !doubts.is_empty());
    let code = if doubted && result["trained"] == true { 3 } else { 0 };
    assert_eq!(output.status.code(), Some(code), "{}", errors(output));
    assert_eq!(errors(output).contains("does not walk"), code == 3, "{}", errors(output));
    result
}

fn read(path: &Path) -> Policy {
    weights::read(&std::fs::read(path).unwrap()).unwrap()
}

fn outcome(runs: &Path) -> PathBuf {
    runs.join("f/seed-1/policy.safetensors")
}

fn sha256(path: &Path) -> String {
    Sha256::digest(std::fs::read(path).unwrap()).iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn resumed_it_ends_with_the_same_bits_and_says_where_it_came_from() {
    let folders: Vec<_> = (0..3).map(|_| tempfile::tempdir().unwrap()).collect();
    let policy = parent(folders[0].path());
    let theta = theta(folders[0].path(), "FL_hip_joint");
    let simulator = ["--theta", theta.to_str().unwrap(), "--torque-noise", "0.5"];
    let more: Vec<&str> = simulator.iter().chain(&["--set", "ppo.critic_warmup=1"]).copied().collect();
    let output = run(&args(folders[1].path(), &policy, 4, &more));
    ended(&output);
    let whole = read(&outcome(folders[1].path()));

    assert_eq!(whole.provenance.parent, sha256(&policy));
    assert_eq!(whole.provenance.theta, sha256(&theta));
    assert_eq!(whole.provenance.iteration, 4);
    assert_eq!(whole.log_std, vec![0.5_f32.ln(); 12]);
    let parent = read(&policy);
    assert_eq!(whole.interface, parent.interface);
    assert_ne!(whole.actor, parent.actor);
    assert!(parent.provenance.parent.is_empty());
    let result = json(&output);
    assert_eq!(result["parent"]["policy_sha256"], whole.provenance.parent);
    assert_eq!(result["trained"], true);
    assert!(result["parent"]["simulator"].as_str().unwrap().contains("torque noise of 0.5"), "{result}");

    // In two parts, on another number of threads.
    for (iterations, on) in [(2, &["--threads", "1"][..]), (4, &["--threads", "2", "--resume"])] {
        let mut more = more.clone();
        more.extend(on);
        let output = run(&args(folders[2].path(), &policy, iterations, &more));
        ended(&output);
    }
    let bytes = |runs: &Path| std::fs::read(outcome(runs)).unwrap();
    assert!(bytes(folders[2].path()) == bytes(folders[1].path()), "a run in two parts ends elsewhere");

    // The run's own configuration does the same again: files, hashes and task are in it.
    let config = folders[1].path().join("f/config.toml");
    let again = ["finetune", "--json", "--name", "g", "--config", config.to_str().unwrap()];
    let output = run(&again);
    ended(&output);
    let again = std::fs::read(folders[1].path().join("g/seed-1/policy.safetensors")).unwrap();
    assert!(again == bytes(folders[1].path()), "the run's configuration trains something else");

    // Another policy or other parameters are another run.
    let other_theta = self::theta(folders[0].path(), "FL_thigh_joint");
    let other = ["--theta", other_theta.to_str().unwrap(), "--torque-noise", "0.5", "--resume"];
    for (policy, more, word) in [
        (&outcome(folders[1].path()), [&simulator[..], &["--resume"]].concat(), "`policy_sha256` was"),
        (&policy, other.to_vec(), "`theta_sha256` was"),
        (&policy, vec!["--torque-noise", "0.5", "--resume"], "`theta_sha256` was"),
    ] {
        let more: Vec<&str> = more.into_iter().chain(["--set", "ppo.critic_warmup=1"]).collect();
        let output = run(&args(folders[1].path(), policy, 5, &more));
        assert_eq!(output.status.code(), Some(2), "{word}: {}", errors(&output));
        assert!(errors(&output).contains(word), "{word}: {}", errors(&output));
    }
}

#[test]
fn it_starts_with_the_bits_of_the_policy_given() {
    let folder = tempfile::tempdir().unwrap();
    let policy = parent(folder.path());
    let output = run(&args(folder.path(), &policy, 2, &["--set", "ppo.critic_warmup=2"]));
    ended(&output);
    let (before, after) = (read(&policy), read(&outcome(folder.path())));
    // The critic has learned alone.
    assert_eq!(after.actor, before.actor);
    assert_ne!(after.critic, before.critic);
    let result = json(&output);
    assert_eq!(result["parent"]["new_critic"], false);
    // The result, the page and the table say so, the result and the table at first.
    assert_eq!(result.as_object().unwrap().iter().next().unwrap(), (&"trained".to_owned(), &false.into()));
    assert!(result["warnings"][0].as_str().unwrap().contains("is not trained"), "{result}");
    let page = std::fs::read_to_string(folder.path().join("f/report.html")).unwrap();
    assert!(page.contains("the policy is not trained"));
    let config = folder.path().join("f/config.toml");
    let again = run(&["finetune", "--config", config.to_str().unwrap(), "--name", "f", "--resume"]);
    let table = String::from_utf8(again.stdout).unwrap();
    assert!(table.lines().next().unwrap().contains("is not trained"), "{table}");
}

#[test]
fn a_policy_without_critic_gets_one() {
    let folder = tempfile::tempdir().unwrap();
    let policy = parent(folder.path());
    let onnx = folder.path().join("walk.onnx");
    let output = run(&["export", policy.to_str().unwrap(), "--onnx", onnx.to_str().unwrap()]);
    assert!(output.status.success(), "{}", errors(&output));
    let output = run(&args(folder.path(), &onnx, 1, &["--set", "ppo.critic_hidden=[8]"]));
    ended(&output);
    let (before, after) = (read(&policy), read(&outcome(folder.path())));
    assert_eq!(after.critic.unwrap().shape.hidden, [8]);
    assert_eq!(after.actor, before.actor, "the new critic is to learn alone at first");
    assert_eq!(json(&output)["parent"]["new_critic"], true);
}

#[test]
fn what_cannot_be_fine_tuned_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let policy = parent(folder.path());
    let lost = theta(folder.path(), "FL_wheel_joint");
    let low = folder.path().join("low.toml");
    std::fs::write(&low, "height = -0.3\n").unwrap();
    for (more, word) in [
        (vec!["--set", "ppo.fixed_std=0"], "fixed_std"),
        (vec!["--set", "ppo.fixed_std=-0.5"], "fixed_std"),
        (vec!["--theta", lost.to_str().unwrap()], "FL_wheel_joint"),
        (vec!["--theta", "nowhere.toml"], "nowhere.toml"),
        (vec!["--spring", "XX_calf_joint=75"], "XX_calf_joint"),
        (vec!["--torque-noise=-1"], "--torque-noise"),
        (vec!["--set", "torque_noise=1e300"], "`torque_noise` (--torque-noise) is 1e300"),
        (vec!["--set", "spring=[\"RR_calf_joint=-75\"]"], "stiffness -75"),
        (vec!["--seeds", "18446744073709551615,"], "`seeds` has 18446744073709551615"),
        (vec!["--robot", "none.xml"], "none.xml"),
        (vec!["--set", "ppo.actor_hidden=[7]"], "actor_hidden"),
        (vec!["--set", "ppo.normalise_observations=true"], "normalise_observations"),
        (vec!["--set", "task.policy.kp=30"], "task.policy"),
        (vec!["--set", "task.control_dt=0.01"], "task.control_dt"),
        (vec!["--set", "task.rewards.walk=1"], "walk"),
        (vec!["--set", "task.heigth=1"], "heigth"),
        (vec!["--set", "ppo.gama=1"], "gamma"),
        (vec!["--set", "train.environments=0"], "environments"),
        (vec!["--task", "swim"], "swim"),
        (vec!["--task", low.to_str().unwrap()], "low.toml: task.height is -0.3"),
        (
            vec!["--set", "task.height=-0.3"],
            "task.height is -0.3; it must be from 0 to 10000. `gaitfit config finetune`",
        ),
    ] {
        let output = run(&args(folder.path(), &policy, 1, &more));
        assert!(matches!(output.status.code(), Some(1 | 2)), "{more:?}: {}", output.status);
        assert!(errors(&output).contains(word), "{more:?}: {}", errors(&output));
    }
    let output = run(&["finetune"]);
    assert!(errors(&output).contains("no policy"), "{}", errors(&output));
    assert!(!folder.path().join("f").exists(), "a refused run leaves a folder");

    // Of another robot.
    let text = std::fs::read_to_string(common::root().join("assets/go2.xml")).unwrap();
    let other = folder.path().join("other.xml");
    std::fs::write(&other, text.replace("RR_calf_joint", "RR_knee_joint")).unwrap();
    let output = run(&args(folder.path(), &policy, 1, &["--robot", other.to_str().unwrap()]));
    assert_eq!(output.status.code(), Some(1));
    assert!(errors(&output).contains("RR_calf_joint"), "{}", errors(&output));
}

#[test]
fn robots_are_drawn_from_what_the_fit_leaves_open() {
    let folder = tempfile::tempdir().unwrap();
    let policy = parent(folder.path());
    let theta = theta(folder.path(), "FL_hip_joint");
    let drawn =
        ["--theta", theta.to_str().unwrap(), "--set", "randomise_theta=true", "--set", "ppo.critic_warmup=0"];
    let output = run(&args(folder.path(), &policy, 1, &drawn));
    assert_eq!(output.status.code(), Some(1), "{}", errors(&output));
    assert!(
        errors(&output).contains("draws.csv") && errors(&output).contains("fit again"),
        "{}",
        errors(&output)
    );
    let output = run(&args(folder.path(), &policy, 1, &drawn[2..]));
    assert!(output.status.code() == Some(2) && errors(&output).contains("--theta"), "{}", errors(&output));
    assert!(!folder.path().join("f").exists(), "nothing is written before the draws are there");

    // Draws that are all the fit's own numbers train as the fit does; others do not.
    let draws = folder.path().join("draws.csv");
    let trained = |rows: &str| {
        std::fs::write(&draws, format!("delay,armature,base_mass,resid_act_RR_calf_offset\n{rows}")).unwrap();
        let runs = tempfile::tempdir().unwrap();
        let output = run(&args(runs.path(), &policy, 2, &drawn));
        ended(&output);
        assert!(json(&output)["parent"]["simulator"].as_str().unwrap().contains(" draws of "));
        read(&outcome(runs.path())).actor
    };
    let plain = tempfile::tempdir().unwrap();
    let point = [&drawn[..2], &["--set", "ppo.critic_warmup=0"]].concat();
    let output = run(&args(plain.path(), &policy, 2, &point));
    ended(&output);
    let same = trained("0.012,0.03,0.5,0.1\n0.012,0.03,0.5,0.2\n");
    assert!(same == read(&outcome(plain.path())).actor);
    assert!(trained("0.012,0.03,0.5,0.1\n0.004,0.01,1.5,0.2\n") != same);
}
