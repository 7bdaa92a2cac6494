//! A policy's walks on a GPU against the CPU's: trajectories, constant commands, crossings of uneven ground.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use crate::motions::{following, observing};
use crate::rollout_device::{SEED, changed, go2};
use gaitfit_cuda::rollout::{crossings, drift, run_trials};
use gaitfit_cuda::runtime::Device;
use gaitfit_learn::evaluate::{self, Subject};
use gaitfit_learn::ppo::{MemorySettings, Settings};
use gaitfit_learn::task::{Task, TaskSettings, TerrainSettings};
use gaitfit_learn::{Training, TrainingSettings};
use gaitfit_physics::Preset;
use gaitfit_policy::network::{Activation, Cell, Network, Shape};
use gaitfit_policy::{Encoder, Front, Interface, Latent, Policy, Quantity, Term};

/// 10,000 trajectories: the same commands, and means that agree within their intervals.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_trajectories_agree_with_the_cpus() {
    let device = Device::open(0).unwrap();
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2-walk.safetensors");
    let policy = gaitfit_policy_files::read(file.as_ref()).unwrap();
    let settings: TaskSettings = toml::from_str(&policy.provenance.task).unwrap();
    for settings in [settings.clone().calm(), settings] {
        let interface = policy.interface.clone();
        let task = Task::with_interface(&go2(), &settings, interface, Preset::Fast, 0.02).unwrap();
        let subject =
            Subject { task: &task, policy: &policy, candidate: None, seed: SEED, cancel: None, moved: None };
        let begin = std::time::Instant::now();
        let trials = run_trials(&device, &subject, 10_000, 4.0, &|| false).unwrap().unwrap();
        let seconds = begin.elapsed().as_secs_f64();
        assert!(run_trials(&device, &subject, 300, 4.0, &|| false).unwrap().unwrap().len() == 300);
        let again = run_trials(&device, &subject, 10_000, 4.0, &|| false).unwrap().unwrap();
        assert!(trials == again, "other numbers the second time");
        assert_eq!(run_trials(&device, &subject, 10_000, 4.0, &|| true).unwrap(), None);
        let begin = std::time::Instant::now();
        let wanted = evaluate::run_trials(&subject, 10_000, 4.0, 16).unwrap();
        println!("{seconds:.2} s with the compilation, the CPU {:.2} s", begin.elapsed().as_secs_f64());
        assert!(trials.iter().zip(&wanted).all(|(got, want)| got.command == want.command));
        let (got, want) = (evaluate::summarise(&trials), evaluate::summarise(&wanted));
        println!("{got:?}\n{want:?}");
        for (got, want) in [
            (got.reward, want.reward),
            (got.linear_velocity_error, want.linear_velocity_error),
            (got.angular_velocity_error, want.angular_velocity_error),
            (got.fall_rate, want.fall_rate),
            (got.action_rate, want.action_rate),
        ] {
            let (got, want) = (got.unwrap(), want.unwrap());
            let apart = got.ci95.unwrap_or(0.0).hypot(want.ci95.unwrap_or(0.0));
            assert!((got.mean - want.mean).abs() <= apart, "{got:?} {want:?}");
        }
    }
}

/// Short trajectories of policies with other networks than a plain perceptron: robot by robot almost the CPU's.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_policies_of_all_kinds_move_as_the_cpus() {
    let device = Device::open(0).unwrap();
    let task = changed(|settings| *settings = settings.calm());
    let trained = |memory: Option<(Cell, usize)>| {
        let memory = memory.map(|(cell, layers)| MemorySettings { cell, width: 32, layers });
        let ppo = Settings { memory, ..Settings::default() };
        let learner = Training::fresh_learner(&task, &ppo, SEED).unwrap();
        let settings = TrainingSettings { environments: 64, steps: 4, iterations: 1 };
        Training::new(&task, None, &settings, learner, SEED).unwrap().policy("", "")
    };
    let plain = trained(None);
    let swish = {
        let shape = Shape { activation: Activation::Silu, ..plain.actor.shape.clone() };
        let mut actor = Network::random(shape, SEED, 0, 0.1).unwrap();
        actor.output = Some(Activation::Tanh);
        Policy { actor, ..plain.clone() }
    };
    let two_part = {
        let inputs = plain.actor.shape.inputs;
        let shape = Shape { inputs, hidden: vec![64], outputs: 12, activation: Activation::Elu };
        let network = Network::random(shape, SEED, 0, 1.0).unwrap();
        let actor = Shape { inputs: 12 + inputs, ..plain.actor.shape.clone() };
        let encoder = Encoder { network, passed: (0..inputs).collect(), latent: Latent::Last };
        let actor = Network::random(actor, SEED, 1, 0.1).unwrap();
        Policy { front: Some(Front::Encoder(encoder)), actor, ..plain.clone() }
    };
    for (label, policy) in [
        ("gru", trained(Some((Cell::Gru, 1)))),
        ("lstm", trained(Some((Cell::Lstm, 2)))),
        ("swish", swish),
        ("two-part", two_part),
        ("motion", following(&plain, 37.0, 12)),
        ("earlier action", observing(&plain, vec![Term::new(Quantity::EarlierAction)])),
        ("plain", plain),
    ] {
        // Policies of other trainers have no critic, and their files do not state what it observes.
        let bare = ["two-part", "motion", "earlier action"].contains(&label).then(|| {
            let interface = Interface { critic_observation: Vec::new(), ..policy.interface.clone() };
            let policy = Policy { interface, critic: None, ..policy.clone() };
            let settings = task.settings.clone();
            (
                Task::with_interface(&go2(), &settings, policy.interface.clone(), Preset::Fast, 0.0).unwrap(),
                policy,
            )
        });
        let (task, policy) = bare.as_ref().map_or((&task, &policy), |(task, policy)| (task, policy));
        let subject = Subject { task, policy, candidate: None, seed: SEED, cancel: None, moved: None };
        // More than are simulated at once: the last robots begin without what those before them remember.
        let count = 16_500;
        let trials = run_trials(&device, &subject, count, 0.3, &|| false).unwrap().unwrap();
        let wanted = evaluate::run_trials(&subject, count, 0.3, 16).unwrap();
        let apart = |(got, want): (&evaluate::Trial, &evaluate::Trial)| {
            let velocity = (got.linear_velocity_error - want.linear_velocity_error).abs();
            let motion = got.motion_error.unwrap_or_default() - want.motion_error.unwrap_or_default();
            assert_eq!(got.motion_error.is_some(), label == "motion");
            velocity.max((got.action_rate - want.action_rate).abs()).max(motion.abs())
        };
        let mut errors: Vec<f64> = trials.iter().zip(&wanted).map(apart).collect();
        assert!(errors[16_384..].iter().all(|error| *error < 1e-2));
        errors.sort_by(f64::total_cmp);
        println!("{label}: apart by {} (half), {} (99 %)", errors[count / 2], errors[count * 99 / 100]);
        assert!(errors[count / 2] < 1e-6 && errors[count * 9 / 10] < 1e-2);
    }
}

/// Constant commands and crossings of uneven ground: the CPU's robots and commands, and results that agree within their
/// intervals.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_drift_and_crossings_agree_with_the_cpus() {
    let device = Device::open(0).unwrap();
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2-walk.safetensors");
    let policy = gaitfit_policy_files::read(file.as_ref()).unwrap();
    let settings: TaskSettings = toml::from_str(&policy.provenance.task).unwrap();
    let with = |settings: &TaskSettings| {
        Task::with_interface(&go2(), settings, policy.interface.clone(), Preset::Fast, 0.02).unwrap()
    };
    let flat = with(&settings);
    let subject =
        Subject { task: &flat, policy: &policy, candidate: None, seed: SEED, cancel: None, moved: None };
    let got = drift(&device, &subject, 200, None, &|| false).unwrap().unwrap();
    assert!(got == drift(&device, &subject, 200, None, &|| false).unwrap().unwrap());
    assert_eq!(drift(&device, &subject, 200, None, &|| true).unwrap(), None);
    let wanted = evaluate::drift(&subject, 200, None, 16).unwrap();
    assert_eq!(got.len(), wanted.len());
    for (got, want) in got.iter().zip(&wanted) {
        assert_eq!((got.name, got.command, got.path.len()), (want.name, want.command, want.path.len()));
        println!(
            "{}: {:?} {:?} {:?}, {:?} {:?} {:?}",
            got.name, got.x, got.y, got.yaw, want.x, want.y, want.yaw
        );
        for (got, want) in
            [(got.x, want.x), (got.y, want.y), (got.yaw, want.yaw), (got.fall_rate, want.fall_rate)]
        {
            let (got, want) = (got.unwrap(), want.unwrap());
            let apart = got.ci95.unwrap_or(0.0).hypot(want.ci95.unwrap_or(0.0));
            assert!((got.mean - want.mean).abs() <= apart, "{got:?} {want:?}");
        }
    }
    let rough = with(&TaskSettings { terrain: Some(TerrainSettings::default()), ..settings });
    let subject = Subject { task: &rough, ..subject };
    let got = crossings(&device, &subject, 4, 0.5, &|| false).unwrap().unwrap();
    assert!(got == crossings(&device, &subject, 4, 0.5, &|| false).unwrap().unwrap());
    let wanted = evaluate::crossings(&subject, 4, 0.5, 16).unwrap();
    assert!(got.iter().zip(&wanted).all(|(got, want)| got.cell == want.cell) && got.len() == wanted.len());
    let share = |crossings: &[evaluate::Crossing]| {
        crossings.iter().filter(|one| one.crossed).count() as f64 / crossings.len() as f64
    };
    let same = got.iter().zip(&wanted).filter(|(got, want)| got.crossed == want.crossed).count();
    println!("crossed: {} and {}; {same} of {} alike", share(&got), share(&wanted), got.len());
    assert!((share(&got) - share(&wanted)).abs() < 0.03 && same * 10 > got.len() * 8);
}
