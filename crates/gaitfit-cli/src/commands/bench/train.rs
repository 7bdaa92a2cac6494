//! `gaitfit bench train`: whole iterations of PPO on a task.

use super::measured::{SEED, WARM_UP, median};
use crate::cli::BenchTrain;
use crate::exit::Failure;
use crate::output;
use gaitfit::machine;
use gaitfit::settings::{self, TrainConfig};
use gaitfit::train::{self, Setup};
use gaitfit_learn::{Training, TrainingSettings};
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
    /// Largest resident memory of the process; none where the system does not tell.
    peak_memory_bytes: Option<u64>,
    environments: usize,
    steps: usize,
    epochs: usize,
    minibatches: usize,
    iterations: usize,
    threads: usize,
    isa: &'static str,
}

/// Trains from nothing and prints medians over the measured iterations.
pub fn run(args: &BenchTrain) -> Result<(), Failure> {
    // Before anything is read: the GPU's report includes the time until the first iteration.
    let begin = Instant::now();
    let mut config: TrainConfig = settings::load(args.config.as_deref(), &[])?;
    // Only sizes are replaced. Robot, task and networks come from the configuration.
    config.train = TrainingSettings {
        environments: args.environments.unwrap_or(config.train.environments),
        steps: args.steps.unwrap_or(config.train.steps),
        // The sum of both, so that as many as were asked for are measured.
        iterations: args.iterations.get().saturating_add(WARM_UP),
    };
    // The numbers of the command line were not checked with the file's.
    config.train.check().map_err(Failure::usage)?;
    let threads = args.threads.map_or_else(machine::threads, std::num::NonZeroUsize::get);
    let setup = train::setup(&config, "bench", args.config.as_deref(), threads, &args.device)?;
    if setup.devices.are_gpus() {
        return super::train_cuda::run(args, &setup, begin);
    }
    let Setup { scene, plan, .. } = &setup;
    let learner = Training::fresh_learner(scene, &plan.ppo, SEED).map_err(Failure::failed)?;
    let mut training = Training::new(scene, None, &plan.train, learner, SEED).map_err(Failure::usage)?;
    let mut measured = Vec::new();
    while !training.finished() {
        let iteration = training.iterate(threads).map_err(Failure::failed)?;
        // Numbers begin with 0.
        if iteration.number >= WARM_UP {
            measured.push(iteration);
        }
    }
    // A median: other programs delay single iterations, and one long iteration would move a mean.
    let iteration_seconds = median(&measured, |it| it.rollout_seconds + it.update_seconds);
    let (environments, steps) = (plan.train.environments, plan.train.steps);
    let document = Document {
        robot: setup.model.name.clone(),
        task: plan.task.clone(),
        iteration_seconds,
        rollout_seconds: median(&measured, |it| it.rollout_seconds),
        update_seconds: median(&measured, |it| it.update_seconds),
        // Rollout and update together: the speed of a training, not of the simulator alone.
        samples_per_second: (environments * steps) as f64 / iteration_seconds,
        peak_memory_bytes: peak_memory(),
        environments,
        steps,
        epochs: plan.ppo.epochs,
        minibatches: plan.ppo.minibatches,
        iterations: measured.len(),
        threads,
        isa: scene.walker.batch.isa().name(),
    };
    if args.json {
        return output::print_json(&document);
    }
    let memory = document.peak_memory_bytes.map_or_else(String::new, |bytes| {
        format!(", peak memory {:.0} MiB", bytes as f64 / f64::from(1 << 20))
    });
    output::print(&format!(
        "{:.3} s an iteration (median of {}): rollout {:.3} s, update {:.3} s; {:.0} k samples/s{memory}\n\
         {}, {} environments × {} steps, {} epochs × {} minibatches, {threads} thread{}, {}\n",
        document.iteration_seconds,
        document.iterations,
        document.rollout_seconds,
        document.update_seconds,
        1e-3 * document.samples_per_second,
        document.robot,
        document.environments,
        document.steps,
        document.epochs,
        document.minibatches,
        if threads == 1 { "" } else { "s" },
        document.isa
    ))
}

/// Linux's high-water mark of resident memory.
fn peak_memory() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find(|line| line.starts_with("VmHWM:"))?;
    let kilobytes: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    // The kernel writes `kB` and means 1,024 bytes.
    Some(1024 * kilobytes)
}
