//! Motions that policies of the tests follow.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_policy::{AnchorJoint, Interface, Policy, Quantity, Reference, Term};
use gaitfit_random::{Purpose, Stream};

/// A short motion about the default pose, whose base leans, turns and changes the sign of its quaternions. Its anchor
/// is the thigh of the front left leg of a Go2.
pub fn reference(interface: &Interface, rate_hz: f64, samples: usize) -> Reference {
    let joints = interface.joints.len();
    let angle = |k: usize| {
        let (sample, joint) = (k / joints, k % joints);
        interface.default_pose[joint] as f32 + 0.1 * (0.7 * sample as f32 + joint as f32).sin()
    };
    let velocity = |k: usize| 0.8 + 2.0 * (0.4 * (k / joints) as f32 - (k % joints) as f32).cos();
    let quaternion = |sample: usize| {
        let lean = 0.1 * sample as f32;
        let sign = if sample.is_multiple_of(3) { -1.01 } else { 0.99 };
        [0.8, 0.1 + 0.3 * lean, -0.2 * lean, 0.6 - lean].map(|x: f32| sign * x)
    };
    let anchor = [("FL_hip_joint", [2.0, 0.0, 0.0]), ("FL_thigh_joint", [0.0, 1.0, 0.0])];
    let reference = Reference {
        rate_hz,
        position: (0..samples * joints).map(angle).collect(),
        velocity: (0..samples * joints).map(velocity).collect(),
        orientation: (0..samples).flat_map(quaternion).collect(),
        anchor: anchor.map(|(joint, axis)| AnchorJoint { joint: joint.to_owned(), axis }).to_vec(),
        anchor_body: None,
    };
    reference.check(&interface.joints).unwrap();
    reference
}

/// Every quantity of a motion, at several times.
pub fn terms() -> Vec<Term> {
    let ahead = |quantity, ahead| Term { ahead, ..Term::new(quantity) };
    vec![
        ahead(Quantity::ReferenceJointPosition, 0),
        ahead(Quantity::ReferenceJointPosition, 3).scaled(&[0.5]),
        ahead(Quantity::ReferenceJointVelocity, 0).scaled(&[0.1]),
        ahead(Quantity::ReferenceJointVelocity, 1).scaled(&[0.2]),
        ahead(Quantity::ReferenceOrientation, 0),
        ahead(Quantity::ReferenceOrientation, 4).scaled(&[1.0, -1.0, 2.0, 0.5, 1.0, 3.0]),
        ahead(Quantity::ReferencePhase, 1),
    ]
}

/// A policy that also observes `terms`, through random weights of its first layer.
pub fn observing(policy: &Policy, terms: Vec<Term>) -> Policy {
    let mut policy = policy.clone();
    policy.interface.observation.extend(terms);
    policy.interface.check().unwrap();
    let (old, outputs) = (policy.actor.shape.inputs, policy.actor.shape.layers()[0].outputs);
    policy.actor.shape.inputs = policy.interface.observation_width();
    let noise = Stream::new(9, Purpose::BOOTSTRAP);
    let further = (policy.actor.shape.inputs - old) * outputs;
    let further = (0..further).map(|k| 0.1 * noise.normal(k as u32) as f32);
    let (first, rest) = policy.actor.parameters.split_at(old * outputs);
    let weights: Vec<f32> = first.iter().copied().chain(further).chain(rest.iter().copied()).collect();
    policy.actor.parameters.resize(weights.len(), 0.0);
    policy.actor.parameters.copy_from_slice(&weights);
    policy.normaliser = None;
    policy
}

/// The policy, which also follows a motion.
pub fn following(policy: &Policy, rate_hz: f64, samples: usize) -> Policy {
    let mut policy = policy.clone();
    policy.interface.reference = Some(reference(&policy.interface, rate_hz, samples));
    observing(&policy, terms())
}
