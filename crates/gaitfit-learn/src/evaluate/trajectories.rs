//! Trajectories with random commands.

use gaitfit_policy::observation::LastAction;
use gaitfit_sim::stats::Estimate;
use serde::Serialize;

use super::Subject;
use crate::player::Player;
use crate::task::{Ended, Environment, TaskError};
use crate::tiles::in_tiles;

/// Environments that one thread advances together.
const TILE: usize = 256;

/// One trajectory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Trial {
    /// Command: forward, left (m/s), yaw rate (rad/s).
    pub command: [f32; 3],
    /// Summed reward up to the end or the fall.
    pub reward: f64,
    /// Mean over the steps of |v − c|, horizontal, heading frame, m/s.
    pub linear_velocity_error: f64,
    /// Mean over the steps of |ω − c|, rad/s.
    pub angular_velocity_error: f64,
    /// Mean over the steps of the action's root-mean-square change a step, per joint.
    pub action_rate: f64,
    /// Steps up to the end or the fall.
    pub steps: u32,
    /// Whether the robot fell.
    pub fell: bool,
    /// Whether its state stopped being a number (counted as a fall too).
    pub diverged: bool,
}

/// Means over trajectories. One that diverged counts as a fall, and in no other mean; without any left there are none.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrialSummary {
    /// Trajectories.
    pub trajectories: usize,
    /// Summed reward.
    pub reward: Option<Estimate>,
    /// |v − c|, horizontal, m/s.
    pub linear_velocity_error: Option<Estimate>,
    /// |ω − c|, rad/s.
    pub angular_velocity_error: Option<Estimate>,
    /// Share of falls.
    pub fall_rate: Option<Estimate>,
    /// Root-mean-square change of an action a step, per joint.
    pub action_rate: Option<Estimate>,
    /// Trajectories whose state stopped being a number.
    pub diverged: usize,
}

/// `count` trajectories of `seconds` each: one random command held from a standing start, the robot left alone
/// after a fall. Results do not depend on the number of threads.
///
/// # Errors
/// A robot that cannot be.
pub fn run_trials(
    subject: &Subject<'_>,
    count: usize,
    seconds: f64,
    threads: usize,
) -> Result<Vec<Trial>, TaskError> {
    let steps = (seconds / subject.task.walker.interface.control_dt).round().max(1.0) as u32;
    in_tiles(count, TILE, threads, |first, count| run_tile(subject, first, count, steps))
}

fn run_tile(subject: &Subject<'_>, first: u32, count: usize, steps: u32) -> Result<Vec<Trial>, TaskError> {
    let Subject { task, policy, candidate, seed } = *subject;
    let mut environment = Environment::new(task, candidate, seed, first, count)?;
    // The command that was drawn stays for the whole trajectory.
    let commands = environment.commands().to_vec();
    for (index, &command) in commands.iter().enumerate() {
        environment.hold_command(index, command);
    }
    let mut trials: Vec<Trial> =
        commands.iter().map(|&command| Trial { command, ..Trial::default() }).collect();
    let joints = task.walker.joints.len();
    let mut last_action = LastAction::new(count, joints);
    let mut player = Player::new(task, policy, environment);
    for step in 1..=steps {
        player.step(step);
        for (index, trial) in trials.iter_mut().enumerate() {
            if trial.fell {
                continue;
            }
            trial.steps = step;
            let [linear, angular] = player.environment.tracking_error(index);
            let ended = player.ended[index];
            if ended == Ended::Diverged {
                (trial.fell, trial.diverged) = (true, true);
                continue;
            }
            trial.reward += f64::from(player.reward[index]);
            trial.linear_velocity_error += f64::from(linear);
            trial.angular_velocity_error += f64::from(angular);
            let change: f32 = player.action[index * joints..(index + 1) * joints]
                .iter()
                .zip(last_action.row(index))
                .map(|(now, before)| (now - before) * (now - before))
                .sum();
            trial.action_rate += f64::from((change / joints as f32).sqrt());
            trial.fell = ended == Ended::Fall;
        }
        last_action.take(&player.action);
    }
    for trial in &mut trials {
        let steps = f64::from(trial.steps.max(1));
        trial.linear_velocity_error /= steps;
        trial.angular_velocity_error /= steps;
        trial.action_rate /= steps;
    }
    Ok(trials)
}

/// Means over trajectories.
pub fn summarise(trials: &[Trial]) -> TrialSummary {
    let finite = || trials.iter().filter(|trial| !trial.diverged);
    let estimate = |value: fn(&Trial) -> f64| Estimate::of(&finite().map(value).collect::<Vec<_>>());
    TrialSummary {
        trajectories: trials.len(),
        reward: estimate(|trial| trial.reward),
        linear_velocity_error: estimate(|trial| trial.linear_velocity_error),
        angular_velocity_error: estimate(|trial| trial.angular_velocity_error),
        fall_rate: Estimate::share(trials.iter().filter(|trial| trial.fell).count(), trials.len()),
        action_rate: estimate(|trial| trial.action_rate),
        diverged: trials.iter().filter(|trial| trial.diverged).count(),
    }
}
