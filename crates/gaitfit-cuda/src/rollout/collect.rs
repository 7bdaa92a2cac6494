//! Logs of a policy's walks.

use gaitfit_learn::collect::{CollectOptions, Collected, Recorder, sensed_width};
use gaitfit_learn::evaluate::Subject;
use gaitfit_learn::task::Environment;
use gaitfit_policy::MotionPlace;

use super::RolloutError;
use super::play::{Extent, Play, Played};
use super::scene::Mode;
use crate::runtime::Device;

/// As [`gaitfit_learn::collect::collect`], on a GPU: the same robots, commands, starts, noise and pushes, and motions that
/// differ by rounding, which walking robots make larger from step to step. Returns `None` if `cancel` asked
/// to stop. The subject's own `cancel` is not called.
///
/// # Errors
/// [`RolloutError::Trials`] for what only the CPU simulates; a robot that cannot be; a failure of the GPU.
pub fn collect(
    device: &Device,
    subject: &Subject<'_>,
    options: &CollectOptions,
    cancel: &dyn Fn() -> bool,
) -> Result<Option<Vec<Collected>>, RolloutError> {
    let Subject { task, candidate, seed, .. } = *subject;
    // A log of the first robot is as long as any, or nearly so.
    let last = Recorder::new(subject, options, 0, 1).last();
    let mut play = Play::new(device, subject, Mode::Logs, Extent::new(options.count, last))?;
    let (environments, steps) = (play.environments, play.steps);
    let (actions, joints) = (task.walker.joints.len(), task.walker.default_pose.len());
    let (width, dt) = (sensed_width(actions), task.walker.interface.control_dt);
    let mut targets = vec![0.0; environments * joints];
    let mut logs = Vec::with_capacity(options.count);
    for first in (0..options.count).step_by(environments) {
        let mut environment = Environment::new(task, candidate, seed, first as u32, environments)?;
        play.begin(&mut environment, first as u32)?;
        let count = environments.min(options.count - first);
        let mut recorder = Recorder::new(subject, options, first as u32, count);
        let last = recorder.last();
        for from in (1..=last).step_by(steps) {
            if cancel() {
                return Ok(None);
            }
            let Played { action, done, .. } = play.advance(from)?;
            let records = play.records()?;
            for (row, step) in (from..=last).take(steps).enumerate() {
                let from = row * environments;
                let action = &action[from * actions..][..environments * actions];
                task.walker.targets(action, &mut targets);
                for index in 0..count {
                    if recorder.records(index, step) {
                        recorder.sense(index, &records[(from + index) * width..][..width]);
                        // A log ends with its robot's first episode, so the motion stays as it was turned at the start.
                        let time = f64::from(step - 1) * dt;
                        recorder.follow(index, MotionPlace { time, ..environment.motion_place(index) });
                    }
                    let taken = &action[index * actions..][..actions];
                    let fell = done[from + index] != 0.0;
                    recorder.act(index, step, taken, &targets[index * joints..][..joints], fell);
                }
            }
            subject.count(count * steps.min((last - from + 1) as usize));
        }
        logs.extend(recorder.finish());
    }
    Ok(Some(logs))
}
