//! Speed of the physics: a randomised batch of robots trotting in place.

use std::time::Instant;

use gaitfit_isa::selected;
use gaitfit_model::{Model, Shape};
use gaitfit_physics::{
    Drive, Isa, Lanes, Params, Period, Preset, Robot, Settings, State, Work, compile, with_lanes,
};

use gaitfit_random::{Purpose, Stream};

use crate::{SimError, pool};

/// Choice of the contact geoms that take part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Geoms {
    /// Spheres at the ends of limbs only.
    Feet,
    /// Every geom of the model.
    All,
}

impl Geoms {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Geoms::Feet => "feet",
            Geoms::All => "all",
        }
    }
}

/// Settings of a measurement.
#[derive(Clone, Debug)]
pub struct PhysicsBench {
    /// Solver effort.
    pub preset: Preset,
    /// Contact geoms.
    pub geoms: Geoms,
    /// Threads.
    pub threads: usize,
    /// Instruction set; `None` takes the program's (see [`gaitfit_isa`]).
    pub isa: Option<Isa>,
    /// Environments, rounded up to whole blocks.
    pub environments: usize,
    /// Measured repetitions of ten control periods of the whole batch.
    pub repetitions: usize,
}

/// Results of a measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct PhysicsSpeed {
    /// Environment substeps per second, median over repetitions.
    pub substeps_per_second: f64,
    /// Substeps a second of the best repetition.
    pub best_substeps_per_second: f64,
    /// Threads used.
    pub threads: usize,
    /// Environments in one vector.
    pub lanes: usize,
    /// Instruction set.
    pub isa: Isa,
    /// Environments simulated.
    pub environments: usize,
    /// Share of feet (or contact points) in contact at the end, averaged over environments.
    pub contacts: f64,
    /// Mean height of the base at the end, m: a fallen batch would measure something else.
    pub base_height: f64,
}

/// Physics steps in one control period of the benchmark (policy at 50 Hz, physics at 200 Hz).
pub const SUBSTEPS: usize = 4;
/// Control periods that a block runs in one go, as it does in a replay. One would measure the start of threads too.
const PERIODS: usize = 10;
/// Dry friction of the benchmark's joints, N·m.
const FRICTIONLOSS: f64 = 0.2;

/// Physics step of the benchmark, s.
pub const TIMESTEP: f64 = 0.005;

/// Keeps the feet only, if asked: spheres on bodies without children.
pub fn with_geoms(model: &Model, geoms: Geoms) -> Model {
    let mut model = model.clone();
    if geoms == Geoms::Feet {
        let leaf = |body: usize| !model.bodies.iter().any(|other| other.parent == Some(body));
        let foot = |geom: usize| {
            let geom = &model.geoms[geom];
            matches!(geom.shape, Shape::Sphere { .. }) && leaf(geom.body)
        };
        let kept: Vec<_> = model.pairs.iter().filter(|pair| foot(pair.geom)).cloned().collect();
        model.pairs = kept;
    }
    model
}

/// Measures the step on `model`, whose joints must be in groups of hip, thigh, calf.
///
/// Each environment has its own base mass, friction, gains and joint friction. The robots hold the pose of the
/// first keyframe and lift diagonal pairs of legs in turn at 2 Hz.
///
/// # Errors
/// A model that cannot be stepped, or has no keyframe or no joints in threes.
pub fn physics(model: &Model, bench: &PhysicsBench) -> Result<PhysicsSpeed, SimError> {
    let isa = bench.isa.map_or_else(selected, Isa::checked)?;
    let model = with_geoms(model, bench.geoms);
    with_lanes!(isa, T => measure::<T>(&model, bench, isa))
}

struct Batch<T> {
    params: Params<T>,
    state: State<T>,
}

/// Scratch of one thread.
struct Scratch<T: Lanes> {
    work: Work<T>,
    drives: Vec<Drive<T>>,
    targets: Vec<T>,
}

fn measure<T: Lanes>(model: &Model, bench: &PhysicsBench, isa: Isa) -> Result<PhysicsSpeed, SimError> {
    let joints = model.joints.len();
    let (height, pose) = standing(model)?;
    let settings = Settings { timestep: TIMESTEP, ..Settings::new(&model.options, bench.preset) };
    let tree = compile::<T>(model, &settings)?;
    // A block has one robot a lane.
    let blocks = bench.environments.div_ceil(T::LANES).max(1);
    let mut batches = Vec::with_capacity(blocks);
    for block in 0..blocks {
        let sets = (0..T::LANES)
            .map(|lane| random_robot(model, (block * T::LANES + lane) as u32).params(model))
            .collect::<Result<Vec<_>, _>>()?;
        let sets: Vec<&Params<f64>> = sets.iter().collect();
        let params = Params::in_lanes(&sets);
        let mut state = State::<T>::new(&tree);
        state.base_position[2] = T::lit(height);
        for (q, angle) in state.qpos.iter_mut().zip(&pose) {
            *q = T::lit(*angle);
        }
        // Each job has a block of its own, so the lock never waits.
        batches.push(std::sync::Mutex::new(Batch { params, state }));
    }
    let scratch = || Scratch {
        work: Work::new(&tree),
        drives: vec![Drive::zero(); joints],
        targets: vec![T::zero(); joints],
    };
    let period = |scratch: &mut Scratch<T>, batch: &mut Batch<T>, targets: &[T]| {
        scratch.targets.copy_from_slice(targets);
        T::control_period(&mut Period {
            tree: &tree,
            params: &batch.params,
            targets: &mut scratch.targets,
            // Neither disturbances nor modifications: the plain step is measured.
            disturbance: &[],
            modifications: &[],
            memory: &mut [],
            substeps: SUBSTEPS,
            state: &mut batch.state,
            work: &mut scratch.work,
            drives: &mut scratch.drives,
        });
    };
    let targets = |period: usize| -> Vec<T> { trot(&pose, period).into_iter().map(T::lit).collect() };

    let mut times = Vec::with_capacity(bench.repetitions);
    const WARM_UP: usize = 3;
    for repetition in 0..bench.repetitions + WARM_UP {
        // Targets are made before the clock starts.
        let sent: Vec<Vec<T>> = (0..PERIODS).map(|k| targets(repetition * PERIODS + k)).collect();
        let start = Instant::now();
        pool::for_each(blocks, bench.threads, scratch, |scratch, index| {
            let Ok(mut batch) = batches[index].lock() else { return };
            for targets in &sent {
                period(scratch, &mut batch, targets);
            }
        });
        // A first repetition is slower: it touches its memory for the first time.
        if repetition >= WARM_UP {
            times.push(start.elapsed().as_secs_f64());
        }
    }
    times.sort_by(f64::total_cmp);
    let steps = (blocks * T::LANES * SUBSTEPS * PERIODS) as f64;
    // One more period, not timed, to look at the contacts.
    let last = targets((bench.repetitions + WARM_UP) * PERIODS);
    let mut scratch = scratch();
    let (mut height, mut contacts) = (0.0, 0.0);
    for batch in &batches {
        let Ok(mut batch) = batch.lock() else { continue };
        period(&mut scratch, &mut batch, &last);
        // As wide as the widest vectors, of AVX-512.
        let mut values = [0.0f32; 16];
        batch.state.base_position[2].store(&mut values);
        height += values[..T::LANES].iter().sum::<f32>() as f64;
        for stiffness in scratch.work.contact_stiffness(&tree) {
            stiffness.store(&mut values);
            contacts += values[..T::LANES].iter().filter(|&&d| d > 0.0).count() as f64;
        }
    }
    let environments = blocks * T::LANES;
    Ok(PhysicsSpeed {
        // Times ascend: the middle one is the median, and the first one is the best.
        substeps_per_second: steps / times[times.len() / 2],
        best_substeps_per_second: steps / times[0],
        threads: bench.threads,
        lanes: T::LANES,
        isa,
        environments,
        contacts: contacts / environments as f64,
        base_height: height / environments as f64,
    })
}

/// Height of the base, m, and joint angles, rad, of the robot's first keyframe.
///
/// # Errors
/// A robot without one, or without joints in threes.
pub fn standing(model: &Model) -> Result<(f64, Vec<f64>), SimError> {
    // A free base has seven numbers: a position and a quaternion.
    let floats = model.nq() == 7 + model.joints.len() && model.joints.len().is_multiple_of(3);
    match model.keyframes.first().filter(|_| floats) {
        Some(key) => Ok((key.qpos[2], key.qpos[7..].to_vec())),
        None => Err(SimError::Option {
            option: "the benchmark's robot",
            value: model.name.clone(),
            must: "a floating robot with three joints a leg and a keyframe",
        }),
    }
}

/// Targets of control period `period`, rad: diagonal pairs of legs lift in turn at 2 Hz.
pub fn trot(pose: &[f64], period: usize) -> Vec<f64> {
    // 0.02 s is the control period, SUBSTEPS · TIMESTEP.
    let phase = (period as f64 * 0.02 * 2.0 * std::f64::consts::TAU).sin();
    pose.iter().enumerate().map(|(j, angle)| angle + lift(j, phase)).collect()
}

/// Target offset of joint `j` (hip, thigh, calf of leg `j / 3`) when diagonal pairs lift in turn.
fn lift(j: usize, phase: f64) -> f64 {
    // Legs are in the order front left, front right, rear left, rear right: 0 and 3 are a diagonal.
    let diagonal = matches!(j / 3 % 4, 0 | 3);
    // While its phase is negative a pair stands, and the other one lifts.
    let up = if diagonal { phase } else { -phase }.max(0.0);
    match j % 3 {
        // The calf turns back by twice the thigh's angle: a leg with links of equal length lifts its foot
        // straight up.
        0 => 0.0,
        1 => 0.35 * up,
        _ => -0.7 * up,
    }
}

/// The robot of environment `environment`: its own base mass, friction, gains and joint friction.
pub fn random_robot(model: &Model, environment: u32) -> Robot {
    let stream = Stream::new(0, Purpose::RANDOMISATION).environment(environment);
    let draw = |number: u32| stream.uniform(number);
    let joints = model.joints.len();
    let mut robot = Robot::nominal(model);
    robot.kp = vec![60.0 + 10.0 * draw(0); joints];
    robot.kd = vec![1.5 + 0.5 * draw(1); joints];
    robot.base_mass = -1.0 + 3.0 * draw(2);
    robot.friction_scale = 0.8 + 0.4 * draw(3);
    robot.frictionloss = (0..joints).map(|j| FRICTIONLOSS * (0.5 + draw(4 + j as u32))).collect();
    robot.armature = vec![0.01; joints];
    robot
}
