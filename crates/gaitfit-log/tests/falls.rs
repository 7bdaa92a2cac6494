//! Falls are found from the base and from the joints, and walking is not taken for one.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_log::{BaseState, CheckSpec, FallSign, Trajectory, falls};

/// Six seconds at 50 Hz of four joints that step at 2 Hz; from `stuck` s on the joints rest while targets go on.
fn walk(stuck: f64) -> Trajectory {
    let time: Vec<f64> = (0..300).map(|k| f64::from(k) / 50.0).collect();
    let wave = |at: f64, joint: usize| 0.3 * (std::f64::consts::TAU * 2.0 * at + joint as f64).sin();
    let mut log = Trajectory {
        target: Some(Vec::new()),
        ..Trajectory::of_joints(
            (0..4).map(|joint| format!("joint_{joint}")).collect(),
            50.0,
            time,
            Vec::new(),
            Vec::new(),
        )
    };
    for &at in &log.time {
        for joint in 0..4 {
            let moves = at < stuck;
            log.target.get_or_insert_default().push(wave(at, joint));
            log.position.push(if moves { 0.8 * wave(at - 0.04, joint) } else { 0.1 });
            let speed = (wave(at - 0.03, joint) - wave(at - 0.05, joint)) / 0.02;
            log.velocity.push(if moves { 0.8 * speed } else { 0.0 });
        }
    }
    log
}

/// Roll, degrees, as a function of time.
fn rolling(mut log: Trajectory, degrees: impl Fn(f64) -> f64) -> Trajectory {
    let quaternion = log.time.iter().flat_map(|&at| {
        let half = 0.5 * degrees(at).to_radians();
        [half.cos(), half.sin(), 0.0, 0.0]
    });
    log.base = Some(BaseState { quaternion: Some(quaternion.collect()), ..BaseState::default() });
    log
}

#[test]
fn a_walk_is_no_fall() {
    assert!(falls(&walk(9.0), &CheckSpec::default()).is_empty());
    let sways = rolling(walk(9.0), |at| 25.0 * (9.0 * at).sin());
    assert!(falls(&sways, &CheckSpec::default()).is_empty());
}

#[test]
fn a_log_may_say_that_it_ends_in_a_fall() {
    let log = Trajectory { fell: true, ..walk(9.0) };
    let events = falls(&log, &CheckSpec::default());
    assert_eq!((events.len(), &events[0].samples, events[0].sign), (1, &(299..300), FallSign::Stated));
    assert!(falls(&log.slice(0..200).unwrap(), &CheckSpec::default()).is_empty());
    assert_eq!(falls(&log.slice(200..300).unwrap(), &CheckSpec::default()).len(), 1);
    // One that also shows it fell once.
    let events = falls(&Trajectory { fell: true, ..walk(3.0) }, &CheckSpec::default());
    assert_eq!((events.len(), events[0].sign), (1, FallSign::Stuck));
}

#[test]
fn joints_that_stop_show_a_fall() {
    let falls = falls(&walk(3.0), &CheckSpec::default());
    assert_eq!(falls.len(), 1, "{falls:?}");
    assert_eq!(falls[0].sign, FallSign::Stuck);
    assert!((100..=150).contains(&falls[0].samples.start) && falls[0].samples.end == 300, "{falls:?}");
}

#[test]
fn the_base_shows_when() {
    // 60° are passed at 2.6 s; up again at 4 s.
    let tumbles = rolling(walk(9.0), |at| if (2.0..4.0).contains(&at) { 100.0 * (at - 2.0) } else { 0.0 });
    let events = falls(&tumbles, &CheckSpec::default());
    assert_eq!(events.len(), 1);
    assert_eq!((events[0].samples.clone(), events[0].sign), (131..200, FallSign::Tilt));
    // A short lurch is no fall, one that ends the log is.
    let lurches = |from: f64, to: f64| {
        falls(&rolling(walk(9.0), |at| if at >= from && at < to { 70.0 } else { 0.0 }), &CheckSpec::default())
    };
    assert!(lurches(2.01, 2.06).is_empty());
    assert_eq!(lurches(5.93, 9.0).len(), 1);
}

/// A robot that walks on its hind legs leans by 90° all the time; it falls when it is on four legs again.
#[test]
fn a_robot_leans_away_from_its_own_posture() {
    let pitched = |angle: fn(f64) -> f64| {
        let mut log = walk(9.0);
        let half = |at: f64| angle(at).to_radians() / 2.0;
        let quaternion = log.time.iter().flat_map(|&at| [half(at).cos(), 0.0, half(at).sin(), 0.0]).collect();
        log.base = Some(BaseState { quaternion: Some(quaternion), ..BaseState::default() });
        log
    };
    // Gravity points at the tail when the base is pitched up by 90°.
    let spec = CheckSpec { posture: Some([-1.0, 0.0, 0.0]), ..CheckSpec::default() };
    let stands = pitched(|_| -80.0);
    assert_eq!(falls(&stands, &CheckSpec::default()).len(), 1, "level is what else a robot is");
    assert!(falls(&stands, &spec).is_empty());
    let drops = pitched(|at| if at < 3.0 { -90.0 } else { 0.0 });
    let events = falls(&drops, &spec);
    assert_eq!((events.len(), events[0].samples.start, events[0].sign), (1, 150, FallSign::Tilt));
}

#[test]
fn height_needs_a_limit() {
    let mut log = walk(9.0);
    let position = log.time.iter().flat_map(|&at| [0.0, 0.0, if at < 5.0 { 0.3 } else { 0.08 }]).collect();
    log.base = Some(BaseState { position: Some(position), ..BaseState::default() });
    assert!(falls(&log, &CheckSpec::default()).is_empty());
    let spec = CheckSpec { lying_height: Some(0.12), ..CheckSpec::default() };
    let events = falls(&log, &spec);
    assert_eq!((events[0].samples.clone(), events[0].sign), (250..300, FallSign::Height));
}

#[test]
fn arrays_that_do_not_fit_have_no_falls() {
    let mut log = walk(3.0);
    log.velocity.pop();
    assert!(falls(&log, &CheckSpec::default()).is_empty());
}
