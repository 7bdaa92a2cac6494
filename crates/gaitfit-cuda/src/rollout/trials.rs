//! How well a policy walks: trajectories with random commands, constant commands, crossings of uneven ground.

use gaitfit_learn::evaluate::{
    Crossing, CrossingRecorder, DriftRecorder, DriftTrial, Subject, Trial, Trials, crossing_environment,
    crossing_size, drift_environment, ground_place, ground_pose, trial_environments, trial_steps,
};
use gaitfit_learn::task::Ended;

use super::RolloutError;
use super::play::{Extent, Play, Played};
use super::scene::Mode;
use crate::runtime::Device;

impl Played {
    /// How the episode of robot number `at` of all steps stands.
    fn ended(&self, at: usize) -> Ended {
        match (self.reward[at].is_nan(), self.done[at] != 0.0) {
            (true, _) => Ended::Diverged,
            (false, true) => Ended::Fall,
            (false, false) => Ended::No,
        }
    }
}

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
    let mut play = Play::new(device, subject, Mode::Trials, Extent::new(count, last))?;
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
            let played = play.advance(from)?;
            let (errors, motion_errors) = (play.errors()?, play.motion_errors()?);
            for (row, step) in (from..=last).take(steps).enumerate() {
                let state = |index: usize| {
                    let at = row * environments + index;
                    (played.reward[at], played.ended(at), [errors[2 * at], errors[2 * at + 1]])
                };
                let width = environments * joints;
                trials.take(step, &played.action[row * width..][..width], state);
                trials.take_motion(|index| motion_errors.get(row * environments + index).copied());
            }
            subject.count(environments.min(count - first) * steps.min((last - from + 1) as usize));
        }
        finished.extend(trials.finish().into_iter().take(count - first));
    }
    Ok(Some(finished))
}

/// As [`gaitfit_learn::evaluate::drift`], on a GPU, as [`run_trials`] does trajectories.
///
/// # Errors
/// As there.
pub fn drift(
    device: &Device,
    subject: &Subject<'_>,
    robots: usize,
    speeds: Option<[f64; 3]>,
    cancel: &dyn Fn() -> bool,
) -> Result<Option<Vec<DriftTrial>>, RolloutError> {
    // All commands have the same times.
    let Some(timed) = DriftRecorder::all(subject.task, 0, speeds).pop() else { return Ok(Some(Vec::new())) };
    let (last, command_period) = (timed.last(), timed.command_period());
    let extent = Extent { count: robots, last, command_period };
    let mut play = Play::new(device, subject, Mode::Trials, extent)?;
    let (environments, steps) = (play.environments, play.steps);
    let mut recorders = Vec::new();
    for first in (0..robots).step_by(environments) {
        let mut environment = drift_environment(subject, first as u32, environments)?;
        let count = environments.min(robots - first);
        for mut recorder in DriftRecorder::all(subject.task, count, speeds) {
            play.begin(&mut environment, first as u32)?;
            for from in (1..=last).step_by(steps) {
                if cancel() {
                    return Ok(None);
                }
                if let Some(command) = recorder.new_command(from) {
                    play.hold(command)?;
                }
                let (played, bases) = (play.advance(from)?, play.bases()?);
                for (row, step) in (from..=last).take(steps).enumerate() {
                    recorder.take(step, |index| {
                        let at = row * environments + index;
                        (played.ended(at), ground_pose(&bases[7 * at..], &bases[7 * at + 3..]))
                    });
                }
                subject.count(count * steps.min((last - from + 1) as usize));
            }
            recorders.push(recorder);
        }
    }
    Ok(Some(DriftRecorder::joined(recorders)))
}

/// As [`gaitfit_learn::evaluate::crossings`], on a GPU, as [`run_trials`] does trajectories.
///
/// # Errors
/// As there.
pub fn crossings(
    device: &Device,
    subject: &Subject<'_>,
    robots: usize,
    speed: f64,
    cancel: &dyn Fn() -> bool,
) -> Result<Option<Vec<Crossing>>, RolloutError> {
    let (count, last) = crossing_size(subject.task, robots, speed);
    if count == 0 {
        return Ok(Some(Vec::new()));
    }
    let mut play = Play::new(device, subject, Mode::Trials, Extent::new(count, last))?;
    let (environments, steps) = (play.environments, play.steps);
    let mut crossings = Vec::with_capacity(count);
    for first in (0..count).step_by(environments) {
        let mut environment = crossing_environment(subject, first as u32, environments, speed)?;
        play.begin(&mut environment, first as u32)?;
        let Some(mut recorder) = CrossingRecorder::new(&environment) else { continue };
        let mut over = false;
        for from in (1..=last).step_by(steps) {
            if cancel() {
                return Ok(None);
            }
            if !over {
                let (played, bases) = (play.advance(from)?, play.bases()?);
                for (row, step) in (from..=last).take(steps).enumerate() {
                    over = recorder.take(step, |index| {
                        let at = row * environments + index;
                        (played.ended(at), ground_place(&bases[7 * at..]))
                    });
                }
            }
            subject.count(environments.min(count - first) * steps.min((last - from + 1) as usize));
        }
        crossings.extend(recorder.finish().into_iter().take(count - first));
    }
    Ok(Some(crossings))
}
