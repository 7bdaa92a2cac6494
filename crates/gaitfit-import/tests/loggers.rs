//! What real loggers write: gains of every sample, gravity vectors, observations, zeros of a second publisher.
#![allow(clippy::unwrap_used)]

use gaitfit_import::{ImportError, Imported, Mapping, ObservedNumber, Options, import};
use gaitfit_log::{FindingKind, Severity};
use std::fmt::Write;

/// Imports a CSV file of 200 rows at 100 Hz with `columns` beside `timestamp`, and their values of each row and time.
fn csv(
    columns: &str,
    values: impl Fn(usize, f64) -> Vec<f64>,
    mapping: Mapping,
) -> Result<Imported, ImportError> {
    let mut text = format!("timestamp,{columns}\n");
    for i in 0..200 {
        let t = i as f64 / 100.0;
        let _ = write!(text, "{t}");
        values(i, t).iter().for_each(|value| text.push_str(&format!(",{value}")));
        text.push('\n');
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording.csv");
    std::fs::write(&path, text).unwrap();
    import(&[&path], &Options { mapping, ..Options::default() })
}

fn joints() -> Mapping {
    Mapping { joints: Some(vec!["a".into(), "b".into()]), ..Mapping::default() }
}

fn wave(t: f64) -> f64 {
    0.4 * (7.3 * t).sin() + 0.1
}

#[test]
fn gains_of_each_sample_are_the_logs_and_a_change_forbids() {
    let columns = "actual_q_0,actual_q_1,actual_dq_0,actual_dq_1,target_q_0,target_q_1,kp_0,kp_1,kd_0,kd_1";
    let row = |kp: f64| {
        move |t: f64| {
            vec![wave(t), wave(t + 1.0), 0.0, 0.0, wave(t + 0.03), wave(t + 1.03), kp, 2.0 * kp, 0.5, 1.0]
        }
    };
    let imported = csv(columns, |_, t| row(20.0)(t), joints()).unwrap();
    let gains = imported.trajectory.gains.unwrap();
    assert_eq!((gains.kp, gains.kd), (vec![20.0, 40.0], vec![0.5, 1.0]));
    assert_eq!(imported.report.noticed, []);
    assert!(imported.report.assumed.iter().any(|line| line == "joints 0 to 1 are, in this order, a, b"));

    let change = |i: usize, t: f64| row(if i < 120 { 20.0 } else { 60.0 })(t);
    let imported = csv(columns, change, joints()).unwrap();
    let finding = &imported.report.noticed[0];
    assert_eq!((finding.kind, finding.severity), (FindingKind::GainsChange, Severity::Error));
    assert!(finding.message.contains("kp of a changes from 20 to 60 at 1.2 s"), "{finding}");
    let mapping = Mapping { allow: vec![FindingKind::GainsChange], ..joints() };
    assert_eq!(csv(columns, change, mapping).unwrap().report.noticed[0].severity, Severity::Warning);
}

#[test]
fn gravity_rates_and_commands_by_usual_names() {
    let columns = "q_0,q_1,gravity_ori_x,gravity_ori_y,gravity_ori_z,ang_vel_0,ang_vel_1,ang_vel_2,vel_cmd_x,vel_cmd_y,vel_cmd_yaw";
    let row = |_: usize, t: f64| vec![wave(t), wave(t + 1.0), 0.1, 0.0, -0.995, 0.0, 0.0, 0.2, 0.5, 0.0, 0.2];
    let log = csv(columns, row, joints()).unwrap().trajectory;
    assert_eq!(log.command.unwrap()[..3], [0.5, 0.0, 0.2]);
    let base = log.base.unwrap();
    assert_eq!(base.angular_velocity.unwrap()[..3], [0.0, 0.0, 0.2]);
    // Pitch asin(0.1), heading 0.
    let quaternion = base.quaternion.unwrap();
    assert!((quaternion[2] - (0.5 * 0.1f64.asin()).sin()).abs() < 1e-3, "{:?}", &quaternion[..4]);
}

#[test]
fn what_a_covariance_of_minus_one_says_is_not_measured_is_left_out() {
    let columns = "q_0,q_1,/imu/orientation_covariance[0;0],/imu/orientation/x,/imu/orientation/y,/imu/orientation/z,\
                   /imu/orientation/w,/imu/angular_velocity/x,/imu/angular_velocity/y,/imu/angular_velocity/z";
    let read = |covariance: f64| {
        let row = move |_: usize, t: f64| {
            vec![wave(t), wave(t + 1.0), covariance, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.2]
        };
        csv(columns, row, joints()).unwrap()
    };
    let base = |covariance: f64| read(covariance).trajectory.base.unwrap();
    assert!(base(0.0).quaternion.is_some() && base(-1.0).quaternion.is_none());
    assert_eq!(base(-1.0).angular_velocity.unwrap()[..3], [0.0, 0.0, 0.2]);
    let left_out = read(-1.0).report.left_out;
    assert!(left_out.iter().any(|line| line.starts_with("/imu/orientation: not measured")), "{left_out:?}");
}

#[test]
fn observations_are_unpacked_by_the_policys_interface() {
    let part =
        |column: &str, scale: f64, offset: f64| Some(ObservedNumber { column: column.into(), scale, offset });
    let known = vec![
        part("wx", 0.25, 0.0),
        part("q_a", 1.0, 0.3),
        part("q_b", 1.0, -0.2),
        part("dq_a", 0.05, 0.0),
        None,
    ];
    let columns = "obs_0,obs_1,obs_2,obs_3,obs_4,action_0,action_1";
    let row = |_: usize, t: f64| vec![0.25 * 2.0, wave(t) - 0.3, wave(t) + 0.2, 0.05 * 3.0, 9.0, 1.0, t];
    let mapping = Mapping { observation: Some(known.clone()), ..joints() };
    let log = csv(columns, row, mapping).unwrap().trajectory;
    assert_eq!(log.joints, ["a", "b"]);
    for (q, t) in log.position.chunks_exact(2).zip(&log.time) {
        assert!((q[0] - wave(*t)).abs() < 1e-12 && (q[1] - wave(*t)).abs() < 1e-12);
    }
    assert_eq!(log.action.unwrap()[..2], [1.0, 0.0]);
    // Another policy's observation has another length; without a policy the remedy is named.
    let mapping = Mapping { observation: Some(known[..4].to_vec()), ..joints() };
    let error = csv(columns, row, mapping).unwrap_err().to_string();
    assert!(error.contains("5 numbers") && error.contains("observes 4"), "{error}");
    let error = csv(columns, row, joints()).unwrap_err().to_string();
    assert!(error.contains("5 numbers of an observation") && error.contains("--policy"), "{error}");
}

#[test]
fn zeros_of_a_second_publisher_are_refused_or_left_out() {
    let row = |i: usize, t: f64| if i % 5 == 3 { vec![0.0; 2] } else { vec![wave(t), wave(t + 1.0)] };
    let error = csv("q_0,q_1", row, joints()).unwrap_err();
    assert!(matches!(&error, ImportError::TwoPublishers { zero: 40, samples: 200, .. }), "{error}");
    assert!(error.to_string().contains("(after 0.03, 0.08, 0.13, … s)"), "{error}");
    let mut mapping = joints();
    mapping.streams.drop_zeros = true;
    let imported = csv("q_0,q_1", row, mapping).unwrap();
    assert_eq!(imported.trajectory.len(), 160);
    assert!(imported.trajectory.position.chunks_exact(2).all(|q| q != [0.0, 0.0]));
    assert!(imported.report.assumed.iter().any(|line| line.contains("40 of 200 samples")));
    // A robot that rests at 0 is no second publisher.
    assert_eq!(csv("q_0,q_1", |_, _| vec![0.0; 2], joints()).unwrap().trajectory.len(), 200);
}

#[test]
fn desired_velocities_and_torques_of_motors_become_targets() {
    let columns = "q_0,q_1,q_des_0,q_des_1,dq_des_0,dq_des_1,tau_ff_0,tau_ff_1,kp_0,kp_1,kd_0,kd_1";
    let row =
        |_: usize, t: f64| vec![wave(t), wave(t), wave(t), 0.5, 0.8, 0.0, 0.0, 3.0, 20.0, 30.0, 2.0, 1.0];
    let imported = csv(columns, row, joints()).unwrap();
    let target = imported.trajectory.target.unwrap();
    assert!((target[0] - (wave(0.0) + 2.0 * 0.8 / 20.0)).abs() < 1e-12 && (target[1] - 0.6).abs() < 1e-12);
    assert_eq!(imported.report.noticed[0].kind, FindingKind::FeedForward);
}

#[test]
fn all_joints_without_positions_are_named() {
    let mapping =
        Mapping { joints: Some(["a", "b", "c", "d"].map(str::to_owned).to_vec()), ..Mapping::default() };
    let error = csv("q_0,q_3,dq_3", |_, t| vec![wave(t), wave(t), 0.0], mapping).unwrap_err().to_string();
    assert!(error.contains("joint 1, b; joint 2, c"), "{error}");
}

#[test]
fn a_damaged_cell_of_a_needed_column_is_named_by_line_and_others_are_left_out() {
    let import_text = |text: String| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("damaged.csv");
        std::fs::write(&path, text).unwrap();
        let mapping = "[time]\ncolumn = \"stamp\"\n[columns]\nposition = \"angle_{joint}\"\nvelocity = \"speed_{joint}\"\n";
        let options = Options { mapping: Mapping::parse(mapping).unwrap(), ..Options::default() };
        import(&[path], &options)
    };
    let rows = |end: &str, damaged: &str, mode: &str| {
        let row = |row: u32| {
            let t = f64::from(row) / 100.0;
            let angle = if row == 47 { damaged.to_owned() } else { format!("{:.4}", wave(t)) };
            let mode = if row == 9 { mode.to_owned() } else { "1".to_owned() };
            format!("{t};{angle};{:.4};{mode}{end}", wave(t))
        };
        format!("stamp;angle_hip;speed_hip;mode{end}") + &(0..100).map(row).collect::<String>()
    };
    for end in ["\n", "\r\n"] {
        let error = import_text(rows(end, "x1", "1")).unwrap_err().to_string();
        assert!(error.contains("line 49, column `angle_hip`: `x1` is not a number"), "{error}");
        let imported = import_text(rows(end, "0.1", "auto")).unwrap();
        assert_eq!(imported.trajectory.len(), 100);
        let left_out = imported.report.left_out.join("\n");
        assert!(left_out.contains("mode: `auto` in line 11 is not a number"), "{left_out}");
    }
}

#[test]
fn a_time_that_jumps_back_far_is_damaged() {
    let row = |_: usize, t: f64| vec![wave(t), wave(t), wave(t), wave(t)];
    let columns = "q_0,q_1,qdes_0,qdes_1";
    let text = format!("timestamp,{columns}\n");
    let written = |back: f64| {
        let mut text = text.clone();
        for i in 0..200 {
            let t = i as f64 / 100.0;
            let stamp = if i == 150 { t - back } else { t };
            let cells: Vec<String> = row(i, t).iter().map(f64::to_string).collect();
            let _ = writeln!(text, "{stamp},{}", cells.join(","));
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("recording.csv");
        std::fs::write(&path, text).unwrap();
        import(&[&path], &Options { mapping: joints(), ..Options::default() })
    };
    assert_eq!(written(0.025).unwrap().trajectory.len(), 200, "late on its way");
    let error = written(1.3).unwrap_err().to_string();
    assert!(error.contains("sample 151 is at 0.200 s, after one at 1.490 s"), "{error}");
}

#[test]
fn a_recording_states_gains_and_steps_as_a_log_does_and_a_mapping_renames_its_joints() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.csv");
    let mut text =
        "# kp = { \"*\" = 40, \"FR_*\" = 60 }\n# kd = 1\n# a remark = of mine\nstamp;p_VR1;p_VL1\n"
            .to_owned();
    for i in 0..100 {
        let t = f64::from(i) / 100.0;
        let _ = writeln!(text, "{t};{};{}", wave(t), -wave(t));
    }
    std::fs::write(&path, &text).unwrap();
    std::fs::write(folder.path().join("mine.toml"), "[columns]\nposition = \"p_{joint}\"\n").unwrap();
    std::fs::write(folder.path().join("log.toml"), "kd = 2\nsimulated_step_s = 0.001\n").unwrap();
    let mapping = "[time]\ncolumn = \"stamp\"\n[columns]\nposition = \"p_{joint}\"\n[joint_names]\nVR1 = \"FR_hip\"\nVL1 = \"FL_hip\"\n";
    let options = Options { mapping: Mapping::parse(mapping).unwrap(), ..Options::default() };
    let log = import(&[&path], &options).unwrap().trajectory;
    assert_eq!(log.joints, ["FR_hip", "FL_hip"]);
    let gains = log.gains.unwrap();
    assert_eq!((gains.kp, gains.kd, log.simulated_step), (vec![60.0, 40.0], vec![1.0; 2], Some(0.001)));
    // Editors of Windows put a mark of the encoding before the first line.
    std::fs::write(&path, format!("\u{feff}{text}")).unwrap();
    assert_eq!(import(&[&path], &options).unwrap().trajectory.gains.unwrap().kp, [60.0, 40.0]);
    let stronger = format!("kp = 7\nkd = 0.3\n{mapping}");
    let options = Options { mapping: Mapping::parse(&stronger).unwrap(), ..Options::default() };
    let imported = import(&[&path], &options).unwrap();
    assert_eq!(imported.trajectory.gains.unwrap().kp, [7.0, 7.0]);
    let said = imported.report.assumed.join("\n");
    assert!(said.contains("kp of FR_hip is 7, as the mapping states, not 60 as "), "{said}");
    std::fs::write(folder.path().join("log.toml"), "kq = 2\n").unwrap();
    let error = import(&[&path], &options).unwrap_err().to_string();
    assert!(error.contains("log.toml") && error.contains("kq"), "{error}");
}

#[test]
fn what_a_mapping_names_in_vain_is_refused_or_said_and_slides_are_not_in_degrees() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("two.csv");
    let mut text = "time_s,q_turn,dq_turn,q_slide,dq_slide\n".to_owned();
    (0..100).for_each(|i| text.push_str(&format!("{},{i},100,{i},100\n", f64::from(i) / 100.0)));
    std::fs::write(&path, text).unwrap();
    let read = |mapping: &str, slides: Option<&str>| {
        let slides = slides.map(|slide| vec![slide.to_owned()]);
        let mapping = Mapping { slides, ..Mapping::parse(mapping).unwrap() };
        import(&[&path], &Options { mapping, ..Options::default() })
    };
    let error = read("[columns]\ntarget = 'nope_{joint}'\n", None).unwrap_err().to_string();
    assert!(error.contains("no column fits `nope_{joint}`") && error.contains("q_turn"), "{error}");
    let left_out = read("joints = ['a', 'b']\n[joint_names]\nx = 'y'\n", None).unwrap().report.left_out;
    let left_out = left_out.join("\n");
    assert!(left_out.contains("[joint_names] `x`") && left_out.contains("numbers no joints"), "{left_out}");
    let degrees = read("unit = 'deg'\n", Some("slide_joint")).unwrap();
    assert_eq!(degrees.trajectory.position[2..4], [1f64.to_radians(), 1.0]);
    let unknown = read("unit = 'deg'\n", None).unwrap();
    assert_eq!(unknown.trajectory.position[2..4], [1f64.to_radians(); 2]);
    assert!(unknown.report.assumed.iter().any(|line| line.contains("all joints are hinges")));
}

#[test]
fn renamed_joints_keep_their_gains_and_what_motors_were_given() {
    let quantities = ["q", "dq", "qdes", "kp", "kd", "dqdes", "tauff"];
    let columns: Vec<String> = quantities.iter().map(|name| format!("{name}_VR1")).collect();
    let mapping = Mapping::parse("[joint_names]\nVR1 = \"FR_hip\"\n").unwrap();
    let row = |_: usize, t: f64| vec![wave(t), 0.0, wave(t), 20.0, 1.0, 2.0, 4.0];
    let log = csv(&columns.join(","), row, mapping).unwrap().trajectory;
    let gains = log.gains.unwrap();
    assert_eq!((log.joints, gains.kp, gains.kd), (vec!["FR_hip".to_owned()], vec![20.0], vec![1.0]));
    // (1 · 2 + 4) / 20 rad further.
    assert!((log.target.unwrap()[3] - log.position[3] - 0.3).abs() < 1e-9);
}

#[test]
fn a_bag_of_very_many_files_is_not_read_in_part() {
    let folder = tempfile::tempdir().unwrap();
    (0..1001).for_each(|i| std::fs::write(folder.path().join(format!("bag_{i}.mcap")), "").unwrap());
    let error = import(&[folder.path()], &Options::default()).unwrap_err().to_string();
    assert!(error.contains("more than 1000 files"), "{error}");
}
