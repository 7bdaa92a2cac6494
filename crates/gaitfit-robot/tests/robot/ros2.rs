//! A robot that speaks ROS 2, over DDS on the loopback interface: its joints follow their motors, and a run on the clock is at
//! the other end.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Stdio;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use gaitfit_log::{ReadOptions, read_csv};
use gaitfit_robot::guard::GuardSettings;
use gaitfit_robot::link::{Dds, Link};
use gaitfit_robot::robot::CommandType;
use gaitfit_robot::ros::{
    DynamicJointState, Float64MultiArray, Header, Imu, JointState, Quaternion, Stamp, Vector3,
};
use gaitfit_robot::run::{Summary, WALK, real_time};
use gaitfit_robot::{Command, MotorCommand, PerMotor, Phase, Robot, RobotState, Times, damping};
use rustdds::no_key::{DataReaderCdr, DataWriterCdr};
use rustdds::policy::{History, Reliability};
use rustdds::{DomainParticipant, DomainParticipantBuilder, QosPolicyBuilder, ReadCondition, TopicKind};

use crate::dds::alone;
use crate::each_robot::run_guarded;
use crate::ros2_messages::{FILE, robot};
use crate::toy::{CONTROL, TICK, Toy};

/// First of the domains that these tests use.
const DOMAIN: u16 = 201;

/// What goes wrong, a while after the first command.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    Nothing,
    ImuStops,
    JointVanishes,
}

/// What the robot felt.
#[derive(Debug, Default)]
struct Felt {
    commands: u64,
    last: Option<Command>,
    /// Names of the joints in its commands.
    names: Vec<String>,
}

enum Commands {
    Dynamic(DataReaderCdr<DynamicJointState>),
    Array(DataReaderCdr<Float64MultiArray>),
}

struct Side {
    states: DataWriterCdr<JointState>,
    imu: DataWriterCdr<Imu>,
    commands: Commands,
    _participant: DomainParticipant,
}

impl Side {
    fn new(domain: u16, kind: CommandType) -> Self {
        let loopback: std::net::IpAddr = std::net::Ipv4Addr::LOCALHOST.into();
        let participant =
            DomainParticipantBuilder::new(domain).with_only_networks([loopback]).build().unwrap();
        let reliable = Reliability::Reliable { max_blocking_time: rustdds::Duration::from_millis(100) };
        let qos =
            QosPolicyBuilder::new().reliability(reliable).history(History::KeepLast { depth: 16 }).build();
        let topic = |name: &str, kind: &str| {
            participant.create_topic(name.to_owned(), kind.to_owned(), &qos, TopicKind::NoKey).unwrap()
        };
        let publisher = participant.create_publisher(&qos).unwrap();
        let subscriber = participant.create_subscriber(&qos).unwrap();
        let states = topic("rt/joint_states", "sensor_msgs::msg::dds_::JointState_");
        let imu = topic("rt/imu/data", "sensor_msgs::msg::dds_::Imu_");
        let command = |kind| topic("rt/joint_commands", kind);
        Self {
            states: publisher.create_datawriter_no_key_cdr(&states, Some(qos.clone())).unwrap(),
            imu: publisher.create_datawriter_no_key_cdr(&imu, Some(qos.clone())).unwrap(),
            commands: match kind {
                CommandType::DynamicJointState => {
                    let topic = command("control_msgs::msg::dds_::DynamicJointState_");
                    Commands::Dynamic(
                        subscriber.create_datareader_no_key_cdr(&topic, Some(qos.clone())).unwrap(),
                    )
                }
                CommandType::Float64MultiArray => {
                    let topic = command("std_msgs::msg::dds_::Float64MultiArray_");
                    Commands::Array(
                        subscriber.create_datareader_no_key_cdr(&topic, Some(qos.clone())).unwrap(),
                    )
                }
            },
            _participant: participant,
        }
    }

    /// A message of the joints in another order than the robot's file, with one more.
    fn say(&self, state: &RobotState, stamp: Stamp, lacks: bool) {
        let header = Header { stamp, ..Header::default() };
        let row = |values: &[f32]| [values[1], 0.5, values[0]].map(f64::from).to_vec();
        let hip = if lacks { "hip_left" } else { "hip_joint" };
        let message = JointState {
            header,
            name: ["lower_leg", "finger", hip].map(str::to_owned).into(),
            position: row(&state.q),
            velocity: row(&state.dq),
            effort: row(&state.torque),
        };
        self.states.write(message, None).unwrap();
    }

    fn level(&self, stamp: Stamp) {
        let message = Imu {
            header: Header { stamp, ..Header::default() },
            orientation: Quaternion { w: 1.0, ..Quaternion::default() },
            linear_acceleration: Vector3 { z: 9.81, ..Vector3::default() },
            ..Imu::default()
        };
        self.imu.write(message, None).unwrap();
    }

    fn take(&mut self, felt: &mut Felt) {
        let motor = |values: &[f64], order: [usize; 5]| {
            let [q, dq, tau, kp, kd] = order.map(|at| values[at] as f32);
            MotorCommand { q, dq, tau, kp, kd }
        };
        match &mut self.commands {
            Commands::Dynamic(reader) => {
                for sample in reader.take(100, ReadCondition::any()).unwrap() {
                    let message = sample.into_value();
                    felt.names = message.joint_names;
                    felt.commands += 1;
                    let values = |k: usize| motor(&message.interface_values[k].values, [0, 1, 2, 3, 4]);
                    felt.last = Some(PerMotor::from_fn(2, values));
                }
            }
            Commands::Array(reader) => {
                for sample in reader.take(100, ReadCondition::any()).unwrap() {
                    let data = sample.into_value().data;
                    felt.commands += 1;
                    // As the file of the test states it: gains, then the targets.
                    felt.last = Some(PerMotor::from_fn(2, |k| motor(&data[5 * k..], [2, 3, 4, 0, 1])));
                }
            }
        }
    }
}

/// The robot's side until `done`.
fn side(robot: &Robot, domain: u16, fault: Fault, done: &AtomicBool) -> Felt {
    let mut side = Side::new(domain, robot.command_type.unwrap_or_default());
    let (mut toy, begin, mut stepped) = (Toy::lying(robot), Instant::now(), Duration::ZERO);
    let (mut felt, mut first) = (Felt::default(), None);
    while !done.load(Ordering::SeqCst) {
        std::thread::sleep(TICK);
        let now = begin.elapsed();
        while stepped + TICK <= now {
            stepped += TICK;
            toy.step(felt.last.as_ref());
        }
        let stamp = Stamp { sec: 100 + now.as_secs() as i32, nanosec: now.subsec_nanos() };
        let is_faulty = first.is_some_and(|first: Duration| now > first + Duration::from_secs(2));
        if !(is_faulty && fault == Fault::ImuStops) {
            side.level(stamp);
        }
        side.say(&toy.state, stamp, is_faulty && fault == Fault::JointVanishes);
        side.take(&mut felt);
        if felt.commands > 0 {
            first.get_or_insert(now);
        }
    }
    felt
}

/// Short phases before and after the walk.
fn quick() -> Times {
    let short = Duration::from_millis(400);
    Times { fold: short, rise: short, settle: short / 4, lie_down: short, damping: short, ..Times::default() }
}

/// A run of two seconds on the robot, with what it ends with.
fn run(robot: &Robot, domain: u16, fault: Fault) -> (Summary, Felt, Vec<Phase>, usize) {
    let patience = Duration::from_millis(if real_time() { 60 } else { 300 });
    let guard = GuardSettings { stale: patience, late: patience, ..robot.guard(CONTROL) };
    let guard = GuardSettings { late_policy: 2 * CONTROL + patience, ..guard };
    let (done, folder) = (AtomicBool::new(false), tempfile::tempdir().unwrap());
    let mut phases = Vec::new();
    let (summary, felt) = std::thread::scope(|scope| {
        let side = scope.spawn(|| side(robot, domain, fault, &done));
        let seconds = if fault == Fault::Nothing { 1.5 } else { 20.0 };
        let summary = run_guarded(robot, domain, folder.path(), seconds, guard, quick(), &mut |phase| {
            phases.push(phase)
        });
        // The last command is on its way.
        std::thread::sleep(Duration::from_millis(100));
        done.store(true, Ordering::SeqCst);
        (summary, side.join().unwrap())
    });
    let log = read_csv(&folder.path().join(WALK), &ReadOptions::default()).unwrap();
    assert_eq!((log.robot.as_deref(), log.joints.len()), (Some("biped"), 2));
    (summary, felt, phases, log.len())
}

/// Whether a command resists motion and holds nothing.
fn damps(command: &Command) -> bool {
    command.iter().all(|motor| motor.kp == 0.0 && motor.tau == 0.0 && motor.kd > 0.0)
}

/// Its file with commands without names, gains first.
fn with_order() -> String {
    let keys = r#"command_type = "std_msgs/msg/Float64MultiArray"
command_order = ["stiffness", "damping", "position", "velocity", "effort"]
guard"#;
    FILE.replacen("guard", keys, 1)
}

fn without_names() -> Robot {
    Robot::parse(&with_order(), "biped.toml").unwrap()
}

#[test]
fn a_robot_that_speaks_ros_2_stands_up_walks_and_is_damped() {
    let _alone = alone();
    for (number, robot) in [robot(), without_names()].iter().enumerate() {
        let (summary, felt, phases, rows) = run(robot, DOMAIN + number as u16, Fault::Nothing);
        assert_eq!(summary.reason, None, "{summary:?}");
        use Phase::{Damping, LieDown, Stand, StandUp, Stop, Walk};
        assert_eq!(phases, [StandUp, Stand, Walk, Stop, LieDown, Damping]);
        assert!(rows > 60 && felt.commands > summary.commands / 2, "{rows} {felt:?} {summary:?}");
        assert!(felt.last.as_ref().is_some_and(damps), "{felt:?}");
        if number == 0 {
            assert_eq!(felt.names, ["hip_joint", "lower_leg"], "the names that the robot uses");
        }
    }
}

#[test]
fn a_robot_whose_inertial_unit_stops_is_damped_with_the_reason() {
    let _alone = alone();
    let (summary, felt, ..) = run(&robot(), DOMAIN + 2, Fault::ImuStops);
    let reason = summary.reason.unwrap_or_default();
    assert!(reason.contains("no inertial unit: nothing on /imu/data for"), "{reason}");
    assert!(felt.last.as_ref().is_some_and(damps), "{felt:?}");
}

#[test]
fn a_robot_that_no_longer_reports_a_joint_is_damped_with_its_name() {
    let _alone = alone();
    let (summary, felt, ..) = run(&robot(), DOMAIN + 3, Fault::JointVanishes);
    let reason = summary.reason.unwrap_or_default();
    assert!(reason.contains("lacks the joint `hip`; it has lower_leg, finger, hip_left"), "{reason}");
    assert!(felt.last.as_ref().is_some_and(damps), "{felt:?}");
}

#[test]
fn another_program_on_the_command_topic_is_seen_and_a_silent_link_says_what_is_missing() {
    let _alone = alone();
    let robot = robot();
    let domain = DOMAIN + 4;
    let side = Side::new(domain, CommandType::DynamicJointState);
    let mut link = Dds::open(&robot, "lo", domain, true).unwrap();
    let other = Dds::open(&robot, "lo", domain, false);
    let mut other = other.unwrap();
    let (begin, mut seen) = (Instant::now(), 0);
    let toy = Toy::lying(&robot);
    while seen == 0 || link.lacks().is_none() {
        side.say(&toy.state, Stamp::default(), false);
        other.send(&damping(&PerMotor::new(2, 2.0))).unwrap();
        seen +=
            link.receive(begin.elapsed(), &mut |_, _| panic!("a state without an inertial unit")).unwrap();
        std::thread::sleep(TICK);
        assert!(begin.elapsed() < Duration::from_secs(30), "{seen} {:?}", link.lacks());
    }
    assert_eq!(link.lacks().unwrap(), "no inertial unit: nothing on /imu/data");
}

#[test]
#[ignore = "needs cyclonedds in .venv"]
fn python_a_robot_behind_another_dds_is_walked_and_damped() {
    let _alone = alone();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let Some(python) = crate::messages::python_with(&root, "cyclonedds") else { return };
    let array = without_names();
    for (number, (robot, file)) in [(robot(), FILE.to_owned()), (array, with_order())].iter().enumerate() {
        let (domain, folder) = (DOMAIN + 5 + number as u16, tempfile::tempdir().unwrap());
        let path = folder.path().join("biped.toml");
        std::fs::write(&path, file).unwrap();
        let mut child = std::process::Command::new(&python)
            .arg(root.join("tools/ros2_follower.py"))
            .arg(&path)
            .args(["--domain", &domain.to_string()])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
        assert!(lines.next().unwrap().contains("ready"));
        let patience = Duration::from_millis(400);
        let guard = GuardSettings { stale: patience, late: patience, ..robot.guard(CONTROL) };
        let guard = GuardSettings { late_policy: patience, ..guard };
        let mut last = None;
        let summary =
            run_guarded(robot, domain, folder.path(), 1.5, guard, quick(), &mut |phase| last = Some(phase));
        drop(child.stdin.take());
        let felt: serde_json::Value = serde_json::from_str(&lines.next().unwrap()).unwrap();
        child.wait().unwrap();
        eprintln!("{} of {} commands taken, {felt}", felt["commands"], summary.commands);
        assert_eq!((summary.reason, last), (None, Some(Phase::Damping)));
        assert!(felt["commands"].as_f64().unwrap() > 0.8 * summary.commands as f64);
        assert_eq!(
            (felt["stiffness"].as_f64(), felt["last"][0]["stiffness"].as_f64()),
            (Some(50.0), Some(0.0))
        );
        assert!(felt["last"][0]["damping"].as_f64().unwrap() > 0.0);
    }
}
