//! Robots, and states in which they move, touch and reach their limits.
#![allow(dead_code, reason = "each test uses its part")]
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_cuda::emit::{EmitOptions, PeriodProgram, Seating};
use gaitfit_model::{HeightField, Model, ObstacleShape, ReadOptions, SelfContact, Shape, read};
use gaitfit_physics::in_f64::control_period;
use gaitfit_physics::trace::{PeriodGraph, Report, Traced, record_period_with};
use gaitfit_physics::{
    ActionDelta, Drive, Gears, JointModification, JointNetwork, Modify, NetworkScales, Params, Period, Real,
    ResidAct, Robot, Settings, State, Tree, VelocityFilter, Work, compile, memory_of, settle,
};

/// A robot of the repository: `go2` or one of the physics tests'.
pub fn robot(name: &str) -> Model {
    let place = match name {
        "go2" => "../../assets/go2.xml".to_owned(),
        name => format!("../gaitfit-physics/tests/fixtures/{name}.xml"),
    };
    let path = format!("{}/{place}", env!("CARGO_MANIFEST_DIR"));
    read(path.as_ref(), &ReadOptions::default()).unwrap()
}

/// Only spheres on bodies without children touch the ground.
pub fn feet(mut model: Model) -> Model {
    let leaf = |body: usize| !model.bodies.iter().any(|other| other.parent == Some(body));
    let foot = |geom: usize| {
        let geom = &model.geoms[geom];
        matches!(geom.shape, Shape::Sphere { .. }) && leaf(geom.body)
    };
    let kept: Vec<_> = model.pairs.iter().filter(|pair| foot(pair.geom)).cloned().collect();
    model.pairs = kept;
    model
}

/// On a rough height field in the planes' place.
pub fn on_field(model: Model) -> Model {
    let mut random = Random(11);
    let (rows, columns) = (41, 31);
    let heights = (0..rows * columns).map(|_| random.uniform(-0.04, 0.04)).collect();
    model.on_field("rough", HeightField { rows, columns, half_size: [1.5, 2.0], heights })
}

/// On a box in the planes' place.
pub fn on_box(model: Model) -> Model {
    let mut model = on_field(model);
    model.obstacles[0].pos[2] = -0.5;
    model.obstacles[0].shape = ObstacleShape::Box { half_size: [0.6, 0.7, 0.5] };
    model
}

/// The model with self-contact of the pairs that `chosen` selects.
pub fn touching(model: &Model, chosen: &SelfContact) -> Model {
    model.touching_itself(chosen).unwrap().0
}

/// `extras`: networks that act on the joints, disturbing torques, and a report of everything.
pub fn recorded(
    model: &Model,
    settings: &Settings,
    taps: usize,
    substeps: usize,
    extras: bool,
) -> (PeriodGraph, Tree<gaitfit_physics::trace::Known>) {
    let tree = compile::<Traced>(model, settings).unwrap();
    let modifications = if extras { modifications::<Traced>(tree.joints()) } else { Vec::new() };
    let tracked = if extras { (0..tree.model_pairs().len()).collect() } else { Vec::new() };
    let report = Report { disturbed: extras, forces: extras, tracked, ..Report::default() };
    (record_period_with(&tree, taps, substeps, &modifications, &report).unwrap(), tree)
}

pub fn shared(
    period: &PeriodGraph,
    tree: &Tree<gaitfit_physics::trace::Known>,
    lanes: usize,
    min_guarded: usize,
) -> PeriodProgram {
    let outline = tree.outline();
    let seating =
        if lanes == 1 { Seating::alone(&outline) } else { Seating::shared(&outline, lanes).unwrap() };
    PeriodProgram::new(period, &seating, EmitOptions { min_guarded }).unwrap()
}

/// One ActionDelta and one ResidAct on all joints, with weights that matter, gears, and a filter of velocities.
pub fn modifications<T: Real>(joints: usize) -> Vec<JointModification<T::K>> {
    let all: Vec<usize> = (0..joints).collect();
    let mut all = networks::<T>(&all, &all);
    all.push(JointModification::Gears(Gears { joints }));
    all.push(JointModification::VelocityFilter(VelocityFilter { joints }));
    all
}

/// An ActionDelta on some joints and a ResidAct on some.
pub fn networks<T: Real>(delta: &[usize], torque: &[usize]) -> Vec<JointModification<T::K>> {
    let network = |joint: usize, output: f64| {
        let weights = std::array::from_fn(|i| 0.8 * (1.3 * i as f64 + 5.0 * joint as f64 + output).sin());
        let scales = NetworkScales { position: 1.0, velocity: 0.05, output };
        JointNetwork::new::<T>(joint, &weights, scales, 0.1)
    };
    vec![
        JointModification::ActionDelta(ActionDelta(
            delta.iter().map(|&joint| network(joint, 0.05)).collect(),
        )),
        JointModification::ResidAct(ResidAct(torque.iter().map(|&joint| network(joint, 2.0)).collect())),
    ]
}

/// Uniform numbers (SplitMix64).
pub struct Random(pub u64);

impl Random {
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        low + (high - low) * (((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64)
    }
}

/// What one environment needs for a control period, and what the `f64` step makes of it.
pub struct Sample {
    pub inputs: Vec<f64>,
    /// Disturbing torques of all physics steps, `substeps × joints`; `inputs` has those of the first.
    pub disturbance: Vec<f64>,
    pub outputs: Vec<f64>,
}

pub fn state_values(state: &State<f64>) -> Vec<f64> {
    let mut all = Vec::new();
    state.visit(|_, &number| all.push(number));
    all
}

fn param_values(params: &Params<f64>) -> Vec<f64> {
    let mut all = Vec::new();
    params.visit(|_, &number| all.push(number));
    all
}

/// Random robots that move about: `count` control periods, each of a robot that has moved for a while. `rounded`: to
/// single precision, as a device has its inputs.
pub fn samples(
    model: &Model,
    settings: &Settings,
    taps: usize,
    substeps: usize,
    extras: bool,
    rounded: bool,
    count: usize,
) -> Vec<Sample> {
    let networks = if extras { modifications::<f64>(model.joints.len()) } else { Vec::new() };
    samples_with(model, settings, taps, substeps, (extras, networks), rounded, count)
}

/// As [`samples`], with these networks.
pub fn samples_with(
    model: &Model,
    settings: &Settings,
    taps: usize,
    substeps: usize,
    (extras, mut modifications): (bool, Vec<JointModification<f64>>),
    rounded: bool,
    count: usize,
) -> Vec<Sample> {
    let tree = compile::<f64>(model, settings).unwrap();
    let joints = tree.joints();
    let mut random = Random(5);
    let round = |x: f64| if rounded { f64::from(x as f32) } else { x };
    let mut weights = Vec::new();
    for modification in &mut modifications {
        modification.visit_weights_mut(|_, weight| {
            *weight = round(*weight);
            weights.push(*weight);
        });
    }
    let pose = model.keyframes.first().map(|key| key.qpos.clone());
    let mut all = Vec::with_capacity(count);
    while all.len() < count {
        let mut robot = Robot::nominal(model);
        robot.kp = vec![random.uniform(30.0, 70.0); joints];
        robot.kd = vec![random.uniform(1.0, 2.0); joints];
        robot.delay = (0..joints).map(|_| if taps > 1 { random.uniform(0.0, 0.02) } else { 0.0 }).collect();
        robot.encoder_bias = (0..joints).map(|_| random.uniform(-0.02, 0.02)).collect();
        robot.frictionloss = (0..joints).map(|_| random.uniform(0.1, 0.3)).collect();
        robot.armature = vec![0.01; joints];
        // Every other robot has friction at rest, torque that falls with speed, and links of its own.
        if all.len() % 2 == 1 {
            robot.stiction.fill(0.2);
            robot.stribeck_velocity.fill(0.5);
            robot.load_friction.fill(0.1);
            robot.play.fill(0.01);
            robot.velocity_lag = 0.004;
            robot.compliance.fill(0.003);
            (0..joints).step_by(2).for_each(|j| robot.no_load_speed[j] = 6.0);
            robot.stall_torque.fill(15.0);
            robot.link_mass.fill(1.2);
            robot.link_com_y.fill(0.01);
        }
        if model.has_slides() {
            // Gears are for robots of hinges.
            robot.play.fill(0.0);
            robot.compliance.fill(0.0);
        }
        robot.base_mass = random.uniform(-1.0, 2.0);
        robot.friction_scale = random.uniform(0.8, 1.2);
        let mut params = robot.params(model).unwrap();
        params.visit_mut(|_, number| *number = round(*number));
        let mut state = State::<f64>::new(&tree);
        let floating = tree.nq() > joints;
        match &pose {
            Some(pose) if floating => {
                state.base_position[2] = pose[2];
                state.qpos.copy_from_slice(&pose[7..]);
            }
            _ => state.base_position[2] = random.uniform(0.2, 1.0),
        }
        let rest = state.qpos.clone();
        let mut memory = vec![0.0; memory_of(&modifications)];
        settle(&modifications, &params, &state, &mut memory);
        let periods = 3 + random.uniform(0.0, 25.0) as usize;
        for period in 0..=periods {
            let targets: Vec<f64> = (0..taps)
                .flat_map(|_| rest.clone())
                .map(|angle| round(angle + random.uniform(-0.5, 0.5)))
                .collect();
            if period == periods {
                state.visit_mut(|_, number| *number = round(*number));
                for number in &mut memory {
                    *number = round(*number);
                }
            }
            // A recording in `f64` has one number for all physics steps.
            let mut disturbance: Vec<f64> = Vec::new();
            for step in 0..if extras { substeps * joints } else { 0 } {
                let again = step.checked_sub(joints).filter(|_| !rounded).map(|first| disturbance[first]);
                disturbance.push(again.unwrap_or_else(|| round(random.uniform(-2.0, 2.0))));
            }
            let first = disturbance.get(..joints).unwrap_or_default().to_vec();
            let before =
                [state_values(&state), param_values(&params), targets.clone(), first, memory.clone()];
            let (mut work, mut drives) = (Work::new(&tree), vec![Drive::zero(); joints]);
            let mut corrected = targets;
            control_period(&mut Period {
                tree: &tree,
                params: &params,
                targets: &mut corrected,
                disturbance: &disturbance,
                modifications: &modifications,
                memory: &mut memory,
                substeps,
                state: &mut state,
                work: &mut work,
                drives: &mut drives,
            });
            if state_values(&state).iter().any(|number| !number.is_finite()) {
                break;
            }
            if period == periods {
                let inputs = [before.concat(), weights.clone()].concat();
                let mut outputs = [state_values(&state), memory.clone()].concat();
                let delta = |one: &JointModification<f64>| matches!(one, JointModification::ActionDelta(_));
                if taps > 1 && modifications.iter().any(delta) {
                    outputs.extend_from_slice(&corrected[..joints]);
                }
                if extras {
                    outputs.extend(shown(&tree, &state, &work, &drives));
                }
                all.push(Sample { inputs, disturbance, outputs });
            }
        }
    }
    all
}

/// What a report of everything holds.
fn shown(tree: &Tree<f64>, state: &State<f64>, work: &Work<f64>, drives: &[Drive<f64>]) -> Vec<f64> {
    let pairs = 0..tree.model_pairs().len();
    let mut all: Vec<f64> = drives.iter().map(|drive| drive.torque).collect();
    all.extend(pairs.clone().map(|pair| work.normal_force(tree, pair)));
    let h = tree.settings().timestep;
    for pair in pairs {
        let center = work.pair_center(tree, pair);
        all.extend((0..3).map(|k| state.base_position[k] - h * state.base_linear[k] + center[k]));
    }
    all
}

/// Largest difference relative to max(1, value).
pub fn difference(got: &[f64], want: &[f64]) -> f64 {
    assert_eq!(got.len(), want.len());
    got.iter().zip(want).fold(0.0, |worst, (got, want)| {
        let error = (got - want).abs() / want.abs().max(1.0);
        if error.is_nan() { f64::INFINITY } else { worst.max(error) }
    })
}
