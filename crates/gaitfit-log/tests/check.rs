//! Every finding has a case that raises it, on a log that is healthy otherwise, and healthy logs raise none.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "check/gross.rs"]
mod gross;
#[path = "check/motion.rs"]
mod motion;

use gaitfit_log::*;

const RATE: f64 = 100.0;

/// A log of PD-controlled joints: inertia 0.1 kg·m², kp 20, kd 1, `load(joint)` N·m of constant load, targets
/// `target(t, joint)`; integrated at 2 kHz. `held` joints do not move.
fn simulate(
    joints: usize,
    seconds: f64,
    target: impl Fn(f64, usize) -> f64,
    load: f64,
    held: &[usize],
) -> Trajectory {
    let samples = (seconds * RATE) as usize;
    let mut log = Trajectory {
        target: Some(Vec::new()),
        gains: Some(Gains { kp: vec![20.0; joints], kd: vec![1.0; joints] }),
        ..Trajectory::of_joints(
            (0..joints).map(|joint| format!("j{joint}")).collect(),
            RATE,
            (0..samples).map(|i| i as f64 / RATE).collect(),
            Vec::new(),
            Vec::new(),
        )
    };
    let mut q: Vec<f64> = (0..joints).map(|joint| target(0.0, joint) - load / 20.0).collect();
    let mut dq = vec![0.0; joints];
    for i in 0..samples {
        let t = i as f64 / RATE;
        log.position.extend(&q);
        // Encoder noise on the velocity keeps resting joints alive, as on a robot.
        log.velocity
            .extend(dq.iter().enumerate().map(|(j, v)| v + 0.01 * ((i * 7919 + j * 31) as f64).sin()));
        let wanted: Vec<f64> = (0..joints).map(|joint| target(t, joint)).collect();
        log.target.as_mut().unwrap().extend(&wanted);
        for _ in 0..20 {
            for joint in (0..joints).filter(|joint| !held.contains(joint)) {
                let tau = 20.0 * (wanted[joint] - q[joint]) - dq[joint] - load;
                dq[joint] += tau / 0.1 / 2000.0;
                q[joint] += dq[joint] / 2000.0;
            }
        }
    }
    for (i, q) in log.position.iter_mut().enumerate() {
        *q += 1e-5 * ((i * 104_729) as f64).sin();
    }
    log
}

/// Two joints at 2 Hz and 1 Hz.
fn wave(t: f64, joint: usize) -> f64 {
    0.3 * (std::f64::consts::TAU * t * if joint == 0 { 2.0 } else { 1.0 }).sin()
}

fn healthy() -> Trajectory {
    simulate(2, 5.0, wave, 0.0, &[])
}

fn kinds(log: &Trajectory) -> Vec<(FindingKind, Severity)> {
    check(log, &CheckSpec::default()).into_iter().map(|finding| (finding.kind, finding.severity)).collect()
}

/// The one finding that `log` raises.
fn only(log: &Trajectory, spec: &CheckSpec) -> Finding {
    let findings = check(log, spec);
    assert_eq!(findings.len(), 1, "{findings:#?}");
    findings.into_iter().next().unwrap()
}

fn spec() -> CheckSpec {
    CheckSpec {
        joints: Some(vec!["j0".into(), "j1".into()]),
        position_limits: [("j0".to_owned(), [-1.0, 1.0]), ("j1".to_owned(), [-1.0, 1.0])].into(),
        velocity_limits: [("j0".to_owned(), 10.0)].into(),
        effort_limits: [("j0".to_owned(), 30.0)].into(),
        ..CheckSpec::default()
    }
}

#[test]
fn a_healthy_log_raises_nothing() {
    assert_eq!(check(&healthy(), &spec()), []);
}

#[test]
fn joints_are_compared_by_name() {
    let mut spec = spec();
    spec.joints = Some(vec!["j1".into(), "j0".into()]);
    let finding = only(&healthy(), &spec);
    assert_eq!((finding.kind, finding.severity), (FindingKind::JointOrder, Severity::Note));

    spec.joints = Some(vec!["j0".into(), "j1".into(), "tail".into()]);
    let finding = only(&healthy(), &spec);
    assert_eq!((finding.kind, finding.severity), (FindingKind::MissingJoint, Severity::Warning));
    assert_eq!(finding.joints, ["tail"]);

    spec.joints = Some(vec!["j0".into(), "j1_joint".into()]);
    let findings = check(&healthy(), &spec);
    assert_eq!((findings.len(), findings[0].severity), (2, Severity::Error));
    assert!(findings[0].message.contains("whose j1 may be it"), "{}", findings[0]);
    assert_eq!((findings[1].kind, &findings[1].joints), (FindingKind::ExtraJoint, &vec!["j1".to_owned()]));
}

#[test]
fn malformed_and_short_logs() {
    let mut log = healthy();
    log.target.as_mut().unwrap().pop();
    assert_eq!(only(&log, &spec()).kind, FindingKind::Malformed);
    assert_eq!(only(&healthy().slice(0..1).unwrap(), &spec()).kind, FindingKind::TooShort);
    for length in 2..60 {
        let findings = check(&healthy().slice(0..length).unwrap(), &spec());
        assert!(findings.iter().all(|finding| finding.severity < Severity::Error), "{length}: {findings:?}");
    }
}

#[test]
fn time_must_increase_regularly_at_the_stated_rate() {
    let mut log = healthy();
    log.time[50] = log.time[49];
    let findings = check(&log, &spec());
    assert_eq!((findings[0].kind, findings[0].severity), (FindingKind::NonMonotonicTime, Severity::Error));
    assert_eq!(findings[0].span.map(|span| (span.start, span.end)), Some((49, 51)));

    let mut log = healthy();
    log.time[200..].iter_mut().for_each(|time| *time += 0.02);
    let gap = only(&log, &spec());
    assert_eq!((gap.kind, gap.severity), (FindingKind::TimeGap, Severity::Warning));
    assert!(gap.message.starts_with("1 gap(s), about 2 samples lost; the longest is 0.0300 s"), "{gap}");
    log.time[200..].iter_mut().for_each(|time| *time += 0.5);
    assert_eq!(only(&log, &spec()).severity, Severity::Error);

    let mut log = healthy();
    log.time.iter_mut().enumerate().for_each(|(i, time)| *time += 0.002 * (i as f64 * 2.3).sin());
    assert!(kinds(&log).contains(&(FindingKind::IrregularTime, Severity::Warning)));

    let mut log = healthy();
    log.time.iter_mut().for_each(|time| *time *= 1000.0);
    let findings = check(&log, &spec());
    assert_eq!(findings[0].kind, FindingKind::RateMismatch);
    assert!(findings[0].message.contains("milliseconds"), "{}", findings[0]);
}

#[test]
fn a_recorder_faster_than_the_robot_is_noticed() {
    let mut log = healthy();
    for i in 0..log.len() {
        let from = i / 2 * 2;
        for joint in 0..2 {
            log.position[i * 2 + joint] = log.position[from * 2 + joint];
            log.velocity[i * 2 + joint] = log.velocity[from * 2 + joint];
        }
    }
    let finding = only(&log, &spec());
    assert_eq!(finding.kind, FindingKind::RepeatedRows);
    assert!(finding.message.starts_with("50 %") && finding.message.contains("50 Hz"), "{finding}");
}

#[test]
fn missing_values_are_errors_in_joint_signals_and_warnings_in_the_base() {
    let mut log = healthy();
    log.velocity[2 * 30 + 1] = f64::NAN;
    log.velocity[2 * 40 + 1] = f64::INFINITY;
    let finding = only(&log, &spec());
    assert_eq!((finding.kind, finding.severity), (FindingKind::NotFinite, Severity::Error));
    assert_eq!(finding.joints, ["j1"]);
    let span = finding.span.unwrap();
    assert_eq!((span.start, span.end, span.from_s), (30, 41, 0.3));

    let mut log = healthy();
    let mut rates = vec![0.0; 3 * log.len()];
    rates[7] = f64::NAN;
    log.base = Some(BaseState { angular_velocity: Some(rates), ..BaseState::default() });
    let finding = only(&log, &spec());
    assert_eq!((finding.kind, finding.severity), (FindingKind::NotFinite, Severity::Warning));
}

#[test]
fn limits_are_held_by_name() {
    let mut tight = spec();
    tight.position_limits.insert("j1".into(), [-0.1, 1.0]);
    let findings = check(&healthy(), &tight);
    let got: Vec<_> = findings.iter().map(|f| (f.kind, f.severity, f.joints.len())).collect();
    assert_eq!(
        got,
        [
            (FindingKind::BeyondPositionLimit, Severity::Error, 1),
            (FindingKind::BeyondPositionLimit, Severity::Note, 1)
        ]
    );
    let mut tight = spec();
    tight.velocity_limits.insert("j0".into(), 3.0);
    let finding = only(&healthy(), &tight);
    assert_eq!((finding.kind, finding.severity), (FindingKind::BeyondVelocityLimit, Severity::Note));
    tight.velocity_limits.insert("j0".into(), 0.1);
    assert_eq!(only(&healthy(), &tight).severity, Severity::Error);
    let mut weak = spec();
    weak.effort_limits.insert("j0".into(), 1.0);
    let finding = only(&healthy(), &weak);
    assert_eq!((finding.kind, finding.joints), (FindingKind::Saturated, vec!["j0".to_owned()]));
}

#[test]
fn a_fall_may_drive_a_joint_beyond_its_limits_for_a_moment() {
    let mut log = healthy();
    let joint = log.joints.iter().position(|name| name == "j1").unwrap();
    let joints = log.joints.len();
    let samples = log.position.len() / joints;
    // Far beyond the limits at the end, while the robot falls.
    let knock = |log: &mut Trajectory, from: usize| {
        (from..samples).for_each(|sample| log.position[sample * joints + joint] = 3.0);
    };
    knock(&mut log, samples - samples / 20);
    let mut tight = spec();
    tight.position_limits.insert("j1".into(), [-1.5, 1.5]);
    let severity = |log: &Trajectory| {
        let findings = check(log, &tight);
        findings.iter().find(|one| one.kind == FindingKind::BeyondPositionLimit).unwrap().severity
    };
    assert_eq!(severity(&log), Severity::Error);
    log.fell = true;
    assert_ne!(severity(&log), Severity::Error);
    // A joint that is beyond them all the time is another joint, or in degrees.
    knock(&mut log, 0);
    assert_eq!(severity(&log), Severity::Error);
}

#[test]
fn a_joint_that_is_pushed_against_its_stop_is_a_note() {
    let mut log = healthy();
    let limit = log.column(Signal::Position, "j1").unwrap().into_iter().fold(0.0, f64::max) - 0.05;
    let mut tight = spec();
    tight.position_limits.insert("j1".into(), [-1.0, limit]);
    // The target goes further.
    log.target.as_mut().unwrap().iter_mut().for_each(|target| *target *= 1.2);
    let severities: Vec<_> = check(&log, &tight).iter().map(|f| (f.kind, f.severity)).collect();
    assert_eq!(severities, [(FindingKind::BeyondPositionLimit, Severity::Note); 2]);
    // It does not: the joint's zero is suspect.
    log.target.as_mut().unwrap().iter_mut().for_each(|target| *target /= 2.4);
    let finding = only(&log, &tight);
    assert_eq!((finding.kind, finding.severity), (FindingKind::BeyondPositionLimit, Severity::Warning));
    assert!(finding.message.contains("zero"), "{finding}");
}

#[test]
fn messages_are_short_and_cannot_command_a_terminal() {
    let mut log = healthy();
    log.joints = vec!["\u{1b}[2Jhip".into(), "k".repeat(10_000)];
    log.position[0] = 1e300;
    log.velocity[7] = f64::NAN;
    log.time[9] = -1e300;
    let mut limits = CheckSpec::default();
    for joint in &log.joints {
        limits.position_limits.insert(joint.clone(), [-1e-300, 1e-300]);
        limits.velocity_limits.insert(joint.clone(), 1e-300);
    }
    limits.joints = Some(vec!["\u{9b}31mtail".into(), "t".repeat(10_000)]);
    let findings = check(&log, &limits);
    assert!(findings.len() > 5, "{findings:#?}");
    for finding in findings {
        let text = finding.to_string();
        assert!(!text.chars().any(char::is_control) && text.len() < 600, "{text}");
    }
}

#[test]
fn units_and_signs() {
    let mut log = healthy();
    let degrees = |values: &mut Vec<f64>| values.iter_mut().for_each(|value| *value = value.to_degrees());
    degrees(&mut log.position);
    degrees(log.target.as_mut().unwrap());
    let findings = check(&log, &CheckSpec::default());
    let suspects = findings.iter().filter(|finding| finding.kind == FindingKind::SuspectUnit).count();
    assert_eq!(suspects, 2, "{findings:#?}");

    let mut log = healthy();
    degrees(&mut log.velocity);
    let finding = only(&log, &CheckSpec::default());
    assert_eq!((finding.kind, finding.severity), (FindingKind::VelocityMismatch, Severity::Error));
    assert!(finding.message.contains("degrees per second"), "{finding}");

    let mut log = healthy();
    log.velocity.iter_mut().skip(1).step_by(2).for_each(|value| *value = -*value);
    let finding = only(&log, &spec());
    assert!(finding.message.contains("opposite sign"), "{finding}");
    assert_eq!((finding.kind, finding.joints), (FindingKind::VelocityMismatch, vec!["j1".to_owned()]));

    // Columns of two joints swapped: 1 Hz against 2 Hz.
    let mut log = healthy();
    log.velocity.chunks_exact_mut(2).for_each(|row| row.swap(0, 1));
    let finding = only(&log, &spec());
    assert!(finding.message.contains("columns mixed up"), "{finding}");
}

#[test]
fn answers_between_samples_are_a_warning_and_a_gear_is_an_error() {
    // The second joint answers each step within its 20 ms; its velocity at their end is a part of the mean one.
    let noise = |row: usize| 2.0 * ((row as f64 * 12.9898).sin() * 43_758.547).fract().abs() - 1.0;
    let said = |part: f64, jumps: bool| {
        let (mut position, mut velocity, mut at) = (Vec::new(), Vec::new(), 0.0);
        let time: Vec<f64> = (0..500).map(|row| 0.02 * row as f64).collect();
        for (row, t) in time.iter().enumerate() {
            let speed = if jumps { 3.0 * noise(row) } else { 3.0 * (4.0 * t).cos() };
            at += 0.02 * speed;
            position.extend([0.5 * (5.0 * t).sin(), at]);
            velocity.extend([2.5 * (5.0 * t).cos(), part * speed]);
        }
        let log = Trajectory::of_joints(vec!["a".into(), "b".into()], 50.0, time, position, velocity);
        let findings = check(&log, &CheckSpec::default());
        let one = findings.iter().find(|one| one.kind == FindingKind::VelocityMismatch)?;
        Some((one.severity, one.message.contains("nothing need be wrong")))
    };
    assert_eq!(said(0.66, true), Some((Severity::Warning, true)));
    assert_eq!(said(0.62, true), Some((Severity::Warning, false)));
    assert_eq!(said(0.4, true), Some((Severity::Error, false)));
    assert_eq!(said(1.0 / 1.9169, false), Some((Severity::Error, false)));
    assert_eq!(said(1.0, false), None);
}
