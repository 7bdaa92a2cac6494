//! Times the PPO update of the paper's sizes on GPU 0, and each of its kernels, and prints JSON.
//!
//! `update_speed [environments [width]]`: 4,096 environments of 24 steps and three hidden layers of 128 by default.

use std::error::Error;

use gaitfit_cuda::ppo::{Batch, Launch, Learner, Precision, Share, run_together};
use gaitfit_cuda::runtime::{Device, Event, Graph, Stream, bytes};
use gaitfit_learn::ppo::{self, Schedule, Settings, Widths, bench::synthetic};

/// Milliseconds of each of `repeats` calls.
fn times(
    device: &Device,
    stream: &Stream,
    repeats: usize,
    mut work: impl FnMut() -> Result<(), Box<dyn Error>>,
) -> Result<Vec<f64>, Box<dyn Error>> {
    let (start, end) = (Event::new(device)?, Event::new(device)?);
    let mut times = Vec::new();
    for _ in 0..repeats {
        start.record(stream)?;
        work()?;
        end.record(stream)?;
        times.push(start.seconds_until(&end)? * 1e3);
    }
    times.sort_by(f64::total_cmp);
    Ok(times)
}

/// Parameters of both networks.
fn parameters(learner: &ppo::Learner) -> Vec<f32> {
    [&learner.actor().parameters[..], &learner.critic().parameters[..]].concat()
}

/// ‖a − b‖ / ‖b − before‖.
fn distance(a: &[f32], b: &[f32], before: &[f32]) -> f64 {
    let norm = |a: &[f32], b: &[f32]| -> f64 {
        a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt()
    };
    norm(a, b) / norm(b, before)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let environments: usize = arguments.next().map_or(Ok(4096), |text| text.parse())?;
    let width: usize = arguments.next().map_or(Ok(128), |text| text.parse())?;
    let device = Device::open(0)?;
    let widths = Widths { observation: 48, critic_observation: 48, action: 12 };
    // A fixed rate: the made-up samples are seen again and again, and an adaptive one would run away.
    let settings = Settings {
        schedule: Schedule::Fixed,
        learning_rate: 1e-4,
        actor_hidden: vec![width; 3],
        critic_hidden: vec![width; 3],
        ..Settings::default()
    };
    let cpu = ppo::Learner::new(settings.clone(), widths, 1)?;
    let before = parameters(&cpu);
    let samples = synthetic(&cpu, environments / 256, 256, 24, 2);
    let batch = Batch { steps: 24, environments: environments / 256 * 256, tile: 256, share: Share::WHOLE };
    let mut by_cpu = ppo::Learner::new(settings.clone(), widths, 1)?;
    let mut copies = samples.clone();
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let cpu_report = by_cpu.update(&mut copies, 0, threads)?;
    let wanted = parameters(&by_cpu);
    let mut results = Vec::new();
    for precision in [Precision::Tf32, Precision::F32, Precision::Bf16] {
        let free = device.memory()?.0;
        let mut learner = Learner::new(&device, &cpu, batch, precision)?;
        let memory = free - device.memory()?.0;
        learner.upload(&samples)?;
        let report = learner.update(0)?;
        let mut after = ppo::Learner::new(settings.clone(), widths, 2)?;
        learner.store(&mut after)?;
        let learned = distance(&parameters(&after), &wanted, &before);
        let stream = Stream::new(&device)?;
        // The learner's own stream runs the update; an event of it times it.
        let (start, end) = (Event::new(&device)?, Event::new(&device)?);
        let mut whole = Vec::new();
        for _ in 0..30 {
            start.record(learner.stream())?;
            run_together(std::slice::from_mut(&mut learner))?;
            end.record(learner.stream())?;
            whole.push(start.seconds_until(&end)? * 1e3);
        }
        whole.sort_by(f64::total_cmp);
        let mut kernels: Vec<serde_json::Value> = Vec::new();
        let mut seen: Vec<&Launch> = Vec::new();
        let resources = learner.resources()?;
        for (number, launch) in learner.plan().launches.iter().enumerate() {
            if seen.iter().any(|other| other.kernel == launch.kernel) {
                continue;
            }
            seen.push(launch);
            let count = learner.plan().launches.iter().filter(|other| other.kernel == launch.kernel).count();
            // The kernels of the deal change their inputs: all of them are timed together.
            let last = launch.kernel == "shuffle_place";
            if launch.kernel.starts_with("shuffle") && !last {
                continue;
            }
            let first = if last { number - 5 } else { number };
            let group = &learner.plan().launches[first..=number];
            let repeat = |stream: &Stream| {
                (0..20).try_for_each(|_| group.iter().try_for_each(|launch| learner.start(stream, launch)))
            };
            let mut graph: Graph = stream.record(repeat)?;
            let times = times(&device, &stream, 9, || Ok(graph.launch(&stream)?))?;
            let resource = resources.iter().find(|(name, ..)| *name == launch.kernel);
            kernels.push(serde_json::json!({
                "kernel": launch.kernel, "launches": count, "microseconds": times[times.len() / 2] * 1e3 / 20.0,
                "blocks": launch.shape.grid, "registers": resource.map(|r| r.1), "local_bytes": resource.map(|r| r.2),
            }));
        }
        results.push(serde_json::json!({
            "precision": precision, "update_ms": whole[whole.len() / 2], "least_ms": whole[0],
            "memory": bytes(memory), "value_loss": report.value_loss, "cpu_value_loss": cpu_report.value_loss,
            "learned_from_cpu": learned, "kernels": kernels,
        }));
    }
    let report = serde_json::json!({
        "gpu": device.info(), "environments": batch.environments, "width": width, "results": results,
    });
    println!("{report:#}");
    Ok(())
}
