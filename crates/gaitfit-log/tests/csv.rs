//! Reading and writing CSV logs: round trips, and one case for every way a file can be wrong.
#![allow(clippy::unwrap_used, reason = "tests")]

use gaitfit_damage::{Bounds, Counting, attack, text};
use gaitfit_log::*;
use std::time::Duration;

/// Sees how much memory the reader takes.
#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn read_text(text: &str) -> Result<(Trajectory, ReadReport), LogError> {
    read_bytes(text.as_bytes(), &ReadOptions::default())
}

fn read_bytes(bytes: &[u8], options: &ReadOptions) -> Result<(Trajectory, ReadReport), LogError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.csv");
    std::fs::write(&path, bytes).unwrap();
    read_csv_report(&path, options)
}

fn message(text: &str) -> String {
    let error = read_text(text).unwrap_err().to_string();
    // Drop the folder, which differs from run to run.
    error[error.find("log.csv").unwrap_or(0)..].to_owned()
}

const SMALL: &str = "time,q_a,dq_a\n0,1,2\n0.01,3,4\n";

fn full_trajectory() -> Trajectory {
    // Values that a careless printer would change: many digits, extremes, signed zero.
    let awkward = [0.1 + 0.2, -0.0, 1e300, 5e-324, f64::MAX, 1.0 / 3.0, -2.5e-17, 123_456_789.123_456_79];
    let take = |from: usize, count: usize| (0..count).map(|i| awkward[(from + i) % 8]).collect::<Vec<_>>();
    Trajectory {
        source: None,
        robot: Some("go2 \"blue\" \\ 7".into()),
        joints: vec!["FR_hip".into(), "FL_hip".into()],
        time: vec![0.1, 0.1 + 1.0 / 3.0, 1.0],
        rate_hz: 1.0 / 0.3,
        position: take(0, 6),
        velocity: take(1, 6),
        target: Some(take(2, 6)),
        action: Some(take(3, 6)),
        command: Some(take(4, 9)),
        motion: Some(vec![0.1 + 0.2, -0.0, 1.0 / 3.0, 5e-324, 12.3, -2.5e-17]),
        base: Some(BaseState {
            position: Some(take(5, 9)),
            quaternion: Some([0.1 + 0.2, -0.0, 0.91_f64.sqrt(), 5e-324].repeat(3)),
            linear_velocity: Some(take(7, 9)),
            angular_velocity: Some([0.1 + 0.2, -0.0, 123.456_789_123_456_79].repeat(3)),
        }),
        gains: Some(Gains { kp: vec![20.0, 1.0 / 7.0], kd: vec![0.0, 1e-9] }),
        lead: Some(Lead { seconds: 0.0003, spread: 1e-5 }),
        simulated_step: Some(0.0025),
        velocity_joints: vec!["FR_hip".into()],
        fell: true,
    }
}

#[test]
fn what_is_written_reads_back_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.csv");
    let mut log = full_trajectory();
    write_csv(&path, &log).unwrap();
    let back = read_csv(&path, &ReadOptions::default()).unwrap();
    log.source = Some(path.clone());
    assert_eq!(back, log);
    // `==` takes −0 for 0; bits do not.
    let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&back.position), bits(&log.position));

    // A bare log, with NaN and infinity in its signals, over the first one.
    let bare = Trajectory {
        robot: None,
        target: None,
        action: None,
        command: None,
        motion: None,
        base: None,
        gains: None,
        lead: None,
        simulated_step: None,
        velocity_joints: Vec::new(),
        fell: false,
        position: vec![f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, 1.0, 2.0],
        ..log
    };
    write_csv(&path, &bare).unwrap();
    let back = read_csv(&path, &ReadOptions::default()).unwrap();
    assert!(back.position[0].is_nan());
    assert_eq!(back.position[1..], bare.position[1..]);
    assert_eq!((back.target, back.base, back.gains), (None, None, None));
    // Nothing but the log is left in the folder.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn a_failed_write_leaves_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.csv");
    std::fs::write(&path, "precious").unwrap();
    let mut log = full_trajectory();
    log.velocity.pop();
    let error = write_csv(&path, &log).unwrap_err().to_string();
    assert_eq!(error, "velocity: 5 values for 3 samples × 2");
    log = full_trajectory();
    log.joints[0] = "FR,hip".into();
    assert!(matches!(write_csv(&path, &log), Err(LogError::Shape { .. })));
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "precious");
    let nowhere = folder.path().join("missing/run.csv");
    let error = write_csv(&nowhere, &full_trajectory()).unwrap_err().to_string();
    assert!(error.contains("cannot create a temporary file") && error.contains("unchanged"), "{error}");
}

#[test]
fn columns_are_found_by_name_in_any_order() {
    let (log, report) = read_text(
        "dq_b,foo,q_b,time,q_a,vy_cmd,cmd_vx,wz_cmd,dq_a,act_b,act_a,wx,wy\n\
         1,text,2,0,3,4,5,6,7,8,9,10,11\r\n\n1,,2,0.5,3,4,5,6,7,8,9,10,11",
    )
    .unwrap();
    assert_eq!(log.joints, ["b", "a"]);
    assert_eq!(log.position[..2], [2.0, 3.0]);
    assert_eq!(log.velocity[2..], [1.0, 7.0]);
    assert_eq!(log.action.unwrap()[..2], [8.0, 9.0]);
    assert_eq!(log.command.unwrap()[..3], [5.0, 4.0, 6.0]);
    assert_eq!((log.rate_hz, log.target, log.base), (2.0, None, None));
    let ignored: Vec<_> = report.ignored.iter().map(|i| (i.column, i.name.as_str())).collect();
    assert_eq!(ignored, [(2, "foo"), (12, "wx"), (13, "wy")]);
    assert_eq!(report.ignored[1].reason, "incomplete: wx, wy, wz belong together");
}

#[test]
fn angles_become_a_quaternion_and_empty_base_cells_nan() {
    let half = std::f64::consts::FRAC_PI_2;
    let (log, report) = read_text(&format!(
        "time,q_a,dq_a,roll,pitch,yaw,wx,wy,wz\n0,0,0,{half},0,0,nan,,nan\n0.1,0,0,0,0,{half},nan,nan,nan\n0.2,0,0,,,,,,\n"
    ))
    .unwrap();
    let base = log.base.unwrap();
    let quaternion = base.quaternion.unwrap();
    let r = std::f64::consts::FRAC_1_SQRT_2;
    for (got, want) in quaternion.iter().zip([r, r, 0.0, 0.0, r, 0.0, 0.0, r]) {
        assert!((got - want).abs() < 1e-15, "{quaternion:?}");
    }
    assert!(quaternion[8..].iter().all(|value| value.is_nan()));
    assert_eq!(base.angular_velocity, None);
    assert_eq!(report.ignored[0].reason, "every body rate cell is NaN");
    let hole = report.imu_hole.unwrap();
    assert_eq!((hole.line, hole.column, hole.name.as_str()), (4, 4, "roll"));

    // All three turned: the matrix of the quaternion is Rz·Ry·Rx, here by its bottom row,
    // (−sin pitch, cos pitch·sin roll, cos pitch·cos roll).
    let (log, _) = read_text("time,q_a,dq_a,roll,pitch,yaw\n0,0,0,0.3,-0.4,1.1\n0.1,0,0,0,0,0\n").unwrap();
    let q = log.base.unwrap().quaternion.unwrap();
    let (w, x, y, z) = (q[0], q[1], q[2], q[3]);
    let row = [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)];
    let want = [-(-0.4f64).sin(), (-0.4f64).cos() * 0.3f64.sin(), (-0.4f64).cos() * 0.3f64.cos()];
    for (got, want) in row.iter().zip(want) {
        assert!((got - want).abs() < 1e-15);
    }
}

#[test]
fn comments_state_gains_rate_and_robot() {
    let (log, report) = read_text(
        "# recorded on a Monday = cold\n#robot = 'go2'\n# rate_hz = 100\n# kp = [20, 40.5]\n# kd = { a = 1, \"*\" = 2 }\n\
         # firmware = 1.2\ntime,q_a,q_b,dq_a,dq_b\n0,0,0,0,0\n",
    )
    .unwrap();
    assert_eq!(log.robot.as_deref(), Some("go2"));
    assert_eq!(log.rate_hz, 100.0);
    assert_eq!(log.gains, Some(Gains { kp: vec![20.0, 40.5], kd: vec![1.0, 2.0] }));
    assert_eq!(report.unknown_keys, ["firmware"]);
    assert!(report.rate_from.unwrap().ends_with("log.csv:3"));

    // A name goes before patterns, of patterns the last one counts; a final `_joint` does not matter.
    let ordered = "# kp = { a_joint = 1, \"*\" = 3 }\n# kd = { \"*\" = 3, \"b*\" = 2 }\n";
    let (log, _) =
        read_text(&format!("{ordered}# rate_hz = 100\ntime,q_a,q_b,dq_a,dq_b\n0,0,0,0,0\n")).unwrap();
    assert_eq!(log.gains, Some(Gains { kp: vec![1.0, 3.0], kd: vec![3.0, 2.0] }));

    let lost = message("# kp = { \"b*\" = 2, \"*\" = 3 }\n# kd = 1\ntime,q_a,q_b,dq_a,dq_b\n0,0,0,0,0\n");
    assert!(lost.contains("kp: `b*` has no effect, because the later `*`"), "{lost}");
    let short = message("# kp = [1, 2]\n# kd = 1\ntime,q_a,dq_a,dq_b\n0,0,0,0\n");
    assert!(short.contains("2 entries for 1 joints") && short.contains("there is no `q_b`"), "{short}");
    for (comment, part) in [
        ("kp = 20", "kp without kd"),
        ("kp = [20", "log.csv:1: `kp = [20` is not TOML for `kp`"),
        ("Kp = 20", "write `kp = …`"),
        ("rate = 20", "write `rate_hz = …`"),
        ("rate_hz = -3", "give a positive sample rate"),
        ("kp = 1\n# kp = 2", "log.csv:2: `kp` is stated twice"),
        ("kp = [1, 2]\n# kd = 1", "kp has 2 entries for 1 joints"),
        ("kp = { b = 1 }\n# kd = 1", "`b` matches no joint"),
        ("kp = { c = 1 }\n# kd = 1", "kp: `c` matches no joint of the log; the nearest names are a"),
        ("kp = -1\n# kd = 1", "gains are finite and not negative"),
        ("kp = \"soft\"\n# kd = 1", "is not TOML for `kp`"),
    ] {
        let error = message(&format!("# {comment}\n{SMALL}"));
        assert!(error.contains(part), "{comment}: {error}");
    }
}

#[test]
fn options_beat_comments_beat_sidecars() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("log.toml"), "robot = 'folder'\nkp = 1\nkd = 1\nrate_hz = 1\nnotes.by = 'me'").unwrap();
    std::fs::write(at("run.toml"), "kp = 2\nrate_hz = 2").unwrap();
    std::fs::write(at("run.csv"), format!("# rate_hz = 3\n{SMALL}")).unwrap();
    let read = |options: &ReadOptions| read_csv_report(&at("run.csv"), options);
    let (log, report) = read(&ReadOptions::default()).unwrap();
    assert_eq!((log.robot.as_deref(), log.rate_hz), (Some("folder"), 3.0));
    assert_eq!(log.gains, Some(Gains { kp: vec![2.0], kd: vec![1.0] }));
    assert_eq!(report.sidecars, [at("run.toml"), at("log.toml")]);

    let named = PerJoint::Named([("*".to_owned(), 9.0)].into());
    let options = ReadOptions { rate_hz: Some(4.0), kp: Some(named), ..Default::default() };
    let log = read(&options).unwrap().0;
    assert_eq!((log.rate_hz, log.gains.unwrap().kp), (4.0, vec![9.0]));
    let log = read(&ReadOptions { sidecar: false, ..Default::default() }).unwrap().0;
    assert_eq!((log.robot, log.gains), (None, None));

    std::fs::write(at("log.toml"), "kP = 1").unwrap();
    let error = read(&ReadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("log.toml") && error.contains("unknown field `kP`"), "{error}");
}

#[test]
fn the_rate_is_the_median_interval_rounded_when_near() {
    let rate = |times: &[f64]| {
        let rows: String = times.iter().map(|time| format!("{time},0,0\n")).collect();
        read_text(&format!("time,q_a,dq_a\n{rows}")).map(|(log, _)| log.rate_hz)
    };
    assert_eq!(rate(&[0.0, 0.005001, 0.010002, 0.015003]).unwrap(), 200.0);
    assert_eq!(rate(&[0.0, 0.02, 0.04, 1.0]).unwrap(), 50.0);
    assert_eq!(rate(&[0.0, 0.03, 0.06]).unwrap(), 1.0 / 0.03);
    assert!(rate(&[0.0]).unwrap_err().to_string().contains("# rate_hz = 200"));
    assert!(rate(&[1.0, 1.0, 1.0]).is_err());
}

#[test]
fn bad_files_say_where_and_what_to_do() {
    for (text, want) in [
        ("", "log.csv: empty file"),
        ("\n# only = 'comments'\n", "log.csv: empty file"),
        ("time,q_a,dq_a\n\n", "log.csv: a header but no samples"),
        (
            "time,q_a,dq_a\n0,1,2\n0.01,3\n",
            "log.csv:3: 2 cells where the header names 3; the row is cut short",
        ),
        ("time,q_a,dq_a\n0,1,2,5\n", "log.csv:2: 4 cells where the header names 3; a comma too many"),
        ("\n# x\ntime,q_a,dq_a\n\n0,1,2\n0,1,x2\n", "log.csv:6: column 3 `dq_a`: \"x2\" is not a number"),
        ("time,q_a,dq_a\n0,,2\n", "log.csv:2: column 2 `q_a`: \"\" is empty; write `nan`"),
        ("time,q_a,dq_a\nnan,1,2\n", "log.csv:2: column 1 `time`: \"nan\" is no sample time"),
        ("time,q_a,dq_a\n1e400,1,2\n", "log.csv:2: column 1 `time`: \"1e400\" is no sample time"),
        ("time,q_a,dq_a\n0,1\u{0},2\n", "log.csv:2: column 2 `q_a`: \"1\\0\" is not a number"),
        ("time,q_a\u{0}\n0,1\n", "log.csv:1: no column `dq_a\\u{0}`"),
        ("time,q_a,dq_a,q_a\n0,1,2,3\n", "log.csv:1: column 4 `q_a` repeats column 2"),
        ("time,q_a,dq_a,vx_cmd,cmd_vx\n", "log.csv:1: column 5 `cmd_vx` repeats column 4"),
        (
            "q_a,dq_a\n0,1\n",
            "log.csv:1: no column `time`; add the sample time in seconds. Or import the file: `gaitfit import FILE --mapping",
        ),
        (
            "time,qdes_a\n0,1\n",
            "log.csv:1: no column `q_<joint>`; the file has targets only, such as chirp.csv of `gaitfit excite`",
        ),
        ("t,q_a,dq_a\n0,1,1\n", "log.csv:1: no column `time`; if `t` is the sample time, rename it"),
        ("0,1,2\n1,2,3\n", "log.csv:1: no column `time`; the first line holds numbers"),
        (
            "time;q_a;dq_a\n0;1;2\n",
            "log.csv:1: no column `time`; the header has one column; cells are separated",
        ),
        ("time,x\n0,1\n", "log.csv:1: no column `q_<joint>`"),
        ("time,q_a\n0,1\n", "log.csv:1: no column `dq_a`; `q_a` needs its velocity"),
        (
            "time,q_a,dq_a,q_b,dq_b,qdes_a\n",
            "log.csv:1: no column `qdes_b`; 1 of 2 joints have a `qdes_` column",
        ),
        (
            "time,q_a,dq_a,base_quat_w,base_quat_x,base_quat_y,base_quat_z\n0,1,2,1,0,0,0\n1,1,2,0,0,0,0\n",
            "log.csv:3: column 4 `base_quat_w`: \"0\" is part of no rotation",
        ),
        (
            "time,q_a,dq_a,wx,wy,wz\n0,1,2,0,0,0\n\n1,1,2,0,1e12,0\n",
            "log.csv:4: column 5 `wy`: \"1e12\" is beyond 200 rad/s",
        ),
        (
            "time,q_a,dq_a,wz,wy,wx\n0,1,2,inf,0,0\n",
            "log.csv:2: column 4 `wz`: \"inf\" is no reading of an inertial unit",
        ),
        (
            "time,q_a,dq_a,roll,pitch,yaw\n0,1,2,5,-90,0\n",
            "log.csv:2: column 5 `pitch`: \"-90\" is more than a full turn",
        ),
        ("time,q_a,dq_a\n\"0\",\" 1 \",\"2\n", "log.csv:2: column 3 `dq_a`: \"\\\"2\" is not a number"),
    ] {
        let error = message(text);
        assert!(error.starts_with(want), "{text:?}\n  gave {error}\n  want {want}");
    }
    // A velocity without a position is reported, not fatal.
    let (_, report) = read_text("time,q_a,dq_a,dq_b\n0,1,2,3\n0.1,1,2,3\n").unwrap();
    assert_eq!(report.ignored[0].reason, "there is no `q_b`");
    // A byte-order mark and quoted names, as spreadsheets write them.
    let (log, _) = read_text("\u{feff}\"time\",\"q_a\",\"dq_a\"\r\n\"0\",1,2\r\n\"0.1\",1,2\r\n").unwrap();
    assert_eq!(log.rate_hz, 10.0);
}

#[test]
fn size_limits_and_binary_files() {
    let small = |max_bytes, max_columns| ReadOptions { max_bytes, max_columns, ..Default::default() };
    let fails = |bytes: &[u8], options: &ReadOptions| read_bytes(bytes, options).unwrap_err();
    assert!(matches!(fails(SMALL.as_bytes(), &small(20, 9)), LogError::TooLarge { limit: 20, .. }));
    assert!(matches!(fails(SMALL.as_bytes(), &small(99, 2)), LogError::TooManyColumns { columns: 3, .. }));
    let long = vec![b'x'; (1 << 20) + 10];
    assert!(matches!(fails(&long, &ReadOptions::default()), LogError::LineTooLong { line: 1, .. }));
    let latin1 = b"time,q_a,dq_a\n0,1,2\n0,\xb0,1\n";
    assert!(matches!(fails(latin1, &ReadOptions::default()), LogError::NotUtf8 { line: 3, .. }));
    for (bytes, hint) in
        [(&b"\xff\xfet\0"[..], "UTF-16"), (b"\x1f\x8b\x08\0", "gzip"), (b"PK\x03\x04", "spreadsheet")]
    {
        let error = fails(bytes, &ReadOptions::default()).to_string();
        assert!(error.contains(hint), "{error}");
    }
    let folder = tempfile::tempdir().unwrap();
    let options = ReadOptions::default();
    assert!(matches!(read_csv(folder.path(), &options), Err(LogError::NotAFile { .. })));
    assert!(matches!(read_csv(&folder.path().join("no.csv"), &options), Err(LogError::Io { .. })));
}

#[test]
fn messages_are_short_and_cannot_command_a_terminal() {
    let (wild, long) = ("\u{1b}[2J\u{202e}\u{9b}31m", "x".repeat(100_000));
    for bad in [wild, &long] {
        for text in [
            format!("{bad},q_a,dq_a\n0,1,2\n"),
            format!("{bad}time,q_a,dq_a\n0,1,2\n"),
            format!("time,q_{bad}\n0,1\n"),
            format!("time,q_a,dq_a,{bad},{bad}\n0,1,2,3,4\n"),
            format!("time,q_{bad},dq_{bad}\n0,1,{bad}\n"),
            format!("time,q_{bad},dq_{bad},q_b,dq_b,qdes_{bad}\n0,1,1,1,1,1\n"),
            format!("# kp = \"{bad}\"\n{SMALL}"),
            format!("# kp = {{ \"{bad}\" = 1 }}\n# kd = 1\n{SMALL}"),
            format!("# kp = {{ \"[{bad}\" = 1 }}\n# kd = 1\n{SMALL}"),
            format!("# kp = -1e300\n# kd = 1\ntime,q_{bad},dq_{bad}\n0,1,2\n0.1,1,2\n"),
            format!("# rate_hz = -1e300\n# x = {bad}\n{SMALL}"),
        ] {
            let error = message(&text);
            assert!(!error.chars().any(|c| c.is_control() || c == '\u{202e}'), "{text:.60}: {error}");
            assert!(error.len() < 500, "{text:.60}: {} bytes", error.len());
        }
    }
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("run.toml"), format!("kp = 1\n\"{wild}\" = 2")).unwrap();
    std::fs::write(folder.path().join("run.csv"), SMALL).unwrap();
    let error = read_csv(&folder.path().join("run.csv"), &ReadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("run.toml: line 2: ") && !error.chars().any(char::is_control), "{error}");
}

/// Files made to cost memory or time are refused, or read, at once.
#[test]
fn hostile_files_are_cheap() {
    let begin = std::time::Instant::now();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.csv");
    let fails = |text: &str| read_text(text).unwrap_err();
    // A file of 600 MB is refused by its length, unread.
    std::fs::File::create(&path).unwrap().set_len(600 << 20).unwrap();
    assert!(matches!(read_csv(&path, &ReadOptions::default()), Err(LogError::TooLarge { .. })));
    // One line of 500 MB is given up after the first megabyte.
    std::fs::File::create(&path).unwrap().set_len(500 << 20).unwrap();
    assert!(matches!(read_csv(&path, &ReadOptions::default()), Err(LogError::LineTooLong { line: 1, .. })));
    assert!(matches!(fails(&",".repeat(100_000)), LogError::TooManyColumns { columns: 100_001, .. }));
    assert!(matches!(fails(&format!("# kp = {}\n{SMALL}", "[".repeat(500_000))), LogError::Metadata { .. }));
    let tables: String = (0..40_000).map(|i| format!("\"*{i}\"=1,")).collect();
    let error = fails(&format!("# kp = {{ {tables} }}\n# kd = 1\n{SMALL}")).to_string();
    assert!(error.contains("kp has 40000 entries"), "{error}");

    // As many joints as are taken, in the order that a search in lists is slowest with.
    let joints: Vec<String> = (0..40_000).map(|i| format!("j{i}")).collect();
    let columns = |prefix: &str| joints.iter().map(|joint| format!("{prefix}{joint},")).collect::<String>();
    let header = format!("{}{}other_{}time", columns("q_"), columns("dq_"), columns("act"));
    let row = "1,".repeat(120_000);
    let text = format!("{header}\n{row}0\n{row}0.01\n");
    let options = ReadOptions { max_columns: 1 << 20, ..ReadOptions::default() };
    let error = read_bytes(text.as_bytes(), &options).unwrap_err();
    assert!(matches!(error, LogError::LineTooLong { .. }), "{error}");
    let text = format!(
        "{}{}time\n{}0\n{}0.01\n",
        columns("q_"),
        columns("dq_"),
        "1,".repeat(80_000),
        "2,".repeat(80_000)
    );
    let (log, _) = read_bytes(text.as_bytes(), &options).unwrap();
    assert_eq!(log.joints.len(), 40_000);
    let spec = CheckSpec { joints: Some(joints), ..CheckSpec::default() };
    assert_eq!(check(&log, &spec), []);
    assert!(begin.elapsed().as_secs_f64() < 10.0, "{:?}", begin.elapsed());
}

/// Deterministic mutations of a small log: bytes flipped, cut, doubled, lines shuffled. Reading gives a
/// trajectory that is well formed, or an error; never a panic. What reads also writes and reads back.
#[test]
fn mutated_logs_never_panic() {
    let seed = "# robot = \"go2\"\n# rate_hz = 50\n# kp = [20.0, 25]\n# kd = {\"*\" = 0.5}\n\
                time,q_a,q_b,dq_a,dq_b,qdes_a,qdes_b,roll,pitch,yaw,wx,wy,wz,vx_cmd,vy_cmd,wz_cmd,note\n\
                0,0.1,-2e-3,1,2,0.1,0,0.01,0,nan,,,0,1,0,0,hi\n\
                0.02,0.1,-2e-3,1,2,0.1,0,0.01,0,1,1,,0,1,0,0,x\n\
                0.04,inf,NaN,1,2,0.1,0,0.01,0,1,1,,0,1,0,0,x\n";
    let alphabet = b"\0\n\r,\"#=[]{}-+.eE019nai_q\xff\xc3\xa9;\t ";
    let folder = tempfile::tempdir().unwrap();
    let (path, again) = (folder.path().join("log.csv"), folder.path().join("again.csv"));
    let options = ReadOptions { max_bytes: 1 << 16, max_columns: 64, ..Default::default() };
    let words = ["nan", "-1", "1e308", "0", "inf", "[1, 2]", "q_a", "1e-320"];
    let bounds = Bounds { bytes: 1 << 20, time: Duration::from_secs(10) };
    let mut read = 0;
    let outcome = attack(
        "CSV logs",
        2000,
        bounds,
        |draws| text(seed.as_bytes(), alphabet, &words, b",=\n", draws),
        |bytes| {
            std::fs::write(&path, bytes).unwrap();
            let result = read_csv(&path, &options);
            // Some file systems flush a file that is overwritten; a new one is quicker.
            std::fs::remove_file(&path).unwrap();
            let Ok(log) = result else { return false };
            log.validate().unwrap();
            read += 1;
            if read % 100 == 0 && write_csv(&again, &log).is_ok() {
                let back = read_csv(&again, &options).unwrap();
                // Text, because NaN is not equal to itself.
                let text = |log: &Trajectory| format!("{:?}", Trajectory { source: None, ..log.clone() });
                assert_eq!(text(&back), text(&log));
            }
            true
        },
    );
    let read = outcome.read;
    assert!(read > 100, "only {read} mutants were readable: the mutations are too coarse to test anything");
}
