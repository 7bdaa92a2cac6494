//! A Go2, what a policy of it sees, and a motion. The tests of `gaitfit-policy-files` use it too.
#![allow(clippy::unwrap_used, dead_code, reason = "a failed unwrap is a failed test; no test uses all of it")]

use gaitfit_log::{BaseState, Trajectory};
use gaitfit_model::Model;
use gaitfit_model::rotation::from_rpy;
use gaitfit_policy::network::Activation;
use gaitfit_policy::{History, Interface, Quantity, Term};
use std::path::{Path, PathBuf};

/// Every activation, those with a number at one of them.
pub const ACTIVATIONS: [Activation; 9] = [
    Activation::Elu,
    Activation::Relu,
    Activation::Tanh,
    Activation::EluOf(0.5),
    Activation::LeakyRelu(0.1),
    Activation::Selu,
    Activation::Silu,
    Activation::Gelu,
    Activation::GeluTanh,
];

/// The repository root.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

/// The project's Go2.
pub fn go2() -> Model {
    gaitfit_model::read(&root().join("assets/go2.xml"), &Default::default()).unwrap()
}

/// 45 observed numbers, 48 for the critic.
pub fn interface() -> Interface {
    let term = |quantity, scale: &[f32]| Term::new(quantity).scaled(scale);
    let observation = vec![
        term(Quantity::BaseAngularVelocity, &[0.25]),
        term(Quantity::ProjectedGravity, &[]),
        term(Quantity::Command, &[2.0, 2.0, 0.5]),
        term(Quantity::JointPosition, &[]),
        term(Quantity::JointVelocity, &[0.05]),
        term(Quantity::LastAction, &[]),
    ];
    let mut critic_observation = observation.clone();
    critic_observation.push(term(Quantity::BaseLinearVelocity, &[]));
    let legs = ["FL", "FR", "RL", "RR"];
    let joints =
        legs.iter().flat_map(|leg| ["hip", "thigh", "calf"].map(|kind| format!("{leg}_{kind}_joint")));
    Interface {
        robot: "go2".into(),
        joints: joints.collect(),
        default_pose: vec![0.1, 0.8, -1.5, -0.1, 0.8, -1.5, 0.1, 1.0, -1.5, -0.1, 1.0, -1.5],
        action_scale: vec![0.25; 12],
        action_clip: Some(gaitfit_policy::ActionClip::All(100.0)),
        kp: vec![25.0; 12],
        kd: vec![0.5; 12],
        velocity_joints: Vec::new(),
        held: Vec::new(),
        control_dt: 0.02,
        gait_frequency: None,
        reference: None,
        history: History::default(),
        observation,
        critic_observation,
    }
}

/// Three samples of 20 Hz of an interface's joints, joint `j` at `j` + 0.1 times the sample.
pub fn motion(joints: &[String]) -> Trajectory {
    let all = |of: fn(usize, usize) -> f64| -> Vec<f64> {
        (0..3).flat_map(|sample| (0..joints.len()).map(move |joint| of(sample, joint))).collect()
    };
    let attitude = |sample: usize| from_rpy(0.1, 0.2 * sample as f64, 0.5 + 0.3 * sample as f64);
    let quaternion = (0..3).flat_map(attitude).collect();
    let (position, velocity) = (
        all(|sample, joint| joint as f64 + 0.1 * sample as f64),
        all(|sample, joint| -2.0 + (sample + joint) as f64),
    );
    let log = Trajectory::of_joints(joints.to_vec(), 20.0, vec![0.0, 0.05, 0.1], position, velocity);
    Trajectory { base: Some(BaseState { quaternion: Some(quaternion), ..BaseState::default() }), ..log }
}
