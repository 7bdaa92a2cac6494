//! Policies of other trainers as their users export them: fixtures of `tools/make_trainer_fixtures.py`, made with these
//! trainers' own libraries.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{along, fixture, largest_difference, rows};
use gaitfit_policy::network::Activation;
use gaitfit_policy::{Front, Policy, Quantity};
use gaitfit_policy_files::{files_of, read};

fn policy(name: &str) -> Policy {
    read(&fixture(&format!("trainers/{name}"))).unwrap()
}

/// How far the policy's actions are from the trainer's.
fn difference(name: &str, policy: &Policy) -> f32 {
    let [observation, wanted] = rows(&format!("trainers/{name}_rows.json"));
    largest_difference(&along(policy, &observation, 1).concat(), &wanted)
}

#[test]
fn each_trainers_export_gives_its_actions() {
    // What reads it: layers, layers behind a memory, or a graph.
    for (name, kind) in [
        ("rsl_rl", "layers"),
        ("rsl_rl_two", "graph"),
        ("rsl_rl_beta", "graph"),
        ("rsl_rl_gru", "memory"),
        ("sb3_ppo", "graph"),
        ("sb3_sac", "graph"),
        ("skrl", "graph"),
        ("brax", "layers"),
    ] {
        let policy = policy(&format!("{name}.toml"));
        let found = match policy.front {
            None => "layers",
            Some(Front::Recurrent(_)) => "memory",
            _ => "graph",
        };
        assert_eq!(found, kind, "{name}");
        let difference = difference(name, &policy);
        assert!(difference < 3e-6, "{name}: {difference}");
    }
}

#[test]
fn a_brax_checkpoint_is_read_from_tensors() {
    let policy = policy("brax_tensors.toml");
    assert_eq!(
        (policy.actor.shape.activation, policy.actor.output),
        (Activation::Silu, Some(Activation::Tanh))
    );
    let difference = difference("brax", &policy);
    assert!(difference < 3e-6, "{difference}");
}

#[test]
fn mjlabs_metadata_give_scales_and_histories() {
    let policy = policy("mjlab.onnx");
    let difference = difference("mjlab", &policy);
    assert!(difference < 3e-6, "{difference}");
    let interface = &policy.interface;
    assert_eq!(
        interface.describe(&interface.observation),
        "63 numbers (3 × 3 base_angular_velocity + 3 projected_gravity + 3 command + 2 × 12 joint_position + 12 \
         joint_velocity + 12 last_action)"
    );
    let scale = |quantity: Quantity| {
        interface.observation.iter().find(|term| term.quantity == quantity).unwrap().scale.clone()
    };
    assert_eq!(scale(Quantity::Command), [2.0, 2.0, 0.25]);
    assert_eq!((scale(Quantity::BaseAngularVelocity), scale(Quantity::JointPosition)), (vec![0.25], vec![]));
    assert!(policy.notes[0].contains("no control period:") && policy.notes.len() == 1, "{:?}", policy.notes);
    assert_eq!(files_of(&fixture("trainers/mjlab.onnx")).unwrap().len(), 2);
}

#[test]
fn mjlabs_metadata_that_are_not_understood_are_named() {
    // Entries of the same length, so that the file stays whole.
    for (from, to, words) in [
        ("-100.000;100.000", "-000.100;000.100", "clips joint_velocity to [-0.1, 0.1]"),
        ("3.000,0.000,0.000,2", "2.000,0.000,0.000,2", "have 60 numbers, its network takes 63"),
        (
            "1.000,1.000,1.000,1.000,1.000,1.000",
            "0.000,1.000,1.000,1.000,1.000,1.000",
            "a history that is not flat",
        ),
        ("2.000;2.000;0.250", "2.000;2.000,0.250", "has 7 entries for 6 terms"),
        ("0.250,1.000,2.000;2", "0.2x0,1.000,2.000;2", "holds `0.2x0`, no number"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let mut bytes = std::fs::read(fixture("trainers/mjlab.onnx")).unwrap();
        let place = bytes.windows(from.len()).position(|window| window == from.as_bytes()).unwrap();
        bytes[place..place + from.len()].copy_from_slice(to.as_bytes());
        std::fs::write(folder.path().join("policy.onnx"), bytes).unwrap();
        let data = folder.path().join("mjlab.onnx.data");
        std::fs::copy(fixture("trainers/mjlab.onnx.data"), data).unwrap();
        let error = read(&folder.path().join("policy.onnx")).unwrap_err().to_string();
        assert!(error.contains(words), "`{words}` is not in `{error}`");
    }
}
