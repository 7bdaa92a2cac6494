//! Faults that listening and tilting show.

use gaitfit_model::rotation::{Quat, from_rpy};
use gaitfit_robot::RobotError;
use gaitfit_robot::link::simulation;
use gaitfit_robot::preflight::{
    Asked, Check, Finding, Severity, TiltMotion, TiltReport, passed, tilt, tilted,
};

use super::bench::{Fault, Given, Hung, hung, listened, sways};

fn named(findings: &[Finding], check: Check, joint: Option<&str>) -> bool {
    findings.iter().any(|one| one.check == check && one.joint.as_deref() == joint)
}

fn seeds() -> u64 {
    std::env::var("GAITFIT_PREFLIGHT_SEEDS").ok().and_then(|text| text.parse().ok()).unwrap_or(2)
}

#[test]
fn a_sound_robot_gives_no_finding_when_listened_to() {
    for seed in 0..3 * seeds() {
        let (report, findings) = listened(Fault::None, sways, seed);
        assert!(findings.is_empty(), "{seed}: {findings:?}");
        let network = &report.network;
        assert!((network.hz - 500.0).abs() < 2.0 && network.lost == Some(0), "{network:?}");
        let unit = report.imu.unwrap();
        assert!(unit.apart.unwrap() < 1.0 && (unit.gravity.value - 9.81).abs() < 0.02, "{unit:?}");
        assert!(unit.gyro_bias.iter().all(|bias| bias.value.abs() < 0.004), "{unit:?}");
        assert!(report.joints.iter().all(|joint| (joint.step - 1e-4).abs() < 2e-5), "{:?}", report.joints[0]);
    }
}

#[test]
fn each_fault_of_listening_is_named_and_no_other() {
    let cases: [(Fault, Check, Option<&str>, Severity); 20] = [
        (Fault::Bias(1, 0.03), Check::GyroBias, None, Severity::Fault),
        (Fault::Bias(2, -0.03), Check::GyroBias, None, Severity::Fault),
        (Fault::Bias(0, 0.014), Check::GyroBias, None, Severity::Warning),
        (Fault::Mounted([180.0, 0.0, 0.0]), Check::Mounting, None, Severity::Fault),
        (Fault::Mounted([90.0, 0.0, 0.0]), Check::Mounting, None, Severity::Fault),
        (Fault::Mounted([0.0, 90.0, 0.0]), Check::Mounting, None, Severity::Fault),
        (Fault::Accelerometer([90.0, 0.0, 0.0]), Check::Attitude, None, Severity::Fault),
        (Fault::Accelerometer([180.0, 0.0, 0.0]), Check::Attitude, None, Severity::Fault),
        (Fault::Order, Check::QuaternionOrder, None, Severity::Fault),
        (Fault::InG, Check::Gravity, None, Severity::Fault),
        (Fault::Lost(5), Check::Gaps, None, Severity::Fault),
        (Fault::Twice(50), Check::Gaps, None, Severity::Warning),
        (Fault::NotFinite(4), Check::Numbers, Some("FL_thigh"), Severity::Fault),
        (Fault::Beyond(5, 0.08), Check::Range, Some("FL_calf"), Severity::Fault),
        (Fault::Sign(2), Check::Range, Some("FR_calf"), Severity::Fault),
        (Fault::Hot(7, 85), Check::Temperature, Some("RR_thigh"), Severity::Fault),
        (Fault::Charge(9), Check::Battery, None, Severity::Fault),
        (Fault::Other, Check::SecondController, None, Severity::Fault),
        (Fault::Error(3), Check::MotorError, Some("FL_hip"), Severity::Fault),
        (Fault::Restless(1, 0.08), Check::Still, Some("FR_thigh"), Severity::Fault),
    ];
    for (fault, check, joint, severity) in cases {
        for seed in 0..seeds() {
            let (_, findings) = listened(fault, sways, seed);
            assert!(named(&findings, check, joint), "{fault:?} {seed}: {findings:?}");
            let others: Vec<&Finding> = findings.iter().filter(|one| one.check != check).collect();
            assert!(others.is_empty(), "{fault:?} {seed}: {others:?}");
            assert_eq!(passed(&findings), severity == Severity::Warning, "{fault:?}: {findings:?}");
        }
    }
}

#[test]
fn mountings_that_gravity_shows_are_stated_as_a_log_takes_them() {
    for degrees in
        [[180.0, 0.0, 0.0], [90.0, 0.0, 0.0], [-90.0, 0.0, 0.0], [0.0, 90.0, 0.0], [0.0, -90.0, 0.0]]
    {
        let (report, _) = listened(Fault::Mounted(degrees), sways, 1);
        let [roll, pitch, _] = report.imu.unwrap().mounting.unwrap();
        if degrees[1] == 0.0 {
            assert_eq!([roll, pitch], [degrees[0], 0.0]);
        } else {
            assert_eq!(pitch, degrees[1]);
        }
    }
}

/// Level for 4 s, then each turn as it is asked for: up to 30°, held, and back.
fn by_hand(time: f64) -> Quat {
    let part = |begin: f64| {
        let ramp = |at: f64| (at / 1.0).clamp(0.0, 1.0);
        0.52 * (ramp(time - begin) - ramp(time - begin - 3.5))
    };
    from_rpy(part(12.0), part(4.0), 0.3 + part(20.0))
}

type Seen = (Vec<TiltReport>, Option<[f64; 3]>, Vec<Finding>);

fn turned(fault: Fault, gyro_bias: [f64; 3]) -> Result<Seen, RobotError> {
    let batch = simulation(hung()).unwrap();
    let mut link = Hung::new(&batch, fault, by_hand, 5);
    let mut asked = Vec::new();
    let turns = tilt(&mut link, &mut Given::default(), &mut |one| asked.push(one), &|| None)?;
    assert_eq!(asked.last(), Some(&Asked::Done));
    assert!(asked.contains(&Asked::Turn(TiltMotion::RollRight)));
    Ok(tilted(&turns, gyro_bias))
}

#[test]
fn turns_by_hand_show_axes_and_signs() {
    let (reports, mounted, findings) = turned(Fault::None, [0.0; 3]).unwrap();
    assert_eq!((findings.len(), mounted), (0, None), "{findings:?}");
    for one in &reports {
        let along: f64 = one.turn.iter().zip(one.motion.axis()).map(|(turn, axis)| turn * axis).sum();
        assert!((along - 29.8).abs() < 1.0, "{one:?}");
        assert!(one.turn.iter().zip(&one.gyro_turn).all(|(a, b)| (a - b).abs() < 1.0), "{one:?}");
    }
    for degrees in [[0.0, 0.0, 90.0], [0.0, 0.0, 180.0], [0.0, 0.0, -90.0], [180.0, 0.0, 0.0]] {
        let (_, mounted, findings) = turned(Fault::Mounted(degrees), [0.0; 3]).unwrap();
        assert!(named(&findings, Check::Mounting, None), "{degrees:?} {findings:?}");
        assert_eq!(mounted, Some(degrees), "{findings:?}");
    }
    let (_, _, findings) = turned(Fault::Order, [0.0; 3]).unwrap();
    assert!(!passed(&findings), "{findings:?}");
    for factor in [-1.0, 57.3, 0.5] {
        let (_, mounted, findings) = turned(Fault::GyroFactor(factor), [0.0; 3]).unwrap();
        assert!(named(&findings, Check::GyroAttitude, None) && mounted.is_none(), "{factor} {findings:?}");
    }
}

#[test]
fn a_bias_of_the_gyro_that_is_known_is_no_wrong_turn() {
    let fault = Fault::Bias(0, 0.15);
    let (_, _, findings) = turned(fault, [0.0; 3]).unwrap();
    assert!(named(&findings, Check::GyroAttitude, None), "{findings:?}");
    let (_, _, findings) = turned(fault, [0.15, 0.0, 0.0]).unwrap();
    assert_eq!(findings, []);
}

#[test]
fn a_turn_that_nobody_makes_ends_with_what_was_asked_for() {
    let batch = simulation(hung()).unwrap();
    let mut link = Hung::new(&batch, Fault::None, sways, 5);
    let error = tilt(&mut link, &mut Given::default(), &mut |_| {}, &|| None).unwrap_err();
    assert!(error.to_string().contains("tilt its nose down"), "{error}");
}
