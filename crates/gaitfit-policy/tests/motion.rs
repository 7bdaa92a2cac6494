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
    // Where its anchor is shows on a robot; nothing is assumed of it.
    assert_eq!(interface.reference.as_ref().unwrap().anchor_body.as_deref(), Some("base"));
    assert!(policy.notes.iter().all(|note| !note.contains("motion")), "{:?}", policy.notes);
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

/// Two seconds of a motion of two joints at 50 Hz, whose rows `change` may change: time and the cells after it.
fn motion_file(change: impl Fn(usize, &mut Vec<f64>)) -> String {
    let mut text = String::from("time,q_a,q_b,dq_a,dq_b\n");
    for row in 0..100 {
        let at = 0.02 * row as f64;
        let mut cells = vec![at, (3.0 * at).sin(), at.cos(), 3.0 * (3.0 * at).cos(), -at.sin()];
        change(row, &mut cells);
        text += &cells.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
        text += "\n";
    }
    text
}

/// Everything of a policy of two joints but its network.
const TWO_JOINTS: &str = "joints = [\"a\", \"b\"]\ndefault_pose = 0\naction_scale = 1\nkp = 1\nkd = 1\ncontrol_dt = 0.02\n\
     observation = [{ quantity = \"reference_joint_position\" }]\n";

/// What reading the interface of `dance.toml` beside the motion `dance.csv` says.
fn beside(motion: &str, more: &str) -> Result<Interface, String> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("dance.csv"), motion).unwrap();
    let path = folder.path().join("dance.toml");
    std::fs::write(&path, format!("{TWO_JOINTS}{more}")).unwrap();
    gaitfit_policy::interface_of(&path).map(|(interface, _)| interface).map_err(|error| error.to_string())
}

#[test]
fn a_description_may_have_the_name_of_its_motion() {
    let interface = beside(&motion_file(|_, _| ()), "reference = \"dance.csv\"\n").unwrap();
    assert_eq!(interface.reference.unwrap().samples(2), 100);
}

/// What is done to the cells of a row.
type RowChange = Box<dyn Fn(usize, &mut Vec<f64>)>;

#[test]
fn a_motion_that_is_none_is_refused_with_its_place() {
    let reference = "reference = \"dance.csv\"\n";
    let cases: [(&str, RowChange); 6] = [
        ("time-gap", Box::new(|row, cells| cells[0] += if row > 50 { 1.4 } else { 0.0 })),
        ("non-monotonic-time", Box::new(|row, cells| cells[0] -= if row == 50 { 0.1 } else { 0.0 })),
        (
            "not-finite: 1 position value(s) of b",
            Box::new(|row, cells| {
                if row == 40 {
                    cells[2] = f64::NAN;
                }
            }),
        ),
        ("velocity-mismatch", Box::new(|_, cells| cells[3..].iter_mut().for_each(|x| *x *= 10.0))),
        ("suspect-unit", Box::new(|_, cells| cells[1..].iter_mut().for_each(|x| *x = x.to_degrees()))),
        ("time runs backwards", Box::new(|_, cells| cells[0] = 3.0 - cells[0])),
    ];
    for (word, change) in cases {
        let found = beside(&motion_file(change), reference).unwrap_err();
        assert!(found.contains(word) && found.contains("dance.csv"), "`{word}` is not in `{found}`");
    }
    // Who has looked says so in the motion itself.
    let faster = motion_file(|_, cells| cells[3..].iter_mut().for_each(|x| *x *= 10.0));
    assert!(beside(&format!("# allow = [\"velocity-mismatch\"]\n{faster}"), reference).is_ok());
    // A motion may rest and lie: only its own numbers must be right.
    assert!(beside(&motion_file(|_, cells| cells[1..].fill(0.3 * 0.0)), reference).is_ok());
}

#[test]
fn rows_of_a_motion_that_jitter_are_placed_evenly() {
    let swing = |row: usize, cells: &mut Vec<f64>| {
        let at = 0.02 * row as f64 + 0.006 * (7.0 * row as f64).sin();
        *cells = vec![at, (3.0 * at).sin(), at.cos(), 3.0 * (3.0 * at).cos(), -at.sin()];
    };
    let interface = beside(&motion_file(swing), "reference = \"dance.csv\"\n").unwrap();
    let reference = interface.reference.unwrap();
    let off = (1..99)
        .map(|row| (f64::from(reference.position[2 * row]) - (0.06 * row as f64).sin()).abs())
        .fold(0.0, f64::max);
    assert!(off < 0.004, "{off}: a row in its place of 6 ms more moves by 0.018 rad");
}

#[test]
fn a_slip_in_a_reference_is_named() {
    let motion = motion_file(|_, _| ());
    let found = beside(&motion, "[reference]\nfile = \"dance.csv\"\nancor = []\n").unwrap_err();
    assert!(found.contains("unknown field `ancor`"), "{found}");
    let alone = beside(&motion, "[reference]\nfile = \"dance.csv\"\n").unwrap();
    assert!(alone.reference.unwrap().anchor.is_empty());
}

/// A description of mjlab's file of motion tracking, whose entries `change` has changed in place, with the folder it is in.
fn changed_mjlab(from: &str, to: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = std::fs::read(fixture("mjlab_motion.onnx")).unwrap();
    let place = bytes.windows(from.len()).position(|window| window == from.as_bytes()).unwrap();
    bytes[place..place + from.len()].copy_from_slice(to.as_bytes());
    std::fs::write(folder.path().join("p.onnx"), bytes).unwrap();
    std::fs::write(folder.path().join("p.toml"), "file = \"p.onnx\"\nreference = \"dance.csv\"\n").unwrap();
    read(&folder.path().join("p.toml")).unwrap_err().to_string()
}

#[test]
fn faults_of_mjlabs_metadata_show_through_a_description_of_two_lines() {
    for (from, to, word) in [
        ("motion_anchor_ori_b", "motion_anchor_pos_b", "the robot's place in the world"),
        ("joint_stiffness", "joint_stiffnets", "its metadata has no `joint_stiffness`"),
        ("anchor_body_name", "ancher_body_name", "its metadata has no `anchor_body_name`"),
    ] {
        let found = changed_mjlab(from, to);
        assert!(found.contains(word) && found.contains("p.onnx"), "`{word}` is not in `{found}`");
        assert!(!found.contains("missing field"), "{found}");
    }
}

#[test]
fn a_file_of_another_kind_and_a_slip_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let found = |text: &str| {
        let path = folder.path().join("p.toml");
        std::fs::write(&path, text).unwrap();
        read(&path).unwrap_err().to_string()
    };
    for (text, word) in [
        ("", "it is empty"),
        ("format = 2\ncost_name = \"wass\"\n", "--theta"),
        ("costs = [\"wass\"]\nlogs = [\"a\"]\n", "`gaitfit fit`"),
        ("[ppo]\nepochs = 3\n", "`gaitfit train`"),
        ("file = \"\"\njoints = []\n", "`file` is empty"),
    ] {
        let full = match text.starts_with("file") {
            true => {
                format!("{}file = \"\"\n", TWO_JOINTS.replace("reference_joint_position", "joint_position"))
            }
            false => text.to_owned(),
        };
        assert!(found(&full).contains(word), "`{word}` is not in `{}`", found(&full));
    }
    for (slip, meant) in [
        ("refrence = \"dance.csv\"", "Did you mean `reference`?"),
        ("critic_observation = [{ quantity = \"joint_positon\" }]", "Did you mean `joint_position`?"),
        ("critic_observation = [{ quantity = \"joint_position\", ahed = 1 }]", "Did you mean `ahead`?"),
    ] {
        let text = found(&format!("file = \"p.onnx\"\n{TWO_JOINTS}{slip}\n"));
        assert!(text.contains(meant) && !text.contains("expected one of"), "{text}");
    }
    let missing = read(&folder.path().join("nope.csv")).unwrap_err().to_string();
    assert!(missing.contains("cannot read"), "{missing}");
}
