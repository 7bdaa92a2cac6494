//! One motion in every kind of file gives one trajectory. `tools/make_import_fixtures.py` wrote the files.

#![allow(clippy::unwrap_used)]

use crate::common;

use common::{JOINTS, apart, fixture, read};
use gaitfit_import::{ClockFinding, ImportError, Imported, Mapping, Options, import, mcap_bytes};
use gaitfit_log::{ReadOptions, Trajectory, read_csv, write_csv};

/// The reference, with joints in the order of `like`.
pub(crate) fn reference(like: &Trajectory) -> Trajectory {
    let log = read_csv(&fixture("motion.csv"), &ReadOptions::default()).unwrap();
    log.select_joints(&like.joints).unwrap()
}

/// Checks positions, targets, times and gains against the reference; and velocities, if the file has them.
pub(crate) fn same(imported: &Imported, velocities: bool, gains: bool, tolerance: f64) {
    let log = &imported.trajectory;
    let want = reference(log);
    assert_eq!(log.joints.len(), 12);
    assert_eq!(log.rate_hz, 200.0);
    assert!(apart(&log.time, &want.time) < 1e-6, "{:?}", &log.time[..4]);
    assert!(apart(&log.position, &want.position) <= tolerance);
    assert!(apart(log.target.as_ref().unwrap(), want.target.as_ref().unwrap()) <= tolerance);
    if velocities {
        assert!(apart(&log.velocity, &want.velocity) <= 10.0 * tolerance);
    }
    if gains {
        assert_eq!(log.gains, want.gains);
    }
}

#[test]
fn every_kind_of_file_gives_the_same_trajectory() {
    for (name, mapping, gains, tolerance) in [
        ("motion.csv", "", true, 0.0),
        ("joint_states.mcap", "", false, 0.0),
        ("controller.mcap", "", false, 0.0),
        ("unitree_go.mcap", "", true, 0.0),
        ("bag", "", false, 0.0),
        ("bag/bag.db3", "", false, 0.0),
        ("motion.npz", "", true, 0.0),
        ("motion.pt", JOINTS, false, 0.0),
        ("motion.pkl", "", false, 0.0),
        ("walk_these_ways.pkl", "", true, 0.0),
        // Degrees are rounded once more.
        ("odd.csv", "odd.toml", true, 1e-14),
    ] {
        let mapping = match mapping.ends_with(".toml") {
            true => std::fs::read_to_string(fixture(mapping)).unwrap(),
            false => mapping.to_owned(),
        };
        let imported = read(name, &mapping).unwrap_or_else(|error| panic!("{name}: {error}"));
        eprintln!("{name}: {:?} {:?}", imported.report.assumed, imported.report.left_out);
        same(&imported, true, gains, tolerance);
    }
}

#[test]
fn pace_recordings_have_no_velocities_and_no_names() {
    let error = read("pace.pt", "").unwrap_err();
    assert!(matches!(error, ImportError::NoJointNames { count: 12 }), "{error}");
    let imported = read("pace.pt", JOINTS).unwrap();
    same(&imported, false, false, 0.0);
    let log = &imported.trajectory;
    assert!(imported.report.assumed.iter().any(|line| line.contains("central differences")));
    let want = (log.position[2 * 12] - log.position[0]) / 0.01;
    assert!((log.velocity[12] - want).abs() < 1e-9);
}

#[test]
fn unitree_layouts_are_decoded_by_the_file_s_definitions() {
    let imported = read("unitree_go.mcap", "").unwrap();
    let base = imported.trajectory.base.as_ref().unwrap();
    assert_eq!(base.quaternion.as_ref().unwrap()[..4], [1.0, 0.0, 0.0, 0.0]);
    assert_eq!(base.angular_velocity.as_ref().unwrap()[..3], [0.125, -0.25, 0.5]);
    assert!(imported.report.left_out.iter().any(|line| line.contains("motors 12 to 19")));

    let log = read("unitree_hg.mcap", "").unwrap().trajectory;
    assert_eq!((log.joints.len(), log.rate_hz), (29, 500.0));
    assert_eq!((log.joints[0].as_str(), log.joints[28].as_str()), ("left_hip_pitch", "right_wrist_yaw"));
    for (i, value) in log.position[29..58].iter().enumerate() {
        let want = 0.01 * i as f64 + 0.001;
        assert!((value - want).abs() < 1e-7, "motor {i}: {value}");
    }
}

#[test]
fn walk_these_ways_actions_belong_to_the_state_before() {
    let imported = read("walk_these_ways.pkl", "").unwrap();
    let log = imported.trajectory;
    let target = log.target.as_ref().unwrap();
    let action = log.action.as_ref().unwrap();
    let scaled: Vec<f64> = target.iter().map(|target| f64::from((4.0 * target) as f32)).collect();
    assert_eq!(action, &scaled);
    assert_eq!(log.command.as_ref().unwrap()[..3], [0.5, 0.25, -0.75]);
    assert_eq!(log.base.as_ref().unwrap().quaternion.as_ref().unwrap()[..4], [1.0, 0.0, 0.0, 0.0]);
}

#[test]
fn plotjuggler_rows_of_several_topics_are_joined() {
    let imported = read("plotjuggler.csv", "").unwrap();
    // Commands were sent half a millisecond before the states.
    same(&imported, true, false, 0.0);
    assert_eq!(imported.report.streams.len(), 2);
}

#[test]
fn streams_of_two_rates_and_clocks_are_joined_by_time() {
    let imported = read("two_rates.mcap", "").unwrap();
    let log = &imported.trajectory;
    assert_eq!((log.rate_hz, log.len()), (500.0, 150));
    let target = log.target.as_ref().unwrap();
    for (sample, time) in log.time.iter().enumerate() {
        assert!((log.position[2 * sample] - time).abs() < 1e-9);
        // Action n is sent at 20 n ms, ten samples before the next.
        assert_eq!(target[2 * sample], (sample / 10) as f64, "at {time} s");
        assert_eq!(target[2 * sample + 1], -((sample / 10) as f64));
    }
    let line = imported.report.assumed.iter().find(|line| line.contains("ahead")).unwrap();
    let ahead: f64 = line.split(" ms").next().unwrap().rsplit(' ').next().unwrap().parse().unwrap();
    assert!((ahead - 3.0).abs() < 0.1, "{line}");
    let mut rates: Vec<f64> = imported.report.streams.iter().map(|stream| stream.rate_hz.round()).collect();
    rates.sort_by(f64::total_cmp);
    assert_eq!(rates, [50.0, 500.0]);

    // Without the correction the actions come a sample or two late.
    let late = read("two_rates.mcap", "clock_offset_s = 0.0").unwrap().trajectory;
    let held = late
        .target
        .as_ref()
        .unwrap()
        .chunks_exact(2)
        .zip(&late.position.chunks_exact(2).collect::<Vec<_>>())
        .filter(|(target, q)| target[0] != (q[0] / 0.02 + 1e-6).floor())
        .count();
    assert!(held >= 14, "{held}");
    // And as stated by hand.
    let stated = read("two_rates.mcap", "clock_offset_s = -0.003").unwrap().trajectory;
    assert_eq!(stated.target, log.target);
}

#[test]
fn two_files_of_one_recording_are_joined() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state.csv");
    let action = folder.path().join("action.csv");
    let mut text = String::from("t,q_0,q_1,dq_0,dq_1\n");
    (0..100).for_each(|i| text.push_str(&format!("{},{i},{},0,0\n", f64::from(i) * 0.002, 2 * i)));
    std::fs::write(&state, text).unwrap();
    let mut text = String::from("stamp,action_0,action_1\n");
    (0..10).for_each(|i| text.push_str(&format!("{},{i},-{i}\n", f64::from(i) * 0.02 + 0.003)));
    std::fs::write(&action, text).unwrap();
    let mapping = Mapping::parse("joints = ['a', 'b']\nclock_offset_s = -0.003").unwrap();
    let imported = import(&[&state, &action], &Options { mapping, ..Options::default() }).unwrap();
    let log = imported.trajectory;
    assert_eq!(log.len(), 100);
    for (sample, row) in log.action.as_ref().unwrap().chunks_exact(2).enumerate() {
        assert_eq!(row[0], (sample / 10) as f64);
    }
}

#[test]
fn what_was_imported_is_written_and_read_as_a_log() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.csv");
    let imported = read("walk_these_ways.pkl", "").unwrap();
    write_csv(&path, &imported.trajectory).unwrap();
    let back = read_csv(&path, &ReadOptions::default()).unwrap();
    assert_eq!(back, Trajectory { source: back.source.clone(), ..imported.trajectory });
}

#[test]
fn what_is_not_understood_is_refused_with_a_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let cases: [(&str, &[u8], &str); 9] = [
        ("a.h5", b"\x89HDF\r\n\x1a\n....", "HDF5"),
        ("a.bag", b"#ROSBAG V2.0\n", "rosbags-convert"),
        ("a.bin", b"\x00\x01\x02", "no kind that is read"),
        ("a.csv", b"time,x,y\n0,1,2\n1,2,3\n", "no column of a known name"),
        ("b.csv", b"q_a,dq_a\n0,1\n1,2\n", "rate_hz"),
        ("c.csv", b"t,q_0,dq_0\n0,1,2\n0.01,2,3\n", "joints = [...]"),
        ("d.csv", b"t,q_a,dq_a\n0,1,2\n0.01,2\n0.02,2,2\n", "line 3: 2 cells"),
        ("e.csv", b"t,q_a,dq_a\n0.02,1,2\n0.01,2,3\n0.0,2,2\n", "no clock"),
        ("a.db3", b"SQLite format 3\0", "damaged"),
    ];
    for (name, bytes, part) in cases {
        let error = import(&[write(name, bytes)], &Options::default()).unwrap_err().to_string();
        assert!(error.contains(part), "{name}: {error}");
    }
    for text in ["unit = 'grad'", "rate_hz = -1", "joints = ['a', 'a']", "colums = 1"] {
        assert!(matches!(Mapping::parse(text), Err(ImportError::Mapping { .. })), "{text}");
    }
}

#[test]
fn clocks_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    let mut text = String::from("time_ms;q_a;dq_a\n");
    (0..200).filter(|i| *i != 50).for_each(|i| text.push_str(&format!("{};{i},5;1\n", i * 5)));
    std::fs::write(&path, text).unwrap();
    let imported = import(&[&path], &Options::default()).unwrap();
    assert_eq!(imported.trajectory.rate_hz, 200.0);
    assert_eq!(imported.trajectory.position[1], 1.5);
    let [ClockFinding::Gaps { gaps: 1, lost: 1, longest_s, at_s }] = imported.report.streams[0].findings[..]
    else {
        panic!("{:?}", imported.report.streams)
    };
    assert!((longest_s - 0.01).abs() < 1e-9 && (at_s - 0.245).abs() < 1e-9);
}

/// A walking log of a second with all that an MCAP file holds.
fn walk() -> Trajectory {
    let mut log = read("walk_these_ways.pkl", "").unwrap().trajectory;
    let samples = log.len();
    log.source = None;
    log.robot = Some("go2".into());
    log.fell = true;
    // Wilder numbers than a robot's: all bits must come back.
    log.velocity.iter_mut().enumerate().for_each(|(i, value)| *value = (i as f64).exp().sin() / 3.0);
    let angles = |sample: usize| 0.01 * sample as f64;
    let quaternion = (0..samples).flat_map(|i| [angles(i).cos(), 0.0, angles(i).sin(), 0.0]).collect();
    let rates = (0..3 * samples).map(|i| 0.1 * i as f64).collect();
    log.base = Some(gaitfit_log::BaseState {
        quaternion: Some(quaternion),
        angular_velocity: Some(rates),
        ..gaitfit_log::BaseState::default()
    });
    log
}

#[test]
fn logs_written_as_mcap_are_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    let log = walk();
    let (bytes, left_out) = mcap_bytes(&log).unwrap();
    assert_eq!(left_out, [""; 0]);
    std::fs::write(&path, bytes).unwrap();
    let mut back = import(&[&path], &Options::default()).unwrap().trajectory;
    back.source = None;
    assert!(apart(&back.time, &log.time) < 1e-9);
    back.time.clone_from(&log.time);
    let turned = apart(
        back.base.as_ref().unwrap().quaternion.as_ref().unwrap(),
        log.base.as_ref().unwrap().quaternion.as_ref().unwrap(),
    );
    assert!(turned < 1e-15);
    back.base.clone_from(&log.base);
    assert_eq!(back, log);
}

#[test]
fn a_log_as_mcap_states_what_it_lacks_and_has_no_rates_that_nobody_measured() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    let mut log = walk();
    log.motion = Some(log.time.iter().flat_map(|time| [*time, 0.5]).collect());
    log.simulated_step = Some(0.002);
    let whole = log.base.clone().unwrap();
    for base in [
        gaitfit_log::BaseState { quaternion: whole.quaternion, ..Default::default() },
        gaitfit_log::BaseState { angular_velocity: whole.angular_velocity, ..Default::default() },
    ] {
        log.base = Some(base);
        let (bytes, left_out) = mcap_bytes(&log).unwrap();
        assert!(left_out.len() == 2 && left_out[0].contains("motion_time"), "{left_out:?}");
        assert!(left_out[1].contains("simulated_step_s"), "{left_out:?}");
        std::fs::write(&path, bytes).unwrap();
        let back = import(&[&path], &Options::default()).unwrap().trajectory.base.unwrap();
        let parts =
            |base: &gaitfit_log::BaseState| (base.quaternion.is_some(), base.angular_velocity.is_some());
        assert_eq!(parts(&back), parts(log.base.as_ref().unwrap()));
    }
}

#[test]
#[ignore = "needs the Python packages of tools/setup_venv.sh"]
fn python_mcap_reads_what_is_written() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    let log = walk();
    std::fs::write(&path, mcap_bytes(&log).unwrap().0).unwrap();
    let script = "
import json, sys
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
out = {}
with open(sys.argv[1], 'rb') as file:
    reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
    assert reader.get_header().profile == 'ros2'
    assert reader.get_summary().statistics.message_count == int(sys.argv[2])
    for schema, channel, message, ros in reader.iter_decoded_messages():
        rows = out.setdefault(channel.topic, [])
        if schema.name == 'sensor_msgs/msg/JointState':
            rows.append([list(ros.name), list(ros.position), list(ros.velocity)])
        elif schema.name == 'sensor_msgs/msg/Imu':
            q = ros.orientation
            rows.append([q.w, q.x, q.y, q.z])
        else:
            rows.append([ros.twist.linear.x, ros.twist.linear.y, ros.twist.angular.z])
        assert ros.header.stamp.sec * 10**9 + ros.header.stamp.nanosec == message.log_time
print(json.dumps(out))
";
    let output = std::process::Command::new(root.join(".venv/bin/python"))
        .args(["-c", script, &path.display().to_string(), &(5 * log.len()).to_string()])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let messages: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    for sample in [0, 1, log.len() - 1] {
        let row = |values: &[f64], width: usize| values[sample * width..(sample + 1) * width].to_vec();
        let states = serde_json::json!([log.joints, row(&log.position, 12), row(&log.velocity, 12)]);
        assert_eq!(messages["/joint_states"][sample], states);
        assert_eq!(
            messages["/joint_targets"][sample][1],
            serde_json::json!(row(log.target.as_ref().unwrap(), 12))
        );
        assert_eq!(
            messages["/joint_actions"][sample][1],
            serde_json::json!(row(log.action.as_ref().unwrap(), 12))
        );
        assert_eq!(messages["/cmd_vel"][sample], serde_json::json!(row(log.command.as_ref().unwrap(), 3)));
        let base = log.base.as_ref().unwrap();
        assert_eq!(messages["/imu"][sample], serde_json::json!(row(base.quaternion.as_ref().unwrap(), 4)));
    }
}

#[test]
fn joints_are_not_dropped_in_silence() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    let refused = |text: &str, mapping: &str| {
        std::fs::write(&path, text).unwrap();
        let mapping = Mapping::parse(mapping).unwrap();
        import(&[&path], &Options { mapping, ..Options::default() }).unwrap_err().to_string()
    };
    let names = "joints = ['a', 'b', 'c']";
    // Positions of two joints, velocities of three.
    let error = refused("t,q_0,q_1,dq_0,dq_1,dq_2\n0,1,2,3,4,5\n0.01,1,2,3,4,5\n", names);
    assert!(error.contains("positions of 2 joints") && error.contains("joint 2, c,"), "{error}");
    // Number 1 is missing.
    let error = refused("t,q_0,q_2,dq_0,dq_2\n0,1,2,3,4\n0.01,1,2,3,4\n", names);
    assert!(error.contains("joint 1, b,"), "{error}");
    let error = refused("t,q_a,dq_a,dq_b\n0,1,2,3\n0.01,1,2,3\n", "");
    assert!(error.contains("joint b") && error.contains("leave"), "{error}");
    let motors = "t,motor_state[0]/q,motor_state[2]/q\n0,1,2\n0.01,1,2\n";
    assert!(refused(motors, names).contains("joint 1, b,"));
    // More motors than joints: idle ones are left out and said, moving ones refused.
    let motors = "t,motor_state[0]/q,motor_state[1]/q,motor_state[2]/q,motor_state[3]/q\n0,1,2,3,0\n0.01,1,2,3,VALUE\n";
    let error = refused(&motors.replace("VALUE", "0.5"), names);
    assert!(error.contains("motors 3 move") && error.contains("only 3 are named"), "{error}");
    std::fs::write(&path, motors.replace("VALUE", "0")).unwrap();
    let options = Options { mapping: Mapping::parse(names).unwrap(), ..Options::default() };
    let imported = import(&[&path], &options).unwrap();
    assert_eq!(imported.trajectory.joints, ["a", "b", "c"]);
    assert!(imported.report.left_out.iter().any(|line| line.contains("motors 3 to 3")));
}

#[test]
fn mistakes_of_the_caller_are_named() {
    let error = Mapping::parse("unit = \"rad\"\njoints = 3\n").unwrap_err().to_string();
    assert!(
        error.contains("line 2, column 10") && !error.contains("\\n") && !error.contains('\n'),
        "{error}"
    );
    let error = Mapping::parse("a = 1\nunit = [").unwrap_err().to_string();
    assert!(!error.contains("\\n") && error.contains("line "), "{error}");
    let error = read("motion.npz", "[time]\ncolumn = 'stamp'").unwrap_err().to_string();
    assert!(
        error.contains("`stamp`") && error.contains("[time] column") && error.contains("joint_pos"),
        "{error}"
    );
    let error = read("motion.csv", "[time]\ncolumn = 'stamp'").unwrap_err().to_string();
    assert!(error.contains("`stamp`") && error.contains("[time] column"), "{error}");
    for (file, take) in
        [("motion.npz", "joint_po_"), ("motion.csv", "q_FX"), ("joint_states.mcap", "/joints")]
    {
        let error = read(file, &format!("[streams]\ntake = ['{take}']")).unwrap_err().to_string();
        assert!(error.contains(&format!("`{take}`")) && error.contains("--take"), "{file}: {error}");
    }
    assert!(matches!(read("motion.npz", "clock_offset_s = 0.1"), Err(ImportError::NothingToShift)));
    assert!(read("plotjuggler.csv", "clock_offset_s = 0.0005").is_ok());
}

#[test]
fn arrays_of_other_lengths_are_named_with_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.pkl");
    // A pickle of protocol 0: times of three samples, positions of two.
    let text = "(dp0\nVtime\np1\n(lp2\nF0.0\naF0.01\naF0.02\nasVjoint_pos\np3\n(lp4\n(lp5\nF1.0\naF2.0\naa(lp6\nF1.0\naF2.0\naas.";
    std::fs::write(&path, text).unwrap();
    let options = Options { mapping: Mapping::parse("joints = ['a', 'b']").unwrap(), ..Options::default() };
    let error = import(&[&path], &options).unwrap_err().to_string();
    assert!(error.contains("`time` has 3 rows and `joint_pos` 2") && error.contains("pickle"), "{error}");
    let log = read("protocol_0.pkl", "").unwrap().trajectory;
    assert_eq!((log.joints.len(), log.len()), (2, 20));
    assert!((log.position[2] - 0.1f64.sin()).abs() < 1e-15);
}

/// Without the feature `all-formats` a conversion is named that the importer reads.
#[cfg(not(feature = "all-formats"))]
#[test]
fn kinds_of_files_that_are_not_built_in_are_named_with_a_conversion() {
    for (name, kind, conversion) in [
        ("motion.parquet", "Parquet", "pandas.read_parquet"),
        ("motion.arrow", "Arrow", "pandas.read_feather"),
        ("stream.arrow", "Arrow", "pyarrow.ipc.open_stream"),
        ("motion.h5", "HDF5", "h5py.File"),
    ] {
        let error = read(name, "").unwrap_err().to_string();
        assert!(error.contains(&format!("{name}: {kind} is not read here")), "{error}");
        assert!(error.contains(conversion) && error.contains("--features all-formats"), "{error}");
    }
}
