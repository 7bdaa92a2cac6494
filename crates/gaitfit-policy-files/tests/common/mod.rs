//! A Go2 and policies for it, with what the tests of `gaitfit-policy` have in common.
#![allow(clippy::unwrap_used, dead_code, reason = "a failed unwrap is a failed test; no test uses all of it")]

use gaitfit_policy::network::{Activation, Network, Normaliser, Scratch, Shape};
use gaitfit_policy::{Policy, Provenance};
use std::path::{Path, PathBuf};

#[path = "../../../gaitfit-policy/tests/common/mod.rs"]
mod of_policy;
pub use of_policy::{ACTIVATIONS, go2, interface, motion, root};

/// A file of the policies made by `tools/make_policy_fixtures.py`.
pub fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/policies").join(name)
}

/// Observations and the actions that another program computed for them.
pub fn rows(name: &str) -> [Vec<f32>; 2] {
    let table: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(fixture(name)).unwrap()).unwrap();
    ["observation", "actions"].map(|key| {
        let rows = table[key].as_array().unwrap().iter();
        rows.flat_map(|row| row.as_array().unwrap()).map(|x| x.as_f64().unwrap() as f32).collect()
    })
}

/// Numbers without a pattern, in ±1, the same every time.
pub fn numbers(count: usize, seed: u32) -> Vec<f32> {
    let mut state = seed.wrapping_mul(2_654_435_761).wrapping_add(1);
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 23) as f32 - 1.0
    };
    (0..count).map(|_| next()).collect()
}

/// A random policy with critic and normalisers.
pub fn policy(activation: Activation) -> Policy {
    let shape = |inputs, outputs| Shape { inputs, hidden: vec![24, 16], outputs, activation };
    let normaliser = |width: usize| Normaliser {
        mean: numbers(width, 7).into_iter().map(f64::from).map(|x| x / 3.0).collect(),
        variance: numbers(width, 8).into_iter().map(|x| 0.1 + f64::from(x) * f64::from(x)).collect(),
        count: 12345.678,
    };
    Policy {
        interface: interface(),
        front: None,
        actor: Network::random(shape(45, 12), 1, 0, 1.0).unwrap(),
        log_std: numbers(12, 3),
        critic: Some(Network::random(shape(48, 1), 1, 1, 1.0).unwrap()),
        normaliser: Some(normaliser(45)),
        critic_memory: None,
        critic_normaliser: Some(normaliser(48)),
        provenance: Provenance {
            seed: u64::MAX - 1,
            configuration_hash: "0123abcd".into(),
            iteration: 300,
            program_version: "0.1.0".into(),
            task: "episode_seconds = 20.0\n".into(),
            parent: "4567".into(),
            theta: "89ef".into(),
            robot_file: Some(gaitfit_policy::RobotFile {
                path: "/robots/go2.xml".into(),
                sha256: "0f1e".into(),
                lenient: true,
            }),
        },
        notes: Vec::new(),
    }
}

/// Mean actions of `rows` rows.
pub fn act(policy: &Policy, observation: &[f32]) -> Vec<f32> {
    let rows = observation.len() / policy.interface.observation_width();
    let mut actions = vec![f32::NAN; rows * policy.actor.shape.outputs];
    policy.act(rows, observation, &mut actions, &mut Scratch::default());
    actions
}

/// Largest difference; NaN counts as infinite.
pub fn largest_difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, |worst, d| {
        if d <= worst {
            worst
        } else if d.is_nan() {
            f32::INFINITY
        } else {
            d
        }
    })
}

/// Actions of `robots` robots along the rows of a sequence, robot after robot within a step. All see the same.
pub fn along(policy: &Policy, observation: &[f32], robots: usize) -> Vec<Vec<f32>> {
    let (mut memory, mut scratch) = (policy.memory(robots), Scratch::default());
    let mut actions = Vec::new();
    for row in observation.chunks_exact(policy.interface.observation_width()) {
        let mut action = vec![f32::NAN; robots * policy.interface.joints.len()];
        policy.act_with(robots, &row.repeat(robots), &mut memory, &mut action, &mut scratch);
        actions.push(action);
    }
    actions
}
