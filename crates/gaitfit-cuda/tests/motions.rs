//! Motions that policies of the tests follow.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_policy::{AnchorJoint, Interface, Quantity, Reference, Term};

/// A short motion about the default pose, whose base leans, turns and changes the sign of its quaternions. Its anchor is the thigh of
/// the front left leg of a Go2.
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
