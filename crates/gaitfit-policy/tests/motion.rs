//! Policies that follow a motion: what they observe of it, their files, and what mjlab's exporter writes.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{act, fixture, interface, largest_difference, rows};
use gaitfit_log::{BaseState, Trajectory, write_csv};
use gaitfit_model::rotation::{from_rpy, inverse, matrix, product, turn};
use gaitfit_policy::observation::{Layout, Sensed};
use gaitfit_policy::{AnchorJoint, Interface, MotionPlace, Pilot, Quantity, Reference, Term, read};

/// Three samples of 20 Hz of an interface's joints, joint `j` at `j` + 0.1 times the sample.
fn motion(joints: &[String]) -> Trajectory {
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
    let found = at(0.01);
    for joint in 0..joints {
        assert!((found[joint] - (joint as f32 + 0.02)).abs() < 1e-5);
        assert!((found[joints + joint] - 0.5 * (joint as f32 - 1.0)).abs() < 1e-5);
    }
    assert!((found[2 * joints] - 0.1).abs() < 1e-6);
    // Before and after it, the motion stands.
    for (time, sample, phase) in [(-1.0, 0.0, 0.0), (5.0, 0.2, 1.0)] {
        let found = at(time);
        assert!((found[1] - (1.0 + sample)).abs() < 1e-6 && found[joints..2 * joints] == vec![0.0; joints]);
        assert_eq!(found[2 * joints], phase);
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
    let found = row(&follows(&[Term::new(Quantity::ReferenceOrientation)]), &sensed);
    let (anchor, wanted) = (product(base, turn(2, 0.4)), product(turn(2, -0.7), from_rpy(0.1, 0.2, 0.8)));
    let relative = matrix(product(inverse(anchor), wanted));
    for (k, value) in found.iter().enumerate() {
        assert!((f64::from(*value) - relative[k / 2][k % 2]).abs() < 1e-6, "{k}");
    }
    // A pilot turns the motion to face as the robot does at the first step.
    let interface = follows(&[Term::new(Quantity::ReferenceOrientation)]);
    let layout = Layout::new(&interface, &interface.observation);
    sensed.motion.time = 0.0;
    sensed.motion.heading = layout.motion_heading(&sensed);
    let found = row(&interface, &sensed);
    let turned = product(turn(2, sensed.motion.heading), from_rpy(0.1, 0.0, 0.5));
    let difference = gaitfit_model::rotation::heading(turned) - gaitfit_model::rotation::heading(anchor);
    assert!(difference.sin().abs() < 1e-6 && found.iter().all(|x| x.is_finite()));
}

/// What is done to a sound interface.
type Change = fn(&mut Interface);

#[test]
fn what_contradicts_a_motion_is_named() {
    let joint = Term::new(Quantity::ReferenceJointPosition);
    let cases: [(&str, Change); 6] = [
        ("there is no motion to follow", |i| i.reference = None),
        ("has no orientations", |i| {
            i.observation.push(Term::new(Quantity::ReferenceOrientation));
            i.reference.as_mut().unwrap().orientation.clear();
        }),
        ("has `ahead`", |i| i.observation = vec![Term { ahead: 1, ..Term::new(Quantity::JointPosition) }]),
        ("angles and", |i| i.reference.as_mut().unwrap().velocity.truncate(3)),
        ("not a joint of the policy", |i| i.reference.as_mut().unwrap().anchor[0].joint = "tail".into()),
        ("a rate of 0 Hz", |i| i.reference.as_mut().unwrap().rate_hz = 0.0),
    ];
    for (message, change) in cases {
        let mut interface = follows(std::slice::from_ref(&joint));
        change(&mut interface);
        let found = interface.check().unwrap_err().to_string();
        assert!(found.contains(message), "`{message}` is not in `{found}`");
    }
}

#[test]
fn an_mjlab_file_of_motion_tracking_is_read_with_a_motion_beside_it() {
    let alone = read(&fixture("mjlab_motion.onnx")).unwrap_err().to_string();
    assert!(alone.contains("no motion to follow") && alone.contains("reference ="), "{alone}");
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(fixture("mjlab_motion.onnx"), folder.path().join("p.onnx")).unwrap();
    let legs = ["FR", "FL", "RR", "RL"];
    let joints: Vec<String> = legs
        .iter()
        .flat_map(|leg| ["hip", "thigh", "calf"].map(|kind| format!("{leg}_{kind}_joint")))
        .rev()
        .collect();
    write_csv(&folder.path().join("dance.csv"), &motion(&joints)).unwrap();
    let path = folder.path().join("p.toml");
    std::fs::write(&path, "file = \"p.onnx\"\nreference = \"dance.csv\"\n").unwrap();
    let policy = read(&path).unwrap();
    let [observation, actions] = rows("mjlab_motion_rows.json");
    let difference = largest_difference(&act(&policy, &observation), &actions);
    assert!(difference < 1e-5, "{difference}");
    let interface = &policy.interface;
    assert_eq!(
        interface.describe(&interface.observation),
        "69 numbers (12 reference_joint_position + 12 reference_joint_velocity + 6 reference_orientation + 3 \
         base_angular_velocity + 12 joint_position + 12 joint_velocity + 12 last_action)"
    );
    let scales = interface.scales(&interface.observation);
    assert_eq!((scales[0], scales[12], scales[24]), (0.5, 2.0, 1.0));
    // The motion's columns are found by name.
    assert_eq!(interface.reference.as_ref().unwrap().position[..2], [11.0, 10.0]);
    assert!(policy.notes.iter().any(|note| note.contains("anchor is `base`")), "{:?}", policy.notes);
    assert!(policy.untrainable().unwrap().contains("reference motion"));
    let mut pilot = Pilot::new(&policy).unwrap();
    let mut sensed = Sensed::new(12);
    let first = pilot.step(&mut sensed).0.to_vec();
    assert!((sensed.motion.heading + gaitfit_model::rotation::heading(from_rpy(0.1, 0.0, 0.5))).abs() < 1e-6);
    assert!(pilot.step(&mut sensed).0 != first && (sensed.motion.time - 0.02).abs() < 1e-12);
    let missing = folder.path().join("q.toml");
    std::fs::write(&missing, "file = \"p.onnx\"\nreference = \"none.csv\"\n").unwrap();
    assert!(read(&missing).unwrap_err().to_string().contains("none.csv"));
}
