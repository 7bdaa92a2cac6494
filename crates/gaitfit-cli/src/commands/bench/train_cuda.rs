//! `gaitfit bench train --device cuda`: whole iterations of PPO on a GPU.

use super::measured::{SEED, WARM_UP, median};
use crate::cli::{BenchTrain, Products};
use crate::exit::Failure;
use crate::output;
use gaitfit::device::{cuda_error, rollout_error};
use gaitfit::train::Setup;
use gaitfit_cuda::ppo::Precision;
use gaitfit_cuda::rollout::{RolloutError, Trainer};
use gaitfit_cuda::runtime::{Device, bytes};
use gaitfit_learn::task::Snapshot;
use gaitfit_learn::{Iteration, Training};
use serde::Serialize;
use std::time::Instant;

#[derive(Serialize)]
struct Document {
    robot: String,
    task: String,
    iteration_seconds: f64,
    rollout_seconds: f64,
    update_seconds: f64,
    samples_per_second: f64,
    device: String,
    precision: Precision,
    breakdown: Parts,
    /// From the robot's model to the first iteration: robots, programs (perhaps compiled), memory.
    start_seconds: f64,
    memory_bytes: u64,
    lanes: usize,
    same_bits: bool,
    environments: usize,
    steps: usize,
    substeps: usize,
    epochs: usize,
    minibatches: usize,
    iterations: usize,
    kernels: Vec<(String, i32, i32)>,
}

/// Each part alone, all its steps, then the whole rollout and the update; s.
#[derive(Serialize)]
struct Parts {
    observe: f64,
    networks: f64,
    act: f64,
    physics: f64,
    finish: f64,
    rollout: f64,
    update: f64,
}

/// The state of a training.
type State = (Vec<f32>, Vec<Snapshot>);

/// The GPUs, in words.
fn names(devices: &[Device]) -> String {
    let names: Vec<&str> = devices.iter().map(|device| &device.info().name[..]).collect();
    match names.first() {
        // Equal GPUs are counted, different ones are listed.
        Some(first) if names.len() > 1 && names.iter().all(|name| name == first) => {
            format!("{} × {first}", names.len())
        }
        _ => names.join(", "),
    }
}

/// Trains from nothing and prints medians over the measured iterations. The program began at `begin`.
pub fn run(args: &BenchTrain, setup: &Setup, begin: Instant) -> Result<(), Failure> {
    let Setup { scene, plan, .. } = setup;
    let (environments, steps) = (plan.train.environments, plan.train.steps);
    // Asked for here, not in the configuration: runs at several precisions compare one training.
    let precision = match args.precision {
        None => plan.ppo.precision,
        Some(Products::Bf16) => Precision::Bf16,
        Some(Products::Tf32) => Precision::Tf32,
        Some(Products::F32) => Precision::F32,
    };
    let devices = setup.devices.open()?;
    // A function, because the training is made twice: from the same seed, to compare both results.
    let training = || -> Result<Training<'_>, Failure> {
        let learner = Training::fresh_learner(scene, &plan.ppo, SEED).map_err(Failure::failed)?;
        Training::new(scene, None, &plan.train, learner, SEED).map_err(Failure::usage)
    };
    let (mut measured, mut start_seconds): (Vec<Iteration>, f64) = (Vec::new(), 0.0);
    let mut train = |host: &mut Training<'_>| -> Result<State, RolloutError> {
        let mut trainer = Trainer::together(&devices, host, precision)?;
        start_seconds =
            // Only the first training counts: the second one finds its programs compiled.
            start_seconds.max(if measured.is_empty() { begin.elapsed().as_secs_f64() } else { 0.0 });
        while !trainer.finished() {
            let iteration = trainer.iterate()?;
            if iteration.number >= WARM_UP {
                measured.push(iteration);
            }
        }
        // The state lives on the GPU and must come back before it can be compared.
        trainer.store(host)?;
        Ok((host.learner().actor().parameters.to_vec(), host.snapshots()))
    };
    let mut host = training()?;
    let first = train(&mut host).map_err(rollout_error)?;
    // The whole training a second time. All sums have a fixed order, so any difference is an error.
    let same_bits = train(&mut training()?).map_err(rollout_error)? == first;
    // A third trainer for the parts: measuring them changes its state.
    let mut trainer = Trainer::together(&devices, &mut host, precision).map_err(rollout_error)?;
    let parts = trainer.breakdown().map_err(rollout_error)?;
    let iteration_seconds = median(&measured, |it| it.rollout_seconds + it.update_seconds);
    let kernels = trainer.rollout().resources().map_err(|error| cuda_error(&error))?;
    let document = Document {
        robot: setup.model.name.clone(),
        task: plan.task.clone(),
        iteration_seconds,
        rollout_seconds: median(&measured, |it| it.rollout_seconds),
        update_seconds: median(&measured, |it| it.update_seconds),
        samples_per_second: (environments * steps) as f64 / iteration_seconds,
        device: names(&devices),
        precision,
        breakdown: Parts {
            observe: parts.observe,
            networks: parts.networks,
            act: parts.act,
            physics: parts.physics,
            finish: parts.finish,
            rollout: parts.rollout,
            update: parts.update,
        },
        start_seconds,
        memory_bytes: trainer.bytes(),
        lanes: trainer.rollout().lanes(),
        same_bits,
        environments,
        steps,
        substeps: scene.walker.batch.options().substeps,
        epochs: plan.ppo.epochs,
        minibatches: plan.ppo.minibatches,
        // Both trainings are in the list.
        iterations: measured.len() / 2,
        kernels,
    };
    if args.json {
        return output::print_json(&document);
    }
    let Parts { observe, networks, act, physics, finish, rollout, update } = document.breakdown;
    output::print(&format!(
        "{:.2} ms an iteration (median of {}): rollout {:.2} ms, update {:.2} ms; {:.2} M samples/s\n\
         GPU alone: observations {:.2} ms, networks {:.2} ms, exploration {:.2} ms, physics {:.2} ms, rewards and new \
         episodes {:.2} ms; rollout {:.2} ms, update {:.2} ms\n\
         {}, {} environments × {} steps × {} substeps, {} epochs × {} minibatches; {}, {} of the first one's memory, started in {:.1} s, \
         {}\n",
        1e3 * document.iteration_seconds,
        document.iterations,
        1e3 * document.rollout_seconds,
        1e3 * document.update_seconds,
        1e-6 * document.samples_per_second,
        1e3 * observe,
        1e3 * networks,
        1e3 * act,
        1e3 * physics,
        1e3 * finish,
        1e3 * rollout,
        1e3 * update,
        document.robot,
        document.environments,
        document.steps,
        document.substeps,
        document.epochs,
        document.minibatches,
        document.device,
        bytes(document.memory_bytes),
        document.start_seconds,
        if same_bits { "the same bits twice" } else { "OTHER BITS the second time" },
    ))
}
