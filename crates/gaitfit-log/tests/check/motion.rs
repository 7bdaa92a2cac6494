//! Checks of how a robot moves: clipping, holding, falling, lying; and the summary.

use super::*;

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

/// A log whose second joint is a wheel: its target is a velocity of `asked(t)` rad/s, and it turns at `turns(t)`.
fn on_wheels(asked: impl Fn(f64) -> f64, turns: impl Fn(f64) -> f64) -> Trajectory {
    let mut log = healthy();
    log.velocity_joints = vec!["j1".into()];
    let (mut angle, mut before) = (0.0, log.time[0]);
    for row in 0..log.len() {
        let t = log.time[row];
        angle += (t - before) * turns(t);
        before = t;
        (log.position[2 * row + 1], log.velocity[2 * row + 1]) = (angle, turns(t));
        if let Some(target) = &mut log.target {
            target[2 * row + 1] = asked(t);
        }
    }
    log
}

#[test]
fn a_wheel_is_judged_by_its_speed() {
    let asked = |t: f64| 8.0 + 5.0 * (5.0 * t).sin();
    assert_eq!(kinds(&on_wheels(asked, |t| 7.0 + 4.5 * (5.0 * t - 0.1).sin())), []);
    // A wheel with a nearly steady target need not follow small changes.
    assert_eq!(kinds(&on_wheels(|t| 8.0 + 0.2 * (9.0 * t).sin(), |t| 8.0 + 0.01 * t.sin())), []);
    let blocked = on_wheels(asked, |t| 0.01 * t.sin());
    // Friction of the ground may hold a wheel against a small target.
    assert_eq!(kinds(&on_wheels(|t| 4.0 + 0.1 * t.sin(), |t| 0.01 * t.sin())), []);
    let steady = on_wheels(|t| 12.0 + 0.1 * t.sin(), |t| 0.01 * t.sin());
    for blocked in [blocked, steady] {
        let finding = only(&blocked, &spec());
        assert_eq!((finding.kind, &finding.joints), (FindingKind::JointNotFollowing, &vec!["j1".to_owned()]));
        assert!(finding.message.contains("rad/s"), "{}", finding.message);
    }
}

#[test]
fn angles_of_wheels_that_wrap_or_count_on_become_continuous() {
    let turn = std::f64::consts::TAU;
    let smooth = on_wheels(|t| 8.0 + t.sin(), |t| 8.0 - 20.0 * t);
    let near = |a: &Trajectory, b: &Trajectory| {
        a.position.iter().zip(&b.position).all(|(a, b)| (a - b).abs() < 1e-6)
    };
    let changed = |change: fn(f64) -> f64| {
        let mut log = smooth.clone();
        log.position.iter_mut().skip(1).step_by(2).for_each(|angle| *angle = change(*angle));
        log.unwrap_wheels();
        log
    };
    assert_eq!(changed(|angle| angle).position, smooth.position);
    assert!(near(&changed(|angle| angle.rem_euclid(std::f64::consts::TAU)), &smooth));
    assert!(near(&changed(|angle| (angle + 3.0).rem_euclid(std::f64::consts::TAU) - 3.0), &smooth));
    assert!(near(&changed(|angle| angle + 1e4 * std::f64::consts::TAU), &smooth));
    let mut hip = smooth.clone();
    hip.position.iter_mut().step_by(2).for_each(|angle| *angle += turn);
    let before = hip.position.clone();
    hip.unwrap_wheels();
    assert_eq!(hip.position, before, "other joints keep their angles");
    let mut broken = smooth.clone();
    (broken.position[21], broken.velocity[41]) = (f64::NAN, f64::INFINITY);
    broken.unwrap_wheels();
    assert!(broken.position[21].is_nan() && (broken.position[101] - smooth.position[101]).abs() < 1e-6);
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
    let kinds = kinds(&log);
    assert!(kinds.contains(&(FindingKind::Stuck, Severity::Warning)), "{kinds:?}");
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
        target: Some(vec![1.0, 0.0, 0.0, 0.0]),
        gains: Some(Gains { kp: vec![3.0], kd: vec![4.0] }),
        ..Trajectory::of_joints(
            vec!["a".into()],
            10.0,
            vec![0.0, 0.1, 0.2, 0.4],
            vec![1.0, -1.0, f64::NAN, 2.0],
            vec![0.0; 4],
        )
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
