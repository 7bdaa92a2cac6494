//! Chirps: limits, draws, turns, bad inputs.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::body::Body;
use super::*;
use gaitfit_log::PerJoint;
use gaitfit_physics::Preset;
use gaitfit_run::watch::Watch;
use gaitfit_sim::{Candidate, Cpu, Engine, JointSignals, Replay, ReplayOptions};
use std::path::PathBuf;
use std::sync::Mutex;

/// A pendulum without limits of any kind.
const BARE: &str = r#"<mujoco model="bare"><worldbody><body name="base"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<body name="arm"><joint name="swing" axis="0 1 0"/><inertial pos="0.2 0 0" mass="1" diaginertia="0.01 0.01 0.01"/></body>
</body></worldbody></mujoco>"#;

/// A short chirp of the Go2.
fn short() -> ChirpSettings {
    let robot = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../assets/go2.xml");
    ChirpSettings { seconds: 2.0, ease: 0.3, rate: 100.0, frequency: [0.5, 5.0], ..ChirpSettings::new(robot) }
}

fn make(settings: &ChirpSettings) -> Result<Chirp, Error> {
    chirp(settings, &Watch::silent())
}

#[test]
fn limits_hold_on_a_robot_that_was_not_tried() {
    let settings = ChirpSettings { amplitude: 1.0, frequency: [0.5, 8.0], ..short() };
    let chirp = make(&settings).unwrap();
    assert_eq!((chirp.joints.len(), chirp.samples), (12, 300));
    assert!(chirp.joints.iter().any(|joint| joint.limited_by.is_some() && joint.amplitude < 0.9));
    assert!(
        chirp.joints.iter().all(|joint| joint.amplitude > 0.02 && joint.torque < 0.9 * joint.torque_limit)
    );
    assert!(chirp.parameters.iter().filter(|one| one.name.starts_with("armature")).all(|one| one.identified));
    // In finer steps, solved to the end.
    let body = Body::read(&settings).unwrap();
    let targets = chirp.expected.target.clone().unwrap();
    let mut base = Candidate::nominal(&body.model);
    base.robot.armature.fill(0.043);
    base.robot.frictionloss.fill(0.31);
    let options = ReplayOptions { substeps: 20, preset: Preset::Converged, max_delay: 0.0, isa: None };
    let replay =
        Replay::new(&body.model, vec![body.recording(settings.rate, targets.clone())], options).unwrap();
    let signals = Mutex::new([Vec::new(), Vec::new()]);
    let keep = |_: usize, _: usize, track: &JointSignals| {
        *signals.lock().unwrap() = [track.position.clone(), track.velocity.clone()];
    };
    Cpu { threads: 1 }.replay(&replay, &[base.robot], &keep, &gaitfit_adapt::never).unwrap();
    let [position, velocity] = signals.into_inner().unwrap();
    assert_eq!(position.len(), targets.len());
    for (at, (q, dq)) in position.into_iter().zip(velocity).enumerate() {
        let (joint, [q, dq]) = (at % 12, [f64::from(q), f64::from(dq)]);
        let torque = body.gains.kp[joint] * (targets[at] - q) - body.gains.kd[joint] * dq;
        assert!((body.range[joint][0]..=body.range[joint][1]).contains(&q), "joint {joint}: {q}");
        assert!(
            dq.abs() < body.velocity[joint] && torque.abs() < body.torque[joint],
            "{joint}: {dq}, {torque}"
        );
    }
}

#[test]
fn a_seed_gives_the_same_chirp_whatever_the_threads() {
    let threads = |count| ChirpSettings { threads: std::num::NonZeroUsize::new(count), ..short() };
    let (one, two) = (make(&threads(1)).unwrap(), make(&threads(2)).unwrap());
    assert_eq!((&one.files, &one.expected, &one.joints), (&two.files, &two.expected, &two.joints));
    let other = make(&ChirpSettings { seed: 1, ..short() }).unwrap();
    assert!(one.files != other.files);
    let smaller = |joint: &Swept| joint.amplitude < 0.3 || joint.top_hz < 4.0;
    assert!(
        one.joints.iter().all(|joint| joint.amplitude <= 0.3 && joint.limited_by.is_some() == smaller(joint))
    );
}

#[test]
fn one_limb_moves_at_a_time() {
    let settings =
        ChirpSettings { turns: Turns::Limbs, joints: vec!["F*".to_owned(), "RL_hip".to_owned()], ..short() };
    let chirp = make(&settings).unwrap();
    // Three turns and half a second at each end.
    assert_eq!((chirp.joints.len(), chirp.samples), (7, 3 * 200 + 100));
    let targets = chirp.expected.target.as_ref().unwrap();
    let moved = |sample: usize, joint: usize| targets[sample * 12 + joint] != targets[joint];
    let limbs = |sample: usize| (0..4).filter(|limb| (0..3).any(|k| moved(sample, limb * 3 + k))).count();
    assert!(
        (0..700).all(|sample| limbs(sample) <= 1) && (0..700).filter(|&one| limbs(one) == 1).count() > 550
    );
    // It begins and ends at rest, and no target jumps.
    assert!((0..12).all(|joint| !moved(49, joint) && !moved(650, joint)));
    for sample in 1..700 {
        for joint in 0..12 {
            let step = (targets[sample * 12 + joint] - targets[(sample - 1) * 12 + joint]).abs();
            assert!(step < 0.3 * 6.3 * 5.0 * 0.01 * 1.3, "{sample}: {step}");
        }
    }
}

#[test]
fn joints_that_follow_others_are_not_moved() {
    let folder = tempfile::tempdir().unwrap();
    let robot = folder.path().join("coupled.xml");
    let go2 = std::fs::read_to_string(short().robot).unwrap();
    let coupling = "<equality><joint joint1=\"RR_calf_joint\" joint2=\"FL_calf_joint\"/></equality></mujoco>";
    std::fs::write(&robot, go2.replace("</mujoco>", coupling)).unwrap();
    let settings = ChirpSettings { robot, ..short() };
    let body = Body::read(&settings).unwrap();
    assert!(body.notes.iter().any(|note| note.contains("follow others: RR_calf_joint")), "{:?}", body.notes);
    let chirp = make(&settings).unwrap();
    assert_eq!(chirp.joints.len(), 11);
    let named = ChirpSettings { joints: vec!["*_calf_joint".into()], ..settings };
    let error = make(&named).unwrap_err().to_string();
    assert!(error.contains("RR_calf_joint follows another joint"), "{error}");
}

#[test]
fn bad_inputs_are_refused_by_name() {
    let gains = Some(PerJoint::All(f64::NAN));
    let cases: Vec<(ChirpSettings, &str)> = vec![
        (ChirpSettings { seconds: 0.0, ..short() }, "--seconds"),
        (ChirpSettings { seconds: f64::NAN, ..short() }, "--seconds"),
        (ChirpSettings { seconds: 2000.0, ..short() }, "more than 100000"),
        (ChirpSettings { rate: f64::INFINITY, ..short() }, "--rate"),
        (ChirpSettings { frequency: [2.0, 1.0], ..short() }, "the lower first"),
        (ChirpSettings { frequency: [0.5, 30.0], ..short() }, "8 targets a period"),
        (ChirpSettings { amplitude: f64::NAN, ..short() }, "--amplitude"),
        (ChirpSettings { ease: 1.5, ..short() }, "--ease"),
        (ChirpSettings { margin: 1.0, ..short() }, "--margin"),
        (ChirpSettings { velocity_limit: Some(-1.0), ..short() }, "--velocity-limit"),
        (ChirpSettings { torque_limit: Some(f64::NAN), ..short() }, "--torque-limit"),
        (ChirpSettings { torque_limit: Some(1e-9), ..short() }, "is 1e-9 N·m; give 1e-3 to 1e6"),
        (ChirpSettings { difference: 0.0, ..short() }, "--difference"),
        (ChirpSettings { joints: vec!["tail".to_owned()], ..short() }, "--joints"),
        (ChirpSettings { pose: vec![("FL_hip".to_owned(), f64::NAN)], ..short() }, "--pose"),
        (ChirpSettings { pose: vec![("FL_hip".to_owned(), 9.0)], ..short() }, "it may be from"),
        (ChirpSettings { kp: gains.clone(), kd: gains, ..short() }, "kp"),
        (ChirpSettings { robot: "none.xml".into(), ..short() }, "none.xml"),
        (ChirpSettings { fit: Some("none.toml".into()), ..short() }, "none.toml"),
    ];
    for (settings, words) in cases {
        let error = make(&settings).unwrap_err().to_string();
        assert!(error.contains(words), "`{words}` is not in `{error}`");
    }
}

#[test]
fn a_robot_without_limits_needs_them() {
    let folder = tempfile::tempdir().unwrap();
    let robot = folder.path().join("bare.xml");
    std::fs::write(&robot, BARE).unwrap();
    let bare = ChirpSettings { robot, ..short() };
    let refused = |settings: &ChirpSettings| make(settings).unwrap_err().to_string();
    assert!(refused(&bare).contains("--kp"), "{}", refused(&bare));
    let gains = (Some(PerJoint::All(30.0)), Some(PerJoint::All(1.0)));
    let driven = ChirpSettings { kp: gains.0, kd: gains.1, ..bare };
    assert!(refused(&driven).contains("no torque limit of swing"), "{}", refused(&driven));
    // Its weight alone is 2 N·m.
    let weak = ChirpSettings { torque_limit: Some(2.0), ..driven.clone() };
    assert!(refused(&weak).contains("swing at rest uses"), "{}", refused(&weak));
    let strong = make(&ChirpSettings { torque_limit: Some(20.0), ..driven }).unwrap();
    let joint = &strong.joints[0];
    assert!(joint.torque < 18.0 && (joint.range[1] - 0.45).abs() < 1e-9, "{joint:?}");
    assert!(strong.notes.iter().any(|note| note.contains("no range of swing")), "{:?}", strong.notes);
    assert!(strong.notes.iter().any(|note| note.contains("no speed limit of swing")), "{:?}", strong.notes);
}

#[test]
fn an_arm_on_a_table_swings_without_the_table_and_a_note_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let robot = folder.path().join("table.xml");
    let joint = r#"<joint name="swing" axis="0 1 0"/>"#;
    let table = BARE.replace("<worldbody>", r#"<worldbody><geom type="plane" size="0 0 1"/>"#);
    std::fs::write(&robot, table.replace(joint, &format!(r#"{joint}<geom size="0.05"/>"#))).unwrap();
    let gains = (Some(PerJoint::All(30.0)), Some(PerJoint::All(1.0)));
    let settings = ChirpSettings { robot, kp: gains.0, kd: gains.1, torque_limit: Some(20.0), ..short() };
    let body = Body::read(&settings).unwrap();
    assert!(body.model.planes.is_empty() && body.model.pairs.is_empty());
    assert!(body.notes.iter().any(|note| note.contains("the file fixes the robot")), "{:?}", body.notes);
}

#[test]
fn changed_files_are_not_overwritten_unasked() {
    let folder = tempfile::tempdir().unwrap();
    let chirp = make(&short()).unwrap();
    chirp.write(folder.path(), false).unwrap();
    // What is the same may be written again.
    chirp.write(folder.path(), false).unwrap();
    let script = folder.path().join("play.py");
    std::fs::write(&script, "mine").unwrap();
    let error = chirp.write(folder.path(), false).unwrap_err().to_string();
    assert!(error.contains("another play.py") && error.contains("--force"), "{error}");
    assert_eq!(std::fs::read_to_string(&script).unwrap(), "mine");
    chirp.write(folder.path(), true).unwrap();
    assert_ne!(std::fs::read_to_string(&script).unwrap(), "mine");
}
