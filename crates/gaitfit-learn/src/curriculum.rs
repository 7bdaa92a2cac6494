//! Commands of a training that grow from first ranges to the final ones.
//!
//! As in legged_gym (Rudin et al. 2022, `update_command_curriculum`), ranges grow by a step when the mean tracking reward
//! of episodes passes a share of its greatest value. There an episode's sum counts over its longest length, so a fall
//! counts as tracking nothing from then on. Here the rollout of one iteration is measured: its tracking over its
//! steps and those that falls left over. That is the same mean, known many episodes earlier.

use serde::{Deserialize, Serialize};

use crate::rollout::Tally;
use crate::task::{Interval, Task, TaskError};

/// Rewards that measure tracking; their greatest value is 1.
const TRACKING: [&str; 2] = ["track_linear_velocity", "track_yaw_rate"];

/// Growth of a training's commands so far: a part of its state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Growth {
    /// Steps that the ranges have grown by.
    pub steps: u32,
    /// Iterations done when they last grew.
    pub last: u32,
}

/// The commands of an iteration under a curriculum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Commands {
    /// Share of the way from the first ranges to the final ones.
    pub level: f64,
    /// Share of their greatest value that the tracking rewards came to; `None` if the task does not pay them.
    pub tracking: Option<f64>,
}

impl Growth {
    /// Share of the way from the first ranges to the final ones, 0 to 1, in iteration number `iteration`; `None`
    /// without a curriculum.
    pub fn level(&self, task: &Task, iteration: u32) -> Option<f64> {
        let curriculum = task.settings.command.curriculum.as_ref()?;
        let level = match curriculum.iterations {
            // No iterations would divide 0 by 0.
            Some(iterations) => f64::from(iteration) / f64::from(iterations.max(1)),
            None => f64::from(self.steps) * curriculum.step,
        };
        Some(level.min(1.0))
    }

    /// Returns the ranges of commands in iteration number `iteration`.
    pub fn ranges(&self, task: &Task, iteration: u32) -> [Interval; 3] {
        task.settings.command.ranges(self.level(task, iteration).unwrap_or(1.0))
    }

    /// Takes up iteration number `iteration`, of rollouts of `steps` control steps. Gives what its commands were.
    pub fn take(&mut self, task: &Task, iteration: u32, steps: usize, tally: &Tally) -> Option<Commands> {
        let level = self.level(task, iteration)?;
        let tracking = tracking(task, tally);
        let curriculum = task.settings.command.curriculum.as_ref()?;
        // A curriculum by `iterations` has no `tracking`: its level follows from the iteration alone.
        if let (Some(tracking), Some(wanted)) = (tracking, curriculum.tracking) {
            // All robots have had commands of the present ranges.
            let renewed = f64::from(iteration + 1 - self.last) * steps as f64;
            if level < 1.0 && tracking > wanted && renewed >= f64::from(task.command_steps()) {
                // `last` counts iterations that are done, and this one is among them.
                *self = Self { steps: self.steps + 1, last: iteration + 1 };
            }
        }
        Some(Commands { level, tracking })
    }
}

/// The smallest share of its greatest value that a tracking reward of a rollout came to.
fn tracking(task: &Task, tally: &Tally) -> Option<f64> {
    let rewards = task.reward_weights().zip(&tally.terms);
    // A negative weight would pay for not tracking, so its term does not count.
    let tracking = rewards.filter(|((name, weight), _)| TRACKING.contains(name) && *weight > 0.0);
    let shares = tracking
        // Steps that falls left over pay nothing. A policy that falls early cannot pass by tracking well for a
        // moment.
        .map(|((_, weight), sum)| sum / f64::from(weight) / (tally.steps + tally.lost_steps).max(1.0));
    // The reward that lags decides: ranges of speed and of yaw rate grow together.
    shares.min_by(f64::total_cmp)
}

/// Refuses a curriculum that waits for a tracking that nothing pays.
pub(crate) fn check(task: &Task) -> Result<(), TaskError> {
    let curriculum = task.settings.command.curriculum.as_ref();
    let waits = curriculum.is_some_and(|curriculum| curriculum.tracking.is_some());
    let paid = task.reward_weights().any(|(name, weight)| TRACKING.contains(&name) && weight > 0.0);
    if waits && !paid {
        return Err(TaskError::Setting {
            setting: "command.curriculum.tracking".to_owned(),
            what: format!(
                "waits for rewards that have no weight; give {} a positive one, or set `iterations` instead",
                TRACKING.join(" or ")
            ),
        });
    }
    Ok(())
}
