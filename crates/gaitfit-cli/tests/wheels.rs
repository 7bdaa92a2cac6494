//! `collect` and `adapt` with a robot on wheels, whose policy sends velocity targets to the wheels.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, json, root, run};
use gaitfit_log::{ReadOptions, Trajectory, read_csv, write_csv};
use gaitfit_policy::network::{Activation, Network, Shape};
use gaitfit_policy::{Interface, Policy, Quantity, Term};
use gaitfit_policy_files::weights;
use std::path::Path;

/// What the fit does not know of the wheels: friction, N·m, and rotor inertia, kg·m².
const TRUTH: [f64; 2] = [0.25, 0.03];
/// Radius of a wheel and half the distance from left to right, m.
const RADIUS_M: f64 = 0.08;
const HALF_TRACK_M: f64 = 0.18;

/// A linear policy of the rover: its wheels turn as the command asks, its legs rest.
fn policy() -> Policy {
    let walk = gaitfit_policy_files::read(&root().join("assets/go2-walk.safetensors")).unwrap();
    let legs = ["FL", "FR", "RL", "RR"];
    let parts = [("hip", 0.4, 0.25), ("knee", -0.8, 0.25), ("wheel", 0.0, 10.0)];
    let all = || legs.iter().flat_map(|leg| parts.iter().map(move |part| (leg, part)));
    let numbers = |number: fn(&(&str, f64, f64)) -> f64| all().map(|(_, part)| number(part)).collect();
    let gain =
        |leg: f64, wheel: f64| all().map(|(_, part)| if part.0 == "wheel" { wheel } else { leg }).collect();
    let joints: Vec<String> = all().map(|(leg, part)| format!("{leg}_{}", part.0)).collect();
    let interface = Interface {
        robot: "rover".into(),
        default_pose: numbers(|part| part.1),
        action_scale: numbers(|part| part.2),
        kp: gain(60.0, 0.0),
        kd: gain(1.5, 0.6),
        velocity_joints: joints.iter().filter(|name| name.ends_with("wheel")).cloned().collect(),
        joints: joints.clone(),
        observation: vec![Term::new(Quantity::Command)],
        critic_observation: Vec::new(),
        gait_frequency: None,
        ..walk.interface.clone()
    };
    let shape = Shape { inputs: 3, hidden: Vec::new(), outputs: joints.len(), activation: Activation::Elu };
    let mut parameters = vec![0.0; shape.parameters()];
    for (joint, name) in joints.iter().enumerate().filter(|(_, name)| name.ends_with("wheel")) {
        // In a turn to the left the right wheels are faster.
        let side = if name[1..].starts_with('L') { -1.0 } else { 1.0 };
        // Speed over radius, divided by 10, the action scale of the wheels.
        parameters[joint] = (1.0 / RADIUS_M / 10.0) as f32;
        parameters[2 * joints.len() + joint] = (side * HALF_TRACK_M / RADIUS_M / 10.0) as f32;
    }
    Policy {
        interface,
        actor: Network::new(shape, &parameters).unwrap(),
        front: None,
        critic: None,
        critic_memory: None,
        normaliser: None,
        critic_normaliser: None,
        provenance: gaitfit_policy::Provenance::default(),
        ..walk
    }
}

#[test]
fn walks_on_wheels_are_fitted_without_the_angles_of_the_wheels() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let rover =
        std::fs::read_to_string(root().join("crates/gaitfit-physics/tests/fixtures/rover.xml")).unwrap();
    let [friction, armature] = TRUTH;
    let in_file = "damping=\"0.02\" frictionloss=\"0.05\"";
    let true_values = format!("damping=\"0.02\" frictionloss=\"{friction}\" armature=\"{armature}\"");
    assert!(rover.contains(in_file));
    std::fs::write(at("rover.xml"), &rover).unwrap();
    std::fs::write(at("hidden.xml"), rover.replace(in_file, &true_values)).unwrap();
    std::fs::write(at("policy.safetensors"), weights::write(&policy()).unwrap()).unwrap();
    let robot = at("hidden.xml");
    let collected = run(&[
        "collect",
        &at("policy.safetensors"),
        "--robot",
        &robot,
        "--out",
        &at("logs"),
        "--trajectories",
        "6",
        "--seconds",
        "6",
        "--seed",
        "2",
        "--json",
    ]);
    assert_eq!(collected.status.code(), Some(0), "{}", errors(&collected));
    let file = json(&collected)["files"][0].as_str().unwrap().to_owned();
    let log = read_csv(Path::new(&file), &ReadOptions::default()).unwrap();
    assert_eq!(log.velocity_joints.len(), 4);

    // A robot may report its wheels' angles within one turn, and may not state which targets are velocities.
    let turn = std::f64::consts::TAU;
    std::fs::create_dir(at("wrapped")).unwrap();
    for file in json(&collected)["files"].as_array().unwrap() {
        let file = Path::new(file.as_str().unwrap());
        let log = read_csv(file, &ReadOptions::default()).unwrap();
        let wrapped =
            |(place, angle): (usize, &f64)| if place % 3 == 2 { angle.rem_euclid(turn) } else { *angle };
        let position = log.position.iter().enumerate().map(wrapped).collect();
        let log = Trajectory { position, velocity_joints: Vec::new(), ..log };
        write_csv(&folder.path().join("wrapped").join(file.file_name().unwrap()), &log).unwrap();
    }
    // Joints that turn by whole turns and do not reach their targets are faults of logs, but not of wheels.
    let (config, wrapped) = (at("new.toml"), at("wrapped"));
    let (rover, policy) = (at("rover.xml"), at("policy.safetensors"));
    let begun =
        run(&["new", "--robot", &rover, "--policy", &policy, "--logs", &wrapped, "--out", &config, "--json"]);
    assert_eq!(begun.status.code(), Some(0), "{}", errors(&begun));
    let warnings = json(&begun)["warnings"].to_string();
    assert!(!warnings.contains("_wheel"), "{warnings}");
    let written = std::fs::read_to_string(&config).unwrap();
    let step = log.simulated_step.unwrap();
    assert!(written.contains(&format!("robot_timestep = {step:?}")), "{step} {written}");
    std::fs::write(
        at("fit.toml"),
        "base = \"free\"\npolicy = \"policy.safetensors\"\nrobot = \"rover.xml\"\nlogs = [\"wrapped\"]\ncosts = [\"matchr1\"]\n\
         runs = \"runs\"\n[[parameter]]\nkind = \"frictionloss\"\njoints = [\"*_wheel\"]\n[[parameter]]\nkind = \"armature\"\n\
         joints = [\"*_wheel\"]\n[optimizer]\nseeds = 1\nreplicates = 0\n[simulation]\nrobot_timestep = 0.005\n",
    )
    .unwrap();
    let output = run(&["adapt", &at("fit.toml"), "--json", "--device", "cpu"]);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{}", errors(&output));
    let report = json(&output);
    for (parameter, truth) in report["parameters"].as_array().unwrap().iter().zip(TRUTH) {
        let value = parameter["value"].as_f64().unwrap();
        assert!((value - truth).abs() < 0.1 * truth, "{}: {value} for {truth}", parameter["name"]);
    }
}
