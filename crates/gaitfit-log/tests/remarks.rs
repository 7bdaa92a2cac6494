//! Messages about logs that are wrong: what they name, and that their remedy is not what was done already.
#![allow(clippy::unwrap_used, reason = "tests")]

use gaitfit_log::*;
use std::fmt::Write as _;

fn read(text: &str) -> Result<(Trajectory, ReadReport), LogError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.csv");
    std::fs::write(&path, text).unwrap();
    read_csv_report(&path, &ReadOptions::default())
}

fn refused(text: &str) -> String {
    read(text).unwrap_err().to_string()
}

/// A joint that swings, with times and further columns by row.
fn rows(
    count: usize,
    head: &str,
    more: &str,
    time: impl Fn(usize) -> f64,
    cells: impl Fn(usize) -> String,
) -> String {
    let mut text = format!("{head}time,q_a,dq_a{more}\n");
    for row in 0..count {
        let at = 0.01 * row as f64;
        let _ = writeln!(text, "{},{},{}{}", time(row), (6.0 * at).sin(), 6.0 * (6.0 * at).cos(), cells(row));
    }
    text
}

fn none(_: usize) -> String {
    String::new()
}

#[test]
fn time_that_runs_backwards_is_named_as_such() {
    let text = refused(&rows(300, "", "", |row| 3.0 - 0.01 * row as f64, none));
    assert!(text.contains("time runs backwards, first from 3 s to 2.99 s after sample 1"), "{text}");
    assert!(!text.contains("rate_hz"), "{text}");
}

#[test]
fn a_stated_rate_is_no_remedy_for_times_that_contradict_it() {
    let text = refused(&rows(300, "# rate_hz = 100\n", "", |_| 0.0, none));
    assert!(text.contains("100 Hz is stated") && !text.contains("# rate_hz = 200"), "{text}");
    assert!(!text.contains("0.000e0") && text.contains("the stamps 0 s"), "{text}");
}

#[test]
fn a_misspelt_key_above_the_header_is_refused() {
    for (key, meant) in [("raet_hz", "rate_hz"), ("fel", "fell"), ("target_lead_z", "target_lead_s")] {
        let text = refused(&format!("# {key} = 200\ntime,q_a,dq_a\n0,1,2\n0.01,3,4\n"));
        assert!(text.contains(&format!("`{key}`")) && text.contains(&format!("`{meant} = …`")), "{text}");
    }
    for key in ["firmware", "km", "full"] {
        let read = read(&format!("# {key} = 200\ntime,q_a,dq_a\n0,1,2\n0.01,3,4\n"));
        assert_eq!(read.unwrap().1.unknown_keys, [key]);
    }
}

#[test]
fn a_place_in_a_motion_has_both_columns_and_numbers() {
    let at = |row: usize| 0.01 * row as f64;
    for (column, lacking) in [("motion_time", "motion_heading"), ("motion_heading", "motion_time")] {
        let text = refused(&rows(30, "", &format!(",{column}"), at, |_| ",0".to_owned()));
        assert!(text.contains(&format!("no column `{lacking}`")), "{text}");
    }
    let both = ",motion_time,motion_heading";
    let text = refused(&rows(30, "# allow = [\"not-finite\"]\n", both, at, |row| match row {
        7 => ",nan,0".to_owned(),
        _ => format!(",{},0", 0.01 * row as f64),
    }));
    assert!(text.contains("log.csv:10: column 4 `motion_time`"), "{text}");
    let (log, _) = read(&rows(300, "", both, at, |row| format!(",{},0.5", 10.0 * row as f64))).unwrap();
    let findings = check(&log, &CheckSpec::default());
    let text = &findings.iter().find(|one| one.kind == FindingKind::SuspectUnit).unwrap().message;
    assert!(text.contains("motion_time runs 1000 times as fast"), "{text}");
    let (log, _) = read(&rows(300, "", both, at, |row| format!(",{},0.5", 3.0 + at(row)))).unwrap();
    assert!(check(&log, &CheckSpec::default()).iter().all(|one| one.kind != FindingKind::SuspectUnit));
}

#[test]
fn a_statement_that_the_robot_did_not_fall_is_contradicted_in_words() {
    let upside_down = |row: usize| if row < 200 { ",1,0,0,0" } else { ",0,1,0,0" }.to_owned();
    let quaternion = ",base_quat_w,base_quat_x,base_quat_y,base_quat_z";
    let text = |head: &str| rows(300, head, quaternion, |row| 0.01 * row as f64, upside_down);
    let noticed = |head: &str| read(&text(head)).unwrap().1.noticed;
    assert!(noticed("").is_empty());
    let findings = noticed("# fell = false\n");
    assert!(
        findings[0].message.contains("`fell = false`") && findings[0].message.contains("from 2 s on"),
        "{findings:?}"
    );
}

#[test]
fn gaps_and_repeated_rows_of_a_clamped_robot_have_a_remedy_that_works() {
    let message = |text: &str, kind: FindingKind| {
        let (log, _) = read(text).unwrap();
        let findings = check(&log, &CheckSpec::default());
        findings.into_iter().find(|one| one.kind == kind).unwrap().message
    };
    let gap = rows(300, "", "", |row| 0.01 * row as f64 + if row > 150 { 1.0 } else { 0.0 }, none);
    let text = message(&gap, FindingKind::TimeGap);
    assert!(text.contains("cut it there") && !text.contains("leave gaps out"), "{text}");
    let mut still = String::from("time,q_a,dq_a\n");
    for row in 0..300 {
        let _ = writeln!(still, "{},{}", 0.01 * f64::from(row), if row < 299 { "0.5,0" } else { "0.6,1" });
    }
    let text = message(&still, FindingKind::RepeatedRows);
    assert!(text.contains("hardly read") && !text.contains("--every"), "{text}");
}

#[test]
fn a_robot_file_is_not_a_log() {
    let text = refused("<mujoco model=\"go2\">\n</mujoco>\n");
    assert!(text.contains("the file is XML"), "{text}");
}
