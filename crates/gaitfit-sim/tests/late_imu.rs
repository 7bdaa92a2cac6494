//! Readings of inertial units that arrive late.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_model::{ReadOptions, builtin, read_mjcf_str};
use gaitfit_physics::{Preset, Robot};
use gaitfit_sim::{Batch, BatchOptions, Cpu, Engine, Motion, Start};

/// Physics step, s, and steps of a control period.
const STEP: f64 = 0.004;
const SUBSTEPS: usize = 5;
const PERIODS: usize = 12;
/// In physics steps.
const DELAYS: [f64; 7] = [0.0, 0.3, 1.0, 2.75, 5.0, 7.5, 10.0];

/// Robots with these delays that tumble in the air, shaken by their targets, which change every `SUBSTEPS` physics steps: what
/// they show every `substeps` physics steps, the first entry before the first one.
fn shown(delays: &[f64], substeps: usize) -> Vec<Motion> {
    let model = read_mjcf_str(builtin::GO2, &ReadOptions::default()).unwrap();
    let options = BatchOptions {
        control_dt: substeps as f64 * STEP,
        substeps,
        preset: Preset::Fast,
        ..BatchOptions::default()
    };
    let batch = Batch::new(&model, options).unwrap();
    let robot = |delay: &f64| {
        let mut robot = Robot::nominal(&model);
        robot.kp.fill(30.0);
        robot.kd.fill(1.0);
        robot.imu_delay = delay * STEP;
        robot.params(&model).unwrap()
    };
    let robots: Vec<_> = delays.iter().map(robot).collect();
    let mut tile = Cpu { threads: 1 }.tile(&batch, &robots, &[]).unwrap();
    for number in 0..robots.len() {
        let start = Start {
            base_position: [0.0, 0.0, 5.0],
            base_quaternion: [1.0, 0.0, 0.0, 0.0],
            base_linear: [0.0; 3],
            base_angular: [1.0, -2.0, 0.5],
            joint_position: vec![0.1; 12],
            joint_velocity: vec![0.5; 12],
        };
        tile.place(number, &start);
    }
    let mut motion = batch.motion(robots.len());
    tile.observe(&mut motion);
    let mut all = vec![motion.clone()];
    for step in 0..PERIODS * SUBSTEPS / substeps {
        let period = (step * substeps / SUBSTEPS) as f32;
        let target = |k: usize| 0.5 * (0.7 * period + (k % 12) as f32).sin();
        let targets: Vec<f32> = (0..robots.len() * 12).map(target).collect();
        tile.step(&targets, &[], &mut motion);
        all.push(motion.clone());
    }
    all
}

/// The reading is the true one of the moment that lies the delay back, between physics steps on the straight line.
#[test]
fn a_late_unit_reads_what_was() {
    // The same robot, seen after each physics step.
    let truth: Vec<[f64; 7]> = shown(&[0.0], 1)
        .iter()
        .map(|motion| {
            assert!(motion.late_imu.is_none(), "a unit that is not late remembers nothing");
            let (attitude, rates) = motion.imu_reading(0);
            std::array::from_fn(|k| f64::from(if k < 4 { attitude[k] } else { rates[k - 4] }))
        })
        .collect();
    let late = shown(&DELAYS, SUBSTEPS);
    let mut largest = 0.0f64;
    for (period, motion) in late.iter().enumerate() {
        for (robot, delay) in DELAYS.iter().enumerate() {
            // Before the first step it stood in its first state for long.
            let moment = ((period * SUBSTEPS) as f64 - delay).max(0.0);
            let (before, part) = (moment as usize, moment.fract());
            let after = truth[(before + 1).min(truth.len() - 1)];
            let mut want: [f64; 7] =
                std::array::from_fn(|k| truth[before][k] + part * (after[k] - truth[before][k]));
            let length = want[..4].iter().map(|x| x * x).sum::<f64>().sqrt();
            want[..4].iter_mut().for_each(|x| *x /= length);
            let (attitude, rates) = motion.imu_reading(robot);
            for (read, want) in attitude.iter().chain(&rates).zip(want) {
                assert!(
                    (f64::from(*read) - want).abs() < 2e-5,
                    "period {period}, {delay}: {read} and {want}"
                );
            }
            let now = truth[period * SUBSTEPS];
            largest =
                rates.iter().zip(&now[4..]).fold(largest, |all, (a, b)| all.max((f64::from(*a) - b).abs()));
            // The motion does not depend on it.
            let place = 3 * robot..3 * robot + 3;
            assert_eq!(motion.base_position[place.clone()], motion.base_position[..3], "{delay}");
            assert_eq!(motion.base_angular[place], motion.base_angular[..3], "{delay}");
        }
    }
    assert!(largest > 1.0, "the rates change much within the delay: {largest} rad/s");
}

#[test]
fn a_unit_later_than_two_control_periods_is_refused() {
    let model = read_mjcf_str(builtin::GO2, &ReadOptions::default()).unwrap();
    let options = BatchOptions { control_dt: 0.02, substeps: 5, ..BatchOptions::default() };
    let batch = Batch::new(&model, options).unwrap();
    let tile = |imu_delay: f64| {
        let robot = Robot { imu_delay, ..Robot::nominal(&model) }.params(&model)?;
        Cpu { threads: 1 }.tile(&batch, &[robot], &[]).map(drop)
    };
    tile(0.04).unwrap();
    let error = tile(0.041).unwrap_err().to_string();
    assert!(error.contains("imu_delay") && error.contains("two control periods"), "{error}");
    assert!(tile(-0.001).unwrap_err().to_string().contains("imu_delay"));
}
