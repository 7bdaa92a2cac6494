//! Faults over DDS of the robots besides the Go2: joints with motors behind the robot's messages (`unitree_hg` of humanoids,
//! `unitree_go` of the others), with the rules of a real robot (checksum, counter, battery), and a run on the clock at the
//! other end.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use gaitfit_random::{Purpose, Stream};
use gaitfit_robot::guard::GuardSettings;
use gaitfit_robot::link::{Dds, Link};
use gaitfit_robot::run::real_time;
use gaitfit_robot::unitree::{LowCmd, LowState, hg};
use gaitfit_robot::{Command, MotorCommand, PerMotor, Robot, RobotState, Times, damping};
use rustdds::ReadCondition;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::dds::{alone, robot_side};
use crate::each_robot::run_guarded;
use crate::limits::violation_of;
use crate::toy::{CONTROL, TICK, Toy};

/// First of the domains that these tests use.
const DOMAIN: u16 = 131;
/// Kind of the machine that the states state.
const MACHINE: u8 = 7;
/// How long ago the state may be that a command was made for: the link's delay on a busy machine.
const RECENT: Duration = Duration::from_millis(100);

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    Killed,
    NotFinite,
    WrongChecksum,
    Hot,
    SecondController,
}

const FAULTS: [(Fault, &str); 5] = [
    (Fault::Killed, "last state is"),
    (Fault::NotFinite, "not finite"),
    (Fault::WrongChecksum, "wrong checksum"),
    (Fault::Hot, "let it cool"),
    (Fault::SecondController, "another program"),
];

/// What the robot felt.
#[derive(Debug, Default)]
struct Felt {
    commands: u64,
    /// Commands with a wrong checksum, for another machine, or with motors that the robot does not have.
    wrong: u64,
    outside: Option<String>,
    last: Option<Command>,
    faulty: bool,
}

/// A robot's kind of messages.
trait Spoken {
    type State: Serialize + std::fmt::Debug;
    type Command: DeserializeOwned + 'static;
    /// The package of the messages.
    const KIND: &'static str;
    /// The state as a robot says it; with a wrong checksum if it is `damaged`.
    fn said(state: &RobotState, damaged: bool) -> Self::State;
    /// What the first `motors` feel of a command; whether its checksum is wrong, or motors beyond them are to do something.
    fn felt(message: &Self::Command, motors: usize) -> (Command, bool);
    /// Whether a command states the robot's kind of machine.
    fn fits(message: &Self::Command) -> bool;
}

struct Humanoid;

impl Spoken for Humanoid {
    type State = hg::LowState;
    type Command = hg::LowCmd;
    const KIND: &'static str = "unitree_hg";

    fn said(state: &RobotState, damaged: bool) -> hg::LowState {
        let mut said = message(state);
        said.crc ^= u32::from(damaged);
        said
    }

    fn felt(message: &hg::LowCmd, motors: usize) -> (Command, bool) {
        let idle = |motor: &hg::MotorCmd| motor.mode == 0 && motor.kp == 0.0 && motor.kd == 0.0;
        let beyond = !message.motor_cmd.as_flattened()[motors..].iter().all(idle);
        (felt(message, motors), message.checksum() != message.crc || beyond)
    }

    fn fits(message: &hg::LowCmd) -> bool {
        message.mode_machine == MACHINE
    }
}

/// A Go2-W or a B2.
struct Quadruped;

impl Spoken for Quadruped {
    type State = LowState;
    type Command = LowCmd;
    const KIND: &'static str = "unitree_go";

    fn said(state: &RobotState, damaged: bool) -> LowState {
        let mut message = LowState { tick: state.tick, ..LowState::default() };
        for (motor, slot) in message.motor_state.iter_mut().take(state.q.len()).enumerate() {
            (slot.q, slot.dq, slot.tau_est) = (state.q[motor], state.dq[motor], state.torque[motor]);
            slot.temperature = state.temperature[motor] as u8;
        }
        let imu = &mut message.imu_state;
        (imu.quaternion, imu.gyroscope, imu.accelerometer) =
            (state.quaternion, state.gyroscope, state.accelerometer);
        (message.bms_state.soc, message.power_v) = (80, 29.0);
        let mut message = message.sealed();
        message.crc ^= u32::from(damaged);
        message
    }

    fn felt(message: &LowCmd, motors: usize) -> (Command, bool) {
        let command = PerMotor::from_fn(motors, |motor| {
            let one = &message.motor_cmd[motor];
            MotorCommand { q: one.q, dq: one.dq, tau: one.tau, kp: one.kp, kd: one.kd }
        });
        let beyond = message.motor_cmd[motors..].iter().any(|motor| motor.kp != 0.0 || motor.kd != 0.0);
        (command, message.checksum() != message.crc || beyond)
    }

    fn fits(_: &LowCmd) -> bool {
        true
    }
}

fn message(state: &RobotState) -> hg::LowState {
    let mut message = hg::LowState { tick: state.tick, mode_machine: MACHINE, ..hg::LowState::default() };
    for (motor, slot) in message.motor_state.as_flattened_mut().iter_mut().take(state.q.len()).enumerate() {
        (slot.q, slot.dq, slot.tau_est) = (state.q[motor], state.dq[motor], state.torque[motor]);
        slot.temperature = [state.temperature[motor]; 2];
    }
    let imu = &mut message.imu_state;
    (imu.quaternion, imu.gyroscope, imu.accelerometer) =
        (state.quaternion, state.gyroscope, state.accelerometer);
    message.sealed()
}

fn felt(message: &hg::LowCmd, motors: usize) -> Command {
    PerMotor::from_fn(motors, |motor| {
        let one = message.motor_cmd.as_flattened()[motor];
        MotorCommand { q: one.q, dq: one.dq, tau: one.tau, kp: one.kp, kd: one.kd }
    })
}

/// The robot's side until `done`; `fault` begins `after` the first command.
fn side<S: Spoken>(robot: &Robot, domain: u16, fault: Fault, after: Duration, done: &AtomicBool) -> Felt {
    let (_participant, states, mut commands) = robot_side::<S::State, S::Command>(domain, S::KIND);
    let (mut toy, motors) = (Toy::lying(robot), robot.motors.len());
    let (begin, mut stepped) = (Instant::now(), Duration::ZERO);
    let (mut felt, mut first, mut other) = (Felt::default(), None, None);
    let mut recent: VecDeque<(Duration, RobotState)> = VecDeque::new();
    while !done.load(Ordering::SeqCst) {
        std::thread::sleep(TICK);
        let now = begin.elapsed();
        while stepped + TICK <= now {
            stepped += TICK;
            toy.step(felt.last.as_ref());
        }
        recent.push_back((now, toy.state));
        while recent.front().is_some_and(|(came, _)| *came + RECENT < now) {
            recent.pop_front();
        }
        felt.faulty |= first.is_some_and(|first: Duration| now >= first + after);
        let mut state = toy.state;
        if felt.faulty {
            match fault {
                Fault::Killed => break,
                Fault::NotFinite => state.dq[motors - 1] = f32::NAN,
                Fault::Hot => state.temperature[3] = 130,
                Fault::SecondController => {
                    let other = other.get_or_insert_with(|| Dds::open(robot, "lo", domain, false).unwrap());
                    // Discovery takes a moment; it stops once the run damps.
                    if felt.last.is_some_and(|last| last.iter().any(|motor| motor.kp > 0.0)) {
                        other.send(&damping(&robot.each(|motor| motor.damping))).unwrap();
                    }
                }
                Fault::WrongChecksum => {}
            }
        }
        for sample in commands.take(100, ReadCondition::any()).unwrap() {
            let sample = sample.into_value();
            let (command, is_wrong) = S::felt(&sample, motors);
            first.get_or_insert(now);
            felt.commands += 1;
            let ours = other.is_none();
            felt.wrong += u64::from(is_wrong || ours && !S::fits(&sample));
            if !recent.iter().any(|(_, state)| violation_of(robot, &command, state).is_none()) {
                felt.outside = felt.outside.or(violation_of(robot, &command, &toy.state));
            }
            felt.last = Some(command);
        }
        let damaged = felt.faulty && fault == Fault::WrongChecksum;
        states.write(S::said(&state, damaged), None).unwrap();
    }
    felt
}

#[test]
fn a_humanoid_over_dds_whose_messages_fail_is_damped_inside_its_limits() {
    fail::<Humanoid>(["unitree-g1", "unitree-h1-2"]);
}

#[test]
fn another_quadruped_over_dds_whose_messages_fail_is_damped_inside_its_limits() {
    fail::<Quadruped>(["unitree-go2w", "unitree-b2"]);
}

/// Faults of every kind, five of the one robot after five of the other.
fn fail<S: Spoken>(robots: [&str; 2]) {
    let _alone = alone();
    // `GAITFIT_DDS_FAULTS` says how many; a machine that gives no real-time priority gets more time.
    let count: usize = std::env::var("GAITFIT_DDS_FAULTS").ok().and_then(|n| n.parse().ok()).unwrap_or(5);
    let patience = Duration::from_millis(if real_time() { 60 } else { 300 });
    for number in 0..count {
        let robot = Robot::built_in(robots[number / FAULTS.len() % 2]).unwrap();
        let (fault, words) = FAULTS[number % FAULTS.len()];
        let draws = Stream::new(32, Purpose::RESET).environment(number as u32);
        let after = Duration::from_millis(100 + u64::from(draws.word(0) % 2000));
        let (domain, done) = (DOMAIN + (number % 60) as u16, AtomicBool::new(false));
        let short = Duration::from_millis(500);
        let times = Times { fold: short, rise: short, settle: short / 4, damping: short, ..Times::default() };
        let guard = GuardSettings { stale: patience, late: patience, ..robot.guard(CONTROL) };
        let guard = GuardSettings { late_policy: 2 * CONTROL + patience, ..guard };
        let folder = tempfile::tempdir().unwrap();
        let (summary, felt) = std::thread::scope(|scope| {
            let side = scope.spawn(|| side::<S>(&robot, domain, fault, after, &done));
            let summary = run_guarded(&robot, domain, folder.path(), 20.0, guard, times, &mut |_| ());
            done.store(true, Ordering::SeqCst);
            (summary, side.join().unwrap())
        });
        let reason = summary.reason.clone().unwrap_or_default();
        eprintln!("{number} {} {fault:?} after {after:?}: {} commands; {reason}", robot.name, felt.commands);
        assert!(reason.contains(words), "{number} {fault:?} after {after:?}: {summary:?}");
        assert!(felt.commands > 20 && felt.wrong == 0 && felt.faulty, "{fault:?}: {felt:?}");
        assert_eq!(felt.outside, None, "{number} {fault:?} after {after:?}");
        let last = felt.last.unwrap();
        if fault != Fault::Killed {
            assert!(
                last.iter().all(|motor| motor.kp == 0.0 && motor.tau == 0.0 && motor.kd > 0.0),
                "{last:?}"
            );
        }
    }
}
