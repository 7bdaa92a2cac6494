//! Policies beside the programs that run them: readings, actions and targets of `tools/check_mjlab.py` and
//! `tools/check_unitree_rl_lab.py`, made by mjlab's environments and by unitree_rl_lab's program for robots.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{fixture, largest_difference};
use gaitfit_policy::observation::Sensed;
use gaitfit_policy::{Pilot, Quantity};
use gaitfit_policy_files::read;
use serde_json::Value;

fn numbers(row: &Value) -> Vec<f32> {
    row.as_array().unwrap().iter().map(|x| x.as_f64().unwrap() as f32).collect()
}

/// Largest differences of the policy's actions and targets from the program's. The last action is gaitfit's own.
fn differences(policy: &str, steps: &str) -> [f32; 2] {
    let policy = read(&fixture(policy)).unwrap();
    let table: Value = serde_json::from_str(&std::fs::read_to_string(fixture(steps)).unwrap()).unwrap();
    let theirs: Vec<&str> =
        table["joints"].as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect();
    let order: Vec<usize> = policy
        .interface
        .joints
        .iter()
        .map(|joint| theirs.iter().position(|name| name == joint).unwrap())
        .collect();
    let ordered = |row: &Value| -> Vec<f32> {
        let row = numbers(row);
        order.iter().map(|&place| row[place]).collect()
    };
    let begins: Vec<u64> =
        table["begins"].as_array().unwrap().iter().map(|step| step.as_u64().unwrap()).collect();
    let readings = &table["readings"];
    let (mut pilot, mut sensed) = (Pilot::new(&policy).unwrap(), Sensed::new(order.len()));
    let mut worst = [0.0_f32; 2];
    let count = table["actions"].as_array().unwrap().len();
    assert!(count >= 10, "{count}");
    for step in 0..count {
        if begins.contains(&(step as u64)) {
            pilot.begin();
        }
        let [w, x, y, z] = numbers(&readings["base_quaternion"][step])[..] else { unreachable!() };
        sensed.orient([w, x, y, z]);
        for quantity in [Quantity::BaseAngularVelocity, Quantity::ProjectedGravity, Quantity::Command] {
            if let Some(row) = readings.get(quantity.name()) {
                assert!(sensed.set(quantity, &numbers(&row[step])));
            }
        }
        for quantity in [Quantity::JointPosition, Quantity::JointVelocity] {
            assert!(sensed.set(quantity, &ordered(&readings[quantity.name()][step])));
        }
        let (action, targets) = pilot.step(&mut sensed);
        for (worst, (found, wanted)) in
            worst.iter_mut().zip([(action, &table["actions"]), (targets, &table["targets"])])
        {
            *worst = worst.max(largest_difference(found, &ordered(&wanted[step])));
        }
    }
    worst
}

#[test]
fn mjlabs_environments_and_gaitfit_compute_the_same_actions() {
    for (policy, name) in [("mjlab_changed.onnx", "mjlab_changed"), ("mjlab_tracking.toml", "mjlab_tracking")]
    {
        let [actions, targets] =
            differences(&format!("trainers/{policy}"), &format!("trainers/{name}_steps.json"));
        assert!(actions < 5e-6, "{name}: {actions}");
        // The metadata's action scales have three decimals.
        assert!(targets < 5e-4, "{name}: {targets}");
    }
}

#[test]
fn unitrees_program_for_robots_and_gaitfit_compute_the_same_actions() {
    let [actions, targets] = differences("unitree/exported/policy.onnx", "trainers/unitree_steps.json");
    assert!(actions < 5e-6 && targets < 5e-6, "{actions} {targets}");
}
