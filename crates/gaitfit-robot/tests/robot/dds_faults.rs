//! Faults over DDS: a Go2 in the project's engine behind the robot's messages, with all that a robot's own settings ask for
//! (checksum, counter, battery), and a run on the clock at the other end.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use gaitfit_random::{Purpose, Stream};
use gaitfit_robot::guard::GuardSettings;
use gaitfit_robot::link::{Dds, Link, Simulated, simulation};
use gaitfit_robot::run::{Controller, Live, Recorder, Script, Sender, Summary, live, real_time};
use gaitfit_robot::unitree::{LowCmd, LowState};
use gaitfit_robot::{
    Command, MotorCommand, PerMotor, Phase, Reading, RobotError, RobotState, Supervisor, Times, damping,
};
use rustdds::ReadCondition;

use crate::dds::{alone, robot_side};
use crate::limits::violation;
use crate::session::walk;
use crate::toy::go2;

/// First of the domains that these tests use.
const DOMAIN: u16 = 100;
/// How long ago the state may be that a command was made for: the link's delay on a busy machine.
const RECENT: Duration = Duration::from_millis(100);

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    Killed,
    Silent,
    Paused,
    NotFinite,
    WrongChecksum,
    OtherOrder,
    SecondController,
}

const FAULTS: [(Fault, &str); 7] = [
    (Fault::Killed, "last state is"),
    (Fault::Silent, "last state is"),
    (Fault::Paused, "last state is"),
    (Fault::NotFinite, "not finite"),
    (Fault::WrongChecksum, "wrong checksum"),
    (Fault::OtherOrder, "another order"),
    (Fault::SecondController, "another program"),
];

/// What the robot felt.
#[derive(Debug, Default)]
struct Felt {
    commands: u64,
    checksums: u64,
    outside: Option<String>,
    last: Option<Command>,
    fault_at: Option<Duration>,
    /// From the fault to the first command that holds nothing.
    answered: Option<Duration>,
}

fn message(state: &RobotState) -> LowState {
    let mut message = LowState { tick: state.tick, ..LowState::default() };
    for (motor, slot) in message.motor_state.iter_mut().take(12).enumerate() {
        (slot.q, slot.dq, slot.tau_est) = (state.q[motor], state.dq[motor], state.torque[motor]);
        slot.temperature = state.temperature[motor] as u8;
    }
    let imu = &mut message.imu_state;
    (imu.quaternion, imu.gyroscope, imu.accelerometer) =
        (state.quaternion, state.gyroscope, state.accelerometer);
    (message.bms_state.soc, message.power_v) = (80, 29.0);
    message.sealed()
}

fn felt(message: &LowCmd) -> Command {
    PerMotor::from_fn(12, |motor| {
        let one = &message.motor_cmd[motor];
        MotorCommand { q: one.q, dq: one.dq, tau: one.tau, kp: one.kp, kd: one.kd }
    })
}

/// The robot's side until `done`; `fault` begins `after` the first command.
fn robot(domain: u16, fault: Fault, after: Duration, pause: Duration, done: &AtomicBool) -> Felt {
    let (_participant, states, mut commands) = robot_side::<LowState, LowCmd>(domain, "unitree_go");
    let batch = simulation(&gaitfit_model::builtin::go2().unwrap()).unwrap();
    let mut body = Simulated::new(&batch, &go2()).unwrap();
    let begin = Instant::now();
    let (mut record, mut first, mut other) = (Felt::default(), None, None);
    let mut recent: VecDeque<(Duration, RobotState)> = VecDeque::new();
    while !done.load(Ordering::SeqCst) {
        std::thread::sleep(Duration::from_millis(2));
        let now = begin.elapsed();
        let mut newest = None;
        body.receive(now, &mut |_, reading: &Reading| newest = Some(reading.state)).unwrap();
        let faulty = first.is_some_and(|first: Duration| now >= first + after);
        if faulty {
            record.fault_at.get_or_insert(now);
            if fault == Fault::Killed {
                break;
            }
            let since = now - record.fault_at.unwrap();
            if fault == Fault::Paused && since < pause {
                continue;
            }
            if fault == Fault::SecondController && other.is_none() {
                other = Some(Dds::open(&go2(), "lo", domain, false).unwrap());
            }
            // Discovery takes a moment, and a moment more on a busy machine.
            if let Some(other) = other.as_mut().filter(|_| record.answered.is_none()) {
                other.send(&damping(&PerMotor::new(12, 2.0))).unwrap();
            }
        }
        for sample in commands.take(100, ReadCondition::any()).unwrap() {
            let sample = sample.into_value();
            let command = felt(&sample);
            first.get_or_insert(now);
            record.commands += 1;
            record.checksums += u64::from(sample.checksum() != sample.crc);
            let inside = recent.iter().any(|(_, state)| violation(&command, state).is_none());
            if let Some((_, state)) = recent.back().filter(|_| !inside && record.outside.is_none()) {
                record.outside = violation(&command, state);
            }
            if let Some(at) = record.fault_at
                && command.iter().all(|motor| motor.kp == 0.0)
                && fault != Fault::SecondController
            {
                record.answered.get_or_insert(now - at);
            }
            record.last = Some(command);
            body.send(&command).unwrap();
        }
        let Some(state) = newest else { continue };
        recent.push_back((now, state));
        while recent.front().is_some_and(|(came, _)| *came + RECENT < now) {
            recent.pop_front();
        }
        let mut said = message(&state);
        if faulty {
            match fault {
                Fault::Silent => continue,
                Fault::NotFinite => {
                    said.motor_state[4].dq = f32::NAN;
                    said = said.sealed();
                }
                Fault::WrongChecksum => said.crc ^= 1,
                Fault::OtherOrder => {
                    said.motor_state[..12].rotate_left(1);
                    said = said.sealed();
                }
                _ => {}
            }
        }
        states.write(said, None).unwrap();
    }
    record
}

/// A run on the clock under the committed walk, with a robot's rules but `patience`.
fn run(domain: u16, patience: Duration, real_time: bool) -> Result<Summary, RobotError> {
    let folder = tempfile::tempdir().unwrap();
    let policy = walk();
    let script = Script::new(vec![(0.0, [0.4, 0.0, 0.2]), (30.0, [0.0; 3])]).unwrap();
    let control = Duration::from_secs_f64(policy.interface.control_dt);
    let guard = GuardSettings { stale: patience, late: patience, ..GuardSettings::new(&go2(), control) };
    let late_policy = guard.late_policy.max(2 * control + patience);
    let guard = GuardSettings { late_policy, ..guard };
    let limits = guard.limits;
    let recorder = Recorder::new(folder.path(), &policy.interface, &go2()).unwrap();
    let controller = Controller::new(&go2(), &policy, &script, recorder).unwrap();
    let link = Box::new(Dds::open(&go2(), "lo", domain, false).unwrap());
    let short = Duration::from_millis(700);
    let times = Times { fold: short, rise: short, settle: short / 4, damping: short, ..Times::default() };
    let sender =
        Sender::new(link, Supervisor::new(guard, go2().postures(&policy.interface).unwrap(), times), false);
    let ask = Live {
        confirm: &mut |_| true,
        phase: &mut |_: Phase| (),
        stop: &|| None,
        control,
        real_time,
        limits,
    };
    live(sender, controller, ask)
}

#[test]
fn a_robot_over_dds_whose_messages_fail_is_damped_inside_its_limits() {
    let _alone = alone();
    // `GAITFIT_DDS_FAULTS` says how many; a machine that gives no real-time priority gets more time.
    let count: usize = std::env::var("GAITFIT_DDS_FAULTS").ok().and_then(|n| n.parse().ok()).unwrap_or(7);
    let real_time = real_time();
    let (patience, pause) = if real_time { (60, 100) } else { (300, 450) };
    let (patience, pause) = (Duration::from_millis(patience), Duration::from_millis(pause));
    for number in 0..count {
        let (fault, words) = FAULTS[number % FAULTS.len()];
        let draws = Stream::new(31, Purpose::RESET).environment(number as u32);
        let after = Duration::from_millis(100 + u64::from(draws.word(0) % 2900));
        let domain = DOMAIN + (number % 100) as u16;
        let done = AtomicBool::new(false);
        let (summary, felt) = std::thread::scope(|scope| {
            let robot = scope.spawn(|| robot(domain, fault, after, pause, &done));
            let summary = run(domain, patience, real_time);
            done.store(true, Ordering::SeqCst);
            (summary.unwrap(), robot.join().unwrap())
        });
        let reason = summary.reason.clone().unwrap_or_default();
        eprintln!(
            "{number} {fault:?} after {after:?}: {} commands, damped {:?} later",
            felt.commands, felt.answered
        );
        assert!(reason.contains(words), "{number} {fault:?} after {after:?}: {summary:?}");
        assert!(felt.commands > 20 && felt.checksums == 0 && felt.fault_at.is_some(), "{fault:?}: {felt:?}");
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
