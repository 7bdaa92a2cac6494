//! ROS 2's messages against bytes of CycloneDDS (`tools/make_ros2_fixtures.py` made them), and states made of them.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use cdr_encoding::{from_bytes, to_vec};
use gaitfit_robot::ros::{
    DynamicJointState, Float64MultiArray, Header, Imu, JointState, MAX_ITEMS, Quaternion, Stamp, States,
    Taken, Vector3,
};
use gaitfit_robot::{Reading, Robot, Seal};

type Little = byteorder::LittleEndian;

const JOINT_STATE: &[u8] = include_bytes!("../fixtures/ros2_joint_state.cdr");
const IMU: &[u8] = include_bytes!("../fixtures/ros2_imu.cdr");
const DYNAMIC: &[u8] = include_bytes!("../fixtures/ros2_dynamic.cdr");
const ARRAY: &[u8] = include_bytes!("../fixtures/ros2_array.cdr");

const PATIENCE: Duration = Duration::from_millis(20);

/// A robot of two joints, one of which has another name in messages.
pub const FILE: &str = r#"
name = "biped"
title = "toy biped"
policies = ["biped"]
messages = "ros2"
guard = { tilt = 60, kp = 100, kd = 5 }
motors = [
  { joint = "hip", range = [-1.0, 1.0], speed = 30, torque = 24, kp = 50, kd = 2, damping = 2, lying = 0.1 },
  { joint = "knee", topic_name = "lower_leg", range = [-2.5, -0.5], speed = 30, torque = 24, kp = 50, kd = 2, damping = 2, lying = -1.5 },
]
"#;

pub fn robot() -> Robot {
    Robot::parse(FILE, "biped.toml").unwrap()
}

#[test]
fn messages_are_those_of_another_dds_byte_for_byte() {
    let counted =
        |from: usize, count: usize| (from..from + count).map(|n| n as f64 / 8.0).collect::<Vec<_>>();
    let stamp = Stamp { sec: 1_700_000_000, nanosec: 123_456_789 };
    let (state, used) = from_bytes::<JointState, Little>(JOINT_STATE).unwrap();
    assert_eq!((used, state.header.stamp), (JOINT_STATE.len(), stamp));
    assert_eq!(state.name, ["hip", "lower_leg"]);
    assert_eq!((state.position, state.velocity, state.effort), (counted(1, 2), counted(3, 2), Vec::new()));
    let (imu, used) = from_bytes::<Imu, Little>(IMU).unwrap();
    assert_eq!((used, imu.header.stamp), (IMU.len(), stamp));
    assert_eq!(imu.orientation, Quaternion { x: 0.125, y: 0.25, z: 0.375, w: 0.5 });
    assert_eq!(imu.orientation_covariance[8], 13.0 / 8.0);
    assert_eq!(imu.angular_velocity, Vector3 { x: 14.0 / 8.0, y: 15.0 / 8.0, z: 2.0 });
    assert_eq!(imu.linear_acceleration.z, 28.0 / 8.0);
    let (dynamic, used) = from_bytes::<DynamicJointState, Little>(DYNAMIC).unwrap();
    assert_eq!((used, &dynamic.joint_names[1]), (DYNAMIC.len(), &"lower_leg".to_owned()));
    assert_eq!(dynamic.interface_values[1].values, counted(6, 5));
    assert_eq!(dynamic.interface_values[1].interface_names[3], "stiffness");
    assert_eq!(to_vec::<_, Little>(&dynamic).unwrap(), DYNAMIC);
    let (array, used) = from_bytes::<Float64MultiArray, Little>(ARRAY).unwrap();
    assert_eq!((used, array.layout.dim[0].label.as_str()), (ARRAY.len(), "joints × interfaces"));
    assert_eq!(array.data, counted(1, 10));
    assert_eq!(to_vec::<_, Little>(&array).unwrap(), ARRAY);
    for bytes in [JOINT_STATE, IMU, DYNAMIC, ARRAY] {
        for length in 0..bytes.len() {
            let cut = &bytes[..length];
            let read = [
                from_bytes::<JointState, Little>(cut).is_ok() && bytes == JOINT_STATE,
                from_bytes::<Imu, Little>(cut).is_ok() && bytes == IMU,
                from_bytes::<DynamicJointState, Little>(cut).is_ok() && bytes == DYNAMIC,
                from_bytes::<Float64MultiArray, Little>(cut).is_ok() && bytes == ARRAY,
            ];
            assert_eq!(read, [false; 4], "{length}");
        }
    }
}

#[test]
fn the_file_of_the_documentation_is_read() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let page = std::fs::read_to_string(root.join("docs/robot-link.md")).unwrap();
    let section = page.split("## A robot that speaks ROS 2").nth(1).unwrap();
    let file = section.split("```").nth(1).unwrap().strip_prefix("toml").unwrap();
    let robot = Robot::parse(file, "robot-link.md").unwrap();
    assert_eq!((robot.motors.len(), robot.ros2().unwrap().imu.name), (4, "/imu/data".to_owned()));
}

#[test]
#[ignore = "needs cyclonedds in .venv"]
fn python_the_ros2_fixtures_are_what_cyclonedds_writes() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let Some(python) = crate::messages::python_with(&root, "cyclonedds") else { return };
    let run =
        Command::new(python).arg(root.join("tools/make_ros2_fixtures.py")).arg("--check").output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
}

#[test]
fn long_names_and_long_sequences_are_refused_before_they_are_kept() {
    let read = |state: &JointState| {
        from_bytes::<JointState, Little>(&to_vec::<_, Little>(state).unwrap())
            .map(|_| ())
            .map_err(|error| error.to_string())
    };
    let fits = JointState { name: vec!["j".repeat(64); MAX_ITEMS], ..JointState::default() };
    assert_eq!(read(&fits), Ok(()));
    let long = JointState { name: vec!["j".repeat(65)], ..JointState::default() };
    assert!(read(&long).unwrap_err().contains("65 bytes"));
    let many = JointState { position: vec![0.0; MAX_ITEMS + 1], ..JointState::default() };
    assert!(read(&many).unwrap_err().contains("more than 256"));
    // A length that no message has takes no memory.
    let mut bytes = to_vec::<_, Little>(&JointState::default()).unwrap();
    for at in (0..bytes.len()).step_by(4) {
        let kept = bytes.clone();
        bytes[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
        let _ = from_bytes::<JointState, Little>(&bytes);
        bytes = kept;
    }
}

fn level(ms: u32) -> Imu {
    let stamp = Stamp { sec: 0, nanosec: 1_000_000 * ms };
    Imu {
        header: Header { stamp, ..Header::default() },
        orientation: Quaternion { x: 0.1, y: 0.2, z: 0.3, w: 0.9 },
        angular_velocity: Vector3 { x: 1.0, y: 2.0, z: 3.0 },
        linear_acceleration: Vector3 { x: 0.5, y: 0.0, z: 9.81 },
        ..Imu::default()
    }
}

fn joints(names: &[&str]) -> JointState {
    let each = |scale: f64| (1..=names.len()).map(|k| scale * k as f64).collect::<Vec<f64>>();
    JointState {
        header: Header { stamp: Stamp { sec: 5_000_000, nanosec: 7_900_000 }, ..Header::default() },
        name: names.iter().map(|&name| name.to_owned()).collect(),
        position: each(0.1),
        velocity: each(1.0),
        effort: each(10.0),
    }
}

fn states() -> (States, Instant) {
    let robot = robot();
    (States::new(&robot, &robot.ros2().unwrap()), Instant::now())
}

fn reading(taken: Result<Taken, String>) -> Reading {
    match taken {
        Ok(Taken::Reading(reading)) => *reading,
        other => panic!("{other:?}"),
    }
}

fn lacks(taken: Result<Taken, String>) -> String {
    match taken {
        Ok(Taken::Lacks(what)) => what,
        other => panic!("{other:?}"),
    }
}

#[test]
fn joints_are_found_by_name_in_any_order_among_others() {
    let (mut states, now) = states();
    assert_eq!(states.names(), ["hip", "lower_leg"]);
    assert_eq!(lacks(states.imu(now, &level(1))), "no joint states: nothing on /joint_states");
    let read = reading(states.joints(now, &joints(&["finger", "lower_leg", "hip_joint"]), PATIENCE));
    let state = &read.state;
    assert_eq!((read.seal, state.battery, state.tick), (Seal::Unused, None, 5_000_000_007u64 as u32));
    assert_eq!(state.q[..], [3.0, 2.0].map(|k| (0.1 * k) as f32));
    assert_eq!((&state.dq[..], &state.torque[..]), (&[3.0, 2.0][..], &[30.0, 20.0][..]));
    assert_eq!(state.quaternion, [0.9, 0.1, 0.2, 0.3]);
    assert_eq!((state.gyroscope, state.accelerometer), ([1.0, 2.0, 3.0], [0.5, 0.0, 9.81]));
    // Commands have the names that the robot uses.
    assert_eq!(states.names(), ["hip_joint", "lower_leg"]);
    let mut message = joints(&["hip", "lower_leg"]);
    message.effort.clear();
    message.header.stamp = Stamp::default();
    message.position[1] = f64::NAN;
    let state = reading(states.joints(now, &message, PATIENCE)).state;
    assert_eq!((&state.torque[..], state.tick, state.q[0]), (&[0.0, 0.0][..], 0, 0.1));
    assert!(state.q[1].is_nan(), "the guard sees it");
    assert_eq!(states.names(), ["hip", "lower_leg"]);
}

#[test]
fn an_inertial_unit_that_is_silent_or_stands_still_leaves_no_state() {
    let (mut states, now) = states();
    let message = joints(&["hip", "lower_leg"]);
    let at = |ms| now + Duration::from_millis(ms);
    assert_eq!(lacks(states.joints(now, &message, PATIENCE)), "no inertial unit: nothing on /imu/data");
    assert_eq!(states.imu(now, &level(1)), Ok(Taken::Nothing));
    reading(states.joints(at(20), &message, PATIENCE));
    // The same stamp again is no news.
    assert_eq!(states.imu(at(20), &level(1)), Ok(Taken::Nothing));
    let what = lacks(states.joints(at(21), &message, PATIENCE));
    assert_eq!(what, "no inertial unit: nothing on /imu/data for 21 ms");
    states.imu(at(22), &level(2)).unwrap();
    reading(states.joints(at(23), &message, PATIENCE));
    let mut blind = level(3);
    blind.orientation_covariance[0] = -1.0;
    let error = states.imu(at(24), &blind).unwrap_err();
    assert!(error.contains("does not measure orientation") && error.contains("imu_topic"), "{error}");
}

#[test]
fn a_message_that_lacks_a_motor_is_an_error_with_the_names_that_it_has() {
    let (mut states, now) = states();
    states.imu(now, &level(1)).unwrap();
    for (names, words) in [
        (&["hip", "foot"][..], &["lacks the joint `lower_leg`", "it has hip, foot", "topic_name"][..]),
        (&["hip", "lower_leg", "hip_joint"], &["has more than once the joint `hip`"]),
        (&["lower_leg_joint", "hip"], &["lacks the joint `lower_leg`"]),
    ] {
        let error = states.joints(now, &joints(names), PATIENCE).unwrap_err();
        assert!(words.iter().all(|words| error.contains(words)), "{error}");
    }
    let what = lacks(states.joints(now, &joints(&["finger", "thumb"]), PATIENCE));
    assert_eq!(what, "no motor of the robot on /joint_states; its messages have finger, thumb");
    // A first message without names has no motor either, and makes no state without joints.
    let what = lacks(states.joints(now, &joints(&[]), PATIENCE));
    assert_eq!(what, "no motor of the robot on /joint_states; its messages have no names");
    // Another program may publish other joints on the topic.
    reading(states.joints(now, &joints(&["hip", "lower_leg"]), PATIENCE));
    assert_eq!(states.joints(now, &joints(&["finger", "thumb"]), PATIENCE), Ok(Taken::Nothing));
    let mut still = joints(&["hip", "lower_leg"]);
    still.velocity.clear();
    let error = states.joints(now, &still, PATIENCE).unwrap_err();
    assert!(error.contains("2 names and 0 numbers of `velocity`"), "{error}");
}
