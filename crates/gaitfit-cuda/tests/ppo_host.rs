//! The GPU's update, run on the CPU as C++, against the CPU's learner; and its text through NVIDIA's compiler.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use crate::host;
use crate::ppo_functions::foreign;

use gaitfit_cuda::ppo::{Batch, Flat, Limits, Precision, Prepared, Share};
use gaitfit_cuda::runtime::{Nvrtc, compile};
use gaitfit_learn::ppo::{Learner, MemorySettings, Samples, Settings, Widths, bench::synthetic};
use gaitfit_policy::network::{Activation, Cell, Memory, Recurrent};
use host::{Arrays, bytes, doubles, floats};

pub const WIDTHS: Widths = Widths { observation: 7, critic_observation: 35, action: 3 };
pub const BATCH: Batch = Batch { steps: 20, environments: 13, tile: 8, share: Share::WHOLE };
pub const LIMITS: Limits = Limits { processors: 3, shared_memory: 232_448 };

pub fn settings() -> Settings {
    Settings {
        actor_hidden: vec![40, 12],
        critic_hidden: vec![33],
        output_gain: 1.0,
        epochs: 2,
        minibatches: 2,
        learning_rate: 3e-3,
        normalise_observations: true,
        ..Settings::default()
    }
}

/// A learner that has learned once, so that nothing is 0, and samples in two tiles of 8 and 5 environments.
pub fn problem(settings: &Settings) -> (Learner, Vec<Samples>) {
    problem_of(settings, [BATCH.tile, BATCH.environments - BATCH.tile])
}

/// As [`problem`], with other tiles.
pub fn problem_of(settings: &Settings, environments: [usize; 2]) -> (Learner, Vec<Samples>) {
    samples_for(Learner::new(settings.clone(), WIDTHS, 5).unwrap(), environments)
}

pub fn samples_for(mut learner: Learner, environments: [usize; 2]) -> (Learner, Vec<Samples>) {
    let tiles = |learner: &Learner, seed: u64| -> Vec<Samples> {
        let tile = |(number, &count)| synthetic(learner, 1, count, BATCH.steps, seed + number);
        (0..).zip(&environments).flat_map(tile).collect()
    };
    learner.update(&mut tiles(&learner, 1), 0, 1).unwrap();
    let mut samples = tiles(&learner, 3);
    // Rollouts go on from rollouts: something is remembered, and some episodes end in their midst.
    let remembers = |tile: &Samples| !tile.actor_memory.is_empty() || !tile.critic_memory.is_empty();
    for (number, tile) in samples.iter_mut().enumerate().filter(|(_, tile)| remembers(tile)) {
        for memory in [&mut tile.actor_memory, &mut tile.critic_memory] {
            let count = memory.numbers().len();
            let numbers: Vec<f32> =
                (0..count).map(|k| 0.5 * (k as f32 * 1.7 + number as f32).sin()).collect();
            assert!(memory.set_numbers(&numbers));
        }
        tile.done.iter_mut().skip(number + 2).step_by(17).for_each(|done| *done = 1.0);
    }
    (learner, samples)
}

/// Rows of a memory of all tiles.
pub fn remembered(tiles: &[Samples], of: fn(&Samples) -> &Memory) -> Vec<u8> {
    let mut rows = Vec::new();
    for tile in tiles.iter().filter(|tile| !of(tile).is_empty()) {
        (0..tile.environments).for_each(|index| of(tile).append_row(index, &mut rows));
    }
    bytes(&rows, f32::to_ne_bytes)
}

/// The arrays of memories, where there are some.
fn memory_arrays(learner: &Learner, tiles: &[Samples], prepared: &Prepared) -> Arrays {
    let memories = [learner.actor_memory(), learner.critic_memory()];
    if memories.iter().all(Option::is_none) {
        return Arrays::new();
    }
    // A network without a memory takes its observation.
    let widths = [WIDTHS.observation, WIDTHS.critic_observation];
    let [actor, critic] = [0, 1].map(|number| memories[number].map_or(widths[number], Recurrent::outputs));
    let flat = Flat::new(learner);
    let unit = |width: usize| [vec![1.0f32; width], vec![0.0; width]].concat();
    Arrays::from([
        ("actor_start", remembered(tiles, |tile| &tile.actor_memory)),
        ("critic_start", remembered(tiles, |tile| &tile.critic_memory)),
        ("memory_parameters", bytes(&flat.memories, f32::to_ne_bytes)),
        ("memory_moments", bytes(&flat.memory_moments, f32::to_ne_bytes)),
        ("memory_turn", bytes(&prepared.turn, u32::to_ne_bytes)),
        ("memory_unit", bytes(&[unit(actor), unit(critic)].concat(), f32::to_ne_bytes)),
    ])
}

/// Samples of all tiles as one array of steps × environments.
fn joined(tiles: &[Samples], steps: usize, of: fn(&Samples) -> &Vec<f32>) -> Vec<u8> {
    let mut all = Vec::new();
    for step in 0..steps {
        for tile in tiles {
            let count = of(tile).len() / steps;
            all.extend_from_slice(&of(tile)[step * count..(step + 1) * count]);
        }
    }
    bytes(&all, f32::to_ne_bytes)
}

pub fn arrays(learner: &Learner, tiles: &[Samples], prepared: &Prepared, control: [u32; 5]) -> Arrays {
    let flat = Flat::new(learner);
    let scalars = learner.scalars();
    let mut state = [0.0; 19];
    (state[0], state[1]) = (scalars.learning_rate, scalars.steps as f64);
    let statistics = |normaliser: Option<gaitfit_policy::network::Normaliser>, width: usize| {
        let from = normaliser.unwrap_or_else(|| gaitfit_policy::network::Normaliser::new(width));
        bytes(&[from.mean, from.variance, vec![from.count]].concat(), f64::to_ne_bytes)
    };
    let steps = BATCH.steps;
    let mut all = memory_arrays(learner, tiles, prepared);
    all.extend([
        ("observation", joined(tiles, steps, |tile| &tile.observation)),
        ("critic_observation", joined(tiles, steps, |tile| &tile.critic_observation)),
        ("action", joined(tiles, steps, |tile| &tile.action)),
        ("mean", joined(tiles, steps, |tile| &tile.mean)),
        ("log_probability", joined(tiles, steps, |tile| &tile.log_probability)),
        ("value", joined(tiles, steps, |tile| &tile.value)),
        ("reward", joined(tiles, steps, |tile| &tile.reward)),
        ("done", joined(tiles, steps, |tile| &tile.done)),
        ("last_value", joined(tiles, 1, |tile| &tile.last_value)),
        ("parameters", bytes(&flat.parameters, f32::to_ne_bytes)),
        ("moments", bytes(&flat.moments, f32::to_ne_bytes)),
        ("map", bytes(&prepared.maps[0], u32::to_ne_bytes)),
        ("forth", bytes(&prepared.maps[1], u32::to_ne_bytes)),
        ("back", bytes(&prepared.maps[2], u32::to_ne_bytes)),
        ("state", bytes(&state, f64::to_ne_bytes)),
        ("control", bytes(&control, u32::to_ne_bytes)),
        ("statistics", statistics(scalars.normaliser, WIDTHS.observation)),
        ("critic_statistics", statistics(scalars.critic_normaliser, WIDTHS.critic_observation)),
    ]);
    all
}

/// ‖a − b‖ / ‖b‖.
pub fn distance(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    let norm = |numbers: &mut dyn Iterator<Item = f64>| numbers.map(|x| x * x).sum::<f64>().sqrt();
    norm(&mut a.iter().zip(b).map(|(a, b)| f64::from(a - b))) / norm(&mut b.iter().map(|&b| f64::from(b)))
}

/// One update of both, and how far they are apart: what was learned, moments, scalars.
pub fn compare(settings: Settings, iteration: u32, flags: [u32; 2], precision: Precision, limit: f64) {
    compare_on(problem(&settings), iteration, flags, precision, limit);
}

/// As [`compare`], of this learner and these samples.
pub fn compare_on(
    (mut learner, mut tiles): (Learner, Vec<Samples>),
    iteration: u32,
    flags: [u32; 2],
    precision: Precision,
    limit: f64,
) {
    let settings = learner.settings().clone();
    let prepared = Prepared::new(&learner, BATCH, precision, LIMITS).unwrap();
    let control = [iteration, flags[0], flags[1], 5, 0];
    let arrays = arrays(&learner, &tiles, &prepared, control);
    let out = host::run(&prepared.program.text, &prepared.plan, &arrays, &["packed"]);
    // Each block keeps derivatives in a place of its own. In bf16 there are gaps between the layers.
    let kept = floats(&out["kept"]);
    assert!(precision == Precision::Bf16 || kept.iter().all(|slope| slope.is_finite()), "places overlap");
    let report = learner.update(&mut tiles, iteration, 1).unwrap();
    let after = Flat::new(&learner);
    let remembers = learner.actor_memory().or(learner.critic_memory()).is_some();
    let memories = [("memory_parameters", "memory_moments", &after.memories, &after.memory_moments)];
    for (parameters, moments, wanted, wanted_moments) in
        [("parameters", "moments", &after.parameters, &after.moments)]
            .into_iter()
            .chain(memories.into_iter().filter(|_| remembers))
    {
        let before = floats(&arrays[parameters]);
        let learned = |after: &[f32]| -> Vec<f32> { after.iter().zip(&before).map(|(a, b)| a - b).collect() };
        let far = distance(&learned(&floats(&out[parameters])), &learned(wanted));
        assert!(far < limit, "what was learned of the {parameters} differs by {far}");
        let estimates = floats(&out[moments]);
        let half = estimates.len() / 2;
        for (name, range) in [("first", 0..half), ("second", half..estimates.len())] {
            let far = distance(&estimates[range.clone()], &wanted_moments[range]);
            assert!(far < limit, "the {name} {moments} differ by {far}");
        }
    }
    let state = doubles(&out["state"]);
    let scalars = learner.scalars();
    assert_eq!((state[0], state[1], state[5]), (scalars.learning_rate, scalars.steps as f64, 0.0));
    let count = (settings.epochs * settings.minibatches) as f64;
    for (name, value, wanted) in [
        ("policy loss", state[8] / count, report.policy_loss),
        ("value loss", state[9] / count, report.value_loss),
        ("entropy", state[10] / count, report.entropy),
        ("KL divergence", state[11] / count, report.kl),
        ("last KL divergence", state[12], report.kl_last),
        ("k1", state[13] / count, report.approx_kl_k1),
        ("k3", state[14] / count, report.approx_kl_k3),
        ("clip fraction", state[15] / count, report.clip_fraction),
        ("gradient norm", state[16] / count, report.gradient_norm),
        ("explained variance", state[17], report.explained_variance),
        ("mean deviation", state[18], report.mean_std),
    ] {
        // A ratio beside the clip may fall on either side of it.
        let scale = wanted.abs().max(if name == "clip fraction" { 0.2 } else { 0.05 });
        assert!((value - wanted).abs() < limit * scale, "{name}: {value}, CPU {wanted}");
    }
    if let Some(normaliser) = scalars.critic_normaliser {
        let wanted = [normaliser.mean, normaliser.variance, vec![normaliser.count]].concat();
        for (value, wanted) in doubles(&out["critic_statistics"]).iter().zip(&wanted) {
            assert!((value - wanted).abs() < 1e-12 * wanted.abs().max(1.0), "{value} {wanted}");
        }
    }
}

#[test]
#[ignore = "needs g++"]
fn cxx_update_is_the_cpus() {
    compare(settings(), 3, [0, 0], Precision::F32, 2e-5);
}

#[test]
#[ignore = "needs g++"]
fn long_cxx_update_with_other_settings_is_the_cpus() {
    let plain = Settings {
        activation: Activation::Tanh,
        clipped_value_loss: false,
        fixed_std: Some(0.7),
        schedule: gaitfit_learn::ppo::Schedule::Fixed,
        normalise_observations: false,
        normalise_advantage: false,
        minibatches: 3,
        ..settings()
    };
    compare(plain, 7, [0, 0], Precision::F32, 2e-5);
}

#[test]
#[ignore = "needs g++"]
fn long_cxx_warm_up_moves_the_critic_alone_and_then_starts_afresh() {
    let warm = Settings { activation: Activation::Relu, critic_warmup: Some(4), ..settings() };
    compare(warm.clone(), 3, [1, 0], Precision::F32, 2e-5);
    compare(warm, 4, [0, 1], Precision::F32, 2e-5);
}

#[test]
#[ignore = "needs g++"]
fn long_cxx_update_with_other_activations_is_the_cpus() {
    for activation in [Activation::Selu, Activation::EluOf(0.6), Activation::LeakyRelu(0.2)] {
        compare(Settings { activation, ..settings() }, 3, [0, 0], Precision::F32, 2e-5);
    }
}

#[test]
#[ignore = "needs g++"]
fn cxx_tf32_is_near() {
    compare(settings(), 3, [0, 0], Precision::Tf32, 2e-2);
}

#[test]
#[ignore = "needs g++"]
fn cxx_bf16_is_near() {
    compare(settings(), 3, [0, 0], Precision::Bf16, 4e-2);
}

/// Rollout and first gradient step compute the same means, to the bit. So the divergence between them is 0.
#[test]
#[ignore = "needs g++"]
fn cxx_rollouts_and_updates_have_the_same_means() {
    have_the_same_means(Learner::new(once(), WIDTHS, 5).unwrap(), &[Precision::Bf16]);
    let bounded = foreign(once(), Activation::Silu, Some(Activation::Tanh));
    have_the_same_means(bounded, &[Precision::Bf16]);
}

#[test]
#[ignore = "needs g++"]
fn long_cxx_rollouts_and_updates_have_the_same_means_in_other_precisions() {
    let precisions = [Precision::Tf32, Precision::F32];
    have_the_same_means(Learner::new(once(), WIDTHS, 5).unwrap(), &precisions);
    have_the_same_means(foreign(once(), Activation::Gelu, Some(Activation::Tanh)), &precisions);
}

/// An update of one gradient step.
pub fn once() -> Settings {
    Settings { epochs: 1, minibatches: 1, ..settings() }
}

fn have_the_same_means(learner: Learner, precisions: &[Precision]) {
    let (learner, tiles) = samples_for(learner, [BATCH.tile, BATCH.environments - BATCH.tile]);
    for &precision in precisions {
        let mut prepared = Prepared::new(&learner, BATCH, precision, LIMITS).unwrap();
        let arrays = arrays(&learner, &tiles, &prepared, [3, 0, 0, 5, 0]);
        let divergence = |prepared: &Prepared| {
            let out = host::run(&prepared.program.text, &prepared.plan, &arrays, &["packed"]);
            doubles(&out["state"])[11]
        };
        // Those of the CPU are others.
        assert!(divergence(&prepared) > 0.0);
        let foresee = prepared.plan.foresee(0, BATCH.rows()).unwrap();
        prepared.plan.launches.insert(0, foresee);
        assert_eq!(divergence(&prepared), 0.0, "{precision:?}");
    }
}

#[test]
#[ignore = "needs g++"]
fn cxx_means_and_values_are_the_cpus() {
    means_and_values_are_the_cpus(problem(&settings()));
    let bounded = foreign(settings(), Activation::GeluTanh, Some(Activation::Tanh));
    means_and_values_are_the_cpus(samples_for(bounded, [BATCH.tile, BATCH.environments - BATCH.tile]));
}

fn means_and_values_are_the_cpus((learner, tiles): (Learner, Vec<Samples>)) {
    let mut prepared = Prepared::new(&learner, BATCH, Precision::F32, LIMITS).unwrap();
    // Seven steps from the third on: one whole tile of rows and a part of one.
    let (from, rows) = (2 * BATCH.environments, 7 * BATCH.environments);
    prepared.plan.launches = vec![prepared.plan.foresee(from, rows).unwrap()];
    let arrays = arrays(&learner, &tiles, &prepared, [0; 5]);
    let out = host::run(&prepared.program.text, &prepared.plan, &arrays, &["packed"]);
    let (means, values) = (floats(&out["mean"]), floats(&out["value"]));
    let mut scratch = gaitfit_policy::network::Scratch::new();
    let observation = floats(&arrays["observation"]);
    let mut wanted = vec![0.0; BATCH.rows() * WIDTHS.action];
    learner.means(BATCH.rows(), &observation, &mut wanted, &mut scratch);
    let part = from * WIDTHS.action..(from + rows) * WIDTHS.action;
    assert!(distance(&means[part.clone()], &wanted[part.clone()]) < 1e-6);
    let before = floats(&arrays["mean"]);
    assert!(means[..part.start] == before[..part.start] && means[part.end..] == before[part.end..]);
    let observation = floats(&arrays["critic_observation"]);
    let mut wanted = vec![0.0; BATCH.rows()];
    learner.values(BATCH.rows(), &observation, &mut wanted, &mut scratch);
    assert!(distance(&values[from..from + rows], &wanted[from..from + rows]) < 1e-6);
}

#[test]
#[ignore = "needs g++"]
fn cxx_numbers_that_are_none_stop_the_update() {
    let (learner, mut tiles) = problem(&settings());
    let prepared = Prepared::new(&learner, BATCH, Precision::F32, LIMITS).unwrap();
    let run = |tiles: &[Samples]| {
        let arrays = arrays(&learner, tiles, &prepared, [3, 0, 0, 5, 0]);
        let out = host::run(&prepared.program.text, &prepared.plan, &arrays, &["packed"]);
        assert_eq!(out["parameters"], arrays["parameters"]);
        assert_eq!(out["moments"], arrays["moments"]);
        doubles(&out["state"])
    };
    // A reward that overflows: the first minibatch's value loss is not finite.
    tiles[0].reward[5] = 1e38;
    tiles[0].reward[6] = 3e38;
    let state = run(&tiles);
    assert!((1.0..=6.0).contains(&state[5]) && state[6..8] == [0.0, 0.0], "{state:?}");
    tiles[1].mean[7] = f32::NAN;
    assert_eq!(run(&tiles)[5], 100.0);
}

#[test]
#[ignore = "needs NVRTC: tools/setup_nvrtc.sh"]
fn nvrtc_compiles_the_update_without_spills() {
    let widths = Widths { observation: 48, critic_observation: 48, action: 12 };
    let batch = Batch { steps: 24, environments: 4096, tile: 256, share: Share::WHOLE };
    let precisions = [Precision::Tf32, Precision::F32, Precision::Bf16];
    let lstm = MemorySettings { cell: Cell::Lstm, width: 128, layers: 2 };
    let remembering = [Activation::Elu, Activation::Silu].map(|activation| (Some(lstm), activation));
    // The derivatives of the others than ELU are kept.
    let plain = [Activation::Elu, Activation::Silu, Activation::Gelu, Activation::GeluTanh];
    let cases = remembering.into_iter().chain(plain.map(|activation| (None, activation)));
    for ((memory, activation), precision) in
        cases.flat_map(|case| precisions.map(|precision| (case, precision)))
    {
        let settings = Settings { memory, activation, ..Settings::default() };
        let learner = Learner::new(settings, widths, 1).unwrap();
        let limits = Limits { processors: 132, shared_memory: 232_448 };
        let prepared = Prepared::new(&learner, batch, precision, limits).unwrap();
        let program = prepared.program.option("--ptxas-options=-v");
        let compiled = compile(Nvrtc::get().unwrap(), &program, (9, 0), None).unwrap();
        let log = &compiled.image.log;
        let lines: Vec<&str> = log.lines().filter(|line| line.contains("spill")).collect();
        // Numbers of the passes in bf16 that do not fit: one, with derivatives that are kept up to eleven.
        let most = match (precision, activation.slope_follows_from_output()) {
            (Precision::Bf16, true) => 4,
            (Precision::Bf16, false) => 44,
            (Precision::F32 | Precision::Tf32, _) => 0,
        };
        let kept =
            |line: &&str| (0..=most).any(|bytes| line.contains(&format!(" {bytes} bytes spill stores")));
        assert!(!lines.is_empty() && lines.iter().all(kept), "{log}");
        println!("{activation}, {precision:?}\n{log}");
    }
}
