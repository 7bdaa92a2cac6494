//! Faults drawn at random, at random moments of a run: whatever happens, all that the robot was sent is inside limits.

use std::time::Duration;

use gaitfit_random::{Purpose, Stream};
use gaitfit_robot::guard::Reason;
use gaitfit_robot::{PerMotor, Phase, Reading, Robot, Seal};

use crate::limits::violation_of;
use crate::toy::{Run, go2, march};

const KINDS: u32 = 15;

/// What a fault does to one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    Killed,
    Paused(u32),
    NotFinite(usize),
    WrongChecksum,
    OtherOrder,
    SwappedLegs,
    SecondController,
    Tilt,
    Hot(usize),
    Battery,
    PolicyNotFinite(usize),
    PolicyWild(f32),
    PolicyDead,
    LoopLate(u32),
    Operator,
}

fn drawn(draws: Stream, robot: &Robot) -> Fault {
    let motor = (draws.word(1) as usize) % robot.motors.len();
    match draws.word(0) % KINDS {
        0 => Fault::Killed,
        1 => Fault::Paused(4 + draws.word(2) % 96),
        2 => Fault::NotFinite(motor),
        3 => Fault::WrongChecksum,
        4 => Fault::OtherOrder,
        5 => Fault::SwappedLegs,
        6 => Fault::SecondController,
        7 => Fault::Tilt,
        8 => Fault::Hot(motor),
        9 if robot.guard.charge.is_some() => Fault::Battery,
        9 => Fault::Killed,
        10 => Fault::PolicyNotFinite(motor),
        11 => Fault::PolicyWild((draws.uniform_f32(3) - 0.5) * 10f32.powf(20.0 * draws.uniform_f32(4))),
        12 => Fault::PolicyDead,
        13 => Fault::LoopLate(4 + draws.word(2) % 96),
        _ => Fault::Operator,
    }
}

impl Fault {
    fn heard(self, mut reading: Reading, since: Duration) -> Option<Reading> {
        let state = &mut reading.state;
        match self {
            Self::Killed => return None,
            Self::Paused(ms) if since < Duration::from_millis(ms.into()) => return None,
            Self::NotFinite(motor) => state.q[motor] = f32::NAN,
            Self::WrongChecksum => {
                // Damaged on the way, in a way that no other rule would notice.
                state.q[0] += 0.01;
                reading.seal = Seal::Wrong;
            }
            Self::OtherOrder => {
                let q = state.q;
                // All joints of a kind, leg after leg, as some programs have them.
                state.q = PerMotor::from_fn(q.len(), |k| match q.len() {
                    12 => q[3 * (k % 4) + k / 4],
                    count => q[(7 * k + 1) % count],
                });
            }
            Self::SwappedLegs => {
                (state.q, state.dq) = (swapped(&state.q), swapped(&state.dq));
            }
            Self::Tilt => state.quaternion = [0.5, 0.5, 0.5, 0.5],
            Self::Hot(motor) => state.temperature[motor] = 100,
            Self::Battery => state.battery.as_mut()?.charge = 3,
            _ => {}
        }
        Some(reading)
    }

    fn policy(self, robot: &Robot, now: Duration) -> Option<PerMotor<f32>> {
        let mut targets = march(robot, now)?;
        match self {
            Self::PolicyNotFinite(motor) => targets[motor] = f32::NAN,
            Self::PolicyWild(by) => targets.iter_mut().for_each(|angle| *angle += by),
            Self::PolicyDead => return None,
            _ => {}
        }
        Some(targets)
    }

    /// Whether `reason` is what this fault must lead to, in the phase in which it happened; `None`: the run goes on.
    fn is_answered(self, robot: &Robot, phase: Phase, reason: Option<&Reason>) -> bool {
        let walking = matches!(phase, Phase::Stand | Phase::Walk);
        match (self, reason) {
            (Self::Killed, Some(Reason::StaleState(_))) => true,
            (Self::Paused(ms), Some(Reason::StaleState(_))) => ms > 18,
            (Self::Paused(ms), None) => ms <= 22,
            (Self::NotFinite(_), Some(Reason::StateNotFinite(_))) => true,
            (Self::WrongChecksum, Some(Reason::WrongChecksum)) => true,
            (Self::OtherOrder, Some(Reason::OutOfRange { .. })) => true,
            // Joints of a humanoid that stands have nearly the same angles.
            (Self::OtherOrder, Some(Reason::Jump { .. }) | None) => robot.name != "go2",
            // Legs that are at the same angles cannot be told apart.
            (Self::SwappedLegs, Some(Reason::Jump { .. } | Reason::OutOfRange { .. }) | None) => true,
            (Self::SecondController, Some(Reason::SecondController)) => true,
            (Self::Tilt, Some(Reason::Tilt(_))) => true,
            (Self::Hot(_), Some(Reason::Hot { .. })) => true,
            (Self::Battery, Some(Reason::Battery(3))) => true,
            (Self::PolicyNotFinite(_), Some(Reason::PolicyNotFinite)) => walking,
            (Self::PolicyDead, Some(Reason::LatePolicy(_))) => walking,
            (Self::PolicyNotFinite(_) | Self::PolicyDead, None) => !walking || phase == Phase::Stand,
            (Self::PolicyWild(_), None | Some(Reason::OutOfRange { .. } | Reason::TooFast { .. })) => true,
            (Self::LoopLate(ms), Some(Reason::LateLoop(_))) => ms >= 20,
            (Self::LoopLate(ms), None) => ms < 20,
            (Self::Operator, Some(Reason::Operator)) => true,
            _ => false,
        }
    }
}

/// Left and right exchanged.
fn swapped(joints: &PerMotor<f32>) -> PerMotor<f32> {
    let legs = [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8];
    PerMotor::from_fn(joints.len(), |motor| joints[legs.get(motor).copied().unwrap_or(motor)])
}

#[test]
fn whatever_fails_a_go2_is_sent_nothing_outside_its_limits() {
    faults(&go2(), 600);
}

#[test]
#[ignore = "takes long: `.ci/run long` runs it"]
fn long_whatever_fails_the_other_robots_are_sent_nothing_outside_their_limits() {
    for name in ["unitree-go2w", "unitree-b2", "unitree-g1", "unitree-h1-2"] {
        faults(&Robot::built_in(name).unwrap(), 200);
    }
}

fn faults(robot: &Robot, count: u32) {
    let mut stopped = 0;
    let mut seen = [0; KINDS as usize];
    for number in 0..count {
        let draws = Stream::new(20, Purpose::RESET).environment(number);
        let fault = drawn(draws, robot);
        seen[(draws.word(0) % KINDS) as usize] += 1;
        let mut run = Run::armed_with(robot.clone());
        run.for_ms(u64::from(draws.word(9) % 7000));
        let (at, phase) = (run.now, run.supervisor.phase());
        match fault {
            Fault::LoopLate(ms) => run.now += Duration::from_millis(u64::from(ms) / 2 * 2),
            Fault::SecondController => run.supervisor.second_controller(at),
            Fault::Operator => run.supervisor.stop(at, Reason::Operator),
            _ => {}
        }
        let mut last = run.command.unwrap();
        for _ in 0..250 {
            let begun = run.now;
            run.tick_with(|reading| fault.heard(reading, begun - at), |now| fault.policy(robot, now));
            last = run.command.unwrap();
            // Swapped joints: the guard's state is another than the robot's until it notices.
            let unseen = fault == Fault::SwappedLegs || fault == Fault::OtherOrder && robot.name != "go2";
            if !unseen {
                let wrong = violation_of(robot, &last, &run.toy.state);
                assert_eq!(wrong, None, "{} {number}: {fault:?} in {phase:?} at {at:?}", robot.name);
            }
        }
        let reason = run.supervisor.reason();
        assert!(
            fault.is_answered(robot, phase, reason),
            "{number}: {fault:?} in {phase:?} at {at:?} led to {reason:?}"
        );
        if reason.is_some() {
            stopped += 1;
            assert!(last.iter().all(|motor| motor.kp == 0.0 && motor.tau == 0.0 && motor.dq == 0.0));
        }
        // Whatever happened, the robot has not left its range.
        if !matches!(fault, Fault::SwappedLegs | Fault::OtherOrder) || robot.name == "go2" {
            assert_eq!(violation_of(robot, &last, &run.toy.state), None, "{number}: {fault:?}");
        }
    }
    assert!(stopped > count / 3 && seen.iter().all(|&seen| seen > count / 30), "{stopped} {seen:?}");
}
