//! Trainings that several GPUs share. One card used twice stands for two; where there are two, both are tried too.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use crate::ppo_device::{distance, problem};
use crate::rollout_device::{changed, origin, state, training};

use gaitfit_cuda::ppo::{Batch, Learner, PpoError, Precision, Share, update_together};
use gaitfit_cuda::rollout::{RolloutError, Trainer};
use gaitfit_cuda::runtime::{Device, find};
use gaitfit_learn::ppo::{MemorySettings, Settings};
use gaitfit_learn::task::TerrainSettings;
use gaitfit_learn::{Training, TrainingSettings};
use gaitfit_policy::network::Cell;

/// One card twice, and two cards if there are two.
fn pairs() -> Vec<[Device; 2]> {
    let one = Device::open(0).unwrap();
    let mut pairs = vec![[one.clone(), one.clone()]];
    if find().gpus.len() < 2 {
        println!("there is one GPU: the test of two cards is skipped");
    } else {
        let other = Device::open(1).unwrap();
        println!("GPU 0 reads GPU 1's memory directly: {}", one.reach(&other).unwrap());
        pairs.push([one, other]);
    }
    pairs
}

/// Two halves have the gradient of the whole, and both GPUs the same bits afterwards, twice.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_two_halves_have_the_gradient_of_the_whole() {
    let memory = Some(MemorySettings { cell: Cell::Gru, width: 32, layers: 1 });
    for (memory, precision, limit) in
        [(None, Precision::F32, 1e-5), (None, Precision::Bf16, 1e-5), (memory, Precision::F32, 1e-5)]
    {
        let settings = Settings {
            epochs: 1,
            minibatches: 1,
            normalise_observations: true,
            memory,
            ..Settings::default()
        };
        let (cpu, tiles) = problem(settings, 2);
        let batch = Batch { steps: 24, environments: 512, tile: 256, share: Share::WHOLE };
        for devices in pairs() {
            let mut whole = Learner::new(&devices[0], &cpu, batch, precision).unwrap();
            whole.upload(&tiles).unwrap();
            let wanted_report = whole.update(9).unwrap();
            let names = ["gradient", "memory_gradient", "advantage", "parameters"];
            let read = |learner: &Learner, name: &str| learner.read_f32(name).unwrap();
            let mut updates = Vec::new();
            for _ in 0..2 {
                let mut learners: Vec<Learner> = (0..2)
                    .map(|number| {
                        let share = Share { number, count: 2 };
                        let half = Batch { environments: 256, share, ..batch };
                        let mut learner = Learner::new(&devices[number], &cpu, half, precision).unwrap();
                        learner.upload(&tiles[number..=number]).unwrap();
                        learner
                    })
                    .collect();
                let report = update_together(&mut learners, 9).unwrap();
                let [one, other] = [0, 1].map(|k| names.map(|name| read(&learners[k], name)));
                assert!(one[0] == other[0] && one[1] == other[1] && one[3] == other[3], "other weights");
                updates.push((report, one));
            }
            assert!(updates[0] == updates[1], "other bits the second time");
            let (report, arrays) = &updates[0];
            for (name, numbers) in names.iter().zip(arrays).take(2).filter(|(_, numbers)| !numbers.is_empty())
            {
                let wanted: Vec<f64> = read(&whole, name).into_iter().map(f64::from).collect();
                let far = distance(numbers.iter().map(|&x| f64::from(x)), &wanted);
                println!("{precision:?}: the {name} of two halves differs by {far:.1e}");
                assert!(far > 0.0 && far < limit, "{far}");
            }
            for (value, wanted) in [
                (report.policy_loss, wanted_report.policy_loss),
                (report.value_loss, wanted_report.value_loss),
                (report.kl, wanted_report.kl),
                (report.explained_variance, wanted_report.explained_variance),
                (report.gradient_norm, wanted_report.gradient_norm),
            ] {
                assert!((value - wanted).abs() < 1e-4 * wanted.abs().max(0.01), "{value} {wanted}");
            }
        }
    }
}

/// The first rollout is that of one GPU, robot by robot; trainings have their bits again, and go on elsewhere.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_two_gpus_train_the_robots_of_one() {
    for uneven in [false, true] {
        let task = changed(|settings| settings.terrain = uneven.then(TerrainSettings::default));
        for devices in pairs() {
            let mut one = training(&task, 600, 3);
            let mut alone = Trainer::new(&devices[0], &mut one, Precision::F32).unwrap();
            let wanted = alone.iterate().unwrap();
            alone.store(&mut one).unwrap();
            let run = |iterations: usize| {
                let mut host = training(&task, 600, 3);
                let mut trainer = Trainer::together(&devices, &mut host, Precision::F32).unwrap();
                let results: Vec<_> = (0..iterations).map(|_| trainer.iterate().unwrap()).collect();
                let weights = |k: usize| trainer.learners()[k].read_f32("parameters").unwrap();
                assert!(weights(0) == weights(1));
                trainer.store(&mut host).unwrap();
                (results, host)
            };
            let (results, mut host) = run(1);
            assert_eq!(results[0].tally.steps, wanted.tally.steps);
            println!("{:?}\n{:?}", results[0].tally, wanted.tally);
            assert!(
                (results[0].tally.reward - wanted.tally.reward).abs()
                    < 1e-2 * wanted.tally.reward.abs().max(1.0)
            );
            let mut errors = Vec::new();
            for (snapshot, wanted) in host.snapshots().iter().zip(one.snapshots()) {
                if snapshot.steps == wanted.steps {
                    assert_eq!(snapshot.command, wanted.command);
                    let pairs = snapshot.robot.state.iter().zip(&wanted.robot.state);
                    errors.push(pairs.fold(0.0f32, |worst, (a, b)| worst.max((a - b).abs())));
                }
            }
            errors.sort_by(f32::total_cmp);
            println!(
                "robots apart by {} (half), {} (99 %)",
                errors[errors.len() / 2],
                errors[errors.len() * 99 / 100]
            );
            assert!(errors.len() > 590 && errors[errors.len() * 9 / 10] < 0.1);
            // Twice, and through a checkpoint, the same bits; and on one GPU it goes on.
            let (_, mut whole) = run(3);
            assert!(state(&mut whole) == state(&mut run(3).1), "other bits the second time");
            let saved = run(1).1.save(&origin(), 0.0).unwrap();
            let go_on = |devices: &[Device], iterations: usize| {
                let mut resumed = training(&task, 600, 3);
                resumed.restore(&saved, &origin()).unwrap();
                let mut trainer = Trainer::together(devices, &mut resumed, Precision::F32).unwrap();
                (0..iterations).for_each(|_| drop(trainer.iterate().unwrap()));
                trainer.store(&mut resumed).unwrap();
                resumed
            };
            assert!(
                state(&mut go_on(&devices, 2)) == state(&mut whole),
                "a training that went on has other bits"
            );
            assert_eq!(go_on(&devices[..1], 2).iteration(), 3);
        }
    }
}

#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_memories_are_shared_too() {
    let task = changed(|settings| settings.episode_seconds = 0.1);
    let memory = Some(MemorySettings { cell: Cell::Lstm, width: 32, layers: 1 });
    let ppo = Settings { memory, normalise_observations: true, ..Settings::default() };
    let settings = TrainingSettings { environments: 300, steps: 12, iterations: 100 };
    let training = || {
        let learner = Training::fresh_learner(&task, &ppo, 11).unwrap();
        Training::new(&task, None, &settings, learner, 11).unwrap()
    };
    for devices in pairs() {
        let (mut one, mut two) = (training(), training());
        let mut alone = Trainer::new(&devices[0], &mut one, Precision::F32).unwrap();
        let mut together = Trainer::together(&devices, &mut two, Precision::F32).unwrap();
        let (wanted, outcome) = (alone.iterate().unwrap(), together.iterate().unwrap());
        alone.store(&mut one).unwrap();
        together.store(&mut two).unwrap();
        let value = |iteration: &gaitfit_learn::Iteration| iteration.diagnostics.value_loss;
        assert!((value(&outcome) - value(&wanted)).abs() < 0.05 * value(&wanted));
        for (memory, wanted) in two.memories().iter().zip(&one.memories()) {
            assert_eq!(memory.len(), wanted.len());
            let mut errors: Vec<f32> = memory.iter().zip(wanted).map(|(a, b)| (a - b).abs()).collect();
            errors.sort_by(f32::total_cmp);
            assert!(errors[errors.len() / 2] < 1e-4 && errors[errors.len() * 9 / 10] < 1e-2);
        }
        (0..3).for_each(|_| drop(together.iterate().unwrap()));
        // It compares the GPUs' weights.
        together.store(&mut two).unwrap();
    }
}

#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_several_gpus_say_what_is_wrong_with_which() {
    let task = changed(|_| {});
    for devices in pairs() {
        let mut host = training(&task, 601, 3);
        let error = Trainer::together(&devices, &mut host, Precision::F32).map(drop).unwrap_err();
        assert!(matches!(error, RolloutError::Uneven { environments: 601, gpus: 2 }), "{error}");
        // Nothing of the samples is finite on the second GPU alone: the message has the robot's number of all.
        let settings = Settings::default();
        let (cpu, mut tiles) = problem(settings, 2);
        tiles[1].action[12 * 300 + 5] = f32::NAN;
        let mut learners: Vec<Learner> = (0..2)
            .map(|number| {
                let share = Share { number, count: 2 };
                let batch = Batch { steps: 24, environments: 256, tile: 256, share };
                let mut learner = Learner::new(&devices[number], &cpu, batch, Precision::F32).unwrap();
                learner.upload(&tiles[number..=number]).unwrap();
                learner
            })
            .collect();
        let error = update_together(&mut learners, 1).unwrap_err();
        assert!(matches!(error, PpoError::Update(_)), "{error}");
        assert!(error.to_string().contains("environment 44 of tile 1"), "{error}");
    }
}
