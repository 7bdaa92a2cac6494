//! What the report of a whole loop shows: collect, adapt, fine-tune, evaluate, once or more often.
//!
//! Conventions as in [`crate::report`]: an unknown number is NaN (shown as "–", `null` in JSON), an empty list or
//! `None` leaves its section out, names are untrusted. Policies and simulators are matched by name.

use crate::evaluation::Drift;
use crate::nullable;
use crate::replay::Replay;
use crate::report::{OptimizerRun, Parameter, Setting};
use crate::training::{Link, SeedCurve};
use serde::{Deserialize, Serialize};

/// Everything `report.html` shows of one loop.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LoopReport {
    /// Heading, e.g. the name of the run folder.
    pub title: String,
    /// Robot whose log was fitted, e.g. `go2 in MuJoCo, worn`.
    pub robot: String,
    /// When the loop ended, as it is to be printed.
    pub created: String,
    /// Wall-clock time of the whole loop, s.
    #[serde(with = "nullable::scalar")]
    pub wall_seconds: f64,
    /// Name of the policy the loop began with, e.g. `π₀`; empty: the first of [`LoopReport::tracking`].
    pub before: String,
    /// Name of the policy it ended with, e.g. `π₁`; empty: the last of [`LoopReport::tracking`]. All other policies
    /// are references, e.g. one fine-tuned on the truth.
    pub after: String,
    /// Name of the simulator (or robot) that the headline speaks of, e.g. `target`; empty: the first.
    pub target: String,
    /// One a repetition, in order.
    pub rounds: Vec<Round>,
    /// How well each policy follows random commands, on one or more simulators.
    pub tracking: Vec<Tracking>,
    /// Constant-command trials of each policy, on one or more simulators.
    pub drift: Vec<DriftTrials>,
    /// Recorded motions played side by side by one clock, e.g. π₀ and π₁ on the target. At most four robots and
    /// 6,000 frames each are kept. One that cannot be drawn is left out with a warning that says why.
    pub replay: Option<Replay>,
    /// Short facts for the head of the page.
    pub facts: Vec<Setting>,
    /// Files beside the report to look at.
    pub links: Vec<Link>,
    /// What the reader must know before trusting the numbers, falls, uncovered commands and parameters that are not
    /// identified among them: rounds show these where they belong, without a word of warning.
    pub warnings: Vec<String>,
    /// Resolved settings, in the order to print them.
    pub settings: Vec<Setting>,
    /// Versions, hashes, hardware.
    pub versions: Vec<Setting>,
}

/// One repetition: a log, the simulators fitted to it, and the training in the fitted simulator.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Round {
    /// What it is called, e.g. `Round 1: π₀ → π₁`; empty: its number.
    pub name: String,
    /// Wall-clock time, s; zero or NaN when unknown.
    #[serde(with = "nullable::scalar")]
    pub wall_seconds: f64,
    /// The robot's log.
    pub log: Option<LogSummary>,
    /// Fits to the log, one a cost or scenario; the first is the one fine-tuning used.
    pub adaptations: Vec<Adaptation>,
    /// How the joints' signals are distributed, one a joint and signal.
    pub distributions: Vec<SignalDistribution>,
    /// Fine-tuning in the fitted simulator, one a seed.
    pub fine_tuning: Vec<SeedCurve>,
}

/// What was recorded and what of it was used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LogSummary {
    /// Where it is from, e.g. a file name.
    pub source: String,
    /// Trajectories recorded.
    pub trajectories: u64,
    /// Length of all of them together, s.
    #[serde(with = "nullable::scalar")]
    pub seconds: f64,
    /// Falls found.
    pub falls: u64,
    /// Length of what was cut because of falls, margins included, s.
    #[serde(with = "nullable::scalar")]
    pub cut_seconds: f64,
    /// Commands given: forward and left (m/s), yaw rate (rad/s), each as often as it is to count. The page thins them.
    pub commands: Vec<[f64; 3]>,
    /// Smallest and largest command the policy is to follow, same order and units.
    pub command_range: [[f64; 2]; 3],
    /// Parts of the command space without data, in words.
    pub uncovered: Vec<String>,
}

/// A simulator fitted to a log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Adaptation {
    /// What tells it from the round's other fits, e.g. `FricArm, Wass`.
    pub name: String,
    /// Name of the cost, e.g. `Wass`.
    pub cost_name: String,
    /// Cost of the nominal simulator on the log.
    #[serde(with = "nullable::scalar")]
    pub nominal_cost: f64,
    /// Cost of the fitted simulator.
    #[serde(with = "nullable::scalar")]
    pub fitted_cost: f64,
    /// Cost between two halves of the log, or of the true simulator: no fit can be expected below.
    #[serde(with = "nullable::scalar")]
    pub floor_cost: f64,
    /// One optimiser run a restart or seed.
    pub runs: Vec<OptimizerRun>,
    /// θ, in its own order.
    pub parameters: Vec<FittedParameter>,
}

/// One entry of θ with what the cost says of its certainty.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FittedParameter {
    /// Name, value, spread over runs, bounds, start, and whether the log identifies it.
    pub parameter: Parameter,
    /// Ends of the interval within which the cost's profile cannot tell values apart, in the parameter's unit.
    pub profile: Option<[f64; 2]>,
    /// The robot's value where it is known, because the robot is simulated.
    pub truth: Option<f64>,
}

/// How one joint's signal is distributed, as quantiles at equal steps of probability (0, 1/n, …, 1).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SignalDistribution {
    /// Joint name.
    pub joint: String,
    /// What is distributed.
    pub signal: Signal,
    /// Quantiles of the robot's log, in the signal's unit, ascending.
    #[serde(with = "nullable::list")]
    pub log: Vec<f64>,
    /// Quantiles of the nominal simulator; may be empty.
    #[serde(with = "nullable::list")]
    pub nominal: Vec<f64>,
    /// Quantiles of the adapted simulator; may be empty.
    #[serde(with = "nullable::list")]
    pub adapted: Vec<f64>,
    /// Wasserstein-1 distance from nominal to log in the signal's unit, when known.
    #[serde(with = "nullable::scalar")]
    pub distance_nominal: f64,
    /// Wasserstein-1 distance from adapted to log in the signal's unit, when known.
    #[serde(with = "nullable::scalar")]
    pub distance_adapted: f64,
}

/// A signal of a joint.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Signal {
    /// Joint position, rad.
    #[default]
    Position,
    /// Joint velocity, rad/s.
    Velocity,
    /// The policy's action for the joint, without a unit.
    Action,
}

/// How well one policy follows random commands on one simulator.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Tracking {
    /// The policy's name.
    pub policy: String,
    /// Where it ran, e.g. `target` or `adapted`.
    pub simulator: String,
    /// Trajectories averaged.
    pub trajectories: u64,
    /// Linear-velocity tracking error, m/s.
    pub linear_velocity_error: Estimate,
    /// Angular-velocity tracking error, rad/s.
    pub angular_velocity_error: Estimate,
    /// Summed reward of a trajectory.
    pub reward: Estimate,
    /// Share of trajectories that end in a fall, 0 to 1.
    pub fall_rate: Estimate,
}

/// A mean and how sure it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Estimate {
    /// The mean.
    #[serde(with = "nullable::scalar")]
    pub mean: f64,
    /// Half-width of the mean's 95 % confidence interval.
    #[serde(with = "nullable::scalar")]
    pub ci95: f64,
}

/// Constant-command trials of one policy on one simulator.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DriftTrials {
    /// The policy's name.
    pub policy: String,
    /// Where it ran.
    pub simulator: String,
    /// One a command; commands are matched by name across policies.
    pub trials: Vec<Drift>,
}

/// Steps of probability in [`SignalDistribution::from_samples`].
const STEPS: usize = 200;

impl SignalDistribution {
    /// Quantiles of samples in the signal's unit, any counts; what is not finite is not counted. The distances stay
    /// unknown.
    pub fn from_samples(joint: &str, signal: Signal, log: &[f64], nominal: &[f64], adapted: &[f64]) -> Self {
        SignalDistribution {
            joint: joint.to_string(),
            signal,
            log: quantiles(log),
            nominal: quantiles(nominal),
            adapted: quantiles(adapted),
            ..SignalDistribution::default()
        }
    }
}

/// Empirical quantiles at `STEPS + 1` probabilities, interpolated between the samples next to them.
fn quantiles(samples: &[f64]) -> Vec<f64> {
    let mut sorted: Vec<f64> = samples.iter().copied().filter(|x| x.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let Some(last) = sorted.len().checked_sub(1) else { return Vec::new() };
    let at = |i: usize| {
        let exact = i as f64 / STEPS as f64 * last as f64;
        let below = (exact as usize).min(last);
        let share = exact - below as f64;
        sorted[below] * (1.0 - share) + sorted[(below + 1).min(last)] * share
    };
    (0..=STEPS).map(at).collect()
}

impl Signal {
    /// The unit of its samples; empty when it has none.
    pub fn unit(self) -> &'static str {
        match self {
            Signal::Position => "rad",
            Signal::Velocity => "rad/s",
            Signal::Action => "",
        }
    }
}

impl Default for Estimate {
    fn default() -> Self {
        Estimate { mean: f64::NAN, ci95: f64::NAN }
    }
}

impl Default for LogSummary {
    fn default() -> Self {
        LogSummary {
            source: String::new(),
            trajectories: 0,
            seconds: f64::NAN,
            falls: 0,
            cut_seconds: f64::NAN,
            commands: Vec::new(),
            command_range: [[-1.0, 1.0]; 3],
            uncovered: Vec::new(),
        }
    }
}

impl Default for Adaptation {
    fn default() -> Self {
        Adaptation {
            name: String::new(),
            cost_name: String::new(),
            nominal_cost: f64::NAN,
            fitted_cost: f64::NAN,
            floor_cost: f64::NAN,
            runs: Vec::new(),
            parameters: Vec::new(),
        }
    }
}

impl Default for SignalDistribution {
    fn default() -> Self {
        SignalDistribution {
            joint: String::new(),
            signal: Signal::Position,
            log: Vec::new(),
            nominal: Vec::new(),
            adapted: Vec::new(),
            distance_nominal: f64::NAN,
            distance_adapted: f64::NAN,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_lie_between_the_samples() {
        let samples: Vec<f64> = (0..=1000).rev().map(f64::from).chain([f64::NAN]).collect();
        let found = quantiles(&samples);
        assert_eq!((found[0], found[STEPS / 2], found[STEPS]), (0.0, 500.0, 1000.0));
        assert_eq!(quantiles(&[3.0]), [3.0; STEPS + 1]);
        let two = quantiles(&[1.0, 2.0]);
        assert!((two[STEPS / 4] - 1.25).abs() < 1e-12);
        assert!(quantiles(&[f64::INFINITY]).is_empty());
    }
}
