//! Files of policies that follow a motion, and what mjlab's exporter writes.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{act, fixture, largest_difference, motion, rows};
use gaitfit_log::write_csv;
use gaitfit_model::rotation::from_rpy;
use gaitfit_policy::observation::Sensed;
use gaitfit_policy::{Interface, Pilot};
use gaitfit_policy_files::read;

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
    gaitfit_policy_files::interface_of(&path)
        .map(|(interface, _)| interface)
        .map_err(|error| error.to_string())
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
