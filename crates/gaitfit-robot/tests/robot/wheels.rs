//! A policy gives velocities to the wheels of a Go2-W.

use std::sync::Arc;
use std::time::Duration;

use gaitfit_policy::{Interface, Policy};
use gaitfit_robot::guard::GuardSettings;
use gaitfit_robot::run::suits;
use gaitfit_robot::{PerMotor, Phase, Robot, Supervisor, Times};

use crate::limits::violation_of;
use crate::toy::{CONTROL, Run, interface, march, postures};

/// How fast the policy rolls the wheels, rad/s.
const ROLL: f32 = 8.0;

fn is_wheel(robot: &Robot) -> PerMotor<bool> {
    robot.each(|motor| motor.is_wheel())
}

/// An armed Go2-W whose policy rolls its wheels.
fn armed() -> Run {
    let mut run = Run::with(Robot::built_in("unitree-go2w").unwrap());
    let postures = gaitfit_robot::Postures { rolls: is_wheel(&run.robot), ..postures(&run.robot) };
    run.supervisor = Supervisor::new(GuardSettings::new(&run.robot, CONTROL), postures, Times::default());
    run.supervisor.read(run.now, &run.toy.reading());
    run.supervisor.arm(run.now).unwrap();
    run
}

/// The legs march, and the wheels roll.
fn roll(robot: &Robot, now: Duration) -> Option<PerMotor<f32>> {
    let legs = march(robot, now)?;
    let wheel = is_wheel(robot);
    Some(PerMotor::from_fn(legs.len(), |motor| if wheel[motor] { ROLL } else { legs[motor] }))
}

fn tick(run: &mut Run) {
    let robot = run.robot.clone();
    run.tick_with(Some, |now| roll(&robot, now));
    let state = run.supervisor.state().unwrap();
    assert_eq!(run.command.as_ref().and_then(|sent| violation_of(&run.robot, sent, state)), None);
}

/// Runs until `phase` ends. The largest speed of a wheel in this phase and the largest wanted by a command, rad/s.
fn through(run: &mut Run, phase: Phase) -> (f32, f32) {
    let wheel = is_wheel(&run.robot);
    let (mut fastest, mut wanted) = (0.0f32, 0.0f32);
    for _ in 0..5000 {
        tick(run);
        if run.supervisor.phase() != phase {
            return (fastest, wanted);
        }
        for motor in (0..wheel.len()).filter(|&motor| wheel[motor]) {
            fastest = fastest.max(run.toy.state.dq[motor].abs());
            wanted = wanted.max(run.command.as_ref().unwrap()[motor].dq.abs());
        }
    }
    panic!("{phase:?} does not end: {:?}", run.supervisor.reason());
}

#[test]
fn wheels_roll_in_the_walk_and_stand_still_before_and_after_it() {
    let mut run = armed();
    for phase in [Phase::StandUp, Phase::Stand] {
        let (fastest, wanted) = through(&mut run, phase);
        assert!(fastest < 0.1 && wanted == 0.0, "{phase:?}: {fastest} {wanted}");
    }
    assert_eq!(run.supervisor.phase(), Phase::Walk);
    // Five seconds at this speed are more than six turns.
    (0..2500).for_each(|_| tick(&mut run));
    let wheel = is_wheel(&run.robot);
    for motor in (0..wheel.len()).filter(|&motor| wheel[motor]) {
        let (turned, speed) = (run.toy.state.q[motor], run.toy.state.dq[motor]);
        assert!((0.8 * ROLL..=ROLL).contains(&speed) && turned > 4.0 * ROLL, "{turned} {speed}");
        let sent = &run.command.as_ref().unwrap()[motor];
        assert_eq!((sent.dq, sent.kp), (ROLL, 0.0));
    }
    run.supervisor.lie_down(run.now);
    let (_, wanted) = through(&mut run, Phase::LieDown);
    assert_eq!((wanted, run.supervisor.phase(), run.supervisor.reason()), (0.0, Phase::Damping, None));
    let speeds = run.toy.state.dq;
    assert!((0..wheel.len()).all(|motor| !wheel[motor] || speeds[motor].abs() < 0.1), "{speeds:?}");
}

#[test]
fn an_encoder_that_begins_again_at_each_turn_is_no_jump_of_a_wheel_but_one_of_a_leg() {
    let turned = |motor: usize| {
        let mut run = armed();
        (0..10).for_each(|_| tick(&mut run));
        run.toy.state.q[motor] -= std::f32::consts::TAU;
        run.tick_with(Some, |_| None);
        run.supervisor.phase()
    };
    assert_eq!(turned(12), Phase::StandUp);
    assert_eq!(turned(0), Phase::Damping);
}

#[test]
fn a_wheel_gets_velocities_or_is_braked_and_is_never_turned_to_an_angle() {
    let robot = Robot::built_in("unitree-go2w").unwrap();
    let all: Vec<usize> = (0..robot.motors.len()).collect();
    let interface = interface(&robot, &all);
    let judged = |interface: Interface| {
        let policy = Policy::of_function(interface, Arc::new(|_: usize, _: &[f32], _: &mut [f32]| true));
        suits(&policy.unwrap(), &robot).map_err(|error| error.to_string())
    };
    assert_eq!(judged(interface.clone()), Ok(()));
    // unitree_mujoco's Go2-W has the name of a Go2; a policy of a Go2 moves no wheels.
    let named_go2 = Interface { robot: "go2".to_owned(), ..interface.clone() };
    assert_eq!(judged(named_go2.clone()), Ok(()));
    let braked = Interface { velocity_joints: Vec::new(), ..named_go2 };
    assert!(judged(braked).unwrap_err().contains("is of the robot `go2`"));
    let turned = Interface { kp: vec![40.0; all.len()], velocity_joints: Vec::new(), ..interface };
    let error = judged(turned).unwrap_err();
    assert!(error.contains("kp = 40 at the wheel `FR_foot`") && error.contains("velocity_joints"), "{error}");
}
