//! A scalar that records instead of computing runs a control period; the recorded graph, evaluated on any state,
//! equals the `f64` step, also where guarded regions are left out. So a code generator can follow the step.

use std::collections::BTreeSet;

use crate::common::batch::{networks, param_values, values};
use crate::common::random::Random;
use crate::common::{Arrays, here, robot, touching};
use gaitfit_model::{Cone, Model};
use gaitfit_physics::in_f64::control_period;
use gaitfit_physics::trace::{
    Id, Input, Loop, PeriodGraph, Region, RegionKind, TraceError, Traced, record, record_period,
};
use gaitfit_physics::{
    Drive, Modify, Owner, Period, Preset, Real, Robot, RowKind, Settings, Slot, Work, compile,
    constraint_rows, memory_of, settle, state_from,
};

const SUBSTEPS: usize = 2;
const TAPS: usize = 3;

fn recorded(model: &Model, settings: &Settings, substeps: usize) -> PeriodGraph {
    let tree = compile::<Traced>(model, settings).unwrap();
    record_period(&tree, TAPS, substeps, &networks::<Traced>(tree.joints())).unwrap()
}

/// Compares recording and `f64` on the states of a fixture file; returns how many contact points each state has.
fn compare(model: &Model, preset: Preset, file: &str) -> BTreeSet<usize> {
    let settings = Settings::new(&model.options, preset);
    let program = recorded(model, &settings, SUBSTEPS);
    let mut weights = Vec::new();
    for modification in &mut networks::<f64>(model.joints.len()) {
        modification.visit_weights_mut(|_, &mut weight| weights.push(weight));
    }
    let tree = compile::<f64>(model, &settings).unwrap();
    let data = Arrays::open(&here(&format!("tests/fixtures/{file}.npz")));
    let mut random = Random(11);
    let mut patterns = BTreeSet::new();
    let (mut limited, mut touching, mut worst) = (0, 0, 0.0f64);
    for index in 0..data.len("qpos") {
        let mut state = state_from(&tree, data.row("qpos", index), data.row("qvel", index)).unwrap();
        let mut robot = Robot::nominal(model);
        robot.kp = vec![random.uniform(10.0, 60.0); tree.joints()];
        robot.kd = vec![random.uniform(0.0, 2.0); tree.joints()];
        robot.delay = vec![random.uniform(0.0, 0.02); tree.joints()];
        robot.encoder_bias = random.signed(tree.joints(), 0.02);
        robot.base_mass = random.uniform(-1.0, 2.0);
        if index % 2 == 1 {
            robot.stiction.fill(0.3);
            robot.load_friction.fill(0.1);
            (robot.no_load_speed[1], robot.stall_torque[1]) = (9.0, 12.0);
        }
        robot.friction_scale = random.uniform(0.5, 1.5);
        let params = robot.params(model).unwrap();
        let targets: Vec<f64> =
            (0..TAPS).flat_map(|_| state.qpos.clone()).map(|q| q + random.uniform(-0.4, 0.4)).collect();

        let rows = constraint_rows(&tree, &params, &state, &mut Work::new(&tree));
        limited += rows.iter().filter(|row| matches!(row.kind, RowKind::Limit(_))).count();
        touching += usize::from(rows.iter().any(|row| matches!(row.kind, RowKind::SelfContact(..))));
        let points = rows.iter().filter_map(|row| match row.kind {
            RowKind::Contact(pair, point) => Some((pair, point)),
            _ => None,
        });
        patterns.insert(points.collect::<BTreeSet<_>>().len());

        let modifications = networks::<f64>(tree.joints());
        let mut memory = vec![0.0; memory_of(&modifications)];
        settle(&modifications, &params, &state, &mut memory);
        let inputs =
            [values(&state), param_values(&params), targets.clone(), memory.clone(), weights.clone()];
        let got = program.graph.evaluate(&inputs.concat());
        let mut targets = targets;
        control_period(&mut Period {
            tree: &tree,
            params: &params,
            targets: &mut targets,
            disturbance: &[],
            modifications: &modifications,
            memory: &mut memory,
            substeps: SUBSTEPS,
            state: &mut state,
            work: &mut Work::new(&tree),
            drives: &mut vec![Drive::zero(); tree.joints()],
        });
        // Of the targets those that were corrected.
        targets.truncate(tree.joints());
        let want = [values(&state), memory, targets].concat();
        assert_eq!(got.len(), want.len());
        for (got, want) in got.iter().zip(&want) {
            assert!(want.is_finite(), "state {index} diverges");
            let error = (got - want).abs() / want.abs().max(1.0);
            assert!(error <= 1e-12, "state {index}: recorded {got}, computed {want}");
            worst = worst.max(error);
        }
    }
    assert!(limited > 0, "no state at a limit");
    assert_eq!(touching > 0, !model.self_pairs.is_empty(), "states with self-contact: {touching}");
    println!(
        "{file}, {preset:?}: {} operations, off by {worst:.1e}, contact points {patterns:?}",
        program.graph.nodes.len()
    );
    patterns
}

#[test]
fn recorded_step_equals_f64() {
    let model = robot("go2");
    let patterns = compare(&model, Preset::Fast, "states_go2_pyr_imp1_fl");
    assert!(patterns.len() >= 4 && patterns.contains(&0), "{patterns:?}");
}

#[test]
fn recorded_line_search_equals_f64() {
    compare(&robot("go2"), Preset::Accurate, "states_go2_pyr_imp100_nofl");
}

#[test]
fn recorded_elliptic_step_equals_f64() {
    let mut model = robot("go2");
    model.options.cone = Cone::Elliptic;
    compare(&model, Preset::Accurate, "states_go2_ell_imp1_nofl");
}

#[test]
fn recorded_step_of_a_dragged_base_equals_f64() {
    compare(&robot("drag"), Preset::Accurate, "states_drag_pyr_imp1_fl");
}

#[test]
fn recorded_step_of_telescopic_legs_equals_f64() {
    compare(&robot("telescope"), Preset::Accurate, "states_telescope_pyr_imp1_fl");
}

#[test]
fn recorded_step_of_coupled_joints_equals_f64() {
    compare(&robot("hand"), Preset::Accurate, "states_hand_pyr_imp1_fl");
    compare(&robot("gears"), Preset::Accurate, "states_gears_pyr_imp1_fl");
    compare(&touching("gears"), Preset::Accurate, "states_gears_pyr_imp1_fl");
}

#[test]
fn recorded_self_contact_equals_f64() {
    compare(&touching("crab"), Preset::Fast, "states_crab_pyr_imp1_fl");
    for (name, file) in [("crab", "states_crab_ell_imp10_nofl"), ("twins", "states_twins_ell_imp1_fl")] {
        let mut model = touching(name);
        model.options.cone = Cone::Elliptic;
        compare(&model, Preset::Accurate, file);
    }
}

/// Nodes and regions of a program.
fn counts(model: &Model, settings: &Settings, substeps: usize) -> (usize, usize) {
    let graph = recorded(model, settings, substeps).graph;
    (graph.nodes.len(), graph.regions.len())
}

#[test]
fn loops_stay_loops() {
    let model = robot("go2");
    let settings = Settings::new(&model.options, Preset::Accurate);
    // The numbers of steps are constants of the delay: ones that nothing else is.
    let few = counts(&model, &settings, 7);
    assert_eq!(counts(&model, &settings, 19), few);
    assert_eq!(counts(&model, &Settings { iterations: 50, ..settings }, 7), few);
}

/// Every geom and every limit is left out in some pose: its numbers are in guarded regions.
#[test]
fn regions_are_kept() {
    let model = robot("go2");
    let settings = Settings::new(&model.options, Preset::Fast);
    let program = recorded(&model, &settings, SUBSTEPS);
    let regions = &program.graph.regions;
    let guards: BTreeSet<Id> = regions
        .iter()
        .filter_map(|region| match region.kind {
            RegionKind::Guarded(guard) => Some(guard),
            RegionKind::Loop { .. } => None,
        })
        .collect();
    let pairs = compile::<f64>(&model, &settings).unwrap().model_pairs().len();
    let limits = model.joints.iter().filter(|joint| joint.range.is_some()).count();
    // Two more guards a pair: softer and firmer ground. Three more a joint: friction at rest, friction under load, torque that falls
    // with speed.
    assert_eq!(guards.len(), 3 * pairs + limits + 3 * model.joints.len());
    assert_eq!(regions.iter().filter(|region| matches!(region.kind, RegionKind::Loop { .. })).count(), 2);
    let guarded = |region: &&Region| matches!(region.kind, RegionKind::Guarded(_));
    let inside: usize = regions.iter().filter(guarded).map(|region| region.nodes.len()).sum();
    assert!(2 * inside > program.graph.nodes.len(), "{inside} of {}", program.graph.nodes.len());
}

#[test]
fn inputs_have_names() {
    let model = robot("go2");
    let program = recorded(&model, &Settings::new(&model.options, Preset::Fast), SUBSTEPS);
    let names: BTreeSet<String> = program.inputs.iter().map(|input| format!("{input:?}")).collect();
    assert_eq!((names.len(), program.graph.inputs), (program.inputs.len(), program.inputs.len()));
    let count = |wanted: fn(&Input) -> bool| program.inputs.iter().filter(|input| wanted(input)).count();
    let joints = model.joints.len();
    assert_eq!(count(|input| matches!(input, Input::Weight { .. })), 2 * 97 * joints);
    assert_eq!(count(|input| matches!(input, Input::Params(slot) if slot.owner == Owner::Joint(3))), 20);
    let links = count(|input| matches!(input, Input::Params(Slot { owner: Owner::Link(_), .. })));
    assert_eq!(links, 10 * (joints + 1), "mass, centre and inertia of each link");
}

#[test]
fn equal_operations_are_one_node() {
    let graph = record(|| {
        let (a, b) = (Traced::input(), Traced::input());
        assert_ne!(a * b, b * a);
        vec![a * b, a * b]
    })
    .unwrap();
    assert_eq!(graph.outputs[0], graph.outputs[1]);
    assert_eq!(graph.evaluate(&[3.0, 5.0]), [15.0, 15.0]);
}

/// A step that reads a number of a region elsewhere would work on the processor and fail where the region is skipped.
/// (a + b, a b, b − a, c) of three numbers.
fn four([a, b, c]: [Traced; 3]) -> [Traced; 4] {
    [a + b, a * b, b - a, c]
}

#[test]
fn a_function_is_recorded_once() {
    let graph = record(|| {
        let [a, b, c] = [Traced::input(), Traced::input(), Traced::input()];
        let first = Traced::call(1, [a, b, c], four);
        Traced::call(1, first[1..].try_into().unwrap(), four).to_vec()
    })
    .unwrap();
    assert_eq!(graph.functions.len(), 1);
    assert_eq!(graph.evaluate(&[2.0, 3.0, 7.0]), [7.0, 6.0, -5.0, 7.0]);
    let nested = |numbers: [Traced; 3]| Traced::call(2, numbers, four);
    let guarded = |[a, b, c]: [Traced; 3]| {
        let guard = a.unless_ge(b);
        assert!(Traced::enter(guard));
        let inside = a * c;
        Traced::leave(guard);
        [inside.merge(guard, a), a, b, c]
    };
    let inputs = || [Traced::input(), Traced::input(), Traced::input()];
    assert_eq!(record(|| Traced::call(1, inputs(), nested).to_vec()), Err(TraceError::Function));
    assert_eq!(record(|| Traced::call(1, inputs(), guarded).to_vec()), Err(TraceError::Function));
}

#[test]
fn numbers_do_not_leave_their_region() {
    let with = |merged: bool| {
        record(|| {
            let (a, b) = (Traced::input(), Traced::input());
            let guard = a.unless_ge(b);
            assert!(Traced::enter(guard));
            let inside = a * b;
            Traced::leave(guard);
            vec![if merged { inside.merge(guard, a) } else { inside }]
        })
    };
    let graph = with(true).unwrap();
    assert_eq!((graph.evaluate(&[2.0, 1.0]), graph.evaluate(&[2.0, 3.0])), (vec![2.0], vec![6.0]));
    assert!(matches!(with(false), Err(TraceError::Escapes(_))));
}

#[test]
fn a_loop_hands_on() {
    let graph = record(|| {
        let (mut a, mut b) = (Traced::input(), Traced::input());
        let turns = Loop::begin(10, vec![&mut a, &mut b]);
        (a, b) = (b, a + b);
        turns.end(vec![&mut a, &mut b]);
        vec![a, b]
    })
    .unwrap();
    assert_eq!(graph.evaluate(&[0.0, 1.0]), [55.0, 89.0]);
    let inside = record(|| {
        let mut a = Traced::input();
        let turns = Loop::begin(10, vec![&mut a]);
        let local = a + a;
        turns.end(vec![&mut a]);
        vec![local]
    });
    assert!(matches!(inside, Err(TraceError::Escapes(_))));
}
