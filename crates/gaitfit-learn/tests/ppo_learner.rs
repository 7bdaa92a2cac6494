//! The learner from outside: it learns, to the same bits on any number of threads, and says what is wrong.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_learn::ppo::{
    Culprit, Diagnostics, Learner, LearnerError, Samples, SamplesError, Schedule, Settings, StateError,
    UpdateError, Widths, bench,
};
use gaitfit_policy::network::{Normaliser, Scratch};
use gaitfit_random::{Purpose, Stream};

const WIDTHS: Widths = Widths { observation: 9, critic_observation: 11, action: 3 };

fn small() -> Settings {
    Settings { actor_hidden: vec![32, 16], critic_hidden: vec![24], ..Settings::default() }
}

fn bits(learner: &Learner) -> Vec<u32> {
    learner.tensors().iter().flat_map(|(_, values)| values.iter().map(|x| x.to_bits())).collect()
}

/// Two updates from the same start.
fn run(settings: &Settings, threads: usize) -> (Vec<u32>, Vec<Diagnostics>, Learner) {
    let mut learner = Learner::new(settings.clone(), WIDTHS, 7).unwrap();
    let reports = (0..2)
        .map(|iteration| {
            let mut tiles = bench::synthetic(&learner, 3, 50, 12, u64::from(iteration));
            learner.update(&mut tiles, iteration, threads).unwrap()
        })
        .collect();
    (bits(&learner), reports, learner)
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let settings = Settings { normalise_observations: true, ..small() };
    let (one, reports, _) = run(&settings, 1);
    for threads in [0, 2, 3, 5, 40] {
        let (many, other_reports, _) = run(&settings, threads);
        assert!(one == many, "{threads} threads");
        assert_eq!(reports, other_reports);
    }
}

#[test]
fn the_first_minibatch_meets_the_networks_as_they_sampled() {
    // One step a call: its losses are those of the policy and the values that the samples hold. Statistics of
    // the two networks' observations differ, and the second call finds the memory of the first.
    let settings = Settings { epochs: 1, minibatches: 1, ..small() };
    let mut learner = Learner::new(settings, WIDTHS, 7).unwrap();
    let statistics = |width: usize, mean: f64, variance: f64| {
        Some(Normaliser { mean: vec![mean; width], variance: vec![variance; width], count: 10.0 })
    };
    learner.set_normalisers(statistics(9, 0.7, 2.5), statistics(11, -1.5, 0.2)).unwrap();
    for iteration in 0..2 {
        let mut tiles = bench::synthetic(&learner, 3, 50, 12, u64::from(iteration));
        let report = learner.update(&mut tiles, iteration, 2).unwrap();
        let errors = tiles.iter().flat_map(|tile| tile.value.iter().zip(&tile.returns));
        let squares = errors.map(|(&value, &target)| f64::from(value - target).powi(2));
        let value_loss = squares.sum::<f64>() / (3.0 * 50.0 * 12.0);
        assert!((report.value_loss / value_loss - 1.0).abs() < 1e-5, "{report:?}, {value_loss}");
        // Normalised advantages have the mean 0, and with it the surrogate where no ratio has moved.
        assert!(report.policy_loss.abs() < 1e-5 && report.approx_kl_k3.abs() < 1e-9, "{report:?}");
        assert!(report.kl.abs() < 1e-9 && report.clip_fraction == 0.0, "{report:?}");
    }
}

#[test]
fn another_iteration_visits_the_samples_in_another_order() {
    let update = |iteration| {
        let mut learner = Learner::new(small(), WIDTHS, 7).unwrap();
        let mut tiles = bench::synthetic(&learner, 1, 64, 8, 0);
        learner.update(&mut tiles, iteration, 1).unwrap();
        bits(&learner)
    };
    assert!(update(0) == update(0));
    assert!(update(0) != update(1));
}

#[test]
fn a_restored_learner_goes_on_to_the_same_bits() {
    for normalise_observations in [false, true] {
        let settings = Settings { normalise_observations, ..small() };
        let (_, _, mut learner) = run(&settings, 1);
        let tensors: Vec<(String, Vec<f32>)> =
            learner.tensors().iter().map(|(name, values)| ((*name).to_owned(), values.to_vec())).collect();
        let scalars = serde_json::to_string(&learner.scalars()).unwrap();

        let mut restored = Learner::new(settings, WIDTHS, 12345).unwrap();
        let find = |name: &str| tensors.iter().find(|(n, _)| n == name).map(|(_, values)| values.as_slice());
        restored.restore(find, &serde_json::from_str(&scalars).unwrap()).unwrap();
        assert!(bits(&learner) == bits(&restored));
        for learner in [&mut learner, &mut restored] {
            let mut tiles = bench::synthetic(learner, 2, 40, 10, 77);
            learner.update(&mut tiles, 2, 2).unwrap();
        }
        assert!(bits(&learner) == bits(&restored));
        assert_eq!(learner.scalars(), restored.scalars());
    }
}

#[test]
fn a_state_of_another_network_is_refused() {
    let mut learner = Learner::new(small(), WIDTHS, 7).unwrap();
    let other = Learner::new(Settings { actor_hidden: vec![8], ..small() }, WIDTHS, 7).unwrap();
    let before = bits(&learner);
    let tensors = other.tensors();
    let find = |name: &str| tensors.iter().find(|(n, _)| *n == name).map(|(_, values)| *values);
    let error = learner.restore(find, &other.scalars()).unwrap_err();
    assert!(matches!(&error, StateError::Size { name, .. } if name == "actor"), "{error}");
    let error = learner.restore(|_| None, &other.scalars()).unwrap_err();
    assert_eq!(error, StateError::Missing("actor".to_owned()));
    assert!(bits(&learner) == before);
}

#[test]
fn statistics_that_cannot_be_are_refused() {
    let settings = Settings { normalise_observations: true, ..small() };
    let (_, _, learner) = run(&settings, 1);
    let tensors = learner.tensors();
    let find = |name: &str| tensors.iter().find(|(n, _)| *n == name).map(|(_, values)| *values);
    let mut restored = Learner::new(settings, WIDTHS, 7).unwrap();
    let before = bits(&restored);
    let mut refused = |change: fn(&mut Normaliser), part: &str| {
        let mut scalars = learner.scalars();
        change(scalars.normaliser.as_mut().unwrap());
        let error = restored.restore(find, &scalars).unwrap_err();
        assert!(matches!(&error, StateError::Number { name, .. } if name == part), "{error}");
        assert!(bits(&restored) == before);
    };
    refused(|normaliser| normaliser.mean[1] = f64::NAN, "normaliser.mean");
    refused(|normaliser| normaliser.variance[0] = -1.0, "normaliser.variance");
    refused(|normaliser| normaliser.variance[0] = f64::INFINITY, "normaliser.variance");
    refused(|normaliser| normaliser.count = -1.0, "normaliser.count");
}

/// One-step episodes: observation s, action a, reward −|a − M s|².
fn bandit(learner: &Learner, iteration: u32) -> (Vec<Samples>, f64) {
    const M: [[f32; 2]; 2] = [[0.8, -0.5], [0.3, 0.9]];
    let mut samples = Samples::new(4, 256, learner.widths());
    let rows = samples.rows();
    let stream = Stream::new(1, Purpose::EXPLORATION).environment(iteration);
    for (draw, x) in samples.observation.iter_mut().enumerate() {
        *x = stream.step(0).normal(draw as u32) as f32;
    }
    samples.critic_observation.copy_from_slice(&samples.observation);
    let mut scratch = Scratch::new();
    learner.actor().forward(rows, &samples.observation, &mut samples.mean, &mut scratch);
    learner.critic().forward(rows, &samples.critic_observation, &mut samples.value, &mut scratch);
    let mut total = 0.0;
    for row in 0..rows {
        let (mut density, mut cost) = (0.0, 0.0);
        for c in 0..2 {
            let i = row * 2 + c;
            let (z, log_std) = (stream.step(1).normal(i as u32) as f32, learner.log_std()[c]);
            samples.action[i] = samples.mean[i] + z * log_std.exp();
            density -= 0.5 * z * z + log_std + 0.918_938_5;
            let s = &samples.observation[row * 2..row * 2 + 2];
            cost += (samples.action[i] - M[c][0] * s[0] - M[c][1] * s[1]).powi(2);
        }
        samples.log_probability[row] = density;
        samples.reward[row] = -cost;
        samples.done[row] = 1.0;
        total -= f64::from(cost);
    }
    (vec![samples], total / rows as f64)
}

#[test]
fn it_learns_a_linear_map_from_rewards() {
    let widths = Widths { observation: 2, critic_observation: 2, action: 2 };
    let settings = Settings {
        actor_hidden: vec![32],
        critic_hidden: vec![32],
        entropy_coefficient: 0.0,
        ..Settings::default()
    };
    let mut learner = Learner::new(settings, widths, 3).unwrap();
    let first = bandit(&learner, 0).1;
    let mut last = Diagnostics::default();
    for iteration in 0..100 {
        let (mut tiles, _) = bandit(&learner, iteration);
        last = learner.update(&mut tiles, iteration, 2).unwrap();
    }
    let reward = bandit(&learner, 1000).1;
    // At first E|a − M s|² ≈ 2 σ² + |M|² = 2 + 1.79; a learned one is left with its own, shrunken σ.
    assert!((first + 3.79).abs() < 0.6, "first reward {first}");
    assert!(reward > -0.25, "reward {first} became {reward} only; {last:?}");
    assert!(last.mean_std < 0.35 && last.kl > 1e-3 && last.kl < 0.05, "{last:?}");
}

#[test]
fn entropy_bonus_alone_widens_the_policy_and_a_fixed_one_stays() {
    for fixed_std in [None, Some(0.5)] {
        let settings = Settings { entropy_coefficient: 1.0, clip: 1e3, fixed_std, ..small() };
        let mut learner = Learner::new(settings, WIDTHS, 7).unwrap();
        let mut tiles = bench::synthetic(&learner, 1, 64, 8, 0);
        // No advantage: with nothing to gain, only the bonus acts on σ.
        tiles[0].reward.fill(0.0);
        tiles[0].value.fill(0.0);
        tiles[0].last_value.fill(0.0);
        let report = learner.update(&mut tiles, 0, 1).unwrap();
        match fixed_std {
            None => assert!(learner.log_std().iter().all(|&s| s > 0.005), "{:?}", learner.log_std()),
            Some(std) => {
                assert!(learner.log_std().iter().all(|&s| s == std.ln() as f32));
                assert!((report.mean_std - 0.5).abs() < 1e-6);
                // H = 3 (ln 0.5 + ½ ln 2πe).
                assert!((report.entropy - 3.0 * (0.5_f64.ln() + 1.418_938_533)).abs() < 1e-6);
            }
        }
    }
}

#[test]
fn learning_rate_follows_the_divergence() {
    let (_, reports, learner) = run(&Settings { desired_kl: 1e-7, ..small() }, 1);
    assert!(reports[1].learning_rate < 1e-3 / 1.5_f64.powi(10), "{reports:?}");
    assert_eq!(reports[1].learning_rate, learner.learning_rate());
    let (_, reports, _) = run(&Settings { desired_kl: 1e3, ..small() }, 1);
    assert_eq!(reports[1].learning_rate, 1e-2);
    let (_, reports, _) = run(&Settings { schedule: Schedule::Fixed, desired_kl: 1e-7, ..small() }, 1);
    assert_eq!(reports[1].learning_rate, 1e-3);
}

#[test]
fn explained_variance_is_one_for_a_critic_that_knows() {
    let mut learner = Learner::new(Settings { gamma: 0.0, ..small() }, WIDTHS, 7).unwrap();
    let mut tiles = bench::synthetic(&learner, 2, 32, 4, 0);
    for tile in &mut tiles {
        tile.value = tile.reward.clone();
    }
    let report = learner.update(&mut tiles, 0, 1).unwrap();
    assert!((report.explained_variance - 1.0).abs() < 1e-9, "{report:?}");
}

#[test]
fn a_nan_in_the_samples_is_named_with_its_place() {
    let mut learner = Learner::new(small(), WIDTHS, 7).unwrap();
    let before = bits(&learner);
    let mut tiles = bench::synthetic(&learner, 2, 10, 4, 0);
    // Step 2, environment 3, element 5 of the second tile.
    tiles[1].observation[(2 * 10 + 3) * 9 + 5] = f32::NAN;
    let error = learner.update(&mut tiles, 0, 1).unwrap_err();
    let UpdateError::Samples(SamplesError::NotFinite { tile, array, step, environment, element, .. }) = error
    else {
        panic!("{error}");
    };
    assert_eq!((tile, array, step, environment, element), (1, "observation", 2, 3, 5));
    assert!(bits(&learner) == before);
    // Of several, the first, however threads share the tiles.
    let mut tiles = bench::synthetic(&learner, 5, 10, 4, 0);
    tiles[3].reward[1] = f32::INFINITY;
    tiles[4].reward[0] = f32::NAN;
    for threads in [0, 1, 2, 3, 8] {
        let error = learner.update(&mut tiles, 0, threads).unwrap_err();
        let first =
            matches!(error, UpdateError::Samples(SamplesError::NotFinite { tile: 3, array: "reward", .. }));
        assert!(first, "{threads} threads: {error}");
    }
}

#[test]
fn arithmetic_that_overflows_is_named_and_leaves_the_parameters() {
    let overflow = |spoil: fn(&mut Samples)| {
        let mut learner = Learner::new(small(), WIDTHS, 7).unwrap();
        let mut tiles = bench::synthetic(&learner, 1, 16, 4, 0);
        spoil(&mut tiles[0]);
        let before = bits(&learner);
        let error = learner.update(&mut tiles, 4, 2).unwrap_err();
        assert!(bits(&learner) == before);
        match error {
            UpdateError::NotFinite { culprit, iteration: 4, epoch: 0, minibatch: 0 } => culprit,
            other => panic!("{other}"),
        }
    };
    assert_eq!(overflow(|tile| tile.value.fill(1e30)), Culprit::ValueLoss);
    assert_eq!(overflow(|tile| tile.mean.fill(1e30)), Culprit::KlDivergence);
    let culprit = overflow(|tile| {
        tile.action.fill(1e3);
        tile.log_probability.fill(-1e7);
    });
    assert!(matches!(culprit, Culprit::PolicyLoss | Culprit::ActorGradient), "{culprit}");
}

#[test]
fn samples_that_do_not_fit_are_refused() {
    let mut learner = Learner::new(small(), WIDTHS, 7).unwrap();
    let mut few = bench::synthetic(&learner, 1, 3, 1, 0);
    let error = learner.update(&mut few, 0, 1).unwrap_err();
    assert_eq!(error, SamplesError::TooFew { samples: 3, minibatches: 4 }.into());
    assert!(learner.update(&mut [], 0, 1).is_err());
    let mut short = bench::synthetic(&learner, 1, 30, 2, 0);
    short[0].reward.pop();
    assert!(matches!(
        learner.update(&mut short, 0, 1).unwrap_err(),
        UpdateError::Samples(SamplesError::Size { array: "reward", expected: 60, found: 59, .. })
    ));
    let mut other = [Samples::new(2, 30, Widths { action: 4, ..WIDTHS })];
    assert!(matches!(
        learner.update(&mut other, 0, 1).unwrap_err(),
        UpdateError::Samples(SamplesError::Widths { tile: 0, .. })
    ));
}

#[test]
fn bad_settings_are_named() {
    for (settings, name) in [
        (Settings { minibatches: 0, ..small() }, "minibatches"),
        (Settings { epochs: 0, ..small() }, "epochs"),
        (Settings { clip: -0.1, ..small() }, "clip"),
        (Settings { gamma: 1.5, ..small() }, "gamma"),
        (Settings { learning_rate: f64::NAN, ..small() }, "learning_rate"),
        (Settings { learning_rate_limits: [1e-2, 1e-5], ..small() }, "learning_rate_limits"),
        (Settings { fixed_std: Some(0.0), ..small() }, "fixed_std"),
        (Settings { critic_hidden: vec![8, 0], ..small() }, "critic_hidden"),
        (Settings { critic_hidden: vec![4096; 2], ..small() }, "critic_hidden"),
    ] {
        match Learner::new(settings, WIDTHS, 0).err() {
            Some(LearnerError::Settings(error)) => assert_eq!(error.name, name),
            other => panic!("{name}: {other:?}"),
        }
    }
    assert!(serde_json::from_str::<Settings>(r#"{"clipp": 0.2}"#).is_err());
    assert_eq!(serde_json::from_str::<Settings>("{}").unwrap(), Settings::default());
}
