//! Trajectories of a policy with random commands.

use gaitfit_learn::Training;
use gaitfit_learn::evaluate::{Subject, Trial, Trials, trial_environments, trial_steps};
use gaitfit_learn::ppo::Settings;
use gaitfit_learn::task::{Ended, Environment, Snapshot};
use gaitfit_sim::Candidate;

use super::run::Rollout;
use super::scene::Sizes;
use super::{RolloutError, check};
use crate::ppo::{Batch, Learner, PpoError, Precision};
use crate::runtime::Device;

/// Environments at once: the kernels of few are hardly faster, and many take memory.
const ENVIRONMENTS: (usize, usize) = (64, 16_384);
/// Steps of one graph, after which rewards, errors and actions are read.
const STEPS: usize = 25;

/// As [`gaitfit_learn::evaluate::run_trials`], on a GPU: the same robots, commands, starts, noise and pushes, and motions
/// that differ by rounding. Gives none if `cancel` asked to stop.
///
/// # Errors
/// [`RolloutError::Trials`] for what only the CPU simulates; a robot that cannot be; a failure of the GPU.
pub fn run_trials(
    device: &Device,
    subject: &Subject<'_>,
    count: usize,
    seconds: f64,
    cancel: &dyn Fn() -> bool,
) -> Result<Option<Vec<Trial>>, RolloutError> {
    let Subject { task, policy, candidate, seed } = *subject;
    let refused = |error: &dyn std::fmt::Display| RolloutError::Trials(error.to_string());
    let host = Training::learner_from(task, &Settings::default(), policy, seed)
        .map_err(|error| refused(&format!("this policy ({error})")))?;
    let nominal;
    let candidates = match candidate {
        Some(candidate) => std::slice::from_ref(candidate),
        None => {
            nominal = [Candidate::nominal(task.walker.model())];
            &nominal
        }
    };
    let unsupported = |error: RolloutError| match error {
        RolloutError::Unsupported(what) | RolloutError::Ppo(PpoError::Unsupported(what)) => refused(&what),
        error => error,
    };
    check(task, candidates, &host).map_err(unsupported)?;
    let last = trial_steps(subject, seconds);
    let environments = count.clamp(ENVIRONMENTS.0, ENVIRONMENTS.1);
    let steps = STEPS.min(last as usize);
    let batch = Batch { steps, environments, tile: Training::TILE };
    let mut learner = Learner::new(device, &host, batch, Precision::F32)?;
    learner.quiet()?;
    let networks = host.actor().parameters.len() + host.critic().parameters.len();
    let sizes = Sizes { steps, environments, networks, gamma: 1.0, trials: true };
    let mut rollout = Rollout::new(device, learner.stream(), task, candidates, sizes, seed)?;
    let mut graph = learner.stream().record(|stream| rollout.start(stream, &learner))?;
    let ranges = task.settings.command.ranges(1.0);
    let joints = task.walker.joints.len();
    let mut all = Vec::with_capacity(count);
    for first in (0..count).step_by(environments) {
        let number = first as u32;
        let mut environment = trial_environments(subject, number, environments)?;
        rollout.randomise(learner.stream(), candidates, seed, number)?;
        rollout.load(learner.stream(), &snapshots(&mut environment))?;
        let mut trials = Trials::new(environment.commands(), joints);
        for from in (1..=last).step_by(steps) {
            if cancel() {
                return Ok(None);
            }
            rollout.number(learner.stream(), from, seed, ranges, number)?;
            graph.launch(learner.stream())?;
            let [action, reward, done] = ["action", "reward", "done"].map(|name| learner.read_f32(name));
            let (action, reward, done) = (action?, reward?, done?);
            let errors = rollout.errors(learner.stream())?;
            for (row, step) in (from..=last).take(steps).enumerate() {
                let state = |index: usize| {
                    let at = row * environments + index;
                    let ended = match (reward[at].is_nan(), done[at] != 0.0) {
                        (true, _) => Ended::Diverged,
                        (false, true) => Ended::Fall,
                        (false, false) => Ended::No,
                    };
                    (reward[at], ended, [errors[2 * at], errors[2 * at + 1]])
                };
                trials.take(step, &action[row * environments * joints..][..environments * joints], state);
            }
        }
        all.extend(trials.finish().into_iter().take(count - first));
    }
    Ok(Some(all))
}

fn snapshots(environment: &mut Environment<'_>) -> Vec<Snapshot> {
    (0..environment.count()).map(|index| environment.snapshot(index)).collect()
}
