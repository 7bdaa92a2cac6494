//! Vectors of `f32` lanes against `f64`, and lanes against each other.

use crate::common::batch::{networks, pack, pack_params, rounded, state_of, unpack, values};
use crate::common::random::Random;
use crate::common::{Arrays, Ledger, here, relative_1, robot, touching};
use gaitfit_model::{Cone, Model};
use gaitfit_physics::in_f64::control_period;
use gaitfit_physics::{
    Drive, Isa, Lanes, Params, Period, Preset, Robot, Settings, Work, compile, memory_of, settle, state_from,
    with_lanes,
};

/// Calls the generic function once for each instruction set of this machine.
macro_rules! each_isa {
    ($function:ident($($argument:expr),*)) => {
        for isa in Isa::found() {
            with_lanes!(isa, T => $function::<T>(isa.name(), $($argument),*));
        }
    };
}

mod derivatives;
mod operations;

/// Environments of one test: states (as flat lists, already rounded to single precision), parameters, targets.
struct Cases {
    states: Vec<Vec<f64>>,
    params: Vec<Params<f64>>,
    targets: Vec<Vec<f64>>,
}

/// States of a fixture file, each with its own robot and targets, repeated to at least `count`.
fn cases(model: &Model, file: &str, count: usize) -> Cases {
    let data = Arrays::open(&here(&format!("tests/fixtures/{file}.npz")));
    let tree = compile::<f64>(model, &Settings::new(&model.options, Preset::Converged)).unwrap();
    let mut random = Random(7);
    let mut cases = Cases { states: Vec::new(), params: Vec::new(), targets: Vec::new() };
    for index in 0..count {
        let row = index % data.len("qpos");
        let state = state_from(&tree, data.row("qpos", row), data.row("qvel", row)).unwrap();
        cases.states.push(rounded(&values(&state)));
        let mut robot = Robot::nominal(model);
        robot.kp = vec![random.uniform(20.0, 60.0); tree.joints()];
        robot.kd = vec![random.uniform(0.5, 2.0); tree.joints()];
        robot.base_mass = random.uniform(0.0, 3.0);
        robot.friction_scale = random.uniform(0.6, 1.4);
        robot.frictionloss.iter_mut().for_each(|x| *x = random.uniform(0.0, 0.5));
        robot.delay = vec![random.uniform(0.0, 0.03); tree.joints()];
        // Neighbours in a block differ in what their joints have at all.
        if index % 3 == 1 {
            robot.stiction.fill(0.2);
            robot.stribeck_velocity.fill(0.5);
            robot.load_friction.fill(0.1);
        }
        if index % 4 == 2 {
            robot.no_load_speed.fill(12.0);
            robot.stall_torque.fill(15.0);
        }
        cases.params.push(robot.params(model).unwrap());
        // Three sent targets around the joint angles.
        let near = |random: &mut Random| -> Vec<f64> {
            state.qpos.iter().map(|q| q + random.uniform(-0.3, 0.3)).collect()
        };
        cases.targets.push(rounded(&(0..3).flat_map(|_| near(&mut random)).collect::<Vec<_>>()));
    }
    cases
}

/// Runs one block for a control period; returns the final state of each lane.
fn run_block<T: Lanes>(
    model: &Model,
    settings: &Settings,
    cases: &Cases,
    pick: &[usize],
    substeps: usize,
) -> Vec<Vec<f32>> {
    let tree = compile::<T>(model, settings).unwrap();
    let columns =
        |all: &[Vec<f64>]| -> Vec<T> { pack(&pick.iter().map(|&i| all[i].clone()).collect::<Vec<_>>()) };
    let mut state = state_of::<T>(&tree, &columns(&cases.states));
    let params = pack_params::<T>(&pick.iter().map(|&i| cases.params[i].clone()).collect::<Vec<_>>());
    let mut targets = columns(&cases.targets);
    let modifications = networks::<T>(tree.joints());
    let mut memory = vec![T::zero(); memory_of(&modifications)];
    settle(&modifications, &params, &state, &mut memory);
    T::control_period(&mut Period {
        tree: &tree,
        params: &params,
        targets: &mut targets,
        disturbance: &[],
        modifications: &modifications,
        memory: &mut memory,
        substeps,
        state: &mut state,
        work: &mut Work::new(&tree),
        drives: &mut vec![Drive::zero(); tree.joints()],
    });
    unpack(&values(&state))
}

/// The same in `f64`, one environment.
fn run_f64(model: &Model, settings: &Settings, cases: &Cases, index: usize, substeps: usize) -> Vec<f64> {
    let tree = compile::<f64>(model, settings).unwrap();
    let mut state = state_of::<f64>(&tree, &cases.states[index]);
    let modifications = networks::<f64>(tree.joints());
    let mut memory = vec![0.0; memory_of(&modifications)];
    settle(&modifications, &cases.params[index], &state, &mut memory);
    control_period(&mut Period {
        tree: &tree,
        params: &cases.params[index],
        targets: &mut cases.targets[index].clone(),
        disturbance: &[],
        modifications: &modifications,
        memory: &mut memory,
        substeps,
        state: &mut state,
        work: &mut Work::new(&tree),
        drives: &mut vec![Drive::zero(); tree.joints()],
    });
    values(&state)
}

/// `most`: largest error of velocities, relative to the largest of them or to 1.
fn against_f64<T: Lanes>(isa: &str, model: &Model, file: &str, most: f64) {
    let settings = Settings::new(&model.options, Preset::Converged);
    let count = 32;
    let cases = cases(model, file, count);
    let joints = model.joints.len();
    let mut ledger = Ledger::default();
    for substeps in [1, 4] {
        for first in (0..count).step_by(T::LANES) {
            let pick: Vec<usize> = (first..first + T::LANES).collect();
            let blocks = run_block::<T>(model, &settings, &cases, &pick, substeps);
            for (&index, got) in pick.iter().zip(&blocks) {
                let want = run_f64(model, &settings, &cases, index, substeps);
                let got: Vec<f64> = got.iter().map(|&x| f64::from(x)).collect();
                // Position, quaternion | velocities | joint angles | joint velocities.
                let part = |values: &[f64], angles: bool| -> Vec<f64> {
                    let cut =
                        if angles { [0..7, 13..13 + joints] } else { [7..13, 13 + joints..13 + 2 * joints] };
                    cut.into_iter().flat_map(|range| values[range].to_vec()).collect()
                };
                for (name, angles, most) in [("position", true, 1e-4), ("velocity", false, most)] {
                    let error = relative_1(&part(&got, angles), &part(&want, angles));
                    let place = || format!("state {index}");
                    ledger.note(&format!("{name} after {substeps} steps"), error, most, place);
                }
            }
        }
    }
    ledger.check(&format!("{isa} against f64, {file}"));
}

#[test]
fn go2_converges_to_f64() {
    let model = robot("go2");
    each_isa!(against_f64(&model, "states_go2_pyr_imp1_fl", 1e-4));
}

#[test]
fn go2_with_elliptic_cones_converges_to_f64() {
    let mut model = robot("go2");
    model.options.cone = Cone::Elliptic;
    // One state of the 32 is off by 4e-5 to 1.1e-4, by the instruction set.
    each_isa!(against_f64(&model, "states_go2_ell_imp1_nofl", 3e-4));
}

#[test]
fn humanoid_converges_to_f64() {
    let model = robot("humanoid");
    each_isa!(against_f64(&model, "states_humanoid_pyr_imp1_fl", 1e-4));
}

/// Armature, damping and dry friction of the free joint.
#[test]
fn a_dragged_base_converges_to_f64() {
    let model = robot("drag");
    each_isa!(against_f64(&model, "states_drag_pyr_imp1_fl", 1e-4));
}

/// Slides, slides beyond them, and hinges beyond both.
#[test]
fn telescopic_legs_converge_to_f64() {
    let model = robot("telescope");
    each_isa!(against_f64(&model, "states_telescope_pyr_imp1_fl", 1e-4));
}

/// Joints that follow others, with and without contact of own parts.
#[test]
fn coupled_joints_converge_to_f64() {
    each_isa!(against_f64(&robot("hand"), "states_hand_pyr_imp1_fl", 1e-4));
    each_isa!(against_f64(&touching("hand"), "states_hand_pyr_imp1_fl", 1e-4));
    each_isa!(against_f64(&robot("gears"), "states_gears_pyr_imp1_fl", 1e-4));
    each_isa!(against_f64(&touching("gears"), "states_gears_pyr_imp1_fl", 1e-4));
}

/// Balls and rods on a height field and on boxes.
#[test]
fn uneven_ground_converges_to_f64() {
    let model = robot("terrain");
    each_isa!(against_f64(&model, "states_terrain_pyr_imp1_fl", 1e-4));
}

/// Legs that touch each other, in a robot with and one without feet of rods.
#[test]
fn own_parts_converge_to_f64() {
    each_isa!(against_f64(&touching("crab"), "states_crab_pyr_imp1_fl", 1e-4));
    each_isa!(against_f64(&touching("twins"), "states_twins_pyr_imp1_nofl_implicitfast", 1e-4));
}

fn same_bits(a: &[f32], b: &[f32]) -> bool {
    a.iter().zip(b).all(|(x, y)| x.to_bits() == y.to_bits())
}

/// A block of different environments gives each what a block of copies of it gives.
fn independent<T: Lanes>(isa: &str, model: &Model, file: &str, preset: Preset) {
    let settings = Settings::new(&model.options, preset);
    let cases = cases(model, file, T::LANES);
    let all: Vec<usize> = (0..T::LANES).collect();
    let together = run_block::<T>(model, &settings, &cases, &all, 2);
    for index in 0..T::LANES {
        let alone = run_block::<T>(model, &settings, &cases, &vec![index; T::LANES], 2);
        for copy in &alone {
            assert!(
                same_bits(copy, &together[index]),
                "{isa}: environment {index} depends on its neighbours"
            );
        }
    }
    let mut turned = all.clone();
    turned.rotate_left(1);
    let moved = run_block::<T>(model, &settings, &cases, &turned, 2);
    for (lane, &index) in turned.iter().enumerate() {
        assert!(same_bits(&moved[lane], &together[index]), "{isa}: environment {index} depends on its lane");
    }
}

#[test]
fn lanes_do_not_see_each_other() {
    for (name, file) in [
        ("go2", "states_go2_pyr_imp1_fl"),
        ("humanoid", "states_humanoid_pyr_imp1_fl"),
        ("terrain", "states_terrain_pyr_imp1_fl"),
        ("crab", "states_crab_pyr_imp1_fl"),
    ] {
        let mut model = if name == "crab" { touching(name) } else { robot(name) };
        each_isa!(independent(&model, file, Preset::Fast));
        each_isa!(independent(&model, file, Preset::Accurate));
        model.options.cone = Cone::Elliptic;
        each_isa!(independent(&model, file, Preset::Accurate));
    }
}

/// One diverged environment leaves the others alone.
fn nan_stays<T: Lanes>(isa: &str, model: &Model, file: &str) {
    let settings = Settings::new(&model.options, Preset::Accurate);
    let mut cases = cases(model, file, T::LANES);
    let all: Vec<usize> = (0..T::LANES).collect();
    let healthy = run_block::<T>(model, &settings, &cases, &all, 2);
    let sick = T::LANES / 2;
    for slot in 0..cases.states[sick].len() {
        let kept = cases.states[sick][slot];
        cases.states[sick][slot] = f64::NAN;
        let block = run_block::<T>(model, &settings, &cases, &all, 2);
        cases.states[sick][slot] = kept;
        for index in all.iter().filter(|&&index| index != sick) {
            assert!(
                same_bits(&block[*index], &healthy[*index]),
                "{isa}: NaN in number {slot} spreads to {index}"
            );
        }
        assert!(block[sick].iter().any(|x| x.is_nan()), "{isa}: NaN in number {slot} vanishes");
    }
}

#[test]
fn nan_stays_in_its_lane() {
    let model = robot("go2");
    each_isa!(nan_stays(&model, "states_go2_pyr_imp1_fl"));
    let model = robot("terrain");
    each_isa!(nan_stays(&model, "states_terrain_pyr_imp1_fl"));
    each_isa!(nan_stays(&touching("crab"), "states_crab_pyr_imp1_fl"));
}

fn sines<T: Lanes>(isa: &str) {
    let mut worst = (0.0f64, 0.0f32);
    let mut buffer = vec![0.0f32; T::LANES];
    let mut x = -1000.0f32;
    while x < 1000.0 {
        let inputs: Vec<f32> = (0..T::LANES).map(|k| x + 0.0137 * k as f32).collect();
        let (s, c) = T::load(&inputs).sin_cos();
        for (value, exact) in [(s, f64::sin as fn(f64) -> f64), (c, f64::cos as fn(f64) -> f64)] {
            value.store(&mut buffer);
            for (input, got) in inputs.iter().zip(&buffer) {
                let error = (f64::from(*got) - exact(f64::from(*input))).abs();
                if error > worst.0 || error.is_nan() {
                    worst = (error, *input);
                }
            }
        }
        x += 0.0137 * T::LANES as f32;
    }
    println!("{isa}: sin_cos is off by at most {:.2e}, at {}", worst.0, worst.1);
    assert!(worst.0 <= 2e-7, "{isa}: off by {} at {}", worst.0, worst.1);
    let (s, c) = T::lit(0.0).sin_cos();
    s.store(&mut buffer);
    assert_eq!(buffer[0], 0.0);
    c.store(&mut buffer);
    assert_eq!(buffer[0], 1.0);
}

#[test]
fn sine_and_cosine() {
    each_isa!(sines());
}
