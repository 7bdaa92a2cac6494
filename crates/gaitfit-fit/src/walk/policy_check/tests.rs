//! Tests of policies and logs that do not belong together.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::*;
use crate::walk::fixtures::{clocked, logs, policy, policy_with, puppet, scene};
use gaitfit_learn::ppo::MemorySettings;
use gaitfit_learn::task::{Task, TaskSettings};
use gaitfit_log::BaseState;
use gaitfit_physics::Preset;
use gaitfit_policy::{Quantity, Term};

fn judged(policy: &Policy, logs: &[Trajectory]) -> (PolicyMatch, Result<Vec<String>, Error>) {
    let policy_match = check(policy, &logs.iter().collect::<Vec<_>>());
    let names: Vec<String> = (0..logs.len()).map(|k| format!("log-{k}.csv")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let verdict = policy_match.judge("walk.safetensors", &names);
    (policy_match, verdict)
}

/// Logs whose actions are changed row by row: `change(row, actions of the log)`.
fn changed(logs: &[Trajectory], change: impl Fn(usize, &[f64]) -> Vec<f64>) -> Vec<Trajectory> {
    let mut logs = logs.to_vec();
    for log in &mut logs {
        let action = log.action.clone().unwrap();
        log.action = Some((0..log.len()).flat_map(|row| change(row, &action)).collect());
    }
    logs
}

#[test]
fn the_policy_that_walked_is_known() {
    let scene = scene();
    let policy = policy(&scene, 3);
    let (policy_match, verdict) = judged(&policy, &logs(&scene, &policy, true));
    assert!(policy_match.exact && policy_match.mismatch < 1e-4, "{policy_match:?}");
    assert!(verdict.unwrap().is_empty());
    let (policy_match, verdict) = judged(&policy, &logs(&scene, &policy, false));
    assert!(!policy_match.exact && policy_match.mismatch < 0.5 * DOUBTFUL, "{policy_match:?}");
    assert!(verdict.unwrap().is_empty());
}

#[test]
fn another_policy_is_refused_by_name() {
    let scene = scene();
    let (walked, other) = (policy(&scene, 3), policy(&scene, 4));
    for privileged in [true, false] {
        let (policy_match, verdict) = judged(&other, &logs(&scene, &walked, privileged));
        let text = verdict.unwrap_err().to_string();
        assert!(text.contains("walk.safetensors") && text.contains("log-"), "{text} {policy_match:?}");
    }
}

#[test]
fn joints_in_another_order_are_refused() {
    let scene = scene();
    let policy = policy(&scene, 3);
    let swapped = changed(&logs(&scene, &policy, false), |row, action| {
        let mut row = action[12 * row..12 * row + 12].to_vec();
        row.rotate_left(3);
        row
    });
    let (policy_match, verdict) = judged(&policy, &swapped);
    assert!(verdict.is_err(), "{policy_match:?}");
}

#[test]
fn actions_in_another_unit_are_told() {
    let scene = scene();
    let policy = policy(&scene, 3);
    let scaled = changed(&logs(&scene, &policy, false), |row, action| {
        action[12 * row..12 * row + 12].iter().map(|x| 0.25 * x).collect()
    });
    let (policy_match, verdict) = judged(&policy, &scaled);
    assert!(verdict.is_err(), "{policy_match:?}");
}

#[test]
fn actions_a_sample_late_are_told() {
    let scene = scene();
    let policy = policy(&scene, 3);
    for (privileged, offset, word) in [(true, -1, "later"), (false, -1, "later"), (false, 1, "earlier")] {
        let moved = changed(&logs(&scene, &policy, privileged), |row, action| {
            let last = action.len() / 12 - 1;
            let row = row.saturating_add_signed(offset).min(last);
            action[12 * row..12 * row + 12].to_vec()
        });
        let (policy_match, verdict) = judged(&policy, &moved);
        let warnings = verdict.unwrap();
        let expected = format!("one sample {word} than");
        assert!(warnings[0].contains(&expected), "{warnings:?} {policy_match:?}");
    }
}

#[test]
fn a_policy_that_sees_the_past_is_known_by_whole_logs_alone() {
    let mut settings = TaskSettings::default().calm();
    settings.policy.observation.iter_mut().for_each(|term| term.history = 4);
    let scene = Task::new(&crate::robot::go2().unwrap(), &settings, Preset::Fast).unwrap();
    let (walked, other) = (policy(&scene, 3), policy(&scene, 4));
    let whole = logs(&scene, &walked, true);
    let (policy_match, verdict) = judged(&walked, &whole);
    assert!(
        policy_match.exact && policy_match.mismatch < 1e-4 && policy_match.samples > 100,
        "{policy_match:?}"
    );
    assert!(verdict.unwrap().is_empty());
    assert!(judged(&other, &whole).1.is_err());
    let (_, verdict) = judged(&walked, &logs(&scene, &walked, false));
    assert!(verdict.unwrap()[0].contains("do not show whether"));
}

#[test]
fn a_policy_that_sees_the_action_before_the_last_is_known_by_whole_logs() {
    for history in [1, 3] {
        let mut settings = TaskSettings::default().calm();
        settings.policy.observation.push(Term::new(Quantity::EarlierAction).scaled(&[0.5]));
        settings.policy.observation.iter_mut().for_each(|term| term.history = history);
        let scene = Task::new(&crate::robot::go2().unwrap(), &settings, Preset::Fast).unwrap();
        let walked = policy(&scene, 3);
        let (policy_match, verdict) = judged(&walked, &logs(&scene, &walked, true));
        assert!(
            policy_match.exact && policy_match.mismatch < 1e-4 && policy_match.samples > 100,
            "{policy_match:?}"
        );
        assert!(verdict.unwrap().is_empty());
    }
}

/// A policy of another program, and the Go2 under it.
fn foreign(name: &str) -> (Policy, Task) {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../gaitfit-policy-files/tests/fixtures/policies/");
    let policy = gaitfit_policy_files::read((folder.to_owned() + name).as_ref()).unwrap();
    let settings = TaskSettings::default().calm();
    let model = crate::robot::go2().unwrap();
    let scene = Task::with_interface(&model, &settings, policy.interface.clone(), Preset::Fast, 0.0).unwrap();
    (policy, scene)
}

#[test]
fn policies_with_a_memory_or_a_graph_are_known_along_whole_logs() {
    let others = ["lstm.toml", "graphs/estimator.toml", "graphs/dreamwaq.toml", "graphs/him.toml"];
    for name in others {
        let (walked, scene) = foreign(name);
        let whole = logs(&scene, &walked, true);
        let (policy_match, verdict) = judged(&walked, &whole);
        assert!(policy_match.mismatch < 1e-3 && policy_match.samples > 40, "{name}: {policy_match:?}");
        assert!(verdict.unwrap().is_empty());
        let (other, _) = foreign("gru.toml");
        assert!(judged(&other, &whole).1.is_err());
        if walked.is_recurrent() {
            let (_, verdict) = judged(&walked, &logs(&scene, &walked, false));
            assert!(verdict.unwrap()[0].contains("do not show whether"));
        }
    }
}

/// Logs of policies with a gait clock may begin at any of its phases.
#[test]
fn a_policy_with_a_memory_is_known_whenever_its_gait_clock_began() {
    let scene = clocked();
    let memory = MemorySettings { width: 16, ..MemorySettings::default() };
    let (walked, other) = (policy_with(&scene, 3, Some(memory)), policy_with(&scene, 4, Some(memory)));
    let log = |number: usize| {
        let log = puppet(&walked, number, 2.0);
        let still = Some(vec![0.0; 3 * log.len()]);
        let base = BaseState {
            position: still.clone(),
            quaternion: Some([1.0, 0.0, 0.0, 0.0].repeat(log.len())),
            linear_velocity: still.clone(),
            angular_velocity: still,
        };
        let log = Trajectory { base: Some(base), ..log };
        // The clock is at its other half then.
        log.slice(10..log.len()).unwrap()
    };
    let logs = [log(1), log(2)];
    let (policy_match, verdict) = judged(&walked, &logs);
    assert!(policy_match.samples > 100 && policy_match.mismatch < 0.25 * DOUBTFUL, "{policy_match:?}");
    assert!(verdict.unwrap().is_empty());
    assert!(judged(&other, &logs).0.mismatch > DOUBTFUL);
}

#[test]
fn too_few_samples_say_nothing() {
    let scene = scene();
    let policy = policy(&scene, 3);
    let short = logs(&scene, &policy, true)[0].slice(0..10).unwrap();
    let (_, verdict) = judged(&policy, &[short]);
    assert!(verdict.unwrap()[0].contains("do not show whether"));
}
