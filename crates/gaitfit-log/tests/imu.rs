//! The inertial unit of a base that rolls, pitches and turns, read rightly and wrongly in every usual way.
#![allow(clippy::unwrap_used, reason = "tests")]

use gaitfit_log::*;
use gaitfit_model::rotation::{Quat, from_rpy, inverse, normalize, product, rotate, rotate_back};
use std::fmt::Write;

const RATE: f64 = 100.0;
const SAMPLES: usize = 500;

/// Orientation and rates (body frame) of a walking base at each sample; its heading begins at `heading` rad.
fn base(heading: f64) -> Vec<(Quat, [f64; 3])> {
    let fine = 20;
    let step = 1.0 / RATE / f64::from(fine);
    let mut q = from_rpy(0.02, -0.03, heading);
    let mut rows = Vec::new();
    for i in 0..SAMPLES * fine as usize {
        let t = i as f64 * step;
        let turn = |hertz: f64, phase: f64| (std::f64::consts::TAU * hertz * t + phase).sin();
        let w = [1.1 * turn(2.0, 0.3), 0.8 * turn(3.1, 1.0), 0.3 * turn(1.0, 2.0) + 0.15];
        if i % fine as usize == 0 {
            rows.push((q, w));
        }
        q = normalize(product(q, [1.0, 0.5 * step * w[0], 0.5 * step * w[1], 0.5 * step * w[2]]));
    }
    rows
}

/// A log of two joints that swing, with the inertial unit's columns `columns` and their values of each sample.
fn log(
    head: &str,
    columns: &str,
    rows: impl Iterator<Item = Vec<f64>>,
) -> (tempfile::TempDir, std::path::PathBuf) {
    let mut text = format!("{head}time,q_a,q_b,dq_a,dq_b,qdes_a,qdes_b,vx_cmd,vy_cmd,wz_cmd,{columns}\n");
    for (i, values) in rows.enumerate() {
        let t = i as f64 / RATE;
        let wave = |hertz: f64, late: f64| (std::f64::consts::TAU * hertz * (t - late)).sin();
        let speed = |hertz: f64| std::f64::consts::TAU * hertz * (std::f64::consts::TAU * hertz * t).cos();
        let _ = write!(
            text,
            "{t},{},{},{},{},{},{},0.5,0,0.1",
            0.3 * wave(1.93, 0.0),
            0.2 * wave(1.47, 0.0),
            0.3 * speed(1.93),
            0.2 * speed(1.47),
            0.3 * wave(1.93, -0.03),
            0.2 * wave(1.47, -0.03)
        );
        values.iter().for_each(|value| text.push_str(&format!(",{value}")));
        text.push('\n');
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.csv");
    std::fs::write(&path, text).unwrap();
    (folder, path)
}

const IMU: &str = "base_quat_w,base_quat_x,base_quat_y,base_quat_z,wx,wy,wz";

fn read(
    head: &str,
    heading: f64,
    change: impl Fn(Quat, [f64; 3]) -> (Quat, [f64; 3]),
) -> (Trajectory, Vec<Finding>) {
    let rows = base(heading).into_iter().map(|(q, w)| {
        let (q, w) = change(q, w);
        q.into_iter().chain(w).collect()
    });
    let (_folder, path) = log(head, IMU, rows);
    let (log, report) = read_csv_report(&path, &ReadOptions::default()).unwrap();
    let mut findings = report.findings();
    findings.extend(check(&log, &CheckSpec::default()));
    (log, findings)
}

/// Largest difference of orientation and rates from those of the base.
fn off(log: &Trajectory, heading: f64) -> f64 {
    let state = log.base.as_ref().unwrap();
    let (quaternion, rates) = (state.quaternion.as_ref().unwrap(), state.angular_velocity.as_ref().unwrap());
    let rows = quaternion.chunks_exact(4).zip(rates.chunks_exact(3));
    rows.zip(base(heading)).fold(0.0, |most, ((q, w), (right, rates))| {
        let along: f64 = q.iter().zip(right).map(|(a, b)| a * b).sum();
        let turned = 1.0 - along.abs();
        w.iter().zip(rates).fold(f64::max(most, turned), |most, (a, b)| most.max((a - b).abs()))
    })
}

#[test]
fn a_right_unit_raises_nothing() {
    for heading in [0.0, 1.5, -2.8] {
        let (log, findings) = read("", heading, |q, w| (q, w));
        assert_eq!(findings, [], "{heading}");
        assert!(off(&log, heading) < 1e-9);
    }
}

/// What is done to orientation and rates of a sample.
type Change<'a> = dyn Fn(Quat, [f64; 3]) -> (Quat, [f64; 3]) + 'a;

#[test]
fn readings_without_doubt_are_mended_and_said() {
    let degrees = |w: [f64; 3]| w.map(f64::to_degrees);
    let cases: [(FindingKind, &str, &Change<'_>); 5] = [
        (FindingKind::ImuFrame, "frame = \"world\"", &|q, w| (q, rotate(q, w))),
        (FindingKind::ImuSign, "negated = true", &|q, w| (q, w.map(|x| -x))),
        (FindingKind::ImuUnit, "unit = \"deg\"", &|q, w| (q, degrees(w))),
        (FindingKind::QuaternionOrder, "order = \"xyzw\"", &|q, w| ([q[1], q[2], q[3], q[0]], w)),
        (FindingKind::ImuFrame, "frame = \"world\", unit = \"deg\"", &|q, w| (q, degrees(rotate(q, w)))),
    ];
    for (kind, key, change) in cases {
        let (log, findings) = read("", 1.5, change);
        assert_eq!(findings.len(), 1, "{kind}: {findings:#?}");
        assert_eq!((findings[0].kind, findings[0].severity), (kind, Severity::Warning), "{}", findings[0]);
        assert!(findings[0].message.contains(key), "{}", findings[0]);
        assert!(off(&log, 1.5) < 1e-9, "{kind}: {}", off(&log, 1.5));
        // Stated, it is no finding.
        let stated: String = key.split(", ").map(|key| format!("# imu.{key}\n")).collect();
        let (log, findings) = read(&stated, 1.5, change);
        assert_eq!(findings, [], "{kind}");
        assert!(off(&log, 1.5) < 1e-9);
        // Against what is stated nothing is changed.
        let (_, findings) = read(&stated, 1.5, |q, w| (q, w));
        assert!(findings.iter().any(|finding| finding.severity == Severity::Error), "{kind}: {findings:#?}");
    }
}

#[test]
fn what_could_be_two_things_is_refused() {
    // Without a heading, negated rates are also those of an inverse orientation.
    let (_, findings) = read("", 0.0, |q, w| {
        let level = [q[0], 0.3 * q[1], 0.3 * q[2], 0.0];
        (normalize(level), w)
    });
    assert!(findings.iter().any(|finding| finding.severity == Severity::Error), "{findings:#?}");
    // Rates about turned axes may be the rates' fault or the orientation's.
    let (_, findings) = read("", 0.7, |q, w| (q, [w[1], -w[0], w[2]]));
    assert_eq!(findings.len(), 1, "{findings:#?}");
    assert_eq!((findings[0].kind, findings[0].severity), (FindingKind::ImuMounting, Severity::Error));
    assert!(
        findings[0].message.contains("about −y, x, z") || findings[0].message.contains("about y, −x, z"),
        "{}",
        findings[0]
    );
    // Rates of another robot.
    let (_, findings) = read("", 0.7, |q, w| (q, [w[2] * 3.0, 0.5 * w[0] * w[1], (9.0 * w[1]).sin()]));
    assert_eq!((findings[0].kind, findings[0].severity), (FindingKind::ImuMismatch, Severity::Error));
}

#[test]
fn a_unit_that_is_mounted_turned_is_named_and_stated() {
    for (mounting, text) in [
        ([180.0_f64, 0.0, 0.0], "[180, 0, 0]"),
        ([0.0, 90.0, 0.0], "[0, 90, 0]"),
        ([-90.0, 0.0, 0.0], "[-90, 0, 0]"),
    ] {
        let [roll, pitch, yaw] = mounting.map(f64::to_radians);
        let of_base = from_rpy(roll, pitch, yaw);
        let change = |q: Quat, w: [f64; 3]| (product(q, of_base), rotate_back(of_base, w));
        let (_, findings) = read("", 0.4, change);
        assert_eq!(findings.len(), 1, "{findings:#?}");
        assert_eq!((findings[0].kind, findings[0].severity), (FindingKind::ImuMounting, Severity::Error));
        assert!(findings[0].message.contains(text), "{text}: {}", findings[0]);
        let (log, findings) = read(&format!("# imu.mounting = {text}\n"), 0.4, change);
        assert_eq!(findings, []);
        assert!(off(&log, 0.4) < 1e-9);
    }
}

#[test]
fn bias_and_lag_of_rates_are_named() {
    let (_, findings) = read("", 0.4, |q, w| (q, [w[0], w[1] + 0.02, w[2]]));
    assert_eq!(findings.len(), 1, "{findings:#?}");
    assert_eq!((findings[0].kind, findings[0].severity), (FindingKind::GyroBias, Severity::Warning));
    assert!(findings[0].message.contains("0.020 rad/s"), "{}", findings[0]);
    for (samples, severity) in [(1, Severity::Warning), (2, Severity::Error)] {
        let rows = base(0.4);
        let late = rows.iter().enumerate().map(|(i, (q, _))| {
            let w = rows[i.saturating_sub(samples)].1;
            q.iter().copied().chain(w).collect::<Vec<f64>>()
        });
        let (_folder, path) = log("", IMU, late);
        let log = read_csv(&path, &ReadOptions::default()).unwrap();
        let findings = check(&log, &CheckSpec::default());
        let lag = findings.iter().find(|finding| finding.kind == FindingKind::GyroLag).unwrap();
        assert_eq!(lag.severity, severity);
        assert!(lag.message.contains(" ms later than"), "{lag}");
    }
}

#[test]
fn gravity_vectors_are_read() {
    for (names, length) in [
        (["projected_gravity_x", "projected_gravity_y", "projected_gravity_z"], 1.0),
        (["gravity_0", "gravity_1", "gravity_2"], 9.81),
    ] {
        let rows = base(0.0).into_iter().map(|(q, w)| {
            let down = rotate_back(q, [0.0, 0.0, -length]);
            w.into_iter().chain(down).collect()
        });
        let (_folder, path) = log("", &format!("wx,wy,wz,{}", names.join(",")), rows);
        let (log, report) = read_csv_report(&path, &ReadOptions::default()).unwrap();
        assert_eq!(report.ignored, []);
        assert_eq!(check(&log, &CheckSpec::default()), []);
        assert!(off(&log, 0.0) < 1e-3, "{}", off(&log, 0.0));
    }
}

#[test]
fn a_base_that_stands_still_while_legs_walk_hangs() {
    let still = base(0.4)[0].0;
    let (log, findings) = read("", 0.4, |_, _| (still, [0.0; 3]));
    let named: Vec<_> = findings.iter().map(|finding| finding.kind).collect();
    assert_eq!(named, [FindingKind::Hanging], "{findings:#?}");
    assert_eq!(findings[0].severity, Severity::Error);
    let fall = &falls(&log, &CheckSpec::default())[0];
    assert_eq!((fall.sign, fall.samples.clone()), (FallSign::Hanging, 0..SAMPLES));
    // A clamped robot under no command is meant to stand still.
    let mut clamped = log;
    clamped.command = Some(vec![0.0; 3 * SAMPLES]);
    assert_eq!(check(&clamped, &CheckSpec::default()), []);
}

#[test]
fn an_inverse_orientation_is_not_taken_for_negated_rates() {
    let (_, findings) = read("", 0.7, |q, w| (inverse(q), w));
    assert!(findings.iter().any(|finding| finding.severity == Severity::Error), "{findings:#?}");
}

/// Roll, pitch and yaw in degrees: the rates tell.
#[test]
fn angles_in_degrees_are_mended() {
    let angles = |q: Quat| {
        let [w, x, y, z] = q;
        let roll = f64::atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y));
        let pitch = (2.0 * (w * y - x * z)).asin();
        let yaw = f64::atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z));
        [roll, pitch, yaw]
    };
    for degrees in [false, true] {
        let rows = base(0.3).into_iter().map(|(q, w)| {
            let angles = angles(q).map(|angle| if degrees { angle.to_degrees() } else { angle });
            angles.into_iter().chain(w).collect()
        });
        let (_folder, path) = log("", "roll,pitch,yaw,wx,wy,wz", rows);
        let (log, report) = read_csv_report(&path, &ReadOptions::default()).unwrap();
        assert_eq!(report.angles_in_degrees, degrees);
        assert!(off(&log, 0.3) < 1e-6, "{degrees}: {}", off(&log, 0.3));
        let named: Vec<_> = report.findings().iter().map(|finding| finding.kind).collect();
        assert_eq!(named, if degrees { vec![FindingKind::ImuUnit] } else { vec![] });
    }
}
