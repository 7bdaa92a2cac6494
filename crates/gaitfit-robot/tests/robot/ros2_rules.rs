//! The guard's and the checklist's rules for states of ROS 2: no checksum, no battery, no temperatures, perhaps no stamp and no
//! torques.

use std::time::Duration;

use gaitfit_robot::guard::{Reason, Watch};
use gaitfit_robot::preflight::{Heard, Listened};
use gaitfit_robot::{Reading, Robot, Seal, Supervisor, Times};

use crate::ros2_messages::robot;
use crate::toy::{CONTROL, Toy, go2, postures};

const STEP: Duration = Duration::from_millis(2);

/// A state as ROS 2's messages make it.
fn reading(robot: &Robot, tick: u32) -> Reading {
    let mut state = Toy::lying(robot).state;
    (state.tick, state.battery) = (tick, None);
    state.temperature = robot.each(|_| 0);
    Reading { state, seal: Seal::Unused }
}

#[test]
fn states_without_checksum_stamp_and_battery_are_taken_and_a_stamp_that_stands_still_is_no_news() {
    let robot = robot();
    for (ticks, fresh) in
        [([0, 0, 0], true), ([5, 7, 9], true), ([u32::MAX - 1, 0, 2], true), ([5, 5, 5], false)]
    {
        let mut watch = Watch::new(robot.guard(CONTROL));
        for (number, tick) in (0..).zip(ticks) {
            watch.take(15 * number * STEP, &reading(&robot, tick)).unwrap();
        }
        assert_eq!(watch.fresh(30 * STEP).is_ok(), fresh, "{ticks:?}");
    }
    // What others leave out is still a fault, and so is a jump.
    let mut watch = Watch::new(robot.guard(CONTROL));
    let unsealed = Reading { seal: Seal::Absent, ..reading(&robot, 0) };
    assert_eq!(watch.take(STEP, &unsealed), Err(Reason::WrongChecksum));
    watch.take(STEP, &reading(&robot, 0)).unwrap();
    let mut far = reading(&robot, 0);
    far.state.q[1] += 1.9;
    assert!(matches!(watch.take(2 * STEP, &far), Err(Reason::Jump { .. } | Reason::OutOfRange { .. })));
}

#[test]
fn a_part_that_does_not_come_keeps_an_idle_robot_from_being_armed_and_damps_another() {
    let robot = robot();
    let mut supervisor = Supervisor::new(robot.guard(CONTROL), postures(&robot), Times::default());
    let what = "no inertial unit".to_owned();
    supervisor.lacks(STEP, what.clone());
    assert_eq!(supervisor.refused(), Some(&Reason::Lacks(what.clone())));
    assert!(supervisor.arm(STEP).is_err());
    // It came after all.
    supervisor.read(2 * STEP, &reading(&robot, 4));
    supervisor.lacks(3 * STEP, what.clone());
    supervisor.arm(3 * STEP).unwrap();
    supervisor.lacks(4 * STEP, what.clone());
    assert_eq!(supervisor.reason(), Some(&Reason::Lacks(what)));
    let command = supervisor.tick(5 * STEP).unwrap();
    assert!(command.iter().all(|motor| motor.kp == 0.0 && motor.kd > 0.0));
}

#[test]
fn zeros_of_messages_without_temperatures_and_irregular_stamps_are_no_findings() {
    let listened = |robot: &Robot, zero: bool| {
        let heard: Vec<Heard> = (0..500)
            .map(|number: u32| {
                // A computer that makes states a little irregularly: every tenth is late.
                let late = if number % 10 == 9 { 2 } else { 0 };
                let Reading { mut state, seal } = reading(robot, 1000 + 2 * number + late);
                state.torque[0] = 1e-3 * number as f32;
                if zero {
                    state.q =
                        robot.each(|motor| motor.range.map_or(0.0, |[low, high]| 0f32.clamp(low, high)));
                }
                Heard { came: number * STEP, state, seal }
            })
            .collect();
        Listened::new(&heard, 0, robot, false).1
    };
    assert_eq!(listened(&robot(), true), []);
    // Zeros of a Go2 show that a motor does not answer.
    let text = format!("{:?}", listened(&go2(), true));
    assert!(text.contains("no motor answers there") && text.contains("reports no battery"), "{text}");
}
