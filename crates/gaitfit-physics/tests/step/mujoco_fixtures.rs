//! The engine against MuJoCo 4.0.0 on five robots (fixtures by tools/make_physics_fixtures.py).

use std::path::PathBuf;

use crate::common::compare::{self, Limits};
use crate::common::{Arrays, Ledger, converged, difference, here, robot, touching, variant};
use gaitfit_model::{JointKind, Model};
use gaitfit_physics::in_f64::control_period;
use gaitfit_physics::{Drive, Forward, Period, Robot, Work, compile, state_from, state_to};

/// Fixture files whose names start so, sorted.
fn files(start: &str) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(here("tests/fixtures"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "npz"))
        .filter(|path| path.file_name().unwrap().to_str().unwrap().starts_with(start))
        .collect();
    files.sort();
    assert!(!files.is_empty(), "no fixtures {start}*");
    files
}

fn compare_states(name: &str) {
    compare_states_after(name, &[(1, "next"), (5, "next5")]);
}

fn compare_states_after(name: &str, next: &[(usize, &str)]) {
    compare_states_of(name, &robot(name), next);
}

fn compare_states_of(name: &str, base: &Model, next: &[(usize, &str)]) {
    for path in files(&format!("states_{name}_")) {
        let data = Arrays::open(&path);
        let model = variant(base, &data);
        let label = path.file_stem().unwrap().to_str().unwrap();
        let mut ledger = Ledger::default();
        let limits = Limits::promised(&model);
        compare::states(label, &model, &converged(&model), &data, next, &limits, &mut ledger);
        ledger.check(label);
    }
}

#[test]
fn states_of_the_go2() {
    compare_states("go2");
}

#[test]
fn states_of_the_biped() {
    compare_states("biped");
}

#[test]
fn states_of_the_humanoid() {
    compare_states("humanoid");
}

/// Massless feet, and actuators clamped at their joints.
#[test]
fn states_of_the_tripod() {
    compare_states("tripod");
}

/// Armature, damping and dry friction of the free joint.
#[test]
fn states_of_a_base_that_is_dragged() {
    let model = robot("drag");
    let free = model.free_joint.unwrap();
    assert_eq!([free.armature, free.damping, free.frictionloss], [0.3, 0.8, 2.5]);
    compare_states("drag");
}

/// Balls on a height field and on boxes, rods on boxes, where MuJoCo's contacts are the same points (later steps may leave
/// that).
#[test]
fn states_on_uneven_ground() {
    compare_states_after("terrain", &[(1, "next")]);
}

/// Spheres, capsules and a box of one robot against each other: four legs with spin and rolling, explicit pairs and
/// excluded bodies; two legs whose feet are rods; a hand whose joints are coupled; legs and fingers that are coupled.
#[test]
fn states_of_robots_that_touch_themselves() {
    for name in ["crab", "twins", "hand", "gears"] {
        let model = touching(name);
        for path in files(&format!("states_{name}_")) {
            let data = Arrays::open(&path);
            let own = data.all("contact_own").iter().filter(|&&own| own == 1.0).count();
            assert!(own > 10, "{name}: own parts hardly touch");
        }
        compare_states_of(name, &model, &[(1, "next"), (5, "next5")]);
    }
}

/// Wheels without limits under velocity servos: cylinders, a ball and a rod.
#[test]
fn states_of_the_rover() {
    compare_states("rover");
}

/// Slides: as knees, beyond each other, with a hinge beyond them, and where a limb branches.
#[test]
fn states_of_telescopic_legs() {
    let model = robot("telescope");
    assert_eq!(model.joints.iter().filter(|joint| joint.kind == JointKind::Slide).count(), 6);
    compare_states("telescope");
}

/// Our PD controller with velocity targets on the wheels is MuJoCo's `<velocity>` servo: 200 steps of a robot that begins to
/// roll.
#[test]
fn velocity_targets_are_mujocos_velocity_servos() {
    let data = Arrays::open(&here("tests/fixtures/rollout_rover_pyr_imp1_fl.npz"));
    let base = variant(&robot("rover"), &data);
    let wheels: Vec<usize> =
        (0..base.joints.len()).filter(|&joint| base.joints[joint].name.ends_with("_wheel")).collect();
    let model = base.with_velocity_targets(&wheels);
    let tree = compile::<f64>(&model, &converged(&model)).unwrap();
    let mut robot = Robot::nominal(&model);
    for joint in 0..model.joints.len() {
        (robot.kp[joint], robot.kd[joint]) = if wheels.contains(&joint) { (0.0, 0.6) } else { (60.0, 1.5) };
    }
    let params = robot.params(&model).unwrap();
    let mut state = state_from(&tree, data.row("qpos", 0), data.row("qvel", 0)).unwrap();
    let (mut work, mut drives) = (Work::new(&tree), vec![Drive::zero(); tree.joints()]);
    let mut ledger = Ledger::default();
    for step in 1..data.len("qpos") {
        control_period(&mut Period {
            tree: &tree,
            params: &params,
            targets: &mut data.all("ctrl").to_vec(),
            disturbance: &[],
            modifications: &[],
            memory: &mut [],
            substeps: 1,
            state: &mut state,
            work: &mut work,
            drives: &mut drives,
        });
        let (q, v) = state_to(&tree, &state);
        let limit = if step <= 50 { 1e-9 } else { 1e-6 };
        let place = || format!("step {step}");
        ledger.note("qpos", difference(&q, data.row("qpos", step)), limit, place);
        ledger.note("qvel", difference(&v, data.row("qvel", step)), 10.0 * limit, place);
    }
    ledger.check("velocity targets");
    // It rolls.
    let (_, v) = state_to(&tree, &state);
    assert!(v[0] > 0.4, "{v:?}");
}

#[test]
fn states_of_the_arm() {
    compare_states("arm");
}

/// 200 steps from just above the ground. Contacts amplify differences, so the limit grows with the horizon.
#[test]
fn rollouts() {
    for path in files("rollout_") {
        let label = path.file_stem().unwrap().to_str().unwrap();
        let name = label.split('_').nth(1).unwrap();
        let data = Arrays::open(&path);
        let base = if ["twins", "hand", "gears"].contains(&name) { touching(name) } else { robot(name) };
        let model = variant(&base, &data);
        let mut forward = Forward::new(&model, &converged(&model)).unwrap();
        let mut state = state_from(forward.tree(), data.row("qpos", 0), data.row("qvel", 0)).unwrap();
        let mut ledger = Ledger::default();
        for step in 1..data.len("qpos") {
            forward.step(&mut state, data.all("ctrl")).unwrap();
            let (q, v) = state_to(forward.tree(), &state);
            let (horizon, limit) = if step <= 50 { (50, 1e-9) } else { (200, 1e-6) };
            let place = || format!("step {step}");
            let (q, v) = (difference(&q, data.row("qpos", step)), difference(&v, data.row("qvel", step)));
            ledger.note(&format!("qpos to step {horizon}"), q, limit, place);
            ledger.note(&format!("qvel to step {horizon}"), v, limit * 10.0, place);
        }
        ledger.check(label);
    }
}
