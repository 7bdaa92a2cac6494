//! Units of the time column, and velocities that do not fit the clock.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_log::*;
use std::f64::consts::TAU;

/// Two joints at 2 and 1 Hz, five seconds at `rate` Hz; `scale` times the derivative as velocity.
fn log(rate: f64, scale: [f64; 2]) -> Trajectory {
    let samples = (5.0 * rate) as usize;
    let mut log = Trajectory::of_joints(
        vec!["hip".into(), "knee".into()],
        rate,
        (0..samples).map(|i| i as f64 / rate).collect(),
        Vec::new(),
        Vec::new(),
    );
    for t in &log.time {
        for (joint, hertz) in [2.0, 1.0].into_iter().enumerate() {
            // Never twice the same extreme: that would look cut off.
            let size = 0.3 + 0.01 * t;
            log.position.push(size * (TAU * hertz * t).sin());
            let speed = size * TAU * hertz * (TAU * hertz * t).cos() + 0.01 * (TAU * hertz * t).sin();
            log.velocity.push(scale[joint] * speed);
        }
    }
    log
}

/// The log as a CSV file whose time column is called `name`, with cells as `cell` writes them.
fn file(log: &Trajectory, header: &str, name: &str, cell: impl Fn(f64) -> String) -> String {
    let mut text = format!("{header}{name},q_hip,q_knee,dq_hip,dq_knee\n");
    for (i, t) in log.time.iter().enumerate() {
        let [q, dq] =
            [&log.position, &log.velocity].map(|values| format!("{},{}", values[2 * i], values[2 * i + 1]));
        text.push_str(&format!("{},{q},{dq}\n", cell(*t)));
    }
    text
}

fn read(text: &str) -> Result<(Trajectory, ReadReport), LogError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.csv");
    std::fs::write(&path, text).unwrap();
    read_csv_report(&path, &ReadOptions::default())
}

#[test]
fn time_stamps_in_smaller_units_are_converted_and_said() {
    let log = log(200.0, [1.0; 2]);
    let start = 1_763_829_312_000_000_000_i64;
    for (unit, per_second) in
        [("milliseconds", 1_000), ("microseconds", 1_000_000), ("nanoseconds", 1_000_000_000_i64)]
    {
        // From zero, and as Unix time.
        for offset in [0, start / (1_000_000_000 / per_second)] {
            let stamp = |t: f64| (offset + (t * per_second as f64).round() as i64).to_string();
            let (trajectory, report) = read(&file(&log, "", "time", stamp)).unwrap();
            assert_eq!(trajectory.rate_hz, 200.0, "{unit} from {offset}");
            assert!((trajectory.duration() - log.duration()).abs() < 1e-6);
            assert_eq!(report.converted_time.as_ref().unwrap().unit.to_string(), unit);
            let notes = report.findings();
            assert_eq!(
                (notes.len(), notes[0].kind, notes[0].severity),
                (1, FindingKind::TimeUnit, Severity::Note)
            );
            assert!(notes[0].message.contains(unit), "{}", notes[0]);
            assert_eq!(check(&trajectory, &CheckSpec::default()), [], "{unit} from {offset}");
        }
        // The name says it.
        let name =
            ["time_ms", "time_us", "time_ns"][[1_000, 1_000_000].iter().filter(|p| **p < per_second).count()];
        let (trajectory, report) =
            read(&file(&log, "", name, |t| ((t * per_second as f64).round() as i64).to_string())).unwrap();
        assert_eq!((trajectory.rate_hz, report.ignored.len()), (200.0, 0));
        assert!(report.findings()[0].message.contains("name"), "{}", report.findings()[0]);
    }
    let (trajectory, report) = read(&file(&log, "", "time", |t| t.to_string())).unwrap();
    assert_eq!((trajectory.rate_hz, report.converted_time), (200.0, None));
}

#[test]
fn a_log_without_motion_is_known_by_its_rate() {
    let rows: String = (0..100).map(|i| format!("{},0.5,0\n", i * 5_000_000)).collect();
    let (trajectory, _) = read(&format!("time,q_a,dq_a\n{rows}")).unwrap();
    assert_eq!(trajectory.rate_hz, 200.0);
}

#[test]
fn velocities_or_a_stated_rate_settle_what_the_steps_do_not() {
    let (fast, counted) = (log(2000.0, [1.0; 2]), log(1000.0, [1.0; 2]));
    let micro = |t: f64| ((t * 1e6).round() as i64).to_string();
    let milli = |t: f64| ((t * 1e3).round() as i64).to_string();
    let unit = |text: &str| read(text).unwrap().1.converted_time.unwrap().unit;
    assert_eq!(unit(&file(&fast, "", "time", micro)), TimeUnit::Microseconds);
    assert_eq!(unit(&file(&counted, "", "time", milli)), TimeUnit::Milliseconds);

    let still = |step: usize, header: &str| {
        let rows: String = (0..100).map(|i| format!("{},0.5,0\n", i * step)).collect();
        read(&format!("{header}time,q_a,dq_a\n{rows}"))
    };
    for step in [1, 500] {
        let error = still(step, "").unwrap_err().to_string();
        let parts =
            ["log.csv: the unit of `time` is not clear", "# rate_hz = 200", "`time_ms`", "milliseconds ("];
        assert!(parts.iter().all(|part| error.contains(part)), "{error}");
    }
    let (trajectory, _) = still(500, "# rate_hz = 2000\n").unwrap();
    assert!((trajectory.duration() - 99.0 * 0.0005).abs() < 1e-12);

    // Time that counts samples, at 200 Hz.
    let log = log(200.0, [1.0; 2]);
    let count = |t: f64| format!("{}", (t * 200.0).round());
    let error = read(&file(&log, "", "time", count)).unwrap_err().to_string();
    assert!(error.contains("may count samples") && error.contains("fit 20"), "{error}");
    let (trajectory, _) = read(&file(&log, "# rate_hz = 200\n", "time", count)).unwrap();
    let finding = &check(&trajectory, &CheckSpec::default())[0];
    assert_eq!(finding.kind, FindingKind::RateMismatch);
    assert!(finding.message.contains("counts samples"), "{finding}");
}

#[test]
fn two_time_columns_are_one_clock() {
    let (trajectory, report) = read("time_ns,time,q_a,dq_a\n0,0,1,1\n5000000,0.005,1,1\n").unwrap();
    assert_eq!((trajectory.rate_hz, report.converted_time), (200.0, None));
    assert_eq!(report.ignored[0].reason, "`time` says it already");
}

#[test]
fn velocities_that_do_not_fit_the_clock_are_named_with_both_readings() {
    // Recorded at 400 Hz, stamped as 200 Hz.
    for (factor, severity, rate) in [
        (2.0, Severity::Error, "400 Hz"),
        (1.07, Severity::Warning, "214 Hz"),
        (0.9, Severity::Warning, "180 Hz"),
    ] {
        let mut log = log(200.0 * factor, [1.0; 2]);
        log.time.iter_mut().for_each(|time| *time *= factor);
        log.rate_hz = 200.0;
        let findings = check(&log, &CheckSpec::default());
        assert_eq!(findings.len(), 1, "{factor}: {findings:#?}");
        assert_eq!((findings[0].kind, findings[0].severity), (FindingKind::VelocityMismatch, severity));
        let text = &findings[0].message;
        for part in ["all 2 joints", rate, "the time column says 200 Hz", "if their scale is wrong"] {
            assert!(text.contains(part), "{factor}: {text}");
        }
    }
    // What 4 % explains is not named.
    for factor in [0.97, 1.0, 1.03] {
        assert_eq!(check(&log(200.0, [factor; 2]), &CheckSpec::default()), [], "{factor}");
    }
}

#[test]
fn a_wrong_scale_of_one_joint_is_its_own() {
    let mut log = log(200.0, [1.0; 2]);
    // A third joint, with a gear ratio taken for another.
    log.joints.push("ankle".into());
    let widen = |values: &[f64], scale: f64| -> Vec<f64> {
        values.chunks(2).flat_map(|row| [row[0], row[1], scale * (0.4 * row[0] + row[1])]).collect()
    };
    log.position = widen(&log.position, 1.0);
    log.velocity = widen(&log.velocity, 1.2);
    let findings = check(&log, &CheckSpec::default());
    assert_eq!(findings.len(), 1, "{findings:#?}");
    assert_eq!((findings[0].severity, &findings[0].joints), (Severity::Warning, &vec!["ankle".to_owned()]));
    assert!(findings[0].message.contains("ankle is 1.2 times"), "{}", findings[0]);
    assert!(findings[0].message.contains("gear ratios"), "{}", findings[0]);
}

#[test]
fn a_stated_rate_is_judged_by_the_velocities() {
    let mut log = log(200.0, [1.0; 2]);
    log.rate_hz = 400.0;
    let findings = check(&log, &CheckSpec::default());
    assert_eq!(findings.len(), 1, "{findings:#?}");
    assert!(findings[0].message.contains("correct the stated rate"), "{}", findings[0]);

    log.time.iter_mut().for_each(|time| *time *= 2.0);
    log.rate_hz = 200.0;
    let findings = check(&log, &CheckSpec::default());
    assert_eq!(findings.len(), 1, "{findings:#?}");
    assert_eq!(findings[0].kind, FindingKind::RateMismatch);
    assert!(findings[0].message.contains("the velocities fit the stated rate"), "{}", findings[0]);
}

#[test]
fn copied_rows_with_empty_numbers_are_no_new_rows() {
    let row = |i: u32| {
        let row = format!("{0},{0},1,NaN,NaN,NaN\n", 0.005 * f64::from(i));
        row.repeat(if i.is_multiple_of(10) { 2 } else { 1 })
    };
    let rows: String = (0..100).map(row).collect();
    let header = "time,q_a,dq_a,base_pos_x,base_pos_y,base_pos_z";
    let (trajectory, report) = read(&format!("# rate_hz = 200\n{header}\n{rows}")).unwrap();
    assert!(report.even_rows.is_none());
    assert_eq!((trajectory.time[0], trajectory.time[1], trajectory.time[2]), (0.0, 0.0, 0.005));
}
