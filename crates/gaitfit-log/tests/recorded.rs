//! Logs of the examples and of real robots: what is healthy raises no alarm, what is stuck does.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_log::*;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

/// What `gaitfit inspect FOLDER --robot assets/go2.xml` knows.
fn summarise(folder: &str, options: &ReadOptions) -> FolderSummary {
    let go2 = gaitfit_model::read(&root().join("assets/go2.xml"), &Default::default()).unwrap();
    let spec = |log: &Trajectory| CheckSpec::of_robot(&go2, &log.joints);
    summarise_folder(&root().join(folder), options, &spec, &mut |_, _| ControlFlow::Continue(())).unwrap()
}

/// Findings that are more than notes.
fn alarms(summary: &FolderSummary) -> Vec<&FindingGroup> {
    summary.findings.iter().filter(|group| group.severity > Severity::Note).collect()
}

fn gains(kp: [f64; 3], kd: [f64; 3]) -> ReadOptions {
    let table = |values: [f64; 3]| {
        PerJoint::Named(["*_hip", "*_thigh", "*_calf"].map(str::to_owned).into_iter().zip(values).collect())
    };
    ReadOptions { kp: Some(table(kp)), kd: Some(table(kd)), ..ReadOptions::default() }
}

#[test]
fn the_examples_raise_no_alarm() {
    let walking = summarise("examples/go2-ground/logs", &ReadOptions::default());
    assert_eq!(alarms(&walking), Vec::<&FindingGroup>::new());
    assert_eq!((walking.logs.len(), walking.common_joints.len(), walking.rates.len()), (64, 12, 1));
    assert!(walking.other_joints.is_empty());
    let clamped = summarise("examples/go2-demo", &ReadOptions::default());
    assert_eq!(clamped.findings, []);
    assert_eq!((clamped.logs.len(), clamped.rates[0].rate_hz), (2, 200.0));
}

/// Each joint of the examples' logs in turn is held, or its velocity has another scale: that is said.
#[test]
fn faults_put_into_the_examples_are_found() {
    let walk = read_csv(&root().join("examples/go2-ground/logs/trajectory_00.csv"), &ReadOptions::default())
        .unwrap();
    for joint in 0..12 {
        let mut log = walk.clone();
        let rest = log.position[joint];
        log.position.iter_mut().skip(joint).step_by(12).enumerate().for_each(|(i, q)| {
            *q = rest + 1e-4 * (i as f64).sin();
        });
        log.velocity
            .iter_mut()
            .skip(joint)
            .step_by(12)
            .enumerate()
            .for_each(|(i, dq)| *dq = 1e-3 * (i as f64).cos());
        let findings = check(&log, &CheckSpec::default());
        let held = findings.iter().filter(|finding| finding.kind == FindingKind::JointNotFollowing);
        let named: Vec<_> = held.flat_map(|finding| finding.joints.clone()).collect();
        assert_eq!(named, [log.joints[joint].clone()], "{findings:#?}");

        let mut log = walk.clone();
        log.velocity.iter_mut().skip(joint).step_by(12).for_each(|dq| *dq *= 1.2);
        let findings = check(&log, &CheckSpec::default());
        assert_eq!(findings.len(), 1, "{findings:#?}");
        assert_eq!((findings[0].kind, findings[0].joints.len()), (FindingKind::VelocityMismatch, 1));
    }
    for factor in [0.5, 0.9, 1.1, 2.0] {
        let mut log = walk.clone();
        log.time.iter_mut().for_each(|time| *time *= factor);
        log.rate_hz /= factor;
        let findings = check(&log, &CheckSpec::default());
        assert_eq!(findings.len(), 1, "{factor}: {findings:#?}");
        let rate = format!("the time column says {} Hz", (5000.0f64 / factor).round() / 100.0);
        assert!(findings[0].message.contains("all 12 joints"), "{}", findings[0]);
        assert!(findings[0].message.contains(&rate), "{rate}: {}", findings[0]);
    }
}

#[test]
#[ignore = "needs the recordings of real robots in ../shared/data"]
fn shared_a_real_robot_with_its_legs_in_the_air_raises_nothing() {
    let air = summarise("../shared/data/go2_air", &gains([20.0, 20.0, 40.0], [1.0, 1.0, 2.0]));
    assert_eq!(air.findings, []);
    assert_eq!((air.logs.len(), air.common_joints.len(), air.rates.len()), (8, 12, 1));
    let run = root().join("../shared/data/go2_air/run_0.csv");
    let (log, report) = read_csv_report(&run, &ReadOptions::default()).unwrap();
    assert_eq!((log.len(), log.rate_hz), (4781, 200.0));
    assert_eq!(log.joints[..4], ["FL_hip", "FL_thigh", "FL_calf", "FR_hip"]);
    assert_eq!(report.ignored, []);
    assert_eq!(log.column(Signal::Target, "FL_calf").unwrap()[0], -2.5);
}

#[test]
#[ignore = "needs the recordings of real robots in ../shared/data"]
fn shared_a_real_robot_that_is_stuck_is_told_from_one_that_trots() {
    let ground = summarise("../shared/data/go2_ground", &gains([20.0; 3], [0.5; 3]));
    let [stuck, trot] = [0, 1];
    let of = |log: usize| ground.findings.iter().filter(move |group| group.logs.contains(&log));
    // The trot's velocities are 1.15 times the derivative of its positions in every joint; its time stamps are counted
    // steps of 0.02 s.
    let said: Vec<_> =
        of(trot).filter(|group| group.severity > Severity::Note).map(|group| group.kind).collect();
    assert!(
        said.iter().all(|kind| *kind == FindingKind::VelocityMismatch || *kind == FindingKind::Stuck),
        "{ground:#?}"
    );
    let group = of(stuck).find(|group| group.kind == FindingKind::Stuck).unwrap();
    assert_eq!((group.severity, &group.logs[..], group.joints.len()), (Severity::Error, &[stuck][..], 12));

    let path = |name: &str| root().join("../shared/data/go2_ground").join(name);
    let stuck = read_csv(&path("stuck.csv"), &ReadOptions::default()).unwrap();
    let findings = check(&stuck, &CheckSpec::default());
    let span = findings.iter().find(|finding| finding.kind == FindingKind::Stuck).unwrap().span.unwrap();
    assert!(span.from_s < 8.0 && span.end == 254, "{span:?}");
    // Without targets, the actions tell.
    for (name, expected) in [("trot.csv", false), ("stuck.csv", true)] {
        let mut log = read_csv(&path(name), &ReadOptions::default()).unwrap();
        log.target = None;
        let stuck =
            check(&log, &CheckSpec::default()).iter().any(|finding| finding.kind == FindingKind::Stuck);
        assert_eq!(stuck, expected, "{name}");
    }
    let (log, report) = read_csv_report(&path("trot.csv"), &ReadOptions::default()).unwrap();
    assert_eq!((log.len(), log.rate_hz), (204, 50.0));
    assert!(log.action.is_some() && log.command.is_some());
    let base = log.base.unwrap();
    assert!(base.quaternion.is_some() && base.angular_velocity.is_none());
    let unknown: Vec<_> = report.ignored.iter().map(|ignored| ignored.name.as_str()).collect();
    assert_eq!(unknown[..4], ["timestep", "wx", "wy", "wz"]);
}
