//! Files for those who run a policy without gaitfit: YAML read back, C++ compiled.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;
mod cxx;
mod yaml;

use common::{interface, numbers, policy};
use gaitfit_policy::network::{Activation, Network, Normaliser, Shape};
use gaitfit_policy::{
    ActionClip, FrameOrder, Held, History, HistoryStart, Interface, Policy, Quantity, Term,
};

/// A policy that sees `observation`, its network random.
fn seeing(interface: Interface, hidden: &[usize]) -> Policy {
    let (inputs, outputs) = (interface.observation_width(), interface.joints.len());
    let shape = Shape { inputs, hidden: hidden.to_vec(), outputs, activation: Activation::Elu };
    Policy {
        interface: Interface { critic_observation: Vec::new(), ..interface },
        actor: Network::random(shape, 3, 0, 1.0).unwrap(),
        log_std: vec![0.0; outputs],
        critic: None,
        critic_memory: None,
        critic_normaliser: None,
        normaliser: Some(Normaliser {
            mean: numbers(inputs, 7).into_iter().map(f64::from).collect(),
            variance: numbers(inputs, 8).into_iter().map(|x| 0.1 + f64::from(x) * f64::from(x)).collect(),
            count: 10.0,
        }),
        ..policy(Activation::Elu)
    }
}

/// Eight joints of the Go2 moved and one held, every quantity that a robot measures, three frames of each.
fn rich(order: FrameOrder, start: HistoryStart) -> Policy {
    let plain = interface();
    let (moved, rest) = plain.joints.split_at(8);
    let quantities = [
        Quantity::GaitPhase,
        Quantity::JointVelocity,
        Quantity::Command,
        Quantity::LastAction,
        Quantity::JointPosition,
        Quantity::ProjectedGravity,
        Quantity::BaseAngularVelocity,
    ];
    let scaled = |quantity| match quantity {
        Quantity::Command => Term::new(quantity).scaled(&[2.0, 1.5, 0.3]),
        Quantity::JointVelocity => Term::new(quantity).scaled(&[0.05]),
        _ => Term::new(quantity),
    };
    let many = |(index, quantity): (usize, &Quantity)| {
        let frames = if order == FrameOrder::Terms { 1 + index % 4 } else { 3 };
        scaled(*quantity).with_history(frames)
    };
    let interface = Interface {
        joints: moved.to_vec(),
        default_pose: plain.default_pose[..8].to_vec(),
        action_scale: (0..8).map(|joint| 0.2 + 0.01 * f64::from(joint)).collect(),
        action_clip: Some(ActionClip::Each((0..8).map(|joint| 0.1 + 0.05 * f64::from(joint)).collect())),
        kp: (0..8).map(|joint| 20.0 + f64::from(joint)).collect(),
        kd: vec![0.5; 8],
        held: vec![Held { joint: rest[0].clone(), position: -0.3, kp: 60.0, kd: 3.0 }],
        control_dt: 0.015,
        gait_frequency: Some(2.3),
        history: History { order, start },
        observation: quantities.iter().enumerate().map(many).collect(),
        ..plain
    };
    seeing(interface, &[20, 12])
}
