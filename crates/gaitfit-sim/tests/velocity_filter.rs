//! Joint velocities as slow sensors read them.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_model::{ReadOptions, builtin, read_mjcf_str};
use gaitfit_physics::{Preset, Robot};
use gaitfit_sim::{Batch, BatchOptions, Cpu, Engine, Motion, Start};

const CONTROL_DT: f64 = 0.005;
const LAG: f64 = 0.012;

/// Twenty robots (more than a block of lanes) of these lags (in turn) in the air, shaken by their targets: what they show after
/// each control period, the first entry before it.
fn shown(lags: &[f64], substeps: usize, emulated_step: Option<f64>, play: f64) -> Vec<Motion> {
    let model = read_mjcf_str(builtin::GO2, &ReadOptions::default()).unwrap();
    let options = BatchOptions {
        control_dt: CONTROL_DT,
        substeps,
        preset: Preset::Fast,
        emulated_step,
        ..BatchOptions::default()
    };
    let batch = Batch::new(&model, options).unwrap();
    let robot = |number: usize| {
        let mut robot = Robot::nominal(&model);
        robot.kp.fill(30.0);
        robot.kd.fill(1.0);
        robot.play.fill(play);
        robot.velocity_lag = lags[number % lags.len()];
        robot.params(&model).unwrap()
    };
    let robots: Vec<_> = (0..20).map(robot).collect();
    let mut tile = Cpu { threads: 1 }.tile(&batch, &robots, &[]).unwrap();
    let joints = model.joints.len();
    for number in 0..robots.len() {
        let start = Start {
            base_position: [0.0, 0.0, 5.0],
            base_quaternion: [1.0, 0.0, 0.0, 0.0],
            base_linear: [0.0; 3],
            base_angular: [0.0; 3],
            joint_position: vec![0.1; joints],
            joint_velocity: vec![0.5; joints],
        };
        tile.place(number, &start);
    }
    let mut motion = batch.motion(robots.len());
    tile.observe(&mut motion);
    let mut all = vec![motion.clone()];
    for step in 0..30 {
        let target = |k: usize| 0.3 * (0.7 * step as f32 + k as f32).sin();
        let targets: Vec<f32> = (0..robots.len() * joints).map(target).collect();
        tile.step(&targets, &[], &mut motion);
        all.push(motion.clone());
    }
    all
}

fn without_readings(motion: &Motion) -> Motion {
    Motion { filtered_velocity: Vec::new(), ..motion.clone() }
}

/// With one physics step a control period every velocity is seen: readings follow from them by the filter's equation.
#[test]
fn readings_are_a_first_order_filter_of_the_velocities_and_the_motion_is_the_same() {
    for (emulated_step, play) in [(None, 0.0), (Some(0.001), 0.0), (None, 0.02)] {
        let (slow, quick) = (shown(&[LAG], 1, emulated_step, play), shown(&[0.0], 1, emulated_step, play));
        let mut reading: Vec<f64> = slow[0].joint_velocity.iter().map(|&v| f64::from(v)).collect();
        assert_eq!(slow[0].velocity_readings(), slow[0].joint_velocity, "a robot that is put somewhere");
        let mut apart = 0.0f64;
        for (slow, quick) in slow.iter().zip(&quick).skip(1) {
            assert_eq!(&without_readings(slow), quick);
            assert_eq!(quick.velocity_readings(), quick.joint_velocity);
            let share = CONTROL_DT / (LAG + CONTROL_DT);
            for ((wanted, found), velocity) in
                reading.iter_mut().zip(slow.velocity_readings()).zip(&slow.joint_velocity)
            {
                *wanted += share * (f64::from(*velocity) - *wanted);
                assert!(
                    (f64::from(*found) - *wanted).abs() < 1e-5 * wanted.abs().max(1.0),
                    "{found} {wanted}"
                );
                apart = apart.max(f64::from((found - velocity).abs()));
            }
        }
        assert!(apart > 1.0, "readings differ from the velocities by {apart} rad/s at most");
    }
}

/// Robots of one tile differ in it, and one without lag reads what it has, to the bit.
#[test]
fn lags_differ_from_robot_to_robot() {
    let (mixed, alone) = (shown(&[LAG, 0.0], 4, None, 0.0), shown(&[LAG], 4, None, 0.0));
    let joints = mixed[0].joint_velocity.len() / 20;
    for (mixed, alone) in mixed.iter().zip(&alone) {
        for number in 0..20 {
            let row = number * joints..(number + 1) * joints;
            let same = if number % 2 == 0 { alone.velocity_readings() } else { &mixed.joint_velocity[..] };
            assert_eq!(mixed.velocity_readings()[row.clone()], same[row]);
        }
    }
}

#[test]
fn a_lag_that_is_none_is_refused() {
    let model = read_mjcf_str(builtin::GO2, &ReadOptions::default()).unwrap();
    for lag in [-0.001, f64::NAN, f64::INFINITY] {
        let error = Robot { velocity_lag: lag, ..Robot::nominal(&model) }.params(&model).unwrap_err();
        assert!(error.to_string().contains("lag"), "{error}");
    }
}
