//! Joints that a policy holds and does not move.

use std::sync::Arc;

use gaitfit_policy::{Held, Interface, Policy};
use gaitfit_robot::Robot;
use gaitfit_robot::run::suits;

use crate::toy;

#[test]
fn joints_that_are_held_get_at_most_the_gains_of_the_guard() {
    let robot = Robot::built_in("unitree-g1").unwrap();
    let legs: Vec<usize> = (0..12).collect();
    let held = |kp: f64| Held { joint: "waist_yaw_joint".to_owned(), position: 0.1, kp, kd: 13.0 };
    let interface = |kp: f64| Interface { held: vec![held(kp)], ..toy::interface(&robot, &legs) };
    let postures = robot.postures(&interface(210.0)).unwrap();
    let waist = robot.motors.iter().position(|motor| motor.joint == "waist_yaw").unwrap();
    assert_eq!((postures.standing[waist], postures.kp[waist], postures.kd[waist]), (0.1, 200.0, 10.0));
    assert_eq!(robot.postures(&interface(30.0)).unwrap().kp[waist], 30.0);
    let judged = |kp: f64| {
        let act = Arc::new(|_: usize, _: &[f32], _: &mut [f32]| true);
        suits(&Policy::of_function(interface(kp), act).unwrap(), &robot)
    };
    assert_eq!(judged(210.0), Ok(()));
}
