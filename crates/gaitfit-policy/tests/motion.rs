//! What policies that follow a motion observe of it.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{interface, motion};
use gaitfit_model::rotation::{from_rpy, inverse, matrix, product, turn};
use gaitfit_policy::observation::{Layout, Sensed};
use gaitfit_policy::{AnchorJoint, Interface, MotionPlace, Quantity, Reference, Term};

/// An interface that observes `terms` of the motion, whose anchor is behind a joint about z.
fn follows(terms: &[Term]) -> Interface {
    let plain = interface();
    let anchor = vec![AnchorJoint { joint: plain.joints[3].clone(), axis: [0.0, 0.0, 2.0] }];
    let reference = Some(Reference::from_log(&motion(&plain.joints), &plain.joints, anchor).unwrap());
    Interface { reference, observation: terms.to_vec(), critic_observation: Vec::new(), ..plain }
}

fn row(interface: &Interface, sensed: &Sensed) -> Vec<f32> {
    interface.check().unwrap();
    let layout = Layout::new(interface, &interface.observation);
    let mut row = vec![f32::NAN; layout.width()];
    layout.write(sensed, None, |_, _| (), &mut row);
    row
}

#[test]
fn a_row_has_the_motion_at_its_time_and_ahead() {
    let joints = interface().joints.len();
    let terms = [
        Term::new(Quantity::ReferenceJointPosition),
        Term { ahead: 2, ..Term::new(Quantity::ReferenceJointVelocity).scaled(&[0.5]) },
        Term::new(Quantity::ReferencePhase),
    ];
    let at = |time: f64| {
        let motion = MotionPlace { time, heading: 0.0 };
        row(&follows(&terms), &Sensed { motion, ..Sensed::new(joints) })
    };
    // Control periods of 0.02 s: two ahead of 0.01 s is the second sample.
    let values = at(0.01);
    for joint in 0..joints {
        assert!((values[joint] - (joint as f32 + 0.02)).abs() < 1e-5);
        assert!((values[joints + joint] - 0.5 * (joint as f32 - 1.0)).abs() < 1e-5);
    }
    assert!((values[2 * joints] - 0.1).abs() < 1e-6);
    // Before and after it, the motion stands.
    for (time, sample, phase) in [(-1.0, 0.0, 0.0), (5.0, 0.2, 1.0)] {
        let values = at(time);
        assert!((values[1] - (1.0 + sample)).abs() < 1e-6 && values[joints..2 * joints] == vec![0.0; joints]);
        assert_eq!(values[2 * joints], phase);
    }
}

#[test]
fn the_orientation_is_that_of_the_turned_motion_seen_from_the_anchor() {
    let joints = interface().joints.len();
    let base = from_rpy(-0.2, 0.3, 1.1);
    let mut sensed = Sensed::new(joints);
    sensed.orient(base.map(|x| x as f32));
    sensed.joint_position[3] = 0.4;
    sensed.motion = MotionPlace { time: 0.05, heading: -0.7 };
    let rotation = row(&follows(&[Term::new(Quantity::ReferenceOrientation)]), &sensed);
    let (anchor, wanted) = (product(base, turn(2, 0.4)), product(turn(2, -0.7), from_rpy(0.1, 0.2, 0.8)));
    let relative = matrix(product(inverse(anchor), wanted));
    for (k, value) in rotation.iter().enumerate() {
        assert!((f64::from(*value) - relative[k / 2][k % 2]).abs() < 1e-6, "{k}");
    }
    // A pilot turns the motion to face as the robot does at the first step.
    let interface = follows(&[Term::new(Quantity::ReferenceOrientation)]);
    let layout = Layout::new(&interface, &interface.observation);
    sensed.motion.time = 0.0;
    sensed.motion.heading = layout.motion_heading(&sensed);
    let observation = row(&interface, &sensed);
    let turned = product(turn(2, sensed.motion.heading), from_rpy(0.1, 0.0, 0.5));
    let difference = gaitfit_model::rotation::heading(turned) - gaitfit_model::rotation::heading(anchor);
    assert!(difference.sin().abs() < 1e-6 && observation.iter().all(|x| x.is_finite()));
}

/// What is done to a sound interface.
type Change = fn(&mut Interface);

#[test]
fn what_contradicts_a_motion_is_named() {
    let joint = Term::new(Quantity::ReferenceJointPosition);
    let cases: [(&str, Change); 9] = [
        ("there is no motion to follow", |i| i.reference = None),
        ("has no orientations", |i| {
            i.observation.push(Term::new(Quantity::ReferenceOrientation));
            i.reference.as_mut().unwrap().orientation.clear();
        }),
        ("has `ahead`", |i| {
            i.observation.push(Term { ahead: 1, ..Term::new(Quantity::JointPosition) });
        }),
        ("angles and", |i| i.reference.as_mut().unwrap().velocity.truncate(3)),
        ("not a joint of the policy", |i| i.reference.as_mut().unwrap().anchor[0].joint = "tail".into()),
        ("names `FR_hip_joint` twice", |i| {
            let first = AnchorJoint { joint: "FR_hip_joint".into(), axis: [1.0, 0.0, 0.0] };
            i.reference.as_mut().unwrap().anchor = vec![first.clone(), first];
        }),
        ("no term of the observation reads it", |i| i.observation = vec![Term::new(Quantity::JointPosition)]),
        ("at most 87381 rows are read; take fewer", |i| {
            let joints = i.joints.len();
            let reference = i.reference.as_mut().unwrap();
            (reference.position, reference.velocity) =
                (vec![0.0; 100_000 * joints], vec![0.0; 100_000 * joints]);
            reference.orientation.clear();
        }),
        ("a rate of 0 Hz", |i| i.reference.as_mut().unwrap().rate_hz = 0.0),
    ];
    for (message, change) in cases {
        let mut interface = follows(std::slice::from_ref(&joint));
        change(&mut interface);
        let text = interface.check().unwrap_err().to_string();
        assert!(text.contains(message), "`{message}` is not in `{text}`");
    }
}
