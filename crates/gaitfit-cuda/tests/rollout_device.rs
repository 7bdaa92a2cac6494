//! Trainings on a GPU against the CPU's.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use crate::motions::{following, reference, terms};
use gaitfit_cuda::ppo::Precision;
use gaitfit_cuda::rollout::{Trainer, collect};
use gaitfit_cuda::runtime::Device;
use gaitfit_learn::collect::{self, CollectOptions, Collected};
use gaitfit_learn::evaluate::Subject;
use gaitfit_learn::ppo::{Learner, MemorySettings, Settings};
use gaitfit_learn::task::{Snapshot, Task, TaskSettings, TerrainSettings, preset};
use gaitfit_learn::{Origin, Training, TrainingSettings};
use gaitfit_log::Trajectory;
use gaitfit_model::Model;
use gaitfit_physics::{NETWORK_WEIGHTS, NetworkScales, Preset};
use gaitfit_policy::network::{Activation, Cell};
use gaitfit_policy::{Quantity, Term};
use gaitfit_sim::{Candidate, JointNetworks, NetworkKind};

pub const SEED: u64 = 11;

pub fn go2() -> Model {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2.xml");
    gaitfit_model::read(path.as_ref(), &Default::default()).unwrap()
}

fn task(name: &str) -> Task {
    let settings: TaskSettings = toml::from_str(preset(name).unwrap()).unwrap();
    Task::new(&go2(), &settings, Preset::Fast).unwrap()
}

/// The velocity task with other settings.
pub fn changed(change: impl FnOnce(&mut TaskSettings)) -> Task {
    let mut settings: TaskSettings = toml::from_str(preset("velocity").unwrap()).unwrap();
    change(&mut settings);
    Task::new(&go2(), &settings, Preset::Fast).unwrap()
}

pub fn training(task: &Task, environments: usize, steps: usize) -> Training<'_> {
    around(task, &Candidate::nominal(&go2()), environments, steps)
}

fn around<'a>(task: &'a Task, candidate: &Candidate, environments: usize, steps: usize) -> Training<'a> {
    let ppo = Settings { normalise_observations: true, ..Settings::default() };
    let settings = TrainingSettings { environments, steps, iterations: 100 };
    let learner = Training::fresh_learner(task, &ppo, SEED).unwrap();
    Training::new(task, Some(candidate), &settings, learner, SEED).unwrap()
}

pub fn origin() -> Origin {
    Origin { robot: "go2".into(), model: String::new(), settings: String::new(), seed: SEED }
}

/// What a training has come to.
pub fn state(training: &mut Training<'_>) -> (Vec<f32>, Vec<Snapshot>) {
    let [actor, critic, log_std, first, second] = training.learner().tensors().map(|(_, numbers)| numbers);
    ([actor, critic, log_std, first, second].concat(), training.snapshots())
}

fn networks(kind: NetworkKind, joints: &[usize]) -> JointNetworks {
    let weights = (0..joints.len() * NETWORK_WEIGHTS).map(|k| 0.3 * (0.7 * k as f64).sin()).collect();
    let scales = NetworkScales { position: 1.0, velocity: 0.05, output: 0.3 };
    JointNetworks { kind, joints: joints.to_vec(), rest: vec![0.1; joints.len()], weights, scales }
}

/// The velocity task along a motion, which actor and critic observe.
pub fn along_a_motion(change: impl FnOnce(&mut TaskSettings)) -> Task {
    let task = changed(change);
    let mut interface = task.walker.interface.clone();
    interface.reference = Some(reference(&interface, 37.0, 30));
    interface.observation.extend(terms());
    interface.critic_observation.extend(terms());
    Task::with_interface(&go2(), &task.settings, interface, Preset::Fast, 0.0).unwrap()
}

/// A few control steps from the same start: the same commands, and almost the same motion.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_rollouts_are_the_cpus() {
    let device = Device::open(0).unwrap();
    let mut fitted = Candidate::nominal(&go2());
    fitted.torque_noise = 0.5;
    fitted.robot.frictionloss = vec![0.2; 12];
    let mut with = Candidate::nominal(&go2());
    with.networks = vec![networks(NetworkKind::ActionDelta, &[2, 4]), networks(NetworkKind::ResidAct, &[11])];
    let mut everywhere = fitted.clone();
    everywhere.networks = vec![networks(NetworkKind::ResidAct, &(0..12).collect::<Vec<_>>())];
    for (name, candidate) in [
        ("velocity", Candidate::nominal(&go2())),
        ("biped", Candidate::nominal(&go2())),
        ("velocity", fitted),
        ("velocity", with),
        ("velocity", everywhere),
        ("uneven", Candidate::nominal(&go2())),
        ("past", Candidate::nominal(&go2())),
        ("earlier action", Candidate::nominal(&go2())),
        ("motion", Candidate::nominal(&go2())),
    ] {
        let task = match name {
            "uneven" => changed(|settings| settings.terrain = Some(TerrainSettings::default())),
            "past" => changed(|settings| {
                settings.policy.observation.iter_mut().for_each(|term| term.history = 5);
                settings.policy.critic_observation[0].history = 3;
            }),
            "earlier action" => changed(|settings| {
                let earlier = Term::new(Quantity::EarlierAction).scaled(&[0.5]);
                settings.policy.observation.insert(0, earlier.clone());
                settings.policy.critic_observation.push(earlier);
            }),
            "motion" => along_a_motion(|_| ()),
            name => task(name),
        };
        let mut cpu = around(&task, &candidate, 300, 3);
        let mut trainer = Trainer::new(&device, &mut cpu, Precision::F32).unwrap();
        let (mut gpu, wanted) = (around(&task, &candidate, 300, 3), cpu.iterate(8).unwrap());
        let outcome = trainer.iterate().unwrap();
        trainer.store(&mut gpu).unwrap();
        let (tally, wanted_tally) = (&outcome.tally, &wanted.tally);
        println!(
            "{name}: {tally:?}\n  {wanted_tally:?}\n{:?}\n{:?}",
            outcome.diagnostics, wanted.diagnostics
        );
        assert_eq!(tally.steps, wanted_tally.steps);
        assert!((tally.episodes - wanted_tally.episodes).abs() <= 2.0);
        let near = |got: f64, want: f64, most: f64| {
            assert!((got - want).abs() < most * want.abs().max(1.0), "{got} {want}")
        };
        near(tally.reward, wanted_tally.reward, 1e-2);
        for k in 0..2 {
            near(tally.tracking[k], wanted_tally.tracking[k], 1e-2);
        }
        near(outcome.diagnostics.value_loss, wanted.diagnostics.value_loss, 0.05);
        let mut errors = Vec::new();
        for (got, want) in gpu.snapshots().iter().zip(cpu.snapshots()) {
            if got.steps != want.steps {
                continue;
            }
            assert_eq!(got.command, want.command);
            assert_eq!(got.last_action.len(), want.last_action.len());
            // Velocities of the joints.
            let velocity = 25..37;
            let pairs = got.robot.state[velocity.clone()].iter().zip(&want.robot.state[velocity]);
            errors.push(pairs.fold(0.0f32, |worst, (a, b)| worst.max((a - b).abs())));
        }
        errors.sort_by(f32::total_cmp);
        println!(
            "{name}: joint velocities apart by {} (half), {} (99 %)",
            errors[errors.len() / 2],
            errors[errors.len() * 99 / 100]
        );
        assert!(errors.len() > 290 && errors[errors.len() / 2] < 5e-3 && errors[errors.len() * 9 / 10] < 0.1);
    }
}

/// As there, with memories: what is remembered, also where episodes ended, and a training that goes across and back.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_trainings_with_a_memory_are_the_cpus() {
    let device = Device::open(0).unwrap();
    for (cell, layers, critic_remembers) in
        [(Cell::Gru, 1, true), (Cell::Lstm, 2, true), (Cell::Gru, 1, false)]
    {
        let task = changed(|settings| settings.episode_seconds = 0.1);
        let ppo = Settings {
            normalise_observations: true,
            memory: Some(MemorySettings { cell, width: 32, layers }),
            ..Settings::default()
        };
        let settings = TrainingSettings { environments: 300, steps: 12, iterations: 100 };
        let training = || {
            let mut learner = Training::fresh_learner(&task, &ppo, SEED).unwrap();
            if !critic_remembers {
                let plain = Settings { memory: None, ..ppo.clone() };
                let critic = Training::fresh_learner(&task, &plain, SEED).unwrap().critic().clone();
                let networks = [learner.actor().clone(), critic];
                let memories = [learner.actor_memory().cloned(), None];
                let log_std = vec![-0.5; learner.widths().action];
                learner = Learner::with_memories(plain, learner.widths(), SEED, networks, memories, log_std)
                    .unwrap();
            }
            Training::new(&task, None, &settings, learner, SEED).unwrap()
        };
        let (mut cpu, mut gpu) = (training(), training());
        let mut trainer = Trainer::new(&device, &mut gpu, Precision::F32).unwrap();
        for iteration in 0..2 {
            let (wanted, outcome) = (cpu.iterate(8).unwrap(), trainer.iterate().unwrap());
            println!("{cell:?}, {iteration}: {:?}\n{:?}", outcome.diagnostics, wanted.diagnostics);
            let near = |got: f64, want: f64, most: f64| {
                assert!((got - want).abs() < most * want.abs().max(0.1), "{got} {want}")
            };
            near(outcome.tally.reward, wanted.tally.reward, 2e-2);
            near(outcome.diagnostics.value_loss, wanted.diagnostics.value_loss, 0.05);
            near(outcome.diagnostics.gradient_norm, wanted.diagnostics.gradient_norm, 0.05);
            near(outcome.diagnostics.kl, wanted.diagnostics.kl, 0.05);
            if iteration > 0 {
                continue;
            }
            trainer.store(&mut gpu).unwrap();
            for (memory, wanted) in gpu.memories().iter().zip(&cpu.memories()) {
                assert_eq!(memory.len(), wanted.len());
                if memory.is_empty() {
                    continue;
                }
                let mut errors: Vec<f32> = memory.iter().zip(wanted).map(|(a, b)| (a - b).abs()).collect();
                errors.sort_by(f32::total_cmp);
                println!(
                    "memories apart by {} (half), {} (99 %)",
                    errors[errors.len() / 2],
                    errors[errors.len() * 99 / 100]
                );
                assert!(errors[errors.len() / 2] < 1e-4 && errors[errors.len() * 9 / 10] < 1e-2);
                assert!(memory.iter().filter(|x| **x != 0.0).count() > memory.len() / 2);
            }
            // Saved, and taken up by another training on the GPU: the same bits.
            let bytes = gpu.save(&origin(), 0.0).unwrap();
            let mut resumed = training();
            resumed.restore(&bytes, &origin()).unwrap();
            let mut other = Trainer::new(&device, &mut resumed, Precision::F32).unwrap();
            let outcome = other.iterate().unwrap();
            let mut again = training();
            again.restore(&bytes, &origin()).unwrap();
            trainer.load(&mut again).unwrap();
            assert_eq!(trainer.iterate().unwrap().diagnostics, outcome.diagnostics);
            trainer.load(&mut again).unwrap();
        }
    }
}

/// SiLU layers and a tanh of the output. A rollout and the first gradient step have the same means, so no sample is
/// outside the clip.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_training_with_silu_and_a_bounded_output_is_the_cpus() {
    let device = Device::open(0).unwrap();
    let task = changed(|settings| settings.episode_seconds = 0.2);
    let ppo = Settings { activation: Activation::Silu, epochs: 1, minibatches: 1, ..Settings::default() };
    let settings = TrainingSettings { environments: 300, steps: 12, iterations: 100 };
    for precision in [Precision::F32, Precision::Tf32, Precision::Bf16] {
        let training = || {
            let learner = Training::fresh_learner(&task, &ppo, SEED).unwrap();
            let mut actor = learner.actor().clone();
            actor.output = Some(Activation::Tanh);
            let networks = [actor, learner.critic().clone()];
            let log_std = vec![-0.5; learner.widths().action];
            let widths = learner.widths();
            let learner =
                Learner::with_memories(ppo.clone(), widths, SEED, networks, [None, None], log_std).unwrap();
            Training::new(&task, None, &settings, learner, SEED).unwrap()
        };
        let (mut cpu, mut gpu) = (training(), training());
        let mut trainer = Trainer::new(&device, &mut gpu, precision).unwrap();
        let (wanted, outcome) = (cpu.iterate(8).unwrap(), trainer.iterate().unwrap());
        let (got, wanted) = (outcome.diagnostics, wanted.diagnostics);
        println!("{precision:?}: {got:?}\n{wanted:?}");
        // In single precision each sample's log-probability rounds by about 1e-6.
        assert!(got.clip_fraction == 0.0 && got.approx_kl_k3.abs() < 1e-6, "{got:?}");
        let near = |got: f64, want: f64| assert!((got - want).abs() < 0.05 * want.abs(), "{got} {want}");
        near(got.value_loss, wanted.value_loss);
        near(got.gradient_norm, wanted.gradient_norm);
    }
}

/// Largest difference of the joint positions of two logs up to row `until`, rad; none of a log that is shorter.
fn apart(log: &Collected, wanted: &Collected, until: usize) -> Option<f64> {
    let (position, wanted) = (&log.trajectory.position, &wanted.trajectory.position);
    let rows = 12 * until..12 * (until + 1);
    let pairs = position.get(rows.clone())?.iter().zip(wanted.get(rows)?);
    Some(pairs.fold(0.0f64, |worst, (a, b)| worst.max((a - b).abs())))
}

/// Logs of a walking robot as the policy's file has it, of a fitted one with networks and torque noise, and of randomised
/// ones: the CPU's commands and starts, and motions that drift apart slowly. Twice the same has the same bits.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_logs_are_the_cpus_at_first() {
    let device = Device::open(0).unwrap();
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2-walk.safetensors");
    let policy = gaitfit_policy_files::read(file.as_ref()).unwrap();
    let settings: TaskSettings = toml::from_str(&policy.provenance.task).unwrap();
    let mut fitted = Candidate::nominal(&go2());
    fitted.torque_noise = 0.4;
    fitted.robot.frictionloss = vec![0.2; 12];
    fitted.networks = vec![networks(NetworkKind::ResidAct, &[2, 11])];
    let walk = policy;
    for (name, candidate, settings) in [
        ("nominal", Candidate::nominal(&go2()), settings.clone().calm()),
        ("fitted", fitted, settings.clone().calm()),
        ("along a motion", Candidate::nominal(&go2()), settings.clone().calm()),
        ("randomised", Candidate::nominal(&go2()), settings),
    ] {
        let policy = if name == "along a motion" { following(&walk, 37.0, 60) } else { walk.clone() };
        let interface = policy.interface.clone();
        let task = Task::with_interface(&go2(), &settings, interface, Preset::Fast, 0.02).unwrap();
        let subject = Subject {
            task: &task,
            policy: &policy,
            candidate: Some(&candidate),
            seed: SEED,
            cancel: None,
            moved: None,
        };
        let options = CollectOptions { count: 301, seconds: 3.0, shift: [0.0, 0.1], privileged: true };
        let begin = std::time::Instant::now();
        let logs = collect(&device, &subject, &options, &|| false).unwrap().unwrap();
        let seconds = begin.elapsed().as_secs_f64();
        assert!(
            logs == collect(&device, &subject, &options, &|| false).unwrap().unwrap(),
            "other bits again"
        );
        assert_eq!(collect(&device, &subject, &options, &|| true).unwrap(), None);
        let begin = std::time::Instant::now();
        let wanted = collect::collect(&subject, &options, 16).unwrap();
        println!(
            "{name}: {seconds:.2} s with the compilation, the CPU {:.2} s",
            begin.elapsed().as_secs_f64()
        );
        assert_eq!(logs.len(), 301);
        for (got, want) in logs.iter().zip(&wanted) {
            // A robot may fall a little earlier.
            let rows = 3 * got.trajectory.len().min(want.trajectory.len());
            let commands = [got, want].map(|log| &log.trajectory.command.as_ref().unwrap()[..rows]);
            assert_eq!(commands[0], commands[1]);
            let places = |log: &Collected| log.trajectory.motion.as_ref().map(|all| all[..2].to_vec());
            assert_eq!(places(got), places(want));
            assert_eq!(got.trajectory.gains, want.trajectory.gains);
            let base = got.trajectory.base.as_ref().unwrap();
            assert_eq!(base.quaternion.as_ref().unwrap().len(), 4 * got.trajectory.len());
            assert_eq!(got.trajectory.target.as_ref().unwrap().len(), 12 * got.trajectory.len());
        }
        let [start, soon, second] = [0, 10, 50].map(|row| {
            let mut all: Vec<f64> =
                logs.iter().zip(&wanted).filter_map(|(got, want)| apart(got, want, row)).collect();
            all.sort_by(f64::total_cmp);
            [all[all.len() / 2], all[all.len() * 9 / 10]]
        });
        let falls = [&logs, &wanted].map(|logs| logs.iter().filter(|log| log.fell).count());
        println!(
            "{name}: apart at the start {start:?}, after 0.2 s {soon:?}, 1 s {second:?} rad; falls {falls:?}"
        );
        // Logs begin up to five steps after the robot.
        assert!(start[1] < 1e-3 && soon[0] < 1e-3 && soon[1] < 1e-2 && second[0] < 0.05, "{name}");
        assert!(falls[0].abs_diff(falls[1]) <= 6, "{falls:?}");
        // Where the log begins with the robot the first row has the CPU's bits.
        let options = CollectOptions { count: 70, seconds: 0.1, shift: [0.0; 2], privileged: true };
        let begun = collect(&device, &subject, &options, &|| false).unwrap().unwrap();
        // Actions are the networks', which round otherwise.
        let first = |log: &Collected| {
            let first = log.trajectory.slice(0..1).unwrap();
            Trajectory { action: None, target: None, ..first }
        };
        for (got, want) in begun.iter().zip(&collect::collect(&subject, &options, 16).unwrap()) {
            assert_eq!(first(got), first(want));
        }
    }
}

#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_training_has_its_bits_again_and_goes_on_anywhere() {
    let device = Device::open(0).unwrap();
    let task = task("velocity");
    let mut candidate = Candidate::nominal(&go2());
    candidate.networks = vec![networks(NetworkKind::ResidAct, &[11])];
    let training = |task, environments, steps| around(task, &candidate, environments, steps);
    let run = |host: &mut Training<'_>, iterations: usize| {
        let mut trainer = Trainer::new(&device, host, Precision::Tf32).unwrap();
        for _ in 0..iterations {
            trainer.iterate().unwrap();
        }
        trainer.store(host).unwrap();
    };
    let mut whole = training(&task, 600, 24);
    run(&mut whole, 4);
    let mut half = training(&task, 600, 24);
    run(&mut half, 2);
    // Through a checkpoint of the CPU.
    let saved = half.save(&origin(), 0.0).unwrap();
    let mut other = training(&task, 600, 24);
    other.restore(&saved, &origin()).unwrap();
    assert_eq!(other.iteration(), 2);
    run(&mut other, 2);
    assert!(state(&mut other) == state(&mut whole), "a training that went on has other bits");
    // And on the CPU.
    let before = half.iteration();
    let iteration = half.iterate(8).unwrap();
    assert_eq!((iteration.number, half.iteration()), (before, before + 1));
    assert!(
        iteration.diagnostics.kl_last < 0.1 && iteration.diagnostics.clip_fraction < 0.6,
        "{iteration:?}"
    );
}

#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_training_walks_towards_its_commands() {
    let device = Device::open(0).unwrap();
    let task = task("velocity");
    let mut host = training(&task, 4096, 24);
    let mut trainer = Trainer::new(&device, &mut host, Precision::Tf32).unwrap();
    println!("{} MiB, kernels {:?}", trainer.bytes() >> 20, trainer.rollout().resources().unwrap());
    assert!(trainer.bytes() < 2 << 30);
    let begin = std::time::Instant::now();
    let mut rewards = Vec::new();
    for _ in 0..100 {
        let iteration = trainer.iterate().unwrap();
        rewards.push(iteration.tally.reward / iteration.tally.steps);
    }
    println!("100 iterations in {:.2} s", begin.elapsed().as_secs_f64());
    println!("{:?}", trainer.breakdown().unwrap());
    assert!(rewards[99] > rewards[0] + 0.01, "{rewards:?}");
}
