//! Updates that several GPUs share: on the CPU as C++, and on GPUs.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use crate::host::{self, Arrays, doubles, floats};
use crate::ppo_host::{BATCH, LIMITS, arrays, distance, problem_of, settings};

use gaitfit_cuda::ppo::{Batch, Plan, Precision, Prepared, Share};
use gaitfit_learn::ppo::{MemorySettings, Samples, Settings};
use gaitfit_policy::network::Cell;

/// Environments of each of two GPUs.
const EACH: usize = 6;
const WHOLE: Batch = Batch { environments: 2 * EACH, tile: EACH, ..BATCH };

fn part(number: usize) -> Batch {
    Batch { environments: EACH, share: Share { number, count: 2 }, ..WHOLE }
}

/// What an update begins with besides samples.
const CONTROL: [u32; 5] = [3, 0, 0, 5, 0];

/// An update of the samples by two GPUs; and what one GPU that has all of them begins with, to be run by [`alone`].
fn update(settings: &Settings, spoil: impl Fn(&mut [Samples])) -> (Vec<Arrays>, Prepared, Arrays) {
    let (learner, mut tiles) = problem_of(settings, [EACH; 2]);
    spoil(&mut tiles);
    let prepare = |batch| Prepared::new(&learner, batch, Precision::F32, LIMITS).unwrap();
    let parts = [0, 1].map(|number| prepare(part(number)));
    assert!(parts[0].program == parts[1].program, "GPUs compile one program");
    let plans: Vec<&Plan> = parts.iter().map(|part| &part.plan).collect();
    let shares = [0, 1].map(|number| arrays(&learner, &tiles[number..=number], &parts[number], CONTROL));
    let together = host::run_together(&parts[0].program.text, &plans, &shares, &["packed"]);
    let whole = prepare(WHOLE);
    let before = arrays(&learner, &tiles, &whole, CONTROL);
    (together, whole, before)
}

/// The same update by one GPU.
fn alone(whole: &Prepared, before: &Arrays) -> Arrays {
    host::run(&whole.program.text, &whole.plan, before, &["packed"])
}

const LEARNED: [&str; 2] = ["parameters", "memory_parameters"];

/// With one minibatch an epoch both ways learn from the same samples: the steps are the same but for rounding, and both
/// GPUs have the same bits.
fn compare(settings: Settings) {
    let settings = Settings { minibatches: 1, ..settings };
    let (together, whole, before) = update(&settings, |_| {});
    let alone = alone(&whole, &before);
    for name in LEARNED.into_iter().filter(|name| before.contains_key(name)) {
        let learned = |after: &Arrays| -> Vec<f32> {
            floats(&after[name]).iter().zip(floats(&before[name])).map(|(a, b)| a - b).collect()
        };
        let far = distance(&learned(&together[0]), &learned(&alone));
        assert!(far > 0.0 && far < 2e-5, "{name}: {far}");
    }
    for name in ["parameters", "moments", "memory_parameters", "memory_moments", "packed", "state"] {
        assert!(together[0].get(name) == together[1].get(name), "{name} differ");
    }
    for name in ["statistics", "critic_statistics"] {
        assert_eq!(together[0][name], together[1][name]);
        for (value, wanted) in doubles(&together[0][name]).iter().zip(&doubles(&alone[name])) {
            assert!((value - wanted).abs() < 1e-12 * wanted.abs().max(1.0), "{name}: {value} {wanted}");
        }
    }
    let advantages: Vec<f32> = {
        // Rows are step by step, of each step the first GPU's robots, then the second's.
        let [one, other] = [0, 1].map(|number| floats(&together[number]["advantage"]));
        one.chunks(EACH).zip(other.chunks(EACH)).flat_map(|(a, b)| [a, b].concat()).collect()
    };
    assert!(distance(&advantages, &floats(&alone["advantage"])) < 1e-6);
    let [state, wanted] = [&together[0], &alone].map(|arrays| doubles(&arrays["state"]));
    assert_eq!((state[0], state[1], state[5]), (wanted[0], wanted[1], 0.0));
    for (number, (value, wanted)) in state.iter().zip(&wanted).enumerate().skip(8) {
        let scale = wanted.abs().max(0.05);
        assert!((value - wanted).abs() < 2e-5 * scale, "number {number}: {value}, one GPU {wanted}");
    }
}

#[test]
#[ignore = "needs g++"]
fn cxx_two_gpus_learn_what_one_does() {
    compare(settings());
}

#[test]
#[ignore = "needs g++"]
fn long_cxx_two_gpus_learn_what_one_does_with_plain_numbers() {
    let plain = Settings {
        fixed_std: Some(0.7),
        normalise_observations: false,
        normalise_advantage: false,
        ..settings()
    };
    compare(plain);
}

#[test]
#[ignore = "needs g++"]
fn long_cxx_two_gpus_learn_what_one_does_with_a_memory() {
    for (cell, layers) in [(Cell::Gru, 1), (Cell::Lstm, 2)] {
        compare(Settings { memory: Some(MemorySettings { cell, width: 9, layers }), ..settings() });
    }
}

/// In several minibatches the samples are dealt otherwise: both GPUs have the same bits, and learn from all samples.
#[test]
#[ignore = "needs g++"]
fn long_cxx_two_gpus_keep_the_same_weights_in_many_minibatches() {
    let (together, _, before) = update(&Settings { minibatches: 3, epochs: 3, ..settings() }, |_| {});
    for name in ["parameters", "moments", "state"] {
        assert_eq!(together[0][name], together[1][name]);
    }
    assert_ne!(together[0]["parameters"], before["parameters"]);
    for arrays in &together {
        let mut places: Vec<u32> =
            arrays["places"].chunks_exact(4).map(|b| u32::from_ne_bytes(b.try_into().unwrap())).collect();
        for epoch in places.chunks_exact_mut(BATCH.steps * EACH) {
            epoch.sort_unstable();
            assert!(epoch.iter().enumerate().all(|(number, &place)| number as u32 == place));
        }
    }
}

/// Of a number that is none on one GPU, all learn nothing.
#[test]
#[ignore = "needs g++"]
fn long_cxx_a_faulty_sample_of_one_gpu_stops_both() {
    let (together, _, before) = update(&settings(), |tiles| tiles[1].mean[7] = f32::NAN);
    for arrays in &together {
        assert_eq!(doubles(&arrays["state"])[5], 100.0);
        assert_eq!(arrays["parameters"], before["parameters"]);
    }
}
