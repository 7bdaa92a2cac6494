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
    /// Mean over the steps of the joints' distance from the motion that the policy follows, rad; absent without one.
    pub motion_error: Option<f64>,
    /// Mean over the steps of the action's root-mean-square change a step, per joint.
    pub action_rate: f64,
    /// Steps up to the end or the fall.
    pub steps: u32,
    /// Whether the robot fell.
    pub fell: bool,
    /// Whether its state stopped being a number (counted as a fall too).
    pub diverged: bool,
}

/// Means over trajectories. A trajectory that diverged counts as a fall and is left out of all other means. If all
/// diverged, there are no other means.
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
    /// Root-mean-square distance of the joints from the motion that the policy follows, rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion_error: Option<Estimate>,
    /// Root-mean-square change of an action a step, per joint.
    pub action_rate: Option<Estimate>,
    /// Trajectories whose state stopped being a number.
    pub diverged: usize,
}

/// `count` trajectories of `seconds` each: one random command held from a standing start, the robot left alone
/// after a fall. Results do not depend on the number of threads.
///
/// # Errors
/// A robot that cannot be, or the subject's `cancel`.
pub fn run_trials(
    subject: &Subject<'_>,
    count: usize,
    seconds: f64,
    threads: usize,
) -> Result<Vec<Trial>, TaskError> {
    let steps = trial_steps(subject, seconds);
    in_tiles(count, TILE, threads, |first, count| run_tile(subject, first, count, steps))
}

/// Control steps of a trajectory of `seconds`.
pub fn trial_steps(subject: &Subject<'_>, seconds: f64) -> u32 {
    (seconds / subject.task.walker.interface.control_dt).round().max(1.0) as u32
}

/// `count` environments from number `first` on, in which each robot keeps the command that it has drawn.
///
/// # Errors
/// A robot that cannot be.
pub fn trial_environments<'a>(
    subject: &Subject<'a>,
    first: u32,
    count: usize,
) -> Result<Environment<'a>, TaskError> {
    let mut environment = Environment::new(subject.task, subject.candidate, subject.seed, first, count)?;
    // The commands that were drawn are held, so that none is drawn anew on the way.
    let commands = environment.commands().to_vec();
    for (index, &command) in commands.iter().enumerate() {
        environment.hold_command(index, command);
    }
    Ok(environment)
}

fn run_tile(subject: &Subject<'_>, first: u32, count: usize, steps: u32) -> Result<Vec<Trial>, TaskError> {
    let environment = trial_environments(subject, first, count)?;
    let mut trials = Trials::new(environment.commands(), subject.task.walker.joints.len());
    let mut player = Player::new(subject, environment);
    for step in 1..=steps {
        player.step(step)?;
        let state = |index: usize| {
            (player.reward[index], player.ended[index], player.environment.tracking_error(index))
        };
        trials.take(step, &player.action, state);
        trials.take_motion(|index| player.environment.motion_error(index));
    }
    Ok(trials.finish())
}

/// Trajectories side by side, step by step.
pub struct Trials {
    trials: Vec<Trial>,
    joints: usize,
    last_action: LastAction,
    /// Steps that count in each motion error.
    moved: Vec<u32>,
}

impl Trials {
    /// One for each command, of robots with this many actions.
    pub fn new(commands: &[[f32; 3]], joints: usize) -> Self {
        let trial = |&command: &[f32; 3]| Trial { command, ..Trial::default() };
        Self {
            trials: commands.iter().map(trial).collect(),
            joints,
            moved: vec![0; commands.len()],
            last_action: LastAction::new(commands.len(), joints),
        }
    }

    /// Adds step number `step`, from 1: all actions, and of each robot its reward, how its episode stands, and its
    /// errors, m/s and rad/s. What a robot does after its fall does not count.
    pub fn take(&mut self, step: u32, action: &[f32], state: impl Fn(usize) -> (f32, Ended, [f32; 2])) {
        let joints = self.joints;
        for (index, trial) in self.trials.iter_mut().enumerate() {
            if trial.fell {
                continue;
            }
            trial.steps = step;
            let (reward, ended, [linear, angular]) = state(index);
            // Reward and errors of such a state are not finite, and one NaN would spoil the sums.
            if ended == Ended::Diverged {
                (trial.fell, trial.diverged) = (true, true);
                continue;
            }
            trial.reward += f64::from(reward);
            trial.linear_velocity_error += f64::from(linear);
            trial.angular_velocity_error += f64::from(angular);
            // Before the first step the last action is 0, so that step's change is the action itself.
            let change: f32 = action[index * joints..(index + 1) * joints]
                .iter()
                .zip(self.last_action.row(index))
                .map(|(now, before)| (now - before) * (now - before))
                .sum();
            trial.action_rate += f64::from((change / joints as f32).sqrt());
            // The sums are above this line, so the step of the fall itself still counts.
            trial.fell = ended == Ended::Fall;
        }
        // Robots that have fallen are set too, but nobody reads their rows.
        self.last_action.take(action);
    }

    /// Adds the distance of each robot's joints from its motion after a step (rad), where it follows one.
    pub fn take_motion(&mut self, error: impl Fn(usize) -> Option<f32>) {
        // `take` came before, so the step of a fall is left out too.
        for (index, trial) in self.trials.iter_mut().enumerate().filter(|(_, trial)| !trial.fell) {
            let Some(error) = error(index) else { continue };
            *trial.motion_error.get_or_insert(0.0) += f64::from(error);
            self.moved[index] += 1;
        }
    }

    /// The trajectories, with means over their steps.
    pub fn finish(mut self) -> Vec<Trial> {
        for trial in &mut self.trials {
            let steps = f64::from(trial.steps.max(1));
            trial.linear_velocity_error /= steps;
            trial.angular_velocity_error /= steps;
            trial.action_rate /= steps;
        }
        for (trial, &moved) in self.trials.iter_mut().zip(&self.moved) {
            trial.motion_error = trial.motion_error.map(|sum| sum / f64::from(moved.max(1)));
        }
        self.trials
    }
}

/// Means over trajectories.
pub fn summarise(trials: &[Trial]) -> TrialSummary {
    let finite = || trials.iter().filter(|trial| !trial.diverged);
    let estimate = |value: fn(&Trial) -> f64| Estimate::from_values(&finite().map(value).collect::<Vec<_>>());
    TrialSummary {
        trajectories: trials.len(),
        reward: estimate(|trial| trial.reward),
        linear_velocity_error: estimate(|trial| trial.linear_velocity_error),
        angular_velocity_error: estimate(|trial| trial.angular_velocity_error),
        // Only trials of a policy that follows a motion have this error, so the list may be empty.
        motion_error: Estimate::from_values(
            &finite().filter_map(|trial| trial.motion_error).collect::<Vec<_>>(),
        ),
        fall_rate: Estimate::share(trials.iter().filter(|trial| trial.fell).count(), trials.len()),
        action_rate: estimate(|trial| trial.action_rate),
        diverged: trials.iter().filter(|trial| trial.diverged).count(),
    }
}
