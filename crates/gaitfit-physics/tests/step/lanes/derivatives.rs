//! Derivatives of whole control periods: duals against differences of plain numbers.

use super::*;
use gaitfit_physics::{Differentiable, Dual, Isa, State};

const TAPS: usize = 3;
const SUBSTEPS: usize = 2;

/// All that goes into a period, as flat lists.
#[derive(Clone)]
struct Inputs {
    state: Vec<f64>,
    params: Vec<f64>,
    targets: Vec<f64>,
}

/// A direction of the inputs: all numbers of one name.
struct Direction {
    name: &'static str,
    of_state: bool,
}

const DIRECTIONS: [(&str, bool); 20] = [
    ("frictionloss", false),
    ("stiction", false),
    ("stribeck_velocity", false),
    ("load_friction", false),
    ("no_load_speed", false),
    ("stall_torque", false),
    ("armature", false),
    ("damping", false),
    ("delay", false),
    ("encoder_bias", false),
    ("torque_scale", false),
    ("stiffness", false),
    ("kp", false),
    ("kd", false),
    ("mass", false),
    ("friction_scale", false),
    ("qpos", true),
    ("qvel", true),
    ("linear", true),
    ("angular", true),
];

/// What a control period makes of `inputs`, with their change along the direction.
fn period<T: gaitfit_physics::Real<K = f64>>(
    model: &Model,
    settings: &Settings,
    inputs: &Inputs,
    number: impl Fn(f64, usize, bool) -> T,
    advance: fn(&mut Period<'_, T>),
) -> Vec<T> {
    let tree = compile::<T>(model, settings).unwrap();
    let state: Vec<T> = inputs.state.iter().enumerate().map(|(at, &x)| number(x, at, true)).collect();
    let mut state: State<T> = state_of(&tree, &state);
    let template = Robot::nominal(model).params(model).unwrap();
    let mut params = Params::<T>::zeros(template.links.len(), template.joints.len(), template.pairs.len());
    let mut at = 0;
    params.visit_mut(|_, slot| {
        *slot = number(inputs.params[at], at, false);
        at += 1;
    });
    let mut targets: Vec<T> = inputs.targets.iter().map(|&x| T::lit(x)).collect();
    advance(&mut Period {
        tree: &tree,
        params: &params,
        targets: &mut targets,
        disturbance: &[],
        modifications: &[],
        memory: &mut [],
        substeps: SUBSTEPS,
        state: &mut state,
        work: &mut Work::new(&tree),
        drives: &mut vec![Drive::zero(); tree.joints()],
    });
    values(&state)
}

/// How much a unit of the direction changes each input: something else for every one of the name.
fn slopes(model: &Model, settings: &Settings, direction: &Direction) -> [Vec<f64>; 2] {
    let tree = compile::<f64>(model, settings).unwrap();
    let slope = |name: &str, of_state: bool, at: usize| match direction.of_state == of_state
        && direction.name == name
    {
        true => 1.0 + 0.5 * (1.7 * at as f64).sin(),
        false => 0.0,
    };
    let (mut state, mut params) = (Vec::new(), Vec::new());
    State::<f64>::new(&tree).visit(|slot, _| state.push(slope(slot.name, true, state.len())));
    let template = Robot::nominal(model).params(model).unwrap();
    template.visit(|slot, _| params.push(slope(slot.name, false, params.len())));
    [state, params]
}

/// Compares all directions on the states of a fixture file, lifted by `lift`, m. Differences that depend on their width
/// cross a kink and say nothing.
fn compare(model: &Model, file: &str, preset: Preset, centred: bool, lift: f64) {
    let settings = Settings { centred, ..Settings::new(&model.options, preset) };
    let data = Arrays::open(&here(&format!("tests/fixtures/{file}.npz")));
    let tree = compile::<f64>(model, &settings).unwrap();
    let elliptic = model.options.cone == Cone::Elliptic;
    let (mut checked, mut kinks, mut ties) = (0, 0, 0);
    let mut ledger = Ledger::default();
    for index in 0..data.len("qpos").min(12) {
        let mut random = Random(100 + index as u64);
        let mut state = state_from(&tree, data.row("qpos", index), data.row("qvel", index)).unwrap();
        state.base_position[2] += lift;
        let joints = tree.joints();
        // A joint beyond each limit.
        for (j, joint) in model.joints.iter().enumerate().take(2) {
            if let (Some([low, high]), true) = (joint.range, index % 2 == 0) {
                state.qpos[j] = if j == 0 { low - 0.02 } else { high + 0.03 };
            }
        }
        let mut robot = Robot::nominal(model);
        robot.kp = vec![random.uniform(20.0, 60.0); joints];
        robot.kd = vec![random.uniform(0.5, 2.0); joints];
        robot.damping.iter_mut().for_each(|x| *x = random.uniform(0.1, 0.5));
        robot.armature.iter_mut().for_each(|x| *x = random.uniform(0.01, 0.05));
        robot.frictionloss.iter_mut().for_each(|x| *x = random.uniform(0.1, 0.5));
        robot.delay = vec![random.uniform(0.001, 0.003); joints];
        robot.encoder_bias = random.signed(joints, 0.02);
        // The others have none of it, and a derivative by it where it is a number.
        for j in 0..joints {
            if j % 2 == 0 {
                (robot.stiction[j], robot.stribeck_velocity[j]) = (0.2, 0.7);
                robot.load_friction[j] = 0.05;
            }
            // With no speed at all a difference would go to and fro across where it begins.
            (robot.no_load_speed[j], robot.stall_torque[j]) =
                if j % 2 == 0 { (6.0, 9.0) } else { (50.0, 1e3) };
        }
        let targets = (0..TAPS).flat_map(|_| state.qpos.clone()).map(|q| q + random.uniform(-0.3, 0.3));
        let inputs = Inputs {
            targets: targets.collect(),
            state: values(&state),
            params: crate::common::batch::param_values(&robot.params(model).unwrap()),
        };
        for (name, of_state) in DIRECTIONS {
            let slopes = slopes(model, &settings, &Direction { name, of_state });
            let slope = |at: usize, of_state: bool| slopes[usize::from(!of_state)][at];
            let dual = |x: f64, at: usize, of_state: bool| Dual::new(x, slope(at, of_state));
            let found = period(model, &settings, &inputs, dual, gaitfit_physics::control_period);
            let plain = |by: f64| {
                let number = |x, at, of_state| x + by * slope(at, of_state);
                period(model, &settings, &inputs, number, control_period)
            };
            let value: Vec<f64> = found.iter().map(|one| one.value).collect();
            assert_eq!(value, plain(0.0), "{name}: values of duals are those of plain numbers");
            let width = match name {
                "delay" => 2e-7,
                // A motor's torque hardly depends on it: narrower, rounding is a millionth of the difference.
                "no_load_speed" => 1e-3,
                _ => 1e-5,
            };
            let difference = |h: f64| -> Vec<f64> {
                plain(h).iter().zip(plain(-h)).map(|(up, down)| (up - down) / (2.0 * h)).collect()
            };
            let (wide, narrow) = (difference(width), difference(0.5 * width));
            let scale = crate::common::largest(&narrow).max(1e-3);
            // Differences err by the square of their width: this takes that part away.
            let wanted: Vec<f64> = narrow.iter().zip(&wide).map(|(n, w)| n + (n - w) / 3.0).collect();
            // How far two differences are apart says how far either may be off.
            let apart = crate::common::difference(&narrow, &wide) / scale;
            if apart > 1e-5 {
                kinks += 1;
                continue;
            }
            checked += 1;
            let tangent: Vec<f64> = found.iter().map(|one| one.tangent).collect();
            let error = crate::common::difference(&tangent, &wanted) / scale - apart;
            if error > 1e-6 && elliptic {
                println!("{name} of state {index} is off by {error:.1e}");
                ties += 1;
                continue;
            }
            ledger.note(name, error.max(0.0), 1e-6, || format!("state {index}"));
        }
    }
    println!("{checked} derivatives, {kinks} kinks, {ties} ties");
    ledger.check(&format!("derivatives, {file}, {}, lifted {lift}", preset.name()));
    assert!(checked > 5 * kinks, "{checked} derivatives could be checked, {kinks} not");
    // A line search that arrives by two ways: see the head of `Dual`.
    assert!(checked >= 50 * ties, "{ties} of {checked} derivatives are wrong");
}

#[test]
fn a_period_on_the_ground_has_its_derivatives() {
    let model = robot("go2");
    for preset in [Preset::Fast, Preset::Accurate, Preset::Converged] {
        compare(&model, "states_go2_pyr_imp1_fl", preset, false, 0.0);
    }
}

#[test]
fn a_period_in_the_air_has_its_derivatives() {
    let model = robot("go2");
    for preset in [Preset::Accurate, Preset::Converged] {
        compare(&model, "states_go2_pyr_imp1_fl", preset, true, 2.0);
    }
}

#[test]
fn a_period_of_telescopic_legs_has_its_derivatives() {
    compare(&robot("telescope"), "states_telescope_pyr_imp1_fl", Preset::Accurate, true, 2.0);
    compare(&robot("telescope"), "states_telescope_pyr_imp1_fl", Preset::Converged, false, 0.0);
}

#[test]
fn a_period_of_coupled_joints_has_its_derivatives() {
    for (name, states) in [("hand", "states_hand_pyr_imp1_fl"), ("gears", "states_gears_pyr_imp1_fl")] {
        compare(&robot(name), states, Preset::Accurate, true, 2.0);
        compare(&robot(name), states, Preset::Converged, false, 0.0);
    }
}

#[test]
fn a_period_with_elliptic_cones_has_its_derivatives() {
    let mut model = robot("go2");
    model.options.cone = Cone::Elliptic;
    for preset in [Preset::Accurate, Preset::Converged] {
        compare(&model, "states_go2_ell_imp1_nofl", preset, false, 0.0);
    }
}

/// Lanes of duals compute what lanes compute, on each instruction set of this machine.
#[test]
fn lanes_of_duals_have_the_values_of_lanes() {
    for isa in Isa::found() {
        gaitfit_physics::with_lanes!(isa, T => values_of_duals::<T>(isa));
    }
}

fn values_of_duals<T: Differentiable>(isa: Isa) {
    for (name, file) in [("go2", "states_go2_pyr_imp1_fl"), ("terrain", "states_terrain_pyr_imp1_fl")] {
        let mut model = robot(name);
        for cone in [Cone::Pyramidal, Cone::Elliptic] {
            model.options.cone = cone;
            let settings = Settings::new(&model.options, Preset::Accurate);
            let cases = cases(&model, file, T::LANES);
            let all: Vec<usize> = (0..T::LANES).collect();
            let plain = run_block::<T>(&model, &settings, &cases, &all, 2);
            let dual = run_block::<Dual<T>>(&model, &settings, &cases, &all, 2);
            for (index, (plain, dual)) in plain.iter().zip(&dual).enumerate() {
                assert!(same_bits(plain, dual), "{isa:?}: the values of duals differ in environment {index}");
            }
        }
    }
}
