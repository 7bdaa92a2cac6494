//! The update on a GPU against the CPU's learner and `f64`.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use crate::reference;

use gaitfit_cuda::ppo::{Batch, Learner, PpoError, Precision, Share};
use gaitfit_cuda::runtime::Device;
use gaitfit_learn::ppo::{self, MemorySettings, Samples, Settings, UpdateError, Widths, bench::synthetic};
use gaitfit_policy::network::{Activation, Cell};

const WIDTHS: Widths = Widths { observation: 45, critic_observation: 48, action: 12 };

/// A learner that has learned once, and its samples.
pub fn problem(settings: Settings, tiles: usize) -> (ppo::Learner, Vec<Samples>) {
    samples_for(ppo::Learner::new(settings, WIDTHS, 5).unwrap(), tiles)
}

/// The same learner, whose actor has a function of its output.
fn bounded(settings: Settings, output: Activation) -> ppo::Learner {
    // A learner from networks has no normalisers.
    let settings = Settings { normalise_observations: false, ..settings };
    let learner = ppo::Learner::new(settings.clone(), WIDTHS, 5).unwrap();
    let mut actor = learner.actor().clone();
    actor.output = Some(output);
    let networks = [actor, learner.critic().clone()];
    let memories = [learner.actor_memory().cloned(), learner.critic_memory().cloned()];
    ppo::Learner::with_memories(settings, WIDTHS, 5, networks, memories, vec![-0.5; WIDTHS.action]).unwrap()
}

fn samples_for(mut learner: ppo::Learner, tiles: usize) -> (ppo::Learner, Vec<Samples>) {
    learner.update(&mut synthetic(&learner, 1, 256, 24, 1), 0, 8).unwrap();
    let samples = synthetic(&learner, tiles, 256, 24, 3);
    (learner, samples)
}

fn batch(tiles: usize) -> Batch {
    Batch { steps: 24, environments: 256 * tiles, tile: 256, share: Share::WHOLE }
}

fn flat(learner: &ppo::Learner) -> Vec<f64> {
    let [actor, critic, log_std, ..] = learner.tensors().map(|(_, numbers)| numbers);
    let memories = learner.memory_tensors();
    let memories = memories.iter().flat_map(|(_, numbers)| numbers.iter().copied());
    [actor, critic, log_std].concat().into_iter().chain(memories).map(f64::from).collect()
}

/// ‖a − b‖ / ‖b‖.
pub fn distance(a: impl IntoIterator<Item = f64>, b: &[f64]) -> f64 {
    let norm = |numbers: &mut dyn Iterator<Item = f64>| numbers.map(|x| x * x).sum::<f64>().sqrt();
    norm(&mut a.into_iter().zip(b).map(|(a, b)| a - b)) / norm(&mut b.iter().copied())
}

#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_gradient_is_that_of_f64() {
    let settings =
        Settings { epochs: 1, minibatches: 1, normalise_observations: true, ..Settings::default() };
    gradient_is_that_of_f64(problem(settings, 1));
}

/// Swish layers and a tanh of the output, as Brax and MuJoCo Playground have them; and GELU.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_gradient_with_silu_gelu_and_a_bounded_output_is_that_of_f64() {
    for activation in [Activation::Silu, Activation::Gelu] {
        let settings = Settings { epochs: 1, minibatches: 1, activation, ..Settings::default() };
        println!("{activation}");
        gradient_is_that_of_f64(samples_for(bounded(settings, Activation::Tanh), 1));
    }
}

fn gradient_is_that_of_f64((cpu, mut tiles): (ppo::Learner, Vec<Samples>)) {
    let device = Device::open(0).unwrap();
    for (precision, limit) in [(Precision::F32, 3e-6), (Precision::Tf32, 3e-3), (Precision::Bf16, 2e-2)] {
        let mut learner = Learner::new(&device, &cpu, batch(1), precision).unwrap();
        learner.upload(&tiles).unwrap();
        learner.update(9).unwrap();
        let gradient = learner.read_f32("gradient").unwrap();
        tiles[0].advantage = learner.read_f32("advantage").unwrap();
        tiles[0].returns = learner.read_f32("returns").unwrap();
        let wanted = reference::gradient(&cpu, &tiles[0]);
        let far = distance(gradient.iter().map(|&g| f64::from(g)), &wanted);
        println!("{precision:?}: the gradient differs from f64 by {far:.1e}");
        assert!(far < limit, "{precision:?}: {far}");
    }
}

#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_update_is_the_cpus_and_its_own_bits_again() {
    let memory = |cell: Cell, layers: usize| Some(MemorySettings { cell, width: 64, layers });
    for memory in [None, memory(Cell::Gru, 1), memory(Cell::Lstm, 2)] {
        println!("{memory:?}");
        let settings = Settings { epochs: 2, normalise_observations: true, memory, ..Settings::default() };
        update_is_the_cpus(problem(settings, 4));
    }
}

#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_update_with_silu_and_a_bounded_output_is_the_cpus() {
    for memory in [None, Some(MemorySettings { cell: Cell::Gru, width: 64, layers: 1 })] {
        println!("{memory:?}");
        let settings = Settings { epochs: 2, activation: Activation::Silu, memory, ..Settings::default() };
        update_is_the_cpus(samples_for(bounded(settings, Activation::Tanh), 4));
    }
}

fn update_is_the_cpus((mut cpu, mut tiles): (ppo::Learner, Vec<Samples>)) {
    let device = Device::open(0).unwrap();
    let before = flat(&cpu);
    let mut updates = Vec::new();
    for precision in [Precision::F32, Precision::F32, Precision::Tf32] {
        let mut learner = Learner::new(&device, &cpu, batch(4), precision).unwrap();
        learner.upload(&tiles).unwrap();
        let report = learner.update(9).unwrap();
        let mut out = ppo::Learner::new(cpu.settings().clone(), WIDTHS, 77).unwrap();
        learner.store(&mut out).unwrap();
        updates.push((flat(&out), report, out.scalars()));
    }
    assert!(updates[0].0 == updates[1].0 && updates[0].1 == updates[1].1, "the same update has other bits");
    let report = cpu.update(&mut tiles, 9, 8).unwrap();
    let learned = |after: &[f64]| -> Vec<f64> { after.iter().zip(&before).map(|(a, b)| a - b).collect() };
    let wanted = learned(&flat(&cpu));
    for ((parameters, own, scalars), limit) in [(&updates[0], 1e-3), (&updates[2], 0.2)] {
        let far = distance(learned(parameters), &wanted);
        println!("what was learned differs from the CPU's by {far:.1e}\n{own:?}");
        assert!(far < limit, "{far}");
        assert_eq!((scalars.steps, scalars.seed), (cpu.scalars().steps, 5));
        assert!((own.kl - report.kl).abs() < 0.1 * limit * report.kl.max(1e-3), "{} {}", own.kl, report.kl);
        assert!((own.value_loss - report.value_loss).abs() < 0.1 * limit * report.value_loss);
        assert!((own.explained_variance - report.explained_variance).abs() < 1e-6);
    }
    assert_eq!(updates[0].2.learning_rate, cpu.scalars().learning_rate);
    println!("{report:?}");
}

#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_means_and_values_are_the_cpus() {
    let (cpu, tiles) = problem(Settings { normalise_observations: true, ..Settings::default() }, 1);
    let device = Device::open(0).unwrap();
    let mut learner = Learner::new(&device, &cpu, batch(1), Precision::F32).unwrap();
    learner.upload(&tiles).unwrap();
    learner.foresee(learner.stream(), 256, 5000).unwrap();
    let mut wanted = tiles[0].mean.clone();
    let mut scratch = gaitfit_policy::network::Scratch::new();
    cpu.means(
        5000,
        &tiles[0].observation[256 * WIDTHS.observation..],
        &mut wanted[256 * 12..5256 * 12],
        &mut scratch,
    );
    let wanted: Vec<f64> = wanted.into_iter().map(f64::from).collect();
    let means = learner.read_f32("mean").unwrap();
    let far = distance(means.into_iter().map(f64::from), &wanted);
    // Products of split numbers on matrix units: 3.4e-6 on an H200.
    assert!(far < 1e-5, "{far}");
}

#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_refuses_what_it_cannot_learn_from() {
    let (mut cpu, mut tiles) = problem(Settings::default(), 1);
    let device = Device::open(0).unwrap();
    let mut learner = Learner::new(&device, &cpu, batch(1), Precision::Tf32).unwrap();
    assert!(learner.foresee(learner.stream(), 1, batch(1).rows()).is_err());
    assert!(matches!(learner.upload(&tiles[..0]), Err(PpoError::Batch { .. })));
    tiles[0].action[12 * 300 + 5] = f32::NAN;
    learner.upload(&tiles).unwrap();
    let error = learner.update(1).unwrap_err();
    assert!(
        error.to_string().contains("`action` is NaN at step 1, environment 44 of tile 0, element 5"),
        "{error}"
    );
    tiles[0].action[12 * 300 + 5] = 0.0;
    tiles[0].reward[7] = 3e38;
    tiles[0].reward[8] = 3e38;
    learner.upload(&tiles).unwrap();
    let error = learner.update(1).unwrap_err();
    // The minibatches before the faulty one were learned from, as on the CPU.
    let wanted = cpu.update(&mut tiles, 1, 8).unwrap_err();
    assert!(matches!(wanted, UpdateError::NotFinite { .. }), "{wanted}");
    assert_eq!(error, PpoError::Update(wanted));
    let mut out = ppo::Learner::new(Settings::default(), WIDTHS, 77).unwrap();
    learner.store(&mut out).unwrap();
    assert_eq!(out.scalars().steps, cpu.scalars().steps);
    let wide = Settings { actor_hidden: vec![2048; 3], ..Settings::default() };
    let wide = ppo::Learner::new(wide, WIDTHS, 1).unwrap();
    let error = Learner::new(&device, &wide, batch(1), Precision::Tf32).map(|_| ()).unwrap_err();
    assert!(error.to_string().contains("45-2048-2048-2048-12"), "{error}");
}
