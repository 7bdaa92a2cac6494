//! Slicing, joint selection and resampling, by hand.
#![allow(clippy::unwrap_used, reason = "tests")]

use gaitfit_log::*;

/// Two joints, four samples at 10 Hz: `a` counts 0, 1, 2, 3 and `b` is ten times that.
fn log() -> Trajectory {
    let rows =
        |scale: f64| (0..4).flat_map(|i| [scale * i as f64, 10.0 * scale * i as f64]).collect::<Vec<_>>();
    Trajectory {
        source: None,
        robot: Some("r".into()),
        joints: vec!["a".into(), "b".into()],
        time: vec![1.0, 1.1, 1.2, 1.3],
        rate_hz: 10.0,
        position: rows(1.0),
        velocity: rows(-1.0),
        target: Some(rows(2.0)),
        action: Some(rows(3.0)),
        command: Some((0..12).map(f64::from).collect()),
        motion: Some((0..8).map(f64::from).collect()),
        base: Some(BaseState {
            position: Some((0..12).map(f64::from).collect()),
            // 0°, 90° about z, then the same 90° with the other sign, then 180°.
            quaternion: Some({
                let r = std::f64::consts::FRAC_1_SQRT_2;
                vec![1.0, 0.0, 0.0, 0.0, r, 0.0, 0.0, r, -r, 0.0, 0.0, -r, 0.0, 0.0, 0.0, 1.0]
            }),
            ..BaseState::default()
        }),
        gains: Some(Gains { kp: vec![1.0, 2.0], kd: vec![3.0, 4.0] }),
        lead: None,
        simulated_step: None,
        velocity_joints: Vec::new(),
        fell: false,
    }
}

#[test]
fn columns_and_sizes() {
    let log = log();
    assert_eq!((log.dt(), log.len()), (0.1, 4));
    assert!((log.duration() - 0.3).abs() < 1e-15);
    assert_eq!(log.column(Signal::Target, "b").unwrap(), [0.0, 20.0, 40.0, 60.0]);
    assert_eq!(log.column(Signal::Target, "c"), None);
    assert_eq!(Trajectory { target: None, ..log.clone() }.column(Signal::Target, "b"), None);
    log.validate().unwrap();
    for (broken, what) in [
        (Trajectory { command: Some(vec![0.0; 4]), ..log.clone() }, "command: 4 values for 4 samples × 3"),
        (Trajectory { joints: vec!["a".into(), "a".into()], ..log.clone() }, "joints: `a` twice"),
        (Trajectory { rate_hz: f64::NAN, ..log.clone() }, "rate_hz: NaN"),
        (Trajectory { time: vec![0.0, f64::NAN, 1.0, 2.0], ..log.clone() }, "time: NaN at sample 1"),
        (
            Trajectory { gains: Some(Gains { kp: vec![1.0], kd: vec![1.0, 1.0] }), ..log.clone() },
            "gains.kp: 1 values",
        ),
    ] {
        let error = broken.validate().unwrap_err().to_string();
        assert!(error.starts_with(what), "{error}");
    }
}

#[test]
fn slices_keep_times() {
    let part = log().slice(1..3).unwrap();
    part.validate().unwrap();
    assert_eq!(part.time, [1.1, 1.2]);
    assert_eq!(part.position, [1.0, 10.0, 2.0, 20.0]);
    assert_eq!(part.command.clone().unwrap()[..3], [3.0, 4.0, 5.0]);
    assert_eq!(part.motion.clone().unwrap(), [2.0, 3.0, 4.0, 5.0]);
    assert_eq!(part.base.clone().unwrap().quaternion.unwrap().len(), 8);
    assert_eq!(log().slice_time(1.05, 1.25).unwrap(), part);
    assert!(log().slice(3..5).is_err());
    assert!(log().slice_time(2.0, f64::NAN).is_err());
}

#[test]
fn joints_are_selected_by_name_with_their_gains() {
    let swapped = log().select_joints(&["b", "a"]).unwrap();
    assert_eq!(swapped.position[2..4], [10.0, 1.0]);
    assert_eq!(swapped.gains.clone().unwrap().kp, [2.0, 1.0]);
    assert_eq!(swapped.select_joints(&["a", "b"]).unwrap(), log());
    let one = log().select_joints(&["b"]).unwrap();
    one.validate().unwrap();
    assert_eq!(one.action.unwrap(), [0.0, 30.0, 60.0, 90.0]);
    let error = log().select_joints(&["c"]).unwrap_err().to_string();
    assert_eq!(error, "the log has no joint `c`; its joints are a, b");
    assert!(log().select_joints(&["a", "a"]).is_err());
    assert!(log().select_joints::<&str>(&[]).unwrap().validate().is_err());
}

#[test]
fn resampling_blends_states_and_holds_targets() {
    let fine = log().resample(20.0).unwrap();
    fine.validate().unwrap();
    assert_eq!((fine.len(), fine.rate_hz), (7, 20.0));
    for (i, value) in fine.column(Signal::Position, "b").unwrap().iter().enumerate() {
        assert!((value - 5.0 * i as f64).abs() < 1e-9, "{i}: {value}");
    }
    assert_eq!(fine.column(Signal::Target, "a").unwrap(), [0.0, 0.0, 2.0, 2.0, 4.0, 4.0, 6.0]);
    let quaternion = fine.base.unwrap().quaternion.unwrap();
    // Half way to 90°: 45°. Half way between one orientation and itself with the other sign: itself.
    let eighth = std::f64::consts::FRAC_PI_8;
    assert!((quaternion[4] - eighth.cos()).abs() < 1e-9 && (quaternion[7] - eighth.sin()).abs() < 1e-9);
    let r = std::f64::consts::FRAC_1_SQRT_2;
    assert!((quaternion[12] - r).abs() < 1e-9 && (quaternion[15] - r).abs() < 1e-9);

    // To the same rate nothing changes; to half of it every other sample stays.
    let same = log().resample(10.0).unwrap();
    assert_eq!((same.len(), same.position), (4, log().position));
    assert_eq!(log().resample(5.0).unwrap().column(Signal::Position, "a").unwrap(), [0.0, 2.0]);

    assert!(log().resample(0.0).is_err());
    assert!(log().resample(1e12).unwrap_err().to_string().contains("too many samples"));
    let mut backward = log();
    backward.time[2] = 1.0;
    let error = backward.resample(20.0).unwrap_err().to_string();
    assert!(error.contains("time goes from 1.1 s to 1 s at sample 2"), "{error}");
}
