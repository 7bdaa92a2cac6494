//! Trainings and fits on several devices.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::device::{Device, Devices};
use crate::run::RunFolder;
use crate::settings::{self, TrainConfig};
use crate::watch::Watch;
use std::path::Path;

fn training(seeds: &str, devices: &Devices) -> Result<crate::train::Setup, crate::Error> {
    let changes = ["train.environments=32", "train.steps=6", "train.iterations=2", seeds];
    let config: TrainConfig = settings::load(None, &changes.map(str::to_owned)).unwrap();
    crate::train::setup(&config, "walk", None, 2, devices)
}

/// Final policy of each seed of a training on `devices`.
fn policies(devices: &Devices) -> Vec<Vec<u8>> {
    let runs = tempfile::tempdir().unwrap();
    let mut setup = training("seeds=[3, 1, 2]", &Device::Cpu.into()).unwrap();
    setup.devices = devices.clone();
    let folder = RunFolder::only(runs.path(), "walk").unwrap();
    let results = crate::train::train_in(&setup, &folder, &Watch::silent()).unwrap();
    assert_eq!(results.seeds.iter().map(|one| one.seed).collect::<Vec<_>>(), [3, 1, 2]);
    results.seeds.iter().map(|one| std::fs::read(&one.policy).unwrap()).collect()
}

#[test]
fn seeds_that_are_shared_have_the_bits_of_those_trained_in_turn() {
    let alone = policies(&Device::Cpu.into());
    assert!(alone[0] != alone[1]);
    assert!(alone == policies(&Devices::new(Device::Cpu, [Device::Cpu])));
}

#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_seeds_side_by_side_have_the_bits_of_those_trained_in_turn() {
    assert!(policies(&Device::Cuda(0).into()) == policies(&Devices::new(Device::Cuda(0), [Device::Cuda(0)])));
}

#[test]
fn several_gpus_train_a_seed_together_or_a_seed_each() {
    let two: Devices = "cuda:0,1".parse().unwrap();
    for seeds in ["seeds=[1]", "seeds=[1, 2, 3]"] {
        let setup = training(seeds, &two).unwrap();
        assert_eq!(setup.devices, two);
        assert!(!setup.warnings.iter().any(|one| one.contains("GPUs")), "{:?}", setup.warnings);
    }
    let three: Devices = "cuda:0,1,2".parse().unwrap();
    let setup = training("seeds=[1, 2]", &three).unwrap();
    assert_eq!(setup.devices, two);
    assert!(
        setup.warnings.iter().any(|one| one.contains("of 3 GPUs cuda:0,1 are used")),
        "{:?}",
        setup.warnings
    );
    let error = training("seeds=[1]", &three).map(drop).unwrap_err().to_string();
    assert!(error.contains("32 robots") && error.contains("30 or 33"), "{error}");
}

/// A whole fit, from the settings to the results: searches of two costs and two seeds, and their intervals. The
/// command line refuses one card twice, for it brings nothing.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_a_fit_in_two_sessions_has_the_bits_of_one() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/go2-demo/adapt.toml");
    let runs = tempfile::tempdir().unwrap();
    let fit = |name: &str, devices: &Devices| {
        let changes = [
            "costs=[\"wass\", \"matcho\"]",
            "optimizer.seeds=2",
            "optimizer.generations=6",
            "simulation.timestep=0.005",
            "check={}",
            "validate=[]",
            "robot=../../assets/go2.xml",
            "logs=[\"../../examples/go2-demo/fit.csv\"]",
        ];
        let config = settings::load(Some(&file), &changes.map(str::to_owned)).unwrap();
        let mut setup =
            crate::adapt::Opening::new(&config, &file).threads(4).devices(devices).open().unwrap();
        let folder = RunFolder::only(runs.path(), name).unwrap();
        let results = crate::adapt::fit(&mut setup, &folder, &Watch::silent()).unwrap();
        let mut results = serde_json::to_value(results).unwrap();
        for key in ["wall_seconds", "run_folder"] {
            results.as_object_mut().unwrap().remove(key);
        }
        results
    };
    let one = fit("one", &Device::Cuda(0).into());
    let two = fit("two", &Devices::new(Device::Cuda(0), [Device::Cuda(0)]));
    assert!(one["parameters"].as_array().is_some_and(|all| !all.is_empty()), "{one}");
    assert_eq!(one, two);
}
