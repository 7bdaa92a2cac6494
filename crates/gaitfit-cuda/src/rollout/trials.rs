//! Trajectories of a policy with random commands.

use gaitfit_learn::evaluate::{Subject, Trial, Trials, trial_environments, trial_steps};
use gaitfit_learn::task::Ended;

use super::RolloutError;
use super::play::{Play, Played};
use super::scene::Mode;
use crate::runtime::Device;

/// As [`gaitfit_learn::evaluate::run_trials`], on a GPU: the same robots, commands, starts, noise and pushes, and motions
/// that differ by rounding. Returns `None` if `cancel` asked to stop. The subject's own `cancel` is not called.
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
    let last = trial_steps(subject, seconds);
    let mut play = Play::new(device, subject, Mode::Trials, count, last)?;
    let (environments, steps) = (play.environments, play.steps);
    let joints = subject.task.walker.joints.len();
    let mut finished = Vec::with_capacity(count);
    for first in (0..count).step_by(environments) {
        let mut environment = trial_environments(subject, first as u32, environments)?;
        play.begin(&mut environment, first as u32)?;
        let mut trials = Trials::new(environment.commands(), joints);
        for from in (1..=last).step_by(steps) {
            if cancel() {
                return Ok(None);
            }
            let Played { action, reward, done } = play.advance(from)?;
            let errors = play.errors()?;
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
            subject.count(environments.min(count - first) * steps.min((last - from + 1) as usize));
        }
        finished.extend(trials.finish().into_iter().take(count - first));
    }
    Ok(Some(finished))
}
