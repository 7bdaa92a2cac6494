//! Gains of robots whose messages state newer angles than those by which the motors' controllers computed the torques.

use std::time::Duration;

use gaitfit_random::{Purpose, Stream};
use gaitfit_robot::link::Link;
use gaitfit_robot::preflight::{Check, Finding, Flight, JointMotion, Severity, fly, moved, sampled};
use gaitfit_robot::{Command, PerMotor, Reading, Robot, RobotState, Seal};

use super::bench::{Given, NOISE};
use crate::toy::Toy;

/// Inertia of a joint, kg·m², and its viscous friction, N·m·s/rad, where the motor has a Go2's hip's torque, as on the vendor's
/// simulator server.
const HEAVY: [f32; 2] = [0.04, 0.3];
/// Dry friction of a real one, N·m.
const DRY: f32 = 0.2;
/// The torque of such a motor, N·m.
const TORQUE: f32 = 23.7;
/// Physics steps in a millisecond.
const STEPS: u64 = 4;

/// How it differs from a robot that reports all at once.
#[derive(Clone, Copy, Debug)]
struct Kind {
    /// Time between two looks of the motors' controllers, and between two messages, ms.
    period: u64,
    /// How much newer the state in a message is than its torques, ms.
    newer: u64,
    /// Inertia and friction of its joints, in parts of those on the server.
    weight: f32,
    /// A motor with wrong gains: its number, and the factor from the commanded gains to its own.
    gains: Option<(usize, f32)>,
    /// Whether it has the noise and the dry friction of a real robot.
    noisy: bool,
}

const SERVER: Kind = Kind { period: 5, newer: 5, weight: 1.0, gains: None, noisy: false };

/// A robot that hangs, without gravity.
struct Aged {
    robot: Robot,
    kind: Kind,
    state: RobotState,
    command: Option<Command>,
    /// Torques since the controllers' last look, N·m.
    torque: PerMotor<f32>,
    noise: Stream,
    now: u64,
}

impl Aged {
    fn new(robot: &Robot, kind: Kind, seed: u64) -> Self {
        let noise = Stream::new(seed, Purpose::OBSERVATION_NOISE);
        let (state, torque) = (Toy::lying(robot).state, robot.each(|_| 0.0));
        Self { robot: robot.clone(), kind, state, command: None, torque, noise, now: 0 }
    }

    /// Simulates a millisecond. The motors' controllers look at its beginning, if it is their turn.
    fn step(&mut self) {
        let Kind { period, gains, weight, .. } = self.kind;
        let state = &mut self.state;
        if let Some(command) = self.command.filter(|_| self.now.is_multiple_of(period)) {
            for (motor, slot) in command.iter().enumerate() {
                let factor = gains.filter(|(one, _)| *one == motor).map_or(1.0, |(_, factor)| factor);
                self.torque[motor] = factor * slot.torque(state.q[motor], state.dq[motor]);
            }
        }
        let dt = 1e-3 / STEPS as f32;
        for motor in (0..state.q.len()).flat_map(|motor| std::iter::repeat_n(motor, STEPS as usize)) {
            let of_motor = weight * self.robot.motors[motor].torque / TORQUE;
            let [inertia, friction] = HEAVY.map(|one| one * of_motor);
            let dry = if self.kind.noisy { DRY * (state.dq[motor] / 0.01).tanh() } else { 0.0 };
            state.dq[motor] += dt * (self.torque[motor] - friction * state.dq[motor] - dry) / inertia;
            state.q[motor] += dt * state.dq[motor];
        }
        self.now += 1;
        state.tick += 1;
    }

    fn reading(&mut self) -> Reading {
        let mut state = RobotState { torque: self.torque, ..self.state };
        let draws = self.noise.step(self.now as u32);
        for motor in (0..state.q.len()).filter(|_| self.kind.noisy) {
            let draw = |of: usize| NOISE[of] * draws.normal(3 * motor as u32 + of as u32) as f32;
            state.q[motor] += draw(0);
            state.dq[motor] += draw(1);
            state.torque[motor] += draw(2);
        }
        Reading { state, seal: Seal::Right }
    }
}

impl Link for Aged {
    fn receive(&mut self, now: Duration, each: &mut dyn FnMut(Duration, &Reading)) -> Result<u64, String> {
        let due = now.as_millis() as u64;
        while self.now < due {
            self.step();
            let Kind { period, newer, .. } = self.kind;
            // A state that is a whole message newer is that of just before the next look.
            if self.now % period == newer % period {
                each(Duration::from_millis(due - self.now), &self.reading());
            }
        }
        Ok(0)
    }

    fn send(&mut self, command: &Command) -> Result<(), String> {
        self.command = Some(*command);
        Ok(())
    }
}

/// What moving a Go2-W of this kind shows: its joints, and what is wrong with gains.
fn moved_one(kind: Kind, seed: u64) -> (Vec<JointMotion>, Vec<Finding>) {
    let robot = Robot::built_in("unitree-go2w").unwrap();
    let flight = Flight::new(&robot, robot.guard(Duration::from_millis(2)));
    let mut link = Aged::new(&robot, kind, seed);
    let flown = fly(&mut link, &mut Given::default(), flight, &mut |_| {}, &|| None).unwrap();
    let (motion, mut findings) = moved(&flown, &sampled(&flown), &robot, None);
    assert_eq!(motion.reason, None, "{kind:?}");
    findings.retain(|one| one.check == Check::Gains);
    (motion.joints, findings)
}

/// Whether the gain `truth` of a joint is possible, to 1 %.
fn is_possible(one: &JointMotion, truth: f64) -> bool {
    one.torque_gain.is_some_and(|[low, high]| (low - 0.01..=high + 0.01).contains(&truth))
}

#[test]
fn a_state_that_is_newer_than_its_torque_is_no_wrong_gain() {
    for kind in [
        // As on the vendor's server; a light joint; as a real robot.
        SERVER,
        Kind { weight: 0.5, ..SERVER },
        Kind { newer: 2, weight: 0.5, ..SERVER },
        Kind { period: 2, newer: 2, weight: 0.5, noisy: true, ..SERVER },
    ] {
        let (joints, findings) = moved_one(kind, 1);
        assert!(findings.is_empty(), "{kind:?}: {findings:?}");
        assert_eq!(joints.len(), 12);
        assert!(joints.iter().all(|one| is_possible(one, 1.0)), "{kind:?}: {joints:?}");
    }
}

#[test]
fn a_wrong_gain_is_found_although_the_state_is_newer() {
    for kind in [
        Kind { gains: Some((2, 0.7)), ..SERVER },
        Kind { gains: Some((2, 1.3)), ..SERVER },
        Kind { gains: Some((5, 0.7)), weight: 0.5, ..SERVER },
        Kind { period: 2, newer: 1, gains: Some((5, 1.3)), noisy: true, ..SERVER },
        Kind { period: 2, newer: 2, gains: Some((5, 0.3)), noisy: true, ..SERVER },
    ] {
        let (motor, truth) = kind.gains.unwrap();
        let (joints, findings) = moved_one(kind, 1);
        let at = if motor == 2 { "FR_calf" } else { "FL_calf" };
        let named: Vec<_> = findings.iter().map(|one| (one.joint.as_deref(), one.severity)).collect();
        let severity = if truth < 0.5 { Severity::Fault } else { Severity::Warning };
        assert_eq!(named, [(Some(at), severity)], "{kind:?}: {findings:?}");
        let one = joints.iter().find(|one| one.joint == at).unwrap();
        assert!(is_possible(one, f64::from(truth)), "{kind:?}: {one:?}");
    }
}

#[test]
fn the_delay_of_a_torque_comes_out_although_the_state_is_newer() {
    let (joints, _) = moved_one(Kind { period: 2, newer: 2, ..SERVER }, 1);
    for one in joints {
        // A command waits for the next look, and its torque for the message at the end of that.
        let delay = one.torque_delay.unwrap();
        assert!((delay.value - 0.001).abs() < 0.0005 && delay.error < 0.001, "{} {delay:?}", one.joint);
    }
}

#[test]
#[ignore = "takes minutes: 60 robots"]
fn long_gains_of_robots_with_states_of_all_ages() {
    let (mut robots, mut missed) = (0, [0, 0]);
    for noisy in [false, true] {
        for (period, newer) in [(2, 1), (2, 2), (5, 1), (5, 2), (5, 5)] {
            for weight in [1.0, 0.5] {
                let sound = Kind { period, newer, weight, noisy, gains: None };
                let (joints, findings) = moved_one(sound, 1);
                assert!(findings.is_empty(), "{sound:?}: {findings:?}");
                assert!(joints.iter().all(|one| is_possible(one, 1.0)), "{sound:?}: {joints:?}");
                for (number, truth) in [0.7, 1.3].into_iter().enumerate() {
                    let kind = Kind { gains: Some((2, truth)), ..sound };
                    let (joints, findings) = moved_one(kind, 1);
                    let of_calf = findings.iter().filter(|one| one.joint.as_deref() == Some("FR_calf"));
                    assert_eq!(of_calf.clone().count(), findings.len(), "{kind:?}: {findings:?}");
                    let one = joints.iter().find(|one| one.joint == "FR_calf").unwrap();
                    println!("{kind:?}: {:.2?}, {} found", one.torque_gain, findings.len());
                    assert!(is_possible(one, f64::from(truth)), "{kind:?}: {one:?}");
                    missed[number] += usize::from(findings.is_empty());
                }
                robots += 3;
            }
        }
    }
    println!("{robots} robots; of 0.7 times the gain {} are missed, of 1.3 {}", missed[0], missed[1]);
    assert_eq!(missed[0], 0);
}
