//! Batches of environments on a GPU.

use std::sync::Arc;

use crate::common::{feet, modifications, networks, robot};
use gaitfit_cuda::emit::EmitOptions;
use gaitfit_cuda::physics::{Batch, DeviceError, Period, PeriodOptions};
use gaitfit_cuda::runtime::{Device, Stream};
use gaitfit_model::Model;
use gaitfit_physics::in_f64::control_period;
use gaitfit_physics::trace::{Known, Report, Traced};
use gaitfit_physics::{
    Drive, JointModification, Kept, Modify, Params, Period as Control, Preset, Robot, Settings, State, Work,
    compile, memory_of, settle,
};

const TAPS: usize = 2;
const SUBSTEPS: usize = 4;

fn rounded(x: f64) -> f64 {
    f64::from(x as f32)
}

/// Weights of a candidate's networks as they are visited, times `factor`, in single precision.
fn weights(
    mut networks: Vec<JointModification<f64>>,
    factor: f64,
) -> (Vec<JointModification<f64>>, Vec<f64>) {
    let mut list = Vec::new();
    for network in &mut networks {
        network.visit_weights_mut(|_, weight| {
            *weight = rounded(factor * *weight);
            list.push(*weight);
        });
    }
    (networks, list)
}

/// Delays, and two candidates with networks of their own: every robot's velocities after three control periods.
fn check(device: &Device, label: &str, model: &Model, lanes: usize, limit: f64) {
    let joints = model.joints.len();
    let networks = (modifications::<Traced>(joints), modifications::<f64>(joints));
    check_with(device, label, model, lanes, limit, networks);
}

fn check_with(
    device: &Device,
    label: &str,
    model: &Model,
    lanes: usize,
    limit: f64,
    (traced, plain): (Vec<JointModification<Known>>, Vec<JointModification<f64>>),
) {
    let settings = Settings { timestep: 0.005, ..Settings::new(&model.options, Preset::Fast) };
    let joints = model.joints.len();
    let options = PeriodOptions { substeps: SUBSTEPS, taps: TAPS, lanes, emit: EmitOptions::default() };
    let period = Arc::new(Period::new(model, &settings, options, &traced).unwrap());
    assert_eq!(period.lanes(), lanes, "{label}");
    // No multiple of a block's environments.
    let environments = 138;
    let stream = Stream::new(device).unwrap();
    let mut batch = Batch::new(device, &period, environments, 2).unwrap();
    let candidates = [weights(plain.clone(), 1.0), weights(plain, 0.3)];
    batch.write_weights(&stream, &[candidates[0].1.clone(), candidates[1].1.clone()]).unwrap();
    let mut random = crate::common::Random(3);
    let tree = compile::<f64>(model, &settings).unwrap();
    let key = &model.keyframes[0].qpos;
    let mut sets: Vec<Params<f64>> = Vec::new();
    let mut states: Vec<State<f64>> = Vec::new();
    let mut memory: Vec<Vec<f64>> = Vec::new();
    for environment in 0..environments {
        let mut one = Robot::nominal(model);
        one.kp = vec![random.uniform(40.0, 70.0); joints];
        one.kd = vec![random.uniform(1.0, 2.0); joints];
        one.delay = (0..joints).map(|_| random.uniform(0.0, 0.02)).collect();
        one.armature = vec![0.01; joints];
        let mut params = one.params(model).unwrap();
        params.visit_mut(|_, number| *number = rounded(*number));
        let mut state = State::<f64>::new(&tree);
        state.base_position[2] = rounded(key[2]);
        state.qpos = key[7..].iter().map(|angle| rounded(angle + random.uniform(-0.1, 0.1))).collect();
        let networks = &candidates[environment / (environments / 2)].0;
        let mut own = vec![0.0; memory_of(networks)];
        settle(networks, &params, &state, &mut own);
        memory.push(own.into_iter().map(rounded).collect());
        sets.push(params);
        states.push(state);
    }
    batch.write_params(&stream, &sets).unwrap();
    batch.write_states(&stream, &states).unwrap();
    batch.write_memory(&stream, &memory).unwrap();
    for _ in 0..3 {
        let targets: Vec<Vec<f64>> = (0..environments)
            .map(|_| {
                (0..TAPS)
                    .flat_map(|_| key[7..].to_vec())
                    .map(|x| rounded(x + random.uniform(-0.2, 0.2)))
                    .collect()
            })
            .collect();
        batch.write_targets(&stream, &targets).unwrap();
        batch.step(&stream).unwrap();
        for environment in 0..environments {
            control_period(&mut Control {
                tree: &tree,
                params: &sets[environment],
                targets: &mut targets[environment].clone(),
                disturbance: &[],
                modifications: &candidates[environment / (environments / 2)].0,
                memory: &mut memory[environment],
                substeps: SUBSTEPS,
                state: &mut states[environment],
                work: &mut Work::new(&tree),
                drives: &mut vec![Drive::zero(); joints],
            });
        }
    }
    let mut errors = Vec::new();
    for (got, want) in batch.read_states(&stream, environments).unwrap().iter().zip(&states) {
        let (mut got, mut worst) = (got.iter(), 0.0f64);
        want.visit(|slot, want| {
            let error = (f64::from(*got.next().unwrap()) - want).abs();
            if matches!(slot.name, "qvel" | "linear" | "angular") {
                worst = worst.max(if error.is_nan() { f64::INFINITY } else { error });
            }
        });
        errors.push(worst);
    }
    errors.sort_by(f64::total_cmp);
    let (median, worst) = (errors[environments / 2], errors[environments - 1]);
    println!("{label}, {lanes} lanes: velocities off by {median:.1e}, at most {worst:.1e}");
    assert!(worst <= limit, "{label}, {lanes} lanes: {worst}");
}

#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_batches_have_delays_networks_and_candidates() {
    let device = Device::open(0).unwrap();
    let go2 = robot("go2");
    for lanes in [4, 2, 1] {
        check(&device, "go2 feet", &feet(go2.clone()), lanes, 1e-3);
    }
    check(&device, "go2", &go2, 4, 1e-3);
    let of_one = (networks::<Traced>(&[2, 4], &[11]), networks::<f64>(&[2, 4], &[11]));
    check_with(&device, "go2 with networks on a leg", &go2, 4, 1e-3, of_one);
    check(&device, "biped", &robot("biped"), 2, 1e-2);
    check(&device, "humanoid", &robot("humanoid"), 2, 1e-2);
}

#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_batches_refuse_wrong_counts() {
    let device = Device::open(0).unwrap();
    let model = feet(robot("go2"));
    let settings = Settings::new(&model.options, Preset::Fast);
    let options = PeriodOptions { substeps: 1, taps: 1, lanes: 4, emit: EmitOptions::default() };
    let period = Arc::new(Period::new(&model, &settings, options, &[]).unwrap());
    assert!(matches!(Batch::new(&device, &period, 10, 3), Err(DeviceError::Count { .. })));
    let stream = Stream::new(&device).unwrap();
    let mut batch = Batch::new(&device, &period, 10, 1).unwrap();
    let error = batch.write_targets(&stream, &[vec![0.0; 11]]).unwrap_err();
    assert_eq!(error.to_string(), "targets must be lists of 12 numbers, one at least; there are 11");
    assert!(batch.write_params(&stream, &[]).is_err());

    let mut one = Robot::nominal(&model);
    let fixed = Kept::from_robot(&one).numbers(&one.params(&model).unwrap());
    let report = Report { fixed, ..Report::default() };
    let period = Arc::new(Period::reporting(&model, &settings, options, &[], &report).unwrap());
    let mut batch = Batch::new(&device, &period, 10, 1).unwrap();
    batch.write_params(&stream, &[one.params(&model).unwrap()]).unwrap();
    one.stiction[3] = 0.5;
    let error = batch.write_params(&stream, &[one.params(&model).unwrap()]).unwrap_err();
    let want = "joint3.stiction.0 is 0 in this program, and 0.5 in a robot; make the program without it among `fixed`";
    assert_eq!(error.to_string(), want);
}

/// What a GPU would be given is made without one.
#[test]
fn long_programs_keep_four_threads() {
    let go2 = robot("go2");
    let lanes = |model: &Model, environments: usize| {
        let settings = Settings::new(&model.options, Preset::Fast);
        let options = PeriodOptions { substeps: 4, taps: 1, lanes: 4, emit: EmitOptions::default() };
        let report = Report::default();
        Period::for_environments(model, &settings, options, &[], &report, environments, 132).unwrap().lanes()
    };
    let feet = feet(go2.clone());
    assert_eq!((lanes(&feet, 4096), lanes(&feet, 65536)), (4, 2));
    assert_eq!((lanes(&go2, 4096), lanes(&go2, 65536)), (4, 4));
    assert_eq!(lanes(&robot("arm"), 65536), 1);
    // Networks on one leg's joint do not take the others' threads away.
    let settings = Settings::new(&feet.options, Preset::Fast);
    let options = PeriodOptions { substeps: 4, taps: 1, lanes: 4, emit: EmitOptions::default() };
    let networks = networks::<Traced>(&[2], &[11]);
    assert_eq!(Period::new(&feet, &settings, options, &networks).unwrap().lanes(), 4);
}
