//! Tiles of floating robots: they move as the same robot alone in double precision, do not see each other, and are
//! saved whole.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use std::path::Path;

use gaitfit_model::kinematics::{Frame, body_frames, standing_height};
use gaitfit_model::{Model, ReadOptions, read};
use gaitfit_physics::in_f64::step;
use gaitfit_physics::{Drive, Isa, Params, Preset, Robot, Settings, State, Work, compile};
use gaitfit_sim::{Batch, BatchOptions, Cpu, Engine, Motion, SimError, Start};

#[path = "batch/emulated.rs"]
mod emulated;

/// What the tests simulate on.
const CPU: Cpu = Cpu { threads: 1 };

const CONTROL_DT: f64 = 0.02;
const SUBSTEPS: usize = 4;
const TIMESTEP: f64 = CONTROL_DT / SUBSTEPS as f64;
const FEET: [&str; 4] = ["FL_foot", "FR_foot", "RL_foot", "RR_foot"];
const POSE: [f64; 3] = [0.0, 0.9, -1.6];

fn go2() -> Model {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/go2.xml");
    read(&path, &ReadOptions::default()).unwrap()
}

/// Numbers without a pattern, in ±1, the same every time.
fn draw(index: usize) -> f64 {
    let word = (index as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let word = (word ^ (word >> 31)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    (word >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// Robots that differ in everything a tile lets them differ in.
fn robots(model: &Model, count: usize) -> Vec<Robot> {
    let joints = model.joints.len();
    (0..count)
        .map(|index| {
            let vary = |j: usize, middle: f64, half: f64| middle + half * draw(1000 * index + j);
            let each = |from: usize, middle: f64, half: f64| -> Vec<f64> {
                (0..joints).map(|j| vary(from + j, middle, half)).collect()
            };
            Robot {
                kp: each(0, 30.0, 5.0),
                kd: each(20, 0.7, 0.2),
                armature: each(40, 0.03, 0.02),
                damping: each(60, 0.2, 0.1),
                frictionloss: each(80, 0.15, 0.1),
                delay: each(100, 0.01, 0.01),
                encoder_bias: each(120, 0.0, 0.02),
                torque_scale: each(140, 1.0, 0.1),
                torque_offset: each(160, 0.0, 0.5),
                stiffness: each(220, 5.0, 5.0),
                spring_torque: each(240, 0.0, 1.0),
                torque_limit: each(180, 8.0, 2.0),
                base_mass: vary(200, 1.0, 1.0),
                base_com: std::array::from_fn(|k| vary(201 + k, 0.0, 0.02)),
                friction_scale: vary(204, 1.0, 0.4),
                ..Robot::nominal(model)
            }
        })
        .collect()
}

fn params(model: &Model, robots: &[Robot]) -> Vec<Params<f64>> {
    robots.iter().map(|robot| robot.params(model).unwrap()).collect()
}

/// On the ground, moving a little.
fn start(model: &Model, index: usize) -> Start {
    let joints = model.joints.len();
    let pose: Vec<f64> = (0..joints).map(|j| POSE[j % 3] + 0.1 * draw(7000 + 50 * index + j)).collect();
    let (sin, cos) = (0.5 * draw(7900 + index)).sin_cos();
    let quaternion = [cos, 0.0, 0.0, sin];
    let height = standing_height(model, quaternion, &pose) + 0.001;
    Start {
        base_position: [0.1 * index as f32, -0.2, height as f32],
        base_quaternion: quaternion.map(|x| x as f32),
        base_linear: [0.2, -0.1, -0.1],
        base_angular: [0.1, 0.2, -0.3],
        joint_position: pose.iter().map(|&x| x as f32).collect(),
        joint_velocity: (0..joints).map(|j| 0.5 * draw(7500 + 50 * index + j) as f32).collect(),
    }
}

/// Target of joint `j` of robot `index` in `period`.
fn target(index: usize, period: usize, j: usize) -> f32 {
    (POSE[j % 3] + 0.25 * draw(20_000 + 997 * index + 31 * period + j)) as f32
}

fn targets(of: impl Iterator<Item = usize>, period: usize) -> Vec<f32> {
    of.flat_map(|index| (0..12).map(move |j| target(index, period, j))).collect()
}

/// Disturbance of joint `j` of robot `index` in physics step `substep`, N·m.
fn disturbance(index: usize, substep: usize, j: usize) -> f32 {
    (2.0 * draw(50_000 + 991 * index + 37 * substep + j)) as f32
}

fn disturbances(of: &[usize], period: usize) -> Vec<f32> {
    (0..SUBSTEPS)
        .flat_map(|s| of.iter().map(move |&index| (index, period * SUBSTEPS + s)))
        .flat_map(|(index, substep)| (0..12).map(move |j| disturbance(index, substep, j)))
        .collect()
}

fn options() -> BatchOptions {
    BatchOptions {
        control_dt: CONTROL_DT,
        substeps: SUBSTEPS,
        max_delay: 0.02,
        tracked: FEET.map(str::to_owned).to_vec(),
        ..BatchOptions::default()
    }
}

fn isas() -> Vec<Isa> {
    [Isa::Avx512, Isa::Avx2, Isa::Portable].into_iter().filter(|isa| isa.available()).collect()
}

/// Motion after each of `periods` of the robots numbered `of`, in one tile, one row of numbers a robot.
fn run(batch: &Batch, params: &[Params<f64>], of: &[usize], periods: usize) -> Vec<Vec<Vec<f32>>> {
    let chosen: Vec<Params<f64>> = of.iter().map(|&index| params[index].clone()).collect();
    let mut tile = CPU.tile(batch, &chosen, &[]).unwrap();
    let mut motion = batch.motion(of.len());
    for (place, &index) in of.iter().enumerate() {
        tile.place(place, &start(batch.model(), index));
    }
    (0..periods)
        .map(|period| {
            tile.step(&targets(of.iter().copied(), period), &disturbances(of, period), &mut motion);
            (0..of.len()).map(|place| row(&motion, place, of.len())).collect()
        })
        .collect()
}

/// Everything that one robot shows.
fn row(motion: &Motion, place: usize, count: usize) -> Vec<f32> {
    let arrays = [
        &motion.base_position,
        &motion.base_quaternion,
        &motion.base_linear,
        &motion.base_angular,
        &motion.joint_position,
        &motion.joint_velocity,
        &motion.joint_acceleration,
        &motion.torque,
        &motion.normal_force,
        &motion.tracked,
    ];
    let part = |values: &Vec<f32>| {
        let width = values.len() / count;
        values[place * width..(place + 1) * width].to_vec()
    };
    arrays.into_iter().flat_map(part).collect()
}

fn bits(row: &[f32]) -> Vec<u32> {
    row.iter().map(|x| x.to_bits()).collect()
}

/// Largest difference, absolute for numbers below 1 and relative above; NaN counts as infinite.
fn difference(found: &[f32], wanted: &[f64]) -> f64 {
    assert_eq!(found.len(), wanted.len());
    let errors = found.iter().zip(wanted).map(|(&found, wanted)| {
        let error = (f64::from(found) - wanted).abs() / wanted.abs().max(1.0);
        if error.is_nan() { f64::INFINITY } else { error }
    });
    errors.fold(0.0, f64::max)
}

/// PD torque as the drive's documentation states it; the delay is at most one control period.
fn torque(robot: &Robot, j: usize, now: f64, before: f64, substep: usize, q: f64, qd: f64) -> f64 {
    // Share of the physics step in which the newer target is in force.
    let newer = (substep as f64 + 1.0 - robot.delay[j] / TIMESTEP).clamp(0.0, 1.0);
    let target = newer * now + (1.0 - newer) * before;
    let pd = robot.kp[j] * (target - (q + robot.encoder_bias[j])) - robot.kd[j] * qd;
    let limit = robot.torque_limit[j];
    (robot.torque_scale[j] * pd + robot.torque_offset[j]).clamp(-limit, limit)
}

/// What is held against double precision, and how far single precision may be off (absolute below 1 SI unit and
/// relative above) over six control periods on the ground under 2 N·m of disturbance: about three times what was
/// measured with AVX-512.
const QUANTITIES: [(&str, f64); 8] = [
    ("position", 3e-5),
    ("quaternion", 2e-4),
    ("velocity", 1e-3),
    ("angular velocity", 1e-2),
    ("joint position", 1e-3),
    ("joint velocity", 2e-2),
    ("normal force", 6e-2),
    ("tracked geom", 3e-4),
];

#[test]
fn robots_of_a_tile_move_as_each_alone_in_double_precision() {
    let model = go2();
    let (count, periods) = (5, 6);
    let robots = robots(&model, count);
    let params = params(&model, &robots);
    let preset = Preset::Converged;
    let settings = Settings { timestep: TIMESTEP, ..Settings::new(&model.options, preset) };
    assert!(!settings.centred, "the torque above is not centred");
    let tree = compile::<f64>(&model, &settings).unwrap();
    let batch = Batch::new(&model, BatchOptions { preset, ..options() }).unwrap();
    let mut tile = CPU.tile(&batch, &params, &[]).unwrap();
    let mut motion = batch.motion(count);
    let mut states = Vec::new();
    for index in 0..count {
        let start = start(&model, index);
        tile.place(index, &start);
        states.push(State {
            base_position: start.base_position.map(f64::from),
            base_quaternion: start.base_quaternion.map(f64::from),
            base_linear: start.base_linear.map(f64::from),
            base_angular: start.base_angular.map(f64::from),
            qpos: start.joint_position.iter().map(|&x| f64::from(x)).collect(),
            qvel: start.joint_velocity.iter().map(|&x| f64::from(x)).collect(),
            ..State::new(&tree)
        });
    }
    let mut work = Work::new(&tree);
    let (mut saturated, mut touching) = (0, 0);
    let mut worst = [0.0f64; QUANTITIES.len()];
    let all: Vec<usize> = (0..count).collect();
    let geoms = batch.contact_geoms().len();
    for period in 0..periods {
        tile.step(&targets(0..count, period), &disturbances(&all, period), &mut motion);
        for (index, state) in states.iter_mut().enumerate() {
            let robot = &robots[index];
            let mut frames = Vec::new();
            for substep in 0..SUBSTEPS {
                let drive = |j: usize| {
                    let sent = |period: usize| f64::from(target(index, period, j));
                    let before = sent(period.saturating_sub(1));
                    let motor = torque(robot, j, sent(period), before, substep, state.qpos[j], state.qvel[j]);
                    let other = f64::from(disturbance(index, period * SUBSTEPS + substep, j));
                    (motor, Drive { torque: motor + other, ..Drive::zero() })
                };
                let (motors, drives): (Vec<f64>, Vec<_>) = (0..12).map(drive).unzip();
                saturated += motors
                    .iter()
                    .zip(&robot.torque_limit)
                    .filter(|(motor, limit)| motor.abs() == **limit)
                    .count();
                let base = Frame { position: state.base_position, quaternion: state.base_quaternion };
                frames = body_frames(&model, &base, &state.qpos);
                step(&tree, &params[index], &drives, state, &mut work);
            }
            let read: Vec<f64> =
                state.qpos.iter().zip(&robot.encoder_bias).map(|(q, bias)| q + bias).collect();
            let forces: Vec<f64> = (0..geoms).map(|pair| work.normal_force(&tree, pair)).collect();
            touching += forces.iter().filter(|&&force| force > 1.0).count();
            // Tracked geoms stand where the bodies were at the start of the last physics step.
            let foot = |name: &str| {
                let geom = model.geoms.iter().find(|geom| geom.name == name).unwrap();
                frames[geom.body].point(geom.pos)
            };
            let feet: Vec<f64> = FEET.iter().flat_map(|name| foot(name)).collect();
            let of = |values: &[f32]| {
                let width = values.len() / count;
                values[index * width..(index + 1) * width].to_vec()
            };
            let errors = [
                difference(&of(&motion.base_position), &state.base_position),
                difference(&of(&motion.base_quaternion), &state.base_quaternion),
                difference(&of(&motion.base_linear), &state.base_linear),
                difference(&of(&motion.base_angular), &state.base_angular),
                difference(&of(&motion.joint_position), &read),
                difference(&of(&motion.joint_velocity), &state.qvel),
                difference(&of(&motion.normal_force), &forces),
                difference(&of(&motion.tracked), &feet),
            ];
            for (worst, error) in worst.iter_mut().zip(errors) {
                *worst = worst.max(error);
            }
        }
    }
    assert!(
        saturated > 0 && touching > 4 * count,
        "{saturated} saturated torques, {touching} touching geoms"
    );
    for ((name, tolerance), error) in QUANTITIES.iter().zip(worst) {
        assert!(error <= *tolerance, "{name} is off by {error:e} at worst; all: {worst:?}");
    }
}

#[test]
fn neighbours_lanes_and_tile_sizes_change_no_bit() {
    let model = go2();
    let count = 19;
    let params = params(&model, &robots(&model, count));
    for isa in isas() {
        let batch = Batch::new(&model, BatchOptions { isa: Some(isa), ..options() }).unwrap();
        let all: Vec<usize> = (0..count).collect();
        let together = run(&batch, &params, &all, 3);
        assert!(together[2][0] != together[2][1], "robots of different parameters move alike");
        let backwards: Vec<usize> = all.iter().rev().copied().collect();
        let reversed = run(&batch, &params, &backwards, 3);
        for index in all {
            let wanted: Vec<_> = together.iter().map(|rows| bits(&rows[index])).collect();
            let back: Vec<_> = reversed.iter().map(|rows| bits(&rows[count - 1 - index])).collect();
            assert!(back == wanted, "{isa:?}: robot {index} in another lane");
            if index % 6 == 0 {
                let alone = run(&batch, &params, &[index], 3);
                let alone: Vec<_> = alone.iter().map(|rows| bits(&rows[0])).collect();
                assert!(alone == wanted, "{isa:?}: robot {index} alone");
            }
        }
    }
}

#[test]
fn a_saved_tile_goes_on_with_the_same_bits() {
    let model = go2();
    let params = params(&model, &robots(&model, 17));
    let all: Vec<usize> = (0..17).collect();
    for isa in isas() {
        let batch = Batch::new(&model, BatchOptions { isa: Some(isa), ..options() }).unwrap();
        let mut tile = CPU.tile(&batch, &params, &[]).unwrap();
        let mut motion = batch.motion(17);
        for index in 0..17 {
            tile.place(index, &start(&model, index));
        }
        for period in 0..3 {
            tile.step(&targets(0..17, period), &[], &mut motion);
        }
        // Placed and not yet stepped: its history is still to come.
        tile.place(16, &start(&model, 3));
        let saved = tile.save();
        let mut resumed = CPU.tile(&batch, &params, &[]).unwrap();
        resumed.restore(&saved).unwrap();
        let (mut seen, mut again) = (batch.motion(17), batch.motion(17));
        tile.observe(&mut seen);
        resumed.observe(&mut again);
        assert!(seen == again, "{isa:?}: shown before a step");
        for period in 3..6 {
            let (targets, noise) = (targets(0..17, period), disturbances(&all, period));
            tile.step(&targets, &noise, &mut seen);
            resumed.step(&targets, &noise, &mut again);
            for index in 0..17 {
                let (seen, again) = (row(&seen, index, 17), row(&again, index, 17));
                assert!(bits(&seen) == bits(&again), "{isa:?}: robot {index} in period {period}");
            }
        }
        let error = CPU.tile(&batch, &params[..16], &[]).unwrap().restore(&saved[1..]).unwrap_err();
        assert!(error.to_string().starts_with("a saved tile's length is "), "{error}");
    }
}

#[test]
fn a_delayed_target_acts_later() {
    let model = go2();
    let batch = Batch::new(&model, BatchOptions { max_delay: 0.03, ..options() }).unwrap();
    let delayed = |delay: f64| {
        let robot =
            Robot { delay: vec![delay; 12], kp: vec![25.0; 12], kd: vec![0.5; 12], ..Robot::nominal(&model) };
        robot.params(&model).unwrap()
    };
    // Robot 0 waits a control period, robots 1 and 2 one and a half, robot 3 does not wait.
    let params = [delayed(0.02), delayed(0.03), delayed(0.03), delayed(0.0)];
    let mut tile = CPU.tile(&batch, &params, &[]).unwrap();
    let mut motion = batch.motion(4);
    for place in 0..4 {
        tile.place(place, &start(&model, 0));
    }
    // Periods whose targets each robot is sent: robot 3 late what robot 0 is sent in time, robot 2 nothing new.
    let sent = [[0, 0, 0, 0], [0, 0, 0, 0], [1, 1, 0, 0], [2, 2, 0, 1], [3, 3, 0, 2]];
    for (period, of) in sent.iter().enumerate() {
        let targets: Vec<f32> =
            of.iter().flat_map(|&period| (0..12).map(move |j| target(0, period, j))).collect();
        tile.step(&targets, &[], &mut motion);
        let [whole, changed, held, none] = [0, 1, 2, 3].map(|place| row(&motion, place, 4));
        let none: Vec<f64> = none.iter().map(|&x| f64::from(x)).collect();
        // Positions and velocities; the rest is derivatives.
        let error = difference(&whole[..37], &none[..37]);
        assert!(error < 1e-4, "sent a period late, it moves otherwise by {error:e} in period {period}");
        // Sent in period 2, it acts from the middle of period 3 on.
        assert_eq!(bits(&changed) == bits(&held), period < 3, "in period {period}");
    }
}

#[test]
fn pushes_and_disturbances_reach_the_robot_they_are_meant_for() {
    let model = go2();
    let robot = Robot { base_mass: 0.0, ..Robot::nominal(&model) }.params(&model).unwrap();
    let batch = Batch::new(&model, options()).unwrap();
    let mut tile = CPU.tile(&batch, &[robot.clone(), robot.clone(), robot], &[]).unwrap();
    let mut motion = batch.motion(3);
    let mut high = start(&model, 0);
    high.base_position = [0.0, 0.0, 2.0];
    high.base_angular = [0.0; 3];
    high.joint_velocity = vec![0.0; 12];
    for place in 0..3 {
        tile.place(place, &high);
    }
    tile.push(1, [0.5, -0.25, 0.125]);
    tile.observe(&mut motion);
    let velocity = |motion: &Motion, place: usize| motion.base_linear[3 * place..3 * place + 3].to_vec();
    assert_eq!(velocity(&motion, 0), high.base_linear);
    assert_eq!(velocity(&motion, 1), [0.2 + 0.5, -0.1 - 0.25, -0.1 + 0.125]);
    // 3 N·m on the left front calf of robot 2 alone, in all substeps; the gains are zero.
    let mut noise = vec![0.0; SUBSTEPS * 3 * 12];
    for substep in 0..SUBSTEPS {
        noise[(substep * 3 + 2) * 12 + 2] = 3.0;
    }
    tile.step(&[0.0; 36], &noise, &mut motion);
    // In free fall a push stays, and moves the base by velocity times time.
    let place = |robot: usize, axis: usize| f64::from(motion.base_position[3 * robot + axis]);
    for (axis, push) in [0.5, -0.25, 0.125].into_iter().enumerate() {
        let moved = place(1, axis) - place(0, axis);
        assert!((moved - push * CONTROL_DT).abs() < 1e-5, "axis {axis} moved by {moved}");
    }
    let calf = |robot: usize| motion.joint_velocity[12 * robot + 2];
    assert!(calf(2) > calf(0) + 1.0, "the disturbed calf turns at {}, others at {}", calf(2), calf(0));
    assert_eq!(calf(1).to_bits(), calf(0).to_bits());
}

#[test]
fn what_cannot_be_simulated_is_named() {
    let model = go2();
    let paws = vec!["paw".to_owned()];
    let wrong = [
        (BatchOptions { substeps: 0, ..options() }, "substeps is 0"),
        (BatchOptions { substeps: 1001, ..options() }, "substeps is 1001"),
        (BatchOptions { control_dt: 0.0, ..options() }, "control_dt is 0"),
        (BatchOptions { control_dt: f64::NAN, ..options() }, "control_dt is NaN"),
        (BatchOptions { control_dt: 1.5, ..options() }, "control_dt is 1.5"),
        (BatchOptions { max_delay: -0.01, ..options() }, "max_delay is -0.01"),
        (BatchOptions { max_delay: f64::INFINITY, ..options() }, "max_delay is inf"),
        (BatchOptions { tracked: paws, ..options() }, "a tracked geom is paw"),
    ];
    for (options, message) in wrong {
        let error = Batch::new(&model, options).err().unwrap();
        assert!(matches!(error, SimError::Option { .. }));
        assert!(error.to_string().starts_with(message), "`{message}` does not begin `{error}`");
    }
    let batch = Batch::new(&model, options()).unwrap();
    let late = Robot { delay: vec![0.021; 12], ..Robot::nominal(&model) }.params(&model).unwrap();
    let error = CPU.tile(&batch, &[late], &[]).err().unwrap().to_string();
    assert!(error.starts_with("a robot's delay is 0.021"), "{error}");
}
