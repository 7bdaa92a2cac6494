//! Friction at rest, torque that falls with speed, and encoders with an offset are found in logs of a clamped robot, and so are
//! masses of links.

use super::in_the_air::{DT, POSE, go2, recording};
use super::*;
use gaitfit_adapt::fit::{sensitivity, simulate_one};
use gaitfit_adapt::{ReplaySimulator, Resets};
use gaitfit_model::Model;
use gaitfit_physics::Preset;
use gaitfit_sim::{Recording, ReplayOptions};

/// Targets that jump every 0.3 to 0.5 s, with gains that take the motors to their limits.
fn jumps(joints: usize, samples: usize) -> Recording {
    let slow = recording(joints, samples);
    let at = |sample: usize, j: usize| {
        let pace = std::f64::consts::TAU * (1.0 + 0.05 * j as f64) * sample as f64 * DT;
        POSE[j % 3] + 0.35 * pace.sin().signum()
    };
    Recording {
        target: (0..samples).flat_map(|i| (0..joints).map(move |j| at(i, j))).collect(),
        kp: vec![60.0; joints],
        kd: vec![1.0; joints],
        ..slow
    }
}

fn simulator(model: &Model, samples: usize) -> ReplaySimulator {
    let options = ReplayOptions { substeps: 4, preset: Preset::Accurate, ..ReplayOptions::default() };
    let joints = model.joints.len();
    let recordings = vec![recording(joints, samples), jumps(joints, samples)];
    ReplaySimulator::new(model, recordings, options, 1).unwrap()
}

/// Fits logs of the robot of `truth` and says what was found and how precisely the logs tell it.
fn fitted(rules: &[ParameterRule], truth: &[f64]) -> (Theta, Vec<f64>, Vec<Option<f64>>) {
    let model = go2();
    let names: Vec<String> = model.joints.iter().map(|joint| joint.name.clone()).collect();
    let groups =
        ["hip", "thigh", "calf"].map(|group| (group.to_owned(), vec![format!("*_{group}*")])).to_vec();
    let theta = Theta::from_rules(rules, &groups, &names).unwrap();
    let simulator = simulator(&model, 400);
    let wide = |all: Vec<f32>| all.into_iter().map(f64::from).collect();
    let recorded: Vec<Recorded> = simulate_one(&simulator, &theta, truth, Resets::Never)
        .unwrap()
        .into_iter()
        .map(|log| Recorded {
            position: wide(log.position),
            velocity: wide(log.velocity),
            ..Recorded::default()
        })
        .collect();
    let reference = Arc::new(Reference::new(simulator.joints().to_vec(), &recorded, 0).unwrap());
    let costs = vec!["matcho".parse::<CostKind>().unwrap().build(&reference, &simulator).unwrap()];
    let mut fit = Fit::new(&simulator, &theta, &costs, options(Method::LeastSquares)).unwrap();
    while fit.step(&never).unwrap().is_some() {}
    let values = fit.outcomes().remove(0).values();
    let problem =
        Problem { simulator: &simulator, theta: &theta, cost: costs[0].as_ref(), draw: 0, cancel: &never };
    let uncertainty = sensitivity(problem, truth, Some(1e-3)).unwrap().unwrap();
    for (((entry, value), truth), deviation) in
        theta.entries().iter().zip(&values).zip(truth).zip(&uncertainty.deviation)
    {
        println!("{}: {value:.5} {} ({truth}), deviation {deviation:?}", entry.name, entry.unit);
    }
    (theta, values, uncertainty.deviation)
}

/// Every entry is found, and the logs tell it.
fn check(rules: &[ParameterRule], truth: &[f64]) {
    let (theta, values, deviations) = fitted(rules, truth);
    for (((entry, value), truth), deviation) in theta.entries().iter().zip(values).zip(truth).zip(deviations)
    {
        assert!((value / truth - 1.0).abs() < 2e-3, "{}: {value} and not {truth}", entry.name);
        assert!(deviation.unwrap() < entry.deviation, "{}: {deviation:?}", entry.name);
    }
}

fn all(kind: JointParameter) -> ParameterRule {
    ParameterRule { per: Sharing::All, ..ParameterRule::new(kind) }
}

#[test]
fn friction_at_rest_falling_torque_and_offsets_are_found() {
    let rules = [
        all(JointParameter::FrictionLoss),
        all(JointParameter::Stiction),
        all(JointParameter::StribeckVelocity),
        all(JointParameter::NoLoadSpeed),
        all(JointParameter::StallTorque),
        ParameterRule::new(JointParameter::EncoderBias),
    ];
    check(&rules, &[0.2, 0.15, 0.25, 14.0, 16.0, 0.02, -0.03, 0.01]);
}

#[test]
fn masses_of_links_and_their_centres_are_found() {
    let of = |kind, joints: &[&str]| ParameterRule {
        joints: joints.iter().map(|&joint| joint.to_owned()).collect(),
        ..ParameterRule::new(kind)
    };
    let rules = [
        of(JointParameter::LinkMass, &["*_thigh*", "*_calf*"]),
        of(JointParameter::LinkComX, &["*_calf*"]),
        of(JointParameter::LinkComY, &["*_thigh*"]),
        of(JointParameter::LinkComZ, &["*_calf*"]),
    ];
    check(&rules, &[1.25, 0.8, 0.012, 0.02, -0.015]);
}
