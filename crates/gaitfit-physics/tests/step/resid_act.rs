//! A network that resists changes of velocity stands for rotor inertia, also for more than the joint's own.

use crate::common::clamped;
use gaitfit_physics::in_f64::control_period;
use gaitfit_physics::{
    Damping, Drive, JointModification, JointNetwork, NETWORK_WEIGHTS, NetworkScales, Period, Preset,
    ResidAct, Robot, Settings, State, Work, compile, memory_of, settle,
};

/// The joint that has the inertia: a calf.
const JOINT: usize = 2;
const TIMESTEP: f64 = 0.005;
/// Several times what the calf has by itself, kg·m².
const INERTIA: f64 = 0.05;

/// −s (q̇ₙ − q̇ₙ₋₁), small enough for both tanh to be straight; s in N·m·s/rad.
fn inertia_network(slope: f64) -> JointModification<f64> {
    let small = 1e-3;
    let mut weights = [0.0; NETWORK_WEIGHTS];
    (weights[8], weights[3 * 8]) = (small, -small); // inputs 1 and 3 to unit 0 of the first layer
    weights[7 * 8] = 1.0; // to unit 0 of the second
    weights[7 * 8 + 9 * 4] = -slope / small; // to the output
    let scales = NetworkScales { position: 1.0, velocity: 1.0, output: 1.0 };
    JointModification::ResidAct(ResidAct(vec![JointNetwork::new::<f64>(JOINT, &weights, scales, 0.0)]))
}

/// Angles of the joint over a second of a swinging target.
fn swing(damping: Damping, armature: f64, networks: &[JointModification<f64>]) -> Vec<f64> {
    let mut model = clamped("go2");
    model.pairs.clear();
    let settings =
        Settings { timestep: TIMESTEP, damping, ..Settings::new(&model.options, Preset::Converged) };
    let tree = compile::<f64>(&model, &settings).unwrap();
    let mut robot = Robot::nominal(&model);
    robot.kp.fill(25.0);
    robot.kd.fill(0.5);
    robot.armature[JOINT] += armature;
    let params = robot.params(&model).unwrap();
    let mut state = State::<f64>::new(&tree);
    let rest: Vec<f64> = (0..tree.joints()).map(|joint| [0.0, 0.9, -1.8][joint % 3]).collect();
    state.qpos.copy_from_slice(&rest);
    let mut memory = vec![0.0; memory_of(networks)];
    settle(networks, &params, &state, &mut memory);
    let (mut work, mut drives) = (Work::new(&tree), vec![Drive::zero(); tree.joints()]);
    (0..200)
        .map(|step| {
            let mut targets = rest.clone();
            targets[JOINT] += 0.3 * (12.0 * TIMESTEP * f64::from(step)).sin();
            control_period(&mut Period {
                tree: &tree,
                params: &params,
                targets: &mut targets,
                disturbance: &[],
                modifications: networks,
                memory: &mut memory,
                substeps: 1,
                state: &mut state,
                work: &mut work,
                drives: &mut drives,
            });
            state.qpos[JOINT]
        })
        .collect()
}

fn largest(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
}

#[test]
fn a_torque_against_changes_of_velocity_is_an_inertia_under_every_setting() {
    // Half of it counts at the step before, half at this one.
    let network = [inertia_network(0.5 * INERTIA / TIMESTEP)];
    for damping in [Damping::Explicit, Damping::Implicit, Damping::Folded] {
        let (bare, armature) = (swing(damping, 0.0, &[]), swing(damping, INERTIA, &[]));
        let felt = swing(damping, 0.0, &network);
        let (off, matters) = (largest(&felt, &armature), largest(&bare, &armature));
        println!("{damping:?}: network to armature {off:.4} rad, armature to none {matters:.4} rad");
        assert!(off < 0.1 * matters, "{damping:?}: {off} of {matters} rad");
    }
}

/// The layers' formula, computed plainly, and a difference of its outputs.
#[test]
fn the_output_is_the_formulas() {
    let weights: [f64; NETWORK_WEIGHTS] = std::array::from_fn(|i| (0.7 * i as f64).sin());
    let scales = NetworkScales { position: 2.0, velocity: 0.1, output: 3.0 };
    let network = JointNetwork::new::<f64>(0, &weights, scales, -1.5);
    let motion = [-1.2, 4.0, -1.3, 3.0, -1.45, 1.0];
    let mut x: Vec<f64> = motion.to_vec();
    for pair in x.chunks_exact_mut(2) {
        pair[0] = 2.0 * (pair[0] + 1.5);
        pair[1] *= 0.1;
    }
    let mut at = 0;
    for (inputs, outputs) in [(6, 8), (8, 4), (4, 1)] {
        let y: Vec<f64> = (0..outputs)
            .map(|o| {
                let sum: f64 = (0..inputs).map(|i| x[i] * weights[at + i * outputs + o]).sum();
                sum + weights[at + inputs * outputs + o]
            })
            .collect();
        at += (inputs + 1) * outputs;
        x = if outputs > 1 { y.iter().map(|y| y.tanh()).collect() } else { y };
    }
    assert_eq!(at, NETWORK_WEIGHTS);
    let (output, slope) = network.evaluate_with_slope(&motion);
    assert!((output - 3.0 * x[0]).abs() < 1e-12);
    let at = |velocity: f64| {
        let mut moved = motion;
        moved[1] = velocity;
        network.evaluate_with_slope(&moved).0
    };
    let difference = (at(4.0 + 1e-5) - at(4.0 - 1e-5)) / 2e-5;
    assert!((slope - difference).abs() < 1e-9 && slope.abs() > 1e-3, "{slope} {difference}");
}
