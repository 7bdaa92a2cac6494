//! Priors and comparisons from estimates of legs in the air.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::*;
use crate::walk::fixtures;
use gaitfit_log::{BaseState, write_csv};

fn report() -> SwingReport {
    let joints = ["FL_calf_joint", "FR_calf_joint"].map(str::to_owned).to_vec();
    let number = |value, error| Estimate { value, error };
    let numbers = [number(0.65, 0.05), number(-0.01, 0.03), number(0.018, 0.001)];
    fixtures::report("calf", joints, numbers, [number(0.0062, 0.0015), number(1.0, 0.2)])
}

#[test]
fn any_name_is_a_key() {
    for name in ["calf-1_a", "", "a b", "a\"\\'\n\u{7f}\u{1b}\u{9b}é"] {
        let table: toml::Table = toml::from_str(&format!("{} = 1", prior_key(name))).unwrap();
        assert!(table.contains_key(name), "{table}");
    }
}

#[test]
fn swings_are_priors_that_settings_read() {
    let tilt = Some([Estimate { value: 0.02, error: 0.0001 }; 2]);
    let findings = SwingFindings { standing: Standing { tilt }, ..SwingFindings::default() };
    let text = prior_toml(&findings, &report(), 0.005);
    assert!(text.contains("# imu_pitch = { value = 0.02000, deviation = 0.00300 }"), "{text}");
    let settings: crate::settings::AdaptConfig = toml::from_str(&text).unwrap();
    let calf = settings.prior["frictionloss_calf"];
    assert_eq!((calf.value, calf.deviation), (0.65, 0.05));
    assert!((settings.prior["delay"].value - 0.0087).abs() < 1e-9);
    assert_eq!(settings.prior.len(), 4);
    let early = SwingReport { delay: Estimate { value: -0.0065, error: 0.003 }, ..report() };
    let delay = numbers(&early, 0.005).pop().unwrap().estimate;
    assert!(delay.value == 0.0 && (delay.error - 0.005).abs() < 1e-12, "{delay:?}");
}

#[test]
fn values_far_from_swings_are_named_and_others_are_not() {
    let calves = ["FL_calf_joint", "FR_calf_joint"].map(str::to_owned);
    let hips = ["FL_hip_joint".to_owned()];
    let one =
        |name, kind, joints, value, interval| Fitted { name, kind, unit: "N·m", joints, value, interval };
    let fitted = [
        one("frictionloss_calf", "frictionloss", &calves[..], 1.9, Some([1.8, 2.0])),
        one("frictionloss_FR_calf", "frictionloss", &calves[1..], 0.7, None),
        one("frictionloss_hip", "frictionloss", &hips[..], 3.0, None),
        one("armature_calf", "armature", &calves[..], 0.020, None),
        one("delay", "delay", &[], 0.0, None),
        one("load", "base_mass", &[], 3.0, None),
    ];
    let strength = Estimate { value: 1.0, error: 0.0 };
    let beside = beside(&report(), 0.005, strength, fitted);
    let named: Vec<(&str, bool)> = beside.iter().map(|one| (one.name.as_str(), one.differ)).collect();
    let expected = [
        ("frictionloss_calf", true),
        ("frictionloss_FR_calf", false),
        ("armature_calf", false),
        ("delay", true),
    ];
    assert_eq!(named, expected);
    assert!((beside[3].swings.value - 0.0087).abs() < 1e-12, "half a step later");
    let text = doubt(&beside).unwrap();
    assert!(text.contains("frictionloss_calf 1.900 fitted, 0.650 ± 0.050"), "{text}");
    assert!(!text.contains("armature"), "{text}");
    assert_eq!(doubt(&beside[1..3]), None);
}

#[test]
fn a_recording_that_is_read_again_keeps_the_turn_of_its_unit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.csv");
    let (joints, rows) = (vec!["knee".to_owned()], 100);
    let time: Vec<f64> = (0..rows).map(|row| 0.01 * f64::from(row)).collect();
    let base = BaseState {
        quaternion: Some([1.0, 0.0, 0.0, 0.0].repeat(time.len())),
        angular_velocity: Some([0.1, 0.2, 0.3].repeat(time.len())),
        ..BaseState::default()
    };
    let still = vec![0.0; time.len()];
    let file = Trajectory {
        base: Some(base),
        target: Some(still.clone()),
        ..Trajectory::of_joints(joints.clone(), 100.0, time, still.clone(), still)
    };
    write_csv(&path, &file).unwrap();
    let rates = |mounting: Option<[f64; 3]>| -> Vec<f64> {
        let (name, joints, trajectory) = (String::new(), joints.clone(), file.clone());
        let log =
            Log { name, path: path.clone(), sidecars: vec![], joints, trajectory, mounting, filled: vec![] };
        recorded(&log).unwrap().base.unwrap().angular_velocity.unwrap()[..3].to_vec()
    };
    let near = |mounting, expected: [f64; 3]| {
        let rates = rates(mounting);
        assert!(rates.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{rates:?}");
    };
    near(None, [0.1, 0.2, 0.3]);
    // Upside down about x: y and z are negated.
    near(Some([180.0, 0.0, 0.0]), [0.1, -0.2, -0.3]);
}
