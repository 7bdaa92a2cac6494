//! What drives motors besides position targets, copies and zeros in signals, joints that turn, and what is allowed.
#![allow(clippy::unwrap_used, reason = "tests")]

use gaitfit_log::*;
use std::fmt::Write;

/// A log of one joint, `columns` after time, position and velocity, `values` of each sample number and time.
fn text(head: &str, columns: &str, values: impl Fn(usize, f64) -> Vec<f64>) -> String {
    let mut text = format!("{head}time,q_a,dq_a,{columns}\n");
    for i in 0..300 {
        let t = i as f64 / 100.0;
        let _ = write!(text, "{t},{},{}", 0.3 * (6.0 * t).sin(), 1.8 * (6.0 * t).cos());
        values(i, t).iter().for_each(|value| text.push_str(&format!(",{value}")));
        text.push('\n');
    }
    text
}

fn read(text: &str) -> (Trajectory, ReadReport) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.csv");
    std::fs::write(&path, text).unwrap();
    read_csv_report(&path, &ReadOptions::default()).unwrap()
}

fn asked(t: f64) -> f64 {
    0.32 * (6.0 * (t + 0.02)).sin()
}

#[test]
fn gains_of_each_sample_are_read_and_a_change_is_said() {
    let (log, report) = read(&text("", "qdes_a,kp_a,kd_a", |_, t| vec![asked(t), 20.0, 0.5]));
    assert_eq!(log.gains, Some(Gains { kp: vec![20.0], kd: vec![0.5] }));
    assert_eq!(report.gains_from.as_deref(), Some("the columns kp_ and kd_"));
    assert_eq!((report.findings(), report.ignored), (vec![], vec![]));

    let step = |i: usize, t: f64| vec![asked(t), if i < 120 { 20.0 } else { 60.0 }, 0.5];
    let (log, report) = read(&text("", "qdes_a,kp_a,kd_a", step));
    let findings = report.findings();
    assert_eq!((findings[0].kind, findings[0].severity), (FindingKind::GainsChange, Severity::Error));
    assert!(findings[0].message.starts_with("kp of a changes from 20 to 60 at 1.2 s"), "{}", findings[0]);
    assert_eq!(log.gains.unwrap().kp, [20.0]);

    // A stated gain is stronger, and a difference is said.
    let (log, report) =
        read(&text("# kp = 25\n# kd = 0.5\n", "qdes_a,kp_a,kd_a", |_, t| vec![asked(t), 20.0, 0.5]));
    assert_eq!(log.gains.unwrap().kp, [25.0]);
    assert_eq!(report.findings()[0].severity, Severity::Warning);
}

#[test]
fn desired_velocities_and_torques_become_targets() {
    let drive = |_: usize, t: f64| vec![asked(t), 1.5 * t.cos(), 2.0 * t.sin()];
    let (log, report) = read(&text("# kp = 20\n# kd = 0.5\n", "qdes_a,dqdes_a,tauff_a", drive));
    let target = log.target.unwrap();
    for i in [0, 57, 299] {
        let t = i as f64 / 100.0;
        let same_torque = asked(t) + (0.5 * 1.5 * t.cos() + 2.0 * t.sin()) / 20.0;
        assert!((target[i] - same_torque).abs() < 1e-12);
    }
    let findings = report.findings();
    assert_eq!((findings[0].kind, findings[0].severity), (FindingKind::FeedForward, Severity::Note));
    // Zeros drive nothing; without gains, or with a gain of 0, the torque cannot be kept.
    let zeros = |_: usize, t: f64| vec![asked(t), 0.0, 0.0];
    assert_eq!(read(&text("", "qdes_a,dqdes_a,tauff_a", zeros)).1.findings(), []);
    for head in ["", "# kp = 0\n# kd = 0.5\n"] {
        let findings = read(&text(head, "qdes_a,dqdes_a,tauff_a", drive)).1.findings();
        assert_eq!((findings[0].kind, findings[0].severity), (FindingKind::FeedForward, Severity::Error));
    }
}

#[test]
fn targets_that_are_the_positions_are_refused() {
    let copies = |late: f64| move |_: usize, t: f64| vec![0.3 * (6.0 * (t - late)).sin()];
    for late in [0.0, 0.01] {
        let (log, _) = read(&text("", "qdes_a", copies(late)));
        let findings = check(&log, &CheckSpec::default());
        assert_eq!(findings.len(), 1, "{findings:#?}");
        assert_eq!(
            (findings[0].kind, findings[0].severity),
            (FindingKind::TargetIsPosition, Severity::Error)
        );
    }
    let (log, _) = read(&text("", "qdes_a", |_, t| vec![asked(t)]));
    assert_eq!(check(&log, &CheckSpec::default()), []);
}

#[test]
fn zeros_of_a_second_writer_are_named() {
    let (mut log, _) = read(&text("", "qdes_a", |_, t| vec![asked(t)]));
    for i in (30..280).step_by(40) {
        log.position[i] = 0.0;
        log.velocity[i] = 0.0;
    }
    let findings = check(&log, &CheckSpec::default());
    let zeros = findings.iter().find(|finding| finding.kind == FindingKind::JumpsToZero).unwrap();
    assert!(
        zeros.severity == Severity::Error && zeros.message.contains("(at 0.3, 0.7, 1.1, … s)"),
        "{zeros}"
    );
}

/// A wheel turns; legs in degrees do so in all joints, and fast.
#[test]
fn an_unlimited_joint_may_turn() {
    let (mut log, _) = read(&text("", "qdes_a", |_, t| vec![16.0 * t + 0.5]));
    let times = log.time.clone();
    log.position = times.iter().map(|t| 16.0 * t).collect();
    log.velocity = vec![16.0; 300];
    let robot = CheckSpec { joints: Some(vec!["a".into()]), ..CheckSpec::default() };
    let worst = |spec: &CheckSpec, log: &Trajectory| {
        check(log, spec)
            .into_iter()
            .filter(|finding| finding.kind == FindingKind::SuspectUnit)
            .map(|f| f.severity)
            .max()
    };
    assert_eq!(worst(&robot, &log), None);
    assert_eq!(worst(&CheckSpec::default(), &log), Some(Severity::Note));
    log.velocity.iter_mut().for_each(|speed| *speed *= 5.0);
    assert_eq!(worst(&CheckSpec::default(), &log), Some(Severity::Error));
}

#[test]
fn what_is_allowed_is_a_warning() {
    let copies = text("# allow = [\"target-is-position\"]\n", "qdes_a", |_, t| vec![0.3 * (6.0 * t).sin()]);
    let (log, report) = read(&copies);
    assert_eq!(report.allowed, [FindingKind::TargetIsPosition]);
    let mut findings = check(&log, &CheckSpec::default());
    allow(&mut findings, &report.allowed);
    assert_eq!(findings[0].severity, Severity::Warning);
    assert!(findings[0].to_string().starts_with("warning: target-is-position: "), "{}", findings[0]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.csv");
    std::fs::write(&path, text("# allow = [\"anything\"]\n", "qdes_a", |_, _| vec![0.0])).unwrap();
    let error = read_csv(&path, &ReadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("anything") && error.contains("time-gap"), "{error}");
}

/// Fast motion between samples makes no gear ratio: 3 Hz with sharp turns at 50 Hz, whose velocities are exact.
#[test]
fn sampling_of_fast_motion_is_no_gear_ratio() {
    let mut text = String::from("time,q_a,q_b,dq_a,dq_b\n");
    // An answer to steps: the velocity of the end of each period is less than its mean.
    let (mut q, mut dq) = ([0.0f64; 2], [0.0f64; 2]);
    for i in 0..400 {
        let t = f64::from(i) / 50.0;
        let _ = writeln!(text, "{t},{},{},{},{}", q[0], q[1], dq[0], dq[1]);
        let wanted = [0.4 * (18.8 * t).sin(), 0.3 * (12.0 * t).sin()];
        for _ in 0..40 {
            for (joint, stiffness) in [(0, 2500.0), (1, 900.0)] {
                let damping = 1.4 * f64::sqrt(stiffness);
                dq[joint] += (stiffness * (wanted[joint] - q[joint]) - damping * dq[joint]) / 2000.0;
                q[joint] += dq[joint] / 2000.0;
            }
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.csv");
    std::fs::write(&path, text).unwrap();
    let log = read_csv(&path, &ReadOptions::default()).unwrap();
    assert_eq!(check(&log, &CheckSpec::default()), []);
}
