//! A scalar that records instead of computing runs a control period; the recorded graph, evaluated on any state,
//! equals the `f64` step. So the step has no branch that depends on a number, and a code generator can follow it.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

mod common;

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::ops::{Add, Mul, Neg, Sub};

use common::batch::{networks, param_values, state_of, values};
use common::random::Random;
use common::{Arrays, here, robot};
use gaitfit_model::{Cone, Model};
use gaitfit_physics::{
    Drive, Params, Period, Preset, Real, Robot, RowKind, Settings, State, Work, compile, constraint_rows,
    control_period, memory_of, settle, state_from,
};

#[derive(Clone, Copy, Debug)]
enum Node {
    Input(usize),
    Constant(f64),
    Add(Tr, Tr),
    Sub(Tr, Tr),
    Mul(Tr, Tr),
    Neg(Tr),
    Fma(Tr, Tr, Tr),
    Fnma(Tr, Tr, Tr),
    Div(Tr, Tr),
    Sqrt(Tr),
    Tanh(Tr),
    Min(Tr, Tr),
    Max(Tr, Tr),
    Abs(Tr),
    Select(Tr, Tr, Tr, Tr),
    Sin(Tr),
    Cos(Tr),
}

/// Place of a node in the recording of this thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Tr(u32);

thread_local! {
    static RECORDING: RefCell<Vec<Node>> = const { RefCell::new(Vec::new()) };
}

fn record(node: Node) -> Tr {
    RECORDING.with_borrow_mut(|nodes| {
        nodes.push(node);
        Tr(nodes.len() as u32 - 1)
    })
}

impl Add for Tr {
    type Output = Tr;
    fn add(self, b: Tr) -> Tr {
        record(Node::Add(self, b))
    }
}
impl Sub for Tr {
    type Output = Tr;
    fn sub(self, b: Tr) -> Tr {
        record(Node::Sub(self, b))
    }
}
impl Mul for Tr {
    type Output = Tr;
    fn mul(self, b: Tr) -> Tr {
        record(Node::Mul(self, b))
    }
}
impl Neg for Tr {
    type Output = Tr;
    fn neg(self) -> Tr {
        record(Node::Neg(self))
    }
}

impl Real for Tr {
    type K = f64;
    fn constant(x: f64) -> f64 {
        x
    }
    fn k(x: f64) -> Tr {
        record(Node::Constant(x))
    }
    fn fma(self, b: Tr, c: Tr) -> Tr {
        record(Node::Fma(self, b, c))
    }
    fn fnma(self, b: Tr, c: Tr) -> Tr {
        record(Node::Fnma(self, b, c))
    }
    fn div(self, b: Tr) -> Tr {
        record(Node::Div(self, b))
    }
    fn sqrt(self) -> Tr {
        record(Node::Sqrt(self))
    }
    fn tanh(self) -> Tr {
        record(Node::Tanh(self))
    }
    fn min(self, b: Tr) -> Tr {
        record(Node::Min(self, b))
    }
    fn max(self, b: Tr) -> Tr {
        record(Node::Max(self, b))
    }
    fn abs(self) -> Tr {
        record(Node::Abs(self))
    }
    fn select_lt(a: Tr, b: Tr, x: Tr, y: Tr) -> Tr {
        record(Node::Select(a, b, x, y))
    }
    fn sin_cos(self) -> (Tr, Tr) {
        (record(Node::Sin(self)), record(Node::Cos(self)))
    }
}

/// Values of all nodes for the given inputs, with the arithmetic of `f64`'s own [`Real`].
fn evaluate(nodes: &[Node], inputs: &[f64]) -> Vec<f64> {
    let mut values: Vec<f64> = Vec::with_capacity(nodes.len());
    for node in nodes {
        let at = |tr: Tr| values[tr.0 as usize];
        values.push(match *node {
            Node::Input(index) => inputs[index],
            Node::Constant(x) => x,
            Node::Add(a, b) => at(a) + at(b),
            Node::Sub(a, b) => at(a) - at(b),
            Node::Mul(a, b) => at(a) * at(b),
            Node::Neg(a) => -at(a),
            Node::Fma(a, b, c) => at(a).fma(at(b), at(c)),
            Node::Fnma(a, b, c) => at(a).fnma(at(b), at(c)),
            Node::Div(a, b) => Real::div(at(a), at(b)),
            Node::Sqrt(a) => at(a).sqrt(),
            Node::Tanh(a) => at(a).tanh(),
            Node::Min(a, b) => Real::min(at(a), at(b)),
            Node::Max(a, b) => Real::max(at(a), at(b)),
            Node::Abs(a) => at(a).abs(),
            Node::Select(a, b, x, y) => f64::select_lt(at(a), at(b), at(x), at(y)),
            Node::Sin(a) => at(a).sin(),
            Node::Cos(a) => at(a).cos(),
        });
    }
    values
}

const SUBSTEPS: usize = 2;
const TAPS: usize = 3;

/// A recorded control period: inputs are the state, the parameters and the targets, in that order.
struct Program {
    nodes: Vec<Node>,
    outputs: Vec<Tr>,
}

fn record_period(model: &Model, settings: &Settings) -> Program {
    RECORDING.with_borrow_mut(Vec::clear);
    let tree = compile::<Tr>(model, settings).unwrap();
    let count = RefCell::new(0);
    let input = || {
        let index = *count.borrow();
        *count.borrow_mut() += 1;
        record(Node::Input(index))
    };
    let blank = State::<Tr>::new(&tree);
    let inputs: Vec<Tr> = values(&blank).iter().map(|_| input()).collect();
    let mut state = state_of::<Tr>(&tree, &inputs);
    let nominal = Robot::nominal(model).params(model).unwrap();
    let params = Params::<Tr>::pack(&[&nominal], |_| input());
    let mut targets: Vec<Tr> = (0..TAPS * tree.joints()).map(|_| input()).collect();
    let modifications = networks::<Tr>(tree.joints());
    let mut memory = vec![Tr::zero(); memory_of(&modifications)];
    settle(&modifications, &params, &state, &mut memory);
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
    Program { nodes: RECORDING.take(), outputs: values(&state) }
}

/// Compares recording and `f64` on the states of a fixture file; returns how many contact points each state has.
fn compare(model: &Model, preset: Preset, file: &str) -> BTreeSet<usize> {
    let settings = Settings::new(&model.options, preset);
    let program = record_period(model, &settings);
    let tree = compile::<f64>(model, &settings).unwrap();
    let data = Arrays::open(&here(&format!("tests/fixtures/{file}.npz")));
    let mut random = Random(11);
    let mut patterns = BTreeSet::new();
    let (mut limited, mut worst) = (0, 0.0f64);
    for index in 0..data.len("qpos") {
        let mut state = state_from(&tree, data.row("qpos", index), data.row("qvel", index)).unwrap();
        let mut robot = Robot::nominal(model);
        robot.kp = vec![random.uniform(10.0, 60.0); tree.joints()];
        robot.kd = vec![random.uniform(0.0, 2.0); tree.joints()];
        robot.delay = vec![random.uniform(0.0, 0.02); tree.joints()];
        robot.encoder_bias = random.signed(tree.joints(), 0.02);
        robot.base_mass = random.uniform(-1.0, 2.0);
        robot.friction_scale = random.uniform(0.5, 1.5);
        let params = robot.params(model).unwrap();
        let targets: Vec<f64> =
            (0..TAPS).flat_map(|_| state.q.clone()).map(|q| q + random.uniform(-0.4, 0.4)).collect();

        let rows = constraint_rows(&tree, &params, &state, &mut Work::new(&tree));
        limited += rows.iter().filter(|row| matches!(row.kind, RowKind::Limit(_))).count();
        let points = rows.iter().filter_map(|row| match row.kind {
            RowKind::Contact(pair, point) => Some((pair, point)),
            _ => None,
        });
        patterns.insert(points.collect::<BTreeSet<_>>().len());

        let inputs = [values(&state), param_values(&params), targets.clone()].concat();
        let modifications = networks::<f64>(tree.joints());
        let mut memory = vec![0.0; memory_of(&modifications)];
        settle(&modifications, &params, &state, &mut memory);
        let nodes = evaluate(&program.nodes, &inputs);
        let got: Vec<f64> = program.outputs.iter().map(|tr| nodes[tr.0 as usize]).collect();
        control_period(&mut Period {
            tree: &tree,
            params: &params,
            targets: &mut targets.clone(),
            disturbance: &[],
            modifications: &modifications,
            memory: &mut memory,
            substeps: SUBSTEPS,
            state: &mut state,
            work: &mut Work::new(&tree),
            drives: &mut vec![Drive::zero(); tree.joints()],
        });
        for (got, want) in got.iter().zip(&values(&state)) {
            assert!(want.is_finite(), "state {index} diverges");
            let error = (got - want).abs() / want.abs().max(1.0);
            assert!(error <= 1e-12, "state {index}: recorded {got}, computed {want}");
            worst = worst.max(error);
        }
    }
    assert!(limited > 0, "no state at a limit");
    println!(
        "{file}, {preset:?}: {} operations, off by {worst:.1e}, contact points {patterns:?}",
        program.nodes.len()
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

/// Recording needs no numbers: two recordings are the same program.
#[test]
fn recording_does_not_depend_on_data() {
    let model = robot("go2");
    let settings = Settings::new(&model.options, Preset::Accurate);
    let (a, b) = (record_period(&model, &settings), record_period(&model, &settings));
    assert_eq!(a.outputs, b.outputs);
    assert_eq!(format!("{:?}", a.nodes), format!("{:?}", b.nodes));
    let states = values(&State::<f64>::new(&compile::<f64>(&model, &settings).unwrap())).len();
    let read = a.nodes.iter().filter(|node| matches!(node, Node::Input(_))).count();
    assert!(read > states);
}
