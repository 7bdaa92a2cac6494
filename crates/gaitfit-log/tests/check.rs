//! Every finding has a case that raises it, on a log that is healthy otherwise, and healthy logs raise none.
#![allow(clippy::unwrap_used, reason = "tests")]

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
        source: None,
        robot: None,
        joints: (0..joints).map(|joint| format!("j{joint}")).collect(),
        time: (0..samples).map(|i| i as f64 / RATE).collect(),
        rate_hz: RATE,
        position: Vec::new(),
        velocity: Vec::new(),
        target: Some(Vec::new()),
        action: None,
        command: None,
        base: None,
        gains: Some(Gains { kp: vec![20.0; joints], kd: vec![1.0; joints] }),
        fell: false,
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
    assert_eq!((finding.kind, finding.joints), (FindingKind::MissingJoint, vec!["tail".to_owned()]));

    spec.joints = Some(vec!["j0".into(), "j1_joint".into()]);
    let findings = check(&healthy(), &spec);
    assert_eq!(findings.len(), 2);
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
fn signals_that_never_change() {
    let fill =
        |values: &mut [f64], joint: usize| values.iter_mut().skip(joint).step_by(2).for_each(|v| *v = 0.2);
    let mut log = healthy();
    fill(&mut log.position, 0);
    let findings = check(&log, &spec());
    assert_eq!(
        (findings[0].kind, &findings[0].joints),
        (FindingKind::ConstantSignal, &vec!["j0".to_owned()])
    );
    assert_eq!(findings[0].severity, Severity::Error);

    let mut log = healthy();
    fill(&mut log.velocity, 1);
    assert_eq!(
        kinds(&log),
        [(FindingKind::ConstantSignal, Severity::Error), (FindingKind::VelocityMismatch, Severity::Warning)]
            [..1]
    );

    let mut log = healthy();
    log.action = Some(vec![0.0; 2 * log.len()]);
    assert_eq!(kinds(&log), [(FindingKind::ConstantSignal, Severity::Warning)]);

    let log = simulate(2, 5.0, |t, joint| if joint == 0 { wave(t, 0) } else { 0.5 }, 0.0, &[]);
    assert_eq!(kinds(&log), [(FindingKind::ConstantSignal, Severity::Note)]);
}

#[test]
fn clipped_velocities_and_actions() {
    let mut log = healthy();
    log.velocity.iter_mut().for_each(|value| *value = value.clamp(-1.5, 1.5));
    assert!(kinds(&log).contains(&(FindingKind::Saturated, Severity::Warning)));
    let mut log = healthy();
    log.action = Some(log.target.iter().flatten().map(|target| (target / 0.25).clamp(-1.0, 1.0)).collect());
    let finding = only(&log, &spec());
    assert_eq!((finding.kind, finding.joints.len()), (FindingKind::Saturated, 2));
}

#[test]
fn a_held_robot_is_stuck_and_a_held_joint_is_named() {
    let targets = |t: f64, joint: usize| wave(t, joint % 2) + 0.1 * joint as f64;
    assert_eq!(kinds(&simulate(4, 5.0, targets, 0.0, &[])), []);

    let log = simulate(4, 5.0, targets, 0.0, &[0, 1, 2, 3]);
    let finding = only(&log, &CheckSpec::default());
    assert_eq!((finding.kind, finding.severity), (FindingKind::Stuck, Severity::Error));
    assert_eq!(finding.span.map(|span| (span.start, span.end)), Some((0, 500)));

    let log = simulate(4, 5.0, targets, 0.0, &[2]);
    let finding = only(&log, &CheckSpec::default());
    assert_eq!((finding.kind, finding.severity), (FindingKind::JointNotFollowing, Severity::Warning));
    assert_eq!(finding.joints, ["j2"]);

    // Held from 3 s on: the finding says since when.
    let (free, held) = (simulate(4, 6.0, targets, 0.0, &[]), simulate(4, 6.0, targets, 0.0, &[0, 1, 2, 3]));
    let mut log = free;
    log.position[4 * 300..].copy_from_slice(&held.position[4 * 300..]);
    log.velocity[4 * 300..].copy_from_slice(&held.velocity[4 * 300..]);
    let finding =
        check(&log, &CheckSpec::default()).into_iter().find(|f| f.kind == FindingKind::Stuck).unwrap();
    let span = finding.span.unwrap();
    assert!((2.4..=3.1).contains(&span.from_s) && span.end == 600, "{finding:?}");
}

#[test]
fn soft_loaded_and_noisy_joints_are_not_stuck() {
    // 8 N·m of load sags by 0.4 rad at kp 20.
    let targets = |t: f64, joint: usize| wave(t, joint % 2);
    assert_eq!(kinds(&simulate(4, 5.0, targets, 8.0, &[])), []);
    // Exploration noise held for 20 ms, white beyond the joint's bandwidth.
    let noise = |t: f64, joint: usize| {
        let step = (t * 50.0 + 1e-9).floor();
        0.3 * ((step * 12.9898 + joint as f64 * 78.233).sin() * 43_758.547).fract()
    };
    let findings = kinds(&simulate(4, 8.0, noise, 0.0, &[]));
    assert!(findings.iter().all(|(kind, _)| *kind != FindingKind::Stuck), "{findings:?}");
}

#[test]
fn standing_is_not_stuck_but_an_unanswered_command_is_said() {
    let mut log = simulate(4, 5.0, |_, joint| 0.3 * joint as f64, 5.0, &[]);
    log.command = Some(vec![0.0; 3 * log.len()]);
    assert_eq!(kinds(&log), [(FindingKind::FrozenTarget, Severity::Warning)]);
    log.command = Some([0.5, 0.0, 0.0].repeat(log.len()));
    let found = kinds(&log);
    assert!(found.contains(&(FindingKind::Stuck, Severity::Warning)), "{found:?}");
}

#[test]
fn a_limp_robot_lies() {
    // Motors off: the targets stand, the joints rest 0.9 rad away.
    let mut log = simulate(4, 5.0, |_, joint| 0.3 * joint as f64, 0.0, &[]);
    log.position.iter_mut().for_each(|q| *q -= 0.9);
    let findings = check(&log, &CheckSpec::default());
    assert_eq!((findings[0].kind, findings[0].severity), (FindingKind::Lying, Severity::Error));
    // Without targets, only the standing pose can tell.
    log.target = None;
    assert_eq!(kinds(&log), []);
    let mut spec = CheckSpec::default();
    for joint in 0..4 {
        spec.default_pose.insert(format!("j{joint}"), 0.3 * joint as f64);
    }
    assert_eq!(only(&log, &spec).kind, FindingKind::Lying);
}

#[test]
fn the_base_tells_falls_and_lying() {
    let mut log = healthy();
    let samples = log.len();
    let tilted = |angle: f64| [(0.5 * angle).cos(), (0.5 * angle).sin(), 0.0, 0.0];
    let mut quaternion = [1.0, 0.0, 0.0, 0.0].repeat(samples);
    // A stumble of 0.2 s is no fall.
    quaternion[4 * 100..4 * 120].copy_from_slice(&tilted(1.2).repeat(20));
    log.base = Some(BaseState { quaternion: Some(quaternion.clone()), ..BaseState::default() });
    assert_eq!(check(&log, &spec()), []);
    quaternion[4 * 400..].copy_from_slice(&tilted(1.5).repeat(samples - 400));
    log.base = Some(BaseState { quaternion: Some(quaternion), ..BaseState::default() });
    let finding = only(&log, &spec());
    assert_eq!((finding.kind, finding.span.unwrap().start), (FindingKind::Fallen, 400));
    assert!(finding.message.contains("86°"), "{finding}");

    let mut low = spec();
    low.lying_height = Some(0.15);
    let position = [0.0, 0.0, 0.08].repeat(samples);
    log.base = Some(BaseState { position: Some(position), ..BaseState::default() });
    assert_eq!(only(&log, &low).kind, FindingKind::Lying);
}

#[test]
fn checks_take_any_values() {
    let strange = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN, 5e-324, -0.0, 0.0, 1e18];
    let mut limits = spec();
    limits.lying_height = Some(0.1);
    limits.default_pose.insert("j0".into(), 0.0);
    for case in 0..400usize {
        let mut log = healthy().slice(0..case % 130).unwrap();
        let samples = log.len();
        log.action = log.target.clone();
        log.command = Some(vec![0.5; 3 * samples]);
        log.base = Some(BaseState {
            position: Some(vec![0.05; 3 * samples]),
            quaternion: Some(vec![0.5; 4 * samples]),
            ..BaseState::default()
        });
        if case % 3 == 0 {
            log.target = None;
        }
        log.rate_hz = [100.0, 1e-9, 1e12][case % 7 % 3];
        for hit in 0..case % 11 {
            let value = strange[(case + hit) % strange.len()];
            let base = log.base.as_mut().unwrap();
            let arrays = [
                &mut log.position,
                &mut log.velocity,
                log.action.as_mut().unwrap(),
                log.command.as_mut().unwrap(),
                base.quaternion.as_mut().unwrap(),
                base.position.as_mut().unwrap(),
            ];
            for (i, array) in arrays.into_iter().enumerate() {
                let length = array.len().max(1);
                if let Some(slot) = array.get_mut((case * 31 + hit * 17 + i * 7) % length) {
                    *slot = value;
                }
            }
            if value.is_finite() && samples > 0 {
                log.time[(case + hit) % samples] = value;
            }
        }
        log.validate().unwrap();
        for finding in check(&log, &limits) {
            assert!(finding.span.is_none_or(|span| span.start < span.end && span.end <= samples));
            assert!(finding.message.len() > 10);
        }
        assert_eq!(summary(&log).samples, samples);
    }
}

#[test]
fn summary_counts_by_hand() {
    let log = Trajectory {
        joints: vec!["a".into()],
        time: vec![0.0, 0.1, 0.2, 0.4],
        rate_hz: 10.0,
        position: vec![1.0, -1.0, f64::NAN, 2.0],
        velocity: vec![0.0; 4],
        target: Some(vec![1.0, 0.0, 0.0, 0.0]),
        gains: Some(Gains { kp: vec![3.0], kd: vec![4.0] }),
        fell: false,
        source: None,
        robot: None,
        action: None,
        command: None,
        base: None,
    };
    let summary = summary(&log);
    let joint = &summary.joints[0];
    let position = joint.position.unwrap();
    assert_eq!((position.min, position.max, position.missing), (-1.0, 2.0, 1));
    // RMS of 1, −1, 2: √(6/3); errors 0, −1, 2: √(5/3).
    assert!((position.rms - 2f64.sqrt()).abs() < 1e-15);
    assert!((joint.tracking_rms_rad.unwrap() - (5.0f64 / 3.0).sqrt()).abs() < 1e-15);
    assert_eq!((joint.kp, joint.kd), (Some(3.0), Some(4.0)));
    assert_eq!(summary.channels, ["position", "velocity", "target"]);
    assert!((summary.longest_interval_s.unwrap() - 0.2).abs() < 1e-15);
    // Intervals 0.1, 0.1, 0.2 against their median 0.1: √(0.01/3).
    assert!((summary.jitter_s.unwrap() - (0.01f64 / 3.0).sqrt()).abs() < 1e-12);
}
