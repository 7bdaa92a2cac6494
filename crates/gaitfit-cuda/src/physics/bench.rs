//! Speed and accuracy of the physics on a GPU: the robots of the processor's benchmark.

use std::sync::Arc;
use std::time::Instant;

use gaitfit_model::Model;
use gaitfit_physics::in_f64::control_period;
use gaitfit_physics::trace::Report;
use gaitfit_physics::{
    Drive, Kept, Params, Period as Control, Preset, Robot, Settings, State, Tree, Work, compile,
};
use gaitfit_sim::SimError;
use gaitfit_sim::bench::{Geoms, SUBSTEPS, TIMESTEP, random_robot, standing, trot, with_geoms};

use super::{Batch, DeviceError, Period, PeriodOptions};
use crate::emit::EmitOptions;
use crate::runtime::{Device, Event, Stream};

/// Settings of a measurement.
#[derive(Clone, Debug)]
pub struct PhysicsBench {
    /// Solver effort.
    pub preset: Preset,
    /// Contact geoms.
    pub geoms: Geoms,
    /// Environments.
    pub environments: usize,
    /// Physics steps of a launch that is timed.
    pub substeps: usize,
    /// Threads of an environment; none for what suits the number of environments.
    pub lanes: Option<usize>,
    /// Options for making the text.
    pub emit: EmitOptions,
    /// Measured repetitions.
    pub repetitions: usize,
}

/// Results of a measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct PhysicsSpeed {
    /// Environment substeps per second, median over repetitions.
    pub substeps_per_second: f64,
    /// Environment substeps per second of the best repetition.
    pub best_substeps_per_second: f64,
    /// Threads of an environment.
    pub lanes: usize,
    /// Registers of a thread.
    pub registers: i32,
    /// Bytes of local memory of a thread.
    pub local_bytes: i32,
    /// Seconds to make and compile the text, or to take it from the cache.
    pub compile_seconds: f64,
    /// Whether it came from the cache.
    pub cached: bool,
    /// Bytes of the GPU's memory.
    pub bytes: usize,
    /// Robots held against `f64`.
    pub checked: usize,
    /// Largest error of a velocity after one control period from the same state, m/s or rad/s: of half of the robots,
    /// and of all.
    pub velocity_error: [f64; 2],
    /// Largest error of a position, m or rad, or of a quaternion's component.
    pub position_error: f64,
    /// Whether a second run from the same states gave the same bits.
    pub same_bits: bool,
    /// Mean height of the base at the end, m: a fallen batch would measure something else.
    pub base_height: f64,
}

/// Different robots of a batch; more environments are copies.
const ROBOTS: usize = 1024;
/// Control periods before anything is looked at, so that robots trot by then.
const WARM_UP: usize = 12;
/// Number of physics steps of one timed graph, about: several launches, so that the start of one does not count.
const TIMED_SUBSTEPS: usize = 80;

/// Measures the step of `model` on a GPU, and holds one control period of 1,024 robots against `f64`.
///
/// # Errors
/// A robot that the benchmark does not know, or a failure of the GPU.
pub fn physics(device: &Device, model: &Model, bench: &PhysicsBench) -> Result<PhysicsSpeed, BenchError> {
    let model = with_geoms(model, bench.geoms);
    let (height, pose) = standing(&model)?;
    let settings = Settings { timestep: TIMESTEP, ..Settings::new(&model.options, bench.preset) };
    let robots = ROBOTS.min(bench.environments);
    let drawn: Vec<Robot> = (0..robots).map(|number| random_robot(&model, number as u32)).collect();
    let sets = drawn.iter().map(|robot| robot.params(&model)).collect::<Result<Vec<_>, _>>();
    let sets: Vec<Params<f64>> = sets.map_err(DeviceError::from)?.into_iter().map(rounded).collect();
    let kept = drawn.iter().map(Kept::from_robot).reduce(Kept::both);
    let fixed = kept.zip(sets.first()).map_or(Vec::new(), |(kept, set)| kept.numbers(set));
    let report = Report { fixed, ..Report::default() };
    let start = Instant::now();
    let period = |substeps: usize| -> Result<Arc<Period>, DeviceError> {
        let options = PeriodOptions { substeps, taps: 1, lanes: bench.lanes.unwrap_or(4), emit: bench.emit };
        let made = match bench.lanes {
            Some(_) => Period::reporting(&model, &settings, options, &[], &report)?,
            None => {
                let (count, info) = (bench.environments, device.info());
                let processors = usize::try_from(info.processors).unwrap_or(1);
                Period::for_environments(&model, &settings, options, &[], &report, count, processors)?
            }
        };
        Ok(Arc::new(made))
    };
    let control = period(SUBSTEPS)?;
    let mut batch = Batch::new(device, &control, bench.environments, 1)?;
    let compile_seconds = start.elapsed().as_secs_f64();

    // The reference: the same step on the CPU in `f64`.
    let tree = compile::<f64>(&model, &settings).map_err(DeviceError::from)?;
    let mut state = State::<f64>::new(&tree);
    state.base_position[2] = height;
    state.qpos.copy_from_slice(&pose);

    let stream = Stream::new(device).map_err(DeviceError::from)?;
    batch.write_params(&stream, &sets)?;
    batch.write_states(&stream, std::slice::from_ref(&state))?;
    // Robots trot out of step, so that their contacts differ.
    let targets = |number: usize| -> Vec<Vec<f64>> {
        let own = |robot: usize| {
            trot(&pose, number + robot % 25).into_iter().map(|x| f64::from(x as f32)).collect()
        };
        (0..robots).map(own).collect()
    };
    // The robots trot for a while, so that what is timed has the usual contacts.
    for number in 0..WARM_UP {
        batch.write_targets(&stream, &targets(number))?;
        batch.step(&stream).map_err(DeviceError::from)?;
    }
    // Both runs of the period start from the same state, to see whether they give the same bits.
    batch.keep(&stream).map_err(DeviceError::from)?;
    let before = batch.read_states(&stream, robots).map_err(DeviceError::from)?;
    let sent = targets(WARM_UP);
    batch.write_targets(&stream, &sent)?;
    let after = one_period(&mut batch, &stream, bench.environments).map_err(DeviceError::from)?;
    let again = one_period(&mut batch, &stream, bench.environments).map_err(DeviceError::from)?;
    let bits = |states: &[Vec<f32>]| states.iter().flatten().map(|x| x.to_bits()).collect::<Vec<_>>();
    let same_bits = bits(&after) == bits(&again);
    let (errors, position_error) = errors(&tree, &mut state, &sets, &sent, &before, &after);

    // Another number of physics steps is another program; its robots go on from the states reached.
    let mut timed = batch;
    if bench.substeps != SUBSTEPS {
        timed = Batch::new(device, &period(bench.substeps)?, bench.environments, 1)?;
        timed.write_params(&stream, &sets)?;
        let states: Vec<State<f64>> = before.iter().map(|numbers| of_numbers(&state, numbers)).collect();
        timed.write_states(&stream, &states)?;
        timed.keep(&stream).map_err(DeviceError::from)?;
        timed.write_targets(&stream, &sent)?;
    }
    let launches = (TIMED_SUBSTEPS / bench.substeps.max(1)).max(1);
    let mut times =
        time(device, &mut timed, &stream, launches, bench.repetitions).map_err(DeviceError::from)?;
    // The median resists what else the machine does; the shortest shows what the GPU can do.
    times.sort_by(f64::total_cmp);
    let steps = (bench.environments * bench.substeps * launches) as f64;
    let end = timed.read_states(&stream, robots).map_err(DeviceError::from)?;
    // The base's position comes first.
    let base_height = end.iter().map(|numbers| f64::from(numbers[2])).sum::<f64>() / robots as f64;
    let kernel = timed.kernel();
    Ok(PhysicsSpeed {
        substeps_per_second: steps / times[times.len() / 2],
        best_substeps_per_second: steps / times[0],
        lanes: control.lanes(),
        registers: kernel.registers().map_err(DeviceError::from)?,
        local_bytes: kernel.local_bytes().map_err(DeviceError::from)?,
        compile_seconds,
        cached: timed.cached(),
        bytes: timed.bytes(),
        checked: robots,
        velocity_error: [errors[errors.len() / 2], errors[errors.len() - 1]],
        position_error,
        same_bits,
        base_height,
    })
}

/// Errors of the velocities of all robots after a control period, ascending, and the largest error of a position. `before` and
/// `after`: the GPU's states; `state` is overwritten.
fn errors(
    tree: &Tree<f64>,
    state: &mut State<f64>,
    sets: &[Params<f64>],
    sent: &[Vec<f64>],
    before: &[Vec<f32>],
    after: &[Vec<f32>],
) -> (Vec<f64>, f64) {
    let mut errors: Vec<f64> = Vec::with_capacity(sets.len());
    let mut position_error = 0.0f64;
    let mut work = Work::new(tree);
    for robot in 0..sets.len() {
        // Each period starts from the GPU's own state, so that errors of earlier periods do not add up.
        let mut numbers = before[robot].iter();
        state.visit_mut(|_, number| *number = numbers.next().map_or(f64::NAN, |&x| f64::from(x)));
        control_period(&mut Control {
            tree,
            params: &sets[robot],
            targets: &mut sent[robot].clone(),
            disturbance: &[],
            modifications: &[],
            memory: &mut [],
            substeps: SUBSTEPS,
            state,
            work: &mut work,
            drives: &mut vec![Drive::zero(); tree.joints()],
        });
        let (velocity, position) = difference(state, &after[robot]);
        errors.push(velocity);
        position_error = position_error.max(position);
    }
    errors.sort_by(f64::total_cmp);
    (errors, position_error)
}

/// Why the benchmark cannot be run.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// The robot is none that the benchmark knows.
    #[error(transparent)]
    Robot(#[from] SimError),
    /// The GPU.
    #[error(transparent)]
    Device(#[from] DeviceError),
}

/// One control period from the states kept.
fn one_period(
    batch: &mut Batch,
    stream: &Stream,
    environments: usize,
) -> Result<Vec<Vec<f32>>, crate::runtime::CudaError> {
    batch.restart(stream)?;
    batch.step(stream)?;
    batch.read_states(stream, environments)
}

/// Seconds of each repetition of `launches` launches, recorded as one graph, from the states kept.
fn time(
    device: &Device,
    batch: &mut Batch,
    stream: &Stream,
    launches: usize,
    repetitions: usize,
) -> Result<Vec<f64>, crate::runtime::CudaError> {
    let mut graph = stream.record(|stream| (0..launches).try_for_each(|_| batch.step(stream)))?;
    let (start, end) = (Event::new(device)?, Event::new(device)?);
    let mut times = Vec::with_capacity(repetitions);
    for repetition in 0..=repetitions.max(1) {
        batch.restart(stream)?;
        start.record(stream)?;
        graph.launch(stream)?;
        end.record(stream)?;
        let seconds = start.seconds_until(&end)?;
        // The first one warms up.
        if repetition > 0 {
            times.push(seconds);
        }
    }
    Ok(times)
}

/// Parameters in single precision, as a GPU has them.
fn rounded(mut params: Params<f64>) -> Params<f64> {
    params.visit_mut(|_, number| *number = f64::from(*number as f32));
    params
}

fn of_numbers(like: &State<f64>, numbers: &[f32]) -> State<f64> {
    let mut state = like.clone();
    let mut numbers = numbers.iter();
    state.visit_mut(|_, number| *number = numbers.next().map_or(f64::NAN, |&x| f64::from(x)));
    state
}

/// Largest differences of velocities and of positions.
fn difference(want: &State<f64>, got: &[f32]) -> (f64, f64) {
    let (mut velocity, mut position) = (0.0f64, 0.0f64);
    let mut got = got.iter();
    want.visit(|slot, want| {
        let error = got.next().map_or(f64::INFINITY, |&got| (f64::from(got) - want).abs());
        let error = if error.is_nan() { f64::INFINITY } else { error };
        match slot.name {
            "qvel" | "linear" | "angular" => velocity = velocity.max(error),
            // The last step's accelerations are a start for the solver, not motion.
            "qacc" | "acceleration" => {}
            _ => position = position.max(error),
        }
    });
    (velocity, position)
}
