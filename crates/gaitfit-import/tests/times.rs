//! Times: targets that are stamped after the state they answer, stamps that lost their digits, jitter, thinning.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_import::{ClockFinding, ImportError, Imported, Mapping, Options, import, mcap_bytes};
use gaitfit_log::{Lead, Trajectory, write_csv};
use std::fmt::Write;

const ROWS: usize = 600;

/// A joint that swings; its target in row `k` is `k`.
fn log(rate: f64) -> Trajectory {
    let time: Vec<f64> = (0..ROWS).map(|row| row as f64 / rate).collect();
    Trajectory {
        robot: Some("rig".into()),
        target: Some((0..ROWS).map(|row| row as f64).collect()),
        ..Trajectory::of_joints(
            vec!["knee".into()],
            rate,
            time.clone(),
            time.iter().map(|t| (3.0 * t).sin()).collect(),
            time.iter().map(|t| 3.0 * (3.0 * t).cos()).collect(),
        )
    }
}

fn read(name: &str, bytes: &[u8], mapping: &str) -> Result<Imported, ImportError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    import(&[path], &Options { mapping: Mapping::parse(mapping).unwrap(), ..Options::default() })
}

/// As PlotJuggler exports two topics: a line a message, cells of the other topic blank.
fn blank_cells(log: &Trajectory, late: impl Fn(usize) -> f64) -> String {
    let mut text = String::from(
        "__time,/joint_states/knee/position,/joint_states/knee/velocity,/joint_commands/knee/position\n",
    );
    for row in 0..log.len() {
        let at = 1_700_000_000.0 + log.time[row];
        writeln!(text, "{at:.6},{},{},", log.position[row], log.velocity[row]).unwrap();
        writeln!(text, "{:.6},,,{}", at + late(row), log.target.as_ref().unwrap()[row]).unwrap();
    }
    text
}

#[test]
fn a_target_stays_in_the_row_of_its_state_and_keeps_its_lead() {
    for rate in [200.0, 50.0] {
        for late in [0.0003, 0.001, 0.002] {
            let mut log = log(rate);
            let text = blank_cells(&log, |_| late);
            log.lead = Some(Lead { seconds: late, spread: 0.0 });
            let (mcap, _) = mcap_bytes(&log).unwrap();
            for (name, bytes) in [("pj.csv", text.as_bytes()), ("log.mcap", &mcap)] {
                let imported = read(name, bytes, "").unwrap();
                assert_eq!(imported.trajectory.target, log.target, "{name} {rate} {late}");
                assert_eq!(imported.report.dropped, [0, 0]);
                let lead = imported.trajectory.lead.unwrap();
                assert!((lead.seconds - late).abs() < 2e-6 && lead.spread < 2e-6, "{name} {rate}: {lead:?}");
                assert_eq!(imported.report.lead, Some(lead));
                assert!(
                    imported.report.assumed.iter().any(|line| line.contains("each message is in the row"))
                );
                // What is written is read again.
                let folder = tempfile::tempdir().unwrap();
                let path = folder.path().join("log.csv");
                write_csv(&path, &imported.trajectory).unwrap();
                let again = import(&[path], &Options::default()).unwrap().trajectory;
                assert_eq!((again.lead, again.target), (Some(lead), log.target.clone()));
            }
            // A clock that is known to be ahead leaves no lead.
            let set_right = read("pj.csv", text.as_bytes(), &format!("clock_offset_s = -{late}")).unwrap();
            assert!(set_right.trajectory.lead.is_none_or(|lead| lead.seconds.abs() < 2e-6));
            assert_eq!(set_right.trajectory.target, log.target);
        }
    }
}

#[test]
fn a_lead_that_varies_keeps_its_spread() {
    let log = log(200.0);
    let late = |row: usize| 0.001 + 1e-5 * ((row * 37) % 101) as f64;
    let trajectory = read("pj.csv", blank_cells(&log, late).as_bytes(), "").unwrap().trajectory;
    assert_eq!(trajectory.target, log.target);
    let lead = trajectory.lead.unwrap();
    assert!((lead.seconds - 0.0015).abs() < 1e-5 && (lead.spread - 0.00045).abs() < 2e-5, "{lead:?}");
}

/// One topic a row, in a CSV file of another program, stamped by `stamp`.
fn stamped(log: &Trajectory, stamp: impl Fn(f64) -> f64) -> String {
    let mut text = String::from("stamp,knee_pos,knee_vel,knee_cmd\n");
    for row in 0..log.len() {
        let target = log.target.as_ref().unwrap()[row];
        writeln!(text, "{},{},{},{target}", stamp(log.time[row]), log.position[row], log.velocity[row])
            .unwrap();
    }
    text
}

const COLUMNS: &str = "[time]\ncolumn = 'stamp'\n[columns]\nposition = '{joint}_pos'\nvelocity = '{joint}_vel'\ntarget = '{joint}_cmd'\n";

#[test]
fn stamps_without_digits_lose_no_row() {
    let log = log(200.0);
    let single = |start: f64| move |t: f64| f64::from((start + t) as f32);
    let coarse = |t: f64| (t / 0.05 + 1e-9).floor() * 0.05;
    for (case, text) in [
        ("40000 s", stamped(&log, single(40_000.0))),
        ("86400 s", stamped(&log, single(86_400.0))),
        ("ticks of 50 ms", stamped(&log, coarse)),
    ] {
        for rate in ["", "rate_hz = 200\n"] {
            let imported = read("log.csv", text.as_bytes(), &format!("{rate}{COLUMNS}")).unwrap();
            let trajectory = &imported.trajectory;
            assert_eq!((trajectory.len(), trajectory.rate_hz), (ROWS, 200.0), "{case}");
            assert_eq!(trajectory.target, log.target);
            let times = trajectory.time.iter().zip(&log.time);
            assert!(times.clone().all(|(a, b)| (a - b).abs() < 1e-6), "{case}");
            let findings = &imported.report.streams[0].findings;
            assert!(matches!(findings[..], [ClockFinding::Coarse { .. }]), "{case}: {findings:?}");
        }
        let wrong =
            read("log.csv", text.as_bytes(), &format!("rate_hz = 100\n{COLUMNS}")).unwrap_err().to_string();
        assert!(wrong.contains("600 rows at 100 Hz last"), "{case}: {wrong}");
    }
    // Nothing is left of Unix time: the rate must be stated.
    let unix = stamped(&log, single(1.7e9));
    let error = read("log.csv", unix.as_bytes(), COLUMNS).unwrap_err().to_string();
    assert!(error.contains("float32") && error.contains("--rate"), "{error}");
    assert!(error.contains("fit about 200 rows a second"), "{error}");
    let trajectory =
        read("log.csv", unix.as_bytes(), &format!("rate_hz = 200\n{COLUMNS}")).unwrap().trajectory;
    assert_eq!((trajectory.len(), trajectory.rate_hz, trajectory.target), (ROWS, 200.0, log.target.clone()));
}

#[test]
fn a_row_that_came_late_is_placed_between_its_neighbours() {
    let log = log(200.0);
    // Two rows share the stamp of the later one.
    let late = |t: f64| if (t - 1.0).abs() < 1e-9 { t + 0.005 } else { t };
    let imported = read("log.csv", stamped(&log, late).as_bytes(), COLUMNS).unwrap();
    assert_eq!(imported.trajectory.target, log.target);
    assert!(imported.trajectory.time.iter().zip(&log.time).all(|(a, b)| (a - b).abs() < 1e-9));
    assert_eq!(imported.report.streams[0].findings, [ClockFinding::Late { samples: 1 }]);
}

#[test]
fn jitter_is_no_loss() {
    let log = log(200.0);
    let jitter = |t: f64| t + 0.0024 * (t * 7919.0).sin();
    let imported = read("log.csv", stamped(&log, jitter).as_bytes(), COLUMNS).unwrap();
    assert_eq!((imported.trajectory.len(), imported.trajectory.rate_hz), (ROWS, 200.0));
    assert!(
        matches!(imported.report.streams[0].findings[..], [ClockFinding::Jitter { .. }]),
        "{:?}",
        imported.report
    );
}

#[test]
fn one_row_of_many_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.csv");
    let log = log(200.0);
    write_csv(&path, &log).unwrap();
    let every = |mapping: &str| {
        let mapping = Mapping::parse(mapping).unwrap();
        import(&[&path], &Options { mapping, ..Options::default() }).unwrap().trajectory
    };
    for mapping in ["every = 4", "every = 4\nrate_hz = 200"] {
        let trajectory = every(mapping);
        assert_eq!((trajectory.len(), trajectory.rate_hz), (ROWS / 4, 50.0));
        assert_eq!(trajectory.target.unwrap()[..3], [0.0, 4.0, 8.0]);
    }
    // A mark of the encoding, as editors of Windows write it, hides neither the log's kind nor its comments.
    let marked = format!("\u{feff}{}", std::fs::read_to_string(&path).unwrap());
    let imported = read("log.csv", marked.as_bytes(), "").unwrap();
    assert_eq!(imported.report.files[0].1, "CSV log of gaitfit");
    assert_eq!(imported.trajectory.robot, log.robot);
    // The place in a motion is thinned too.
    let motion = log.time.iter().flat_map(|time| [time + 1.0, 0.5]).collect();
    write_csv(&path, &Trajectory { motion: Some(motion), ..log.clone() }).unwrap();
    assert_eq!(every("every = 4").motion.unwrap()[..4], [1.0, 0.5, 1.02, 0.5]);
    let text = stamped(&log, |t| t);
    let trajectory = read("other.csv", text.as_bytes(), &format!("every = 4\n{COLUMNS}")).unwrap().trajectory;
    assert_eq!((trajectory.len(), trajectory.rate_hz), (ROWS / 4, 50.0));
}
