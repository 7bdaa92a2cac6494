//! Times the update on made-up samples.

use std::time::Instant;

use gaitfit_random::{Purpose, Stream};
use serde::Serialize;

use super::{Diagnostics, Learner, LearnerError, Samples, Settings, UpdateError, Widths, loss::HALF_LOG_TAU};
use gaitfit_policy::network::Scratch;

/// Results of one timing.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Timing {
    /// Wall-clock seconds of every timed update, in order.
    pub seconds: Vec<f64>,
    /// Seconds of processor time of the whole process in each, all threads together; empty where the system does
    /// not tell. Other programs on the machine spoil it less.
    pub cpu_seconds: Vec<f64>,
    /// Diagnostics of the last update.
    pub diagnostics: Diagnostics,
}

/// Reasons why updates cannot be timed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BenchError {
    /// The learner cannot be made.
    #[error(transparent)]
    Learner(#[from] LearnerError),
    /// The update failed.
    #[error(transparent)]
    Update(#[from] UpdateError),
}

/// Samples as a rollout of `learner` would leave them: normal observations and rewards, actions drawn from the actor,
/// values from the critic, an episode's end about once in 500 steps. `tiles × environments × steps` of them.
pub fn synthetic(
    learner: &Learner,
    tiles: usize,
    environments: usize,
    steps: usize,
    seed: u64,
) -> Vec<Samples> {
    let widths = learner.widths();
    let mut scratch = Scratch::new();
    let make = |tile: usize| {
        let mut samples = Samples::new(steps, environments, widths);
        let rows = samples.rows();
        let stream = Stream::new(seed, Purpose::EXPLORATION).environment(tile as u32);
        let normals = |step: u32, out: &mut [f32]| {
            let mut numbers = vec![0.0; out.len()];
            stream.step(step).fill_normals(0, &mut numbers);
            out.iter_mut().zip(&numbers).for_each(|(out, &x)| *out = x as f32);
        };
        normals(0, &mut samples.observation);
        normals(1, &mut samples.critic_observation);
        normals(2, &mut samples.action);
        normals(3, &mut samples.reward);
        // Step numbers keep the arrays' draws apart.
        normals(4, &mut samples.last_value);
        // The rollout begins with new episodes, so nothing is remembered.
        [samples.actor_memory, samples.critic_memory] = learner.blank_memories(environments);
        // Copies: the samples keep the memories as they were before the first step, from which the update
        // starts again.
        let [mut actor, mut critic] = learner.blank_memories(environments);
        let (of_actor, of_critic) =
            (environments * widths.observation, environments * widths.critic_observation);
        let steps_seen = samples
            .observation
            .chunks_exact(of_actor)
            .zip(samples.critic_observation.chunks_exact(of_critic));
        let of_action = environments * widths.action;
        let given =
            samples.mean.chunks_exact_mut(of_action).zip(samples.value.chunks_exact_mut(environments));
        // Step by step, because a memory's output depends on all steps before.
        for ((seen, critic_seen), (mean, value)) in steps_seen.zip(given) {
            learner.means_with(environments, seen, &mut actor, mean, &mut scratch);
            learner.values_with(environments, critic_seen, &mut critic, value, &mut scratch);
        }
        // `action` holds the normal draw z until it becomes μ + σ z.
        for row in 0..rows {
            let mut log_probability = 0.0;
            for (c, &log_std) in learner.log_std().iter().enumerate() {
                let i = row * widths.action + c;
                let z = samples.action[i];
                samples.action[i] = samples.mean[i] + z * log_std.exp();
                log_probability -= 0.5 * z * z + log_std + HALF_LOG_TAU as f32;
            }
            samples.log_probability[row] = log_probability;
            samples.done[row] = if stream.step(5).uniform_f32(row as u32) < 0.002 { 1.0 } else { 0.0 };
        }
        samples
    };
    (0..tiles).map(make).collect()
}

/// Times `repeats` updates after one that warms up, on the samples of [`synthetic`].
///
/// # Errors
/// [`BenchError`] for bad settings.
pub fn time_updates(
    settings: &Settings,
    widths: Widths,
    [tiles, environments, steps]: [usize; 3],
    threads: usize,
    repeats: usize,
) -> Result<Timing, BenchError> {
    // A fixed rate: the made-up samples are seen again and again, and an adaptive one would run away.
    let settings = Settings { schedule: super::Schedule::Fixed, learning_rate: 1e-4, ..settings.clone() };
    // Seeds are fixed, so that all timings are of the same networks and samples.
    let mut learner = Learner::new(settings, widths, 1)?;
    let mut samples = synthetic(&learner, tiles, environments, steps, 2);
    // Warms up: the first update allocates gradients and workers.
    let diagnostics = learner.update(&mut samples, 0, threads)?;
    let mut timing = Timing { seconds: Vec::new(), cpu_seconds: Vec::new(), diagnostics };
    for iteration in 0..repeats {
        let (start, cpu_start) = (Instant::now(), process_seconds());
        timing.diagnostics = learner.update(&mut samples, iteration as u32 + 1, threads)?;
        timing.seconds.push(start.elapsed().as_secs_f64());
        // Stays empty where the system tells no process times.
        timing.cpu_seconds.extend(process_seconds().zip(cpu_start).map(|(end, start)| end - start));
    }
    Ok(timing)
}

/// Processor time that this process has used.
fn process_seconds() -> Option<f64> {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
        Some(time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9)
    }
    #[cfg(not(unix))]
    None
}
