//! A program shared among threads, computed in `f64`, equals the step.

use crate::common::{
    difference, feet, networks, on_box, on_field, recorded, robot, samples, samples_with, shared, touching,
};
use gaitfit_cuda::emit::{EmitOptions, Node, Op, PeriodProgram, Seating};
use gaitfit_cuda::physics::{Period, PeriodOptions, Shared};
use gaitfit_model::{Cone, Model, SelfContact};
use gaitfit_physics::trace::{Input, Report, Traced, record_period_with};
use gaitfit_physics::{Kept, Preset, Robot, Settings, compile};

/// Holds the program of `lanes` threads against the step.
fn compare(label: &str, model: &Model, preset: Preset, lanes: usize, min_guarded: usize, limit: f64) {
    let settings = Settings { timestep: 0.005, ..Settings::new(&model.options, preset) };
    let (taps, substeps) = (2, 3);
    let (period, tree) = recorded(model, &settings, taps, substeps, true);
    let program = shared(&period, &tree, lanes, min_guarded);
    let mut worst = 0.0f64;
    for sample in samples(model, &settings, taps, substeps, true, false, 12) {
        worst = worst.max(difference(&program.evaluate(&sample.inputs), &sample.outputs));
    }
    let table = program.program.table.len();
    let (nodes, regions) = (program.program.nodes.len(), program.program.regions.len());
    println!(
        "{label}, {preset:?}, {lanes} lanes: {nodes} nodes, {regions} regions, {table} rows, off by {worst:.1e}"
    );
    assert!(worst <= limit, "{worst}");
}

#[test]
fn one_thread_computes_the_step() {
    let go2 = robot("go2");
    compare("go2", &go2, Preset::Fast, 1, 100, 0.0);
    compare("go2 feet", &feet(go2), Preset::Accurate, 1, 0, 0.0);
}

#[test]
fn a_quadruped_is_shared() {
    let go2 = robot("go2");
    for lanes in [2, 4] {
        for min_guarded in [0, usize::MAX] {
            compare("go2 feet", &feet(go2.clone()), Preset::Fast, lanes, min_guarded, 1e-11);
        }
        compare("go2", &go2, Preset::Accurate, lanes, 100, 1e-11);
    }
}

/// Feet on a height field and on a box. A point beside a vertex may be given to the neighbour by the last bits.
#[test]
fn a_quadruped_on_uneven_ground_is_shared() {
    for (label, model) in [("field", on_field(feet(robot("go2")))), ("box", on_box(feet(robot("go2"))))] {
        compare(label, &model, Preset::Fast, 1, 0, 0.0);
        for lanes in [2, 4] {
            compare(label, &model, Preset::Fast, lanes, 600, 1e-9);
        }
    }
}

/// Self-contact couples limbs, so one thread computes all of them.
#[test]
fn self_contact_takes_one_thread() {
    let crab = touching(&robot("crab"), &SelfContact::File);
    let go2 = touching(&feet(robot("go2")), &SelfContact::Limbs);
    for (label, model) in [("crab", &crab), ("go2", &go2)] {
        compare(label, model, Preset::Fast, 1, 0, 0.0);
        let settings = Settings::new(&model.options, Preset::Fast);
        let options = PeriodOptions { substeps: 2, taps: 1, lanes: 4, emit: EmitOptions::default() };
        assert_eq!(Period::new(model, &settings, options, &[]).unwrap().lanes(), 1);
    }
}

#[test]
fn an_elliptic_quadruped_is_shared() {
    let mut go2 = robot("go2");
    go2.options.cone = Cone::Elliptic;
    compare("elliptic go2 feet", &feet(go2), Preset::Accurate, 4, 100, 1e-9);
}

/// Networks on joints of some legs alone: the threads of the others have them too, without weights.
#[test]
fn networks_of_one_limb_are_shared() {
    let model = feet(robot("go2"));
    let settings = Settings { timestep: 0.005, ..Settings::new(&model.options, Preset::Fast) };
    let (taps, substeps) = (2, 3);
    let (delta, torque) = (vec![2, 4], vec![11]);
    let tree = compile::<Traced>(&model, &settings).unwrap();
    let seating = Seating::shared(&tree.outline(), 4).unwrap();
    let own = networks::<Traced>(&delta, &torque);
    let whole = Shared::new(&own, &seating, tree.joints());
    // Calves and thighs of all legs; calves.
    let asked = |all: &[bool]| (all.len(), all.iter().filter(|&&asked| asked).count());
    assert_eq!((asked(&whole.memory), asked(&whole.weights)), ((4 * 12, 4 * 3), (97 * 12, 97 * 3)));
    let report = Report {
        disturbed: true,
        forces: true,
        tracked: (0..tree.model_pairs().len()).collect(),
        ..Report::default()
    };
    let record = |networks: &[_]| record_period_with(&tree, taps, substeps, networks, &report).unwrap();
    let emit = |networks: &[_]| PeriodProgram::new(&record(networks), &seating, EmitOptions::default());
    assert!(emit(&own).is_err(), "legs with other networks cannot be shared");
    let program = emit(&whole.modifications).unwrap();
    let mut worst = 0.0f64;
    let sampled = (true, networks::<f64>(&delta, &torque));
    for sample in samples_with(&model, &settings, taps, substeps, sampled, false, 12) {
        let (rest, own) = sample.inputs.split_at(sample.inputs.len() - 3 * (4 + 97));
        let mut own = own.iter().copied();
        let asked = whole.memory.iter().chain(&whole.weights);
        let further = asked.map(|&asked| if asked { own.next().unwrap() } else { 0.0 });
        let inputs: Vec<f64> = rest.iter().copied().chain(further).collect();
        let mut outputs = program.evaluate(&inputs);
        let states = 19 + 3 * tree.joints();
        for (place, _) in whole.memory.iter().enumerate().rev().filter(|(_, asked)| !**asked) {
            outputs.remove(states + place);
        }
        worst = worst.max(difference(&outputs, &sample.outputs));
    }
    println!("networks on one limb: off by {worst:.1e}");
    assert!(worst <= 1e-11, "{worst}");
}

/// Robots that keep their model's links and motors take a shorter program, of the same numbers.
#[test]
fn what_robots_keep_is_constant() {
    let model = feet(robot("go2"));
    let settings = Settings { timestep: 0.005, ..Settings::new(&model.options, Preset::Fast) };
    let robot = Robot::nominal(&model);
    let fixed = Kept::from_robot(&robot).numbers(&robot.params(&model).unwrap());
    // Ten numbers of each link; friction at rest and under load, play, compliance and speed of each joint; softness and
    // impedance of the ground, and how late velocities and the inertial unit are read.
    assert_eq!(fixed.len(), 12 * (10 + 5) + 4);
    let options = PeriodOptions { substeps: 3, taps: 1, lanes: 4, emit: EmitOptions::default() };
    let period = |fixed| {
        let report = Report { fixed, ..Report::default() };
        Period::reporting(&model, &settings, options, &[], &report).unwrap()
    };
    let (short, whole) = (period(fixed.clone()), period(Vec::new()));
    println!("operations: {} of {}", short.operations(), whole.operations());
    assert!(short.operations() < whole.operations());
    assert_eq!((short.lanes(), whole.lanes()), (4, 4));

    let tree = compile::<Traced>(&model, &settings).unwrap();
    let report = Report { fixed: fixed.clone(), ..Report::default() };
    let graph = record_period_with(&tree, 1, 3, &[], &report).unwrap();
    let mut worst = 0.0f64;
    let program = shared(&graph, &tree, 4, EmitOptions::default().min_guarded);
    let read = |node: &Node| match node.op {
        Op::Input(number) => Some(graph.inputs[number as usize]),
        _ => None,
    };
    let read: Vec<Input> = program.program.nodes.iter().filter_map(read).collect();
    assert!(read.iter().any(|input| matches!(input, Input::Params(_))));
    assert!(!fixed.iter().any(|&(slot, _)| read.contains(&Input::Params(slot))));
    // Every other robot keeps them.
    for sample in samples(&model, &settings, 1, 3, false, false, 100).iter().step_by(2) {
        worst = worst.max(difference(&program.evaluate(&sample.inputs), &sample.outputs));
    }
    println!("constants: off by {worst:.1e}");
    assert!(worst <= 1e-11, "{worst}");
}

#[test]
fn two_legged_robots_are_shared() {
    compare("biped", &robot("biped"), Preset::Fast, 2, 100, 1e-11);
    // Some of its velocities are large, and sums over the limbs are rounded in another order.
    compare("humanoid", &robot("humanoid"), Preset::Fast, 2, 100, 1e-10);
}
