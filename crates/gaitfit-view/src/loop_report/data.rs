//! Content of the report of a whole loop: collect, adapt, fine-tune, evaluate, once or more often.
//!
//! Policies and simulators are matched by name.

use crate::fit::{Fit, HeldOut, LogSummary, SignalDistribution};
use crate::replay::Replay;
use crate::training::SeedCurve;
use crate::{Doubt, Drift, Estimate, Link, Setting};

/// Everything `report.html` shows of one loop.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoopReport {
    /// Heading, e.g. the name of the run folder.
    pub title: String,
    /// Robot whose log was fitted, e.g. `go2 in MuJoCo, worn`.
    pub robot: String,
    /// Time at which the loop ended, as it is to be printed.
    pub created: String,
    /// Wall-clock time of the whole loop, s.
    pub wall_seconds: f64,
    /// Doubts about the result.
    pub doubts: Vec<Doubt>,
    /// Name of the policy the loop began with, e.g. `π₀`; empty: the first of [`LoopReport::tracking`].
    pub before: String,
    /// Name of the policy it ended with, e.g. `π₁`; empty: the last of [`LoopReport::tracking`]. All other policies
    /// are references, e.g. one fine-tuned on the truth.
    pub after: String,
    /// Where the headline was measured and on how much, after "measured", e.g. `on the robot, 300 trajectories of 4 s`;
    /// empty: on [`LoopReport::target`].
    pub measured: String,
    /// Name of the simulator (or robot) that the headline speaks of, e.g. `target`; empty: the first.
    pub target: String,
    /// One a repetition, in order.
    pub rounds: Vec<Round>,
    /// Place in `rounds` of the one that trained the policy it ended with; none: the last.
    pub best: Option<usize>,
    /// Errors of each policy under random commands, on one or more simulators.
    pub tracking: Vec<Tracking>,
    /// Differences between policies, trajectory by trajectory.
    pub differences: Vec<Difference>,
    /// Gain of the fit over training without it, in a sentence or two; empty: unknown.
    pub bought: String,
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
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Round {
    /// Name, e.g. `Round 1: π₀ → π₁`; empty: its number.
    pub name: String,
    /// Wall-clock time, s; zero or NaN when unknown.
    pub wall_seconds: f64,
    /// The robot's log.
    pub log: Option<LogSummary>,
    /// Fits to the log, one a cost or scenario; the first is the one fine-tuning used.
    pub fits: Vec<Fit>,
    /// Distributions of the joints' signals, one a joint and signal.
    pub distributions: Vec<SignalDistribution>,
    /// Logs that were not fitted; absent if there were none.
    pub held_out: Option<HeldOut>,
    /// Fine-tuning in the fitted simulator, one a seed.
    pub fine_tuning: Vec<SeedCurve>,
}

/// Errors of one policy under random commands on one simulator.
#[derive(Clone, Debug, Default, PartialEq)]
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

/// One policy minus another on one simulator.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Difference {
    /// The policy's name.
    pub policy: String,
    /// The name of the policy whose numbers are subtracted.
    pub against: String,
    /// Where both ran.
    pub simulator: String,
    /// Whether the intervals are of differences on the same trajectories.
    pub paired: bool,
    /// Linear-velocity tracking error, m/s.
    pub linear_velocity_error: Estimate,
    /// Angular-velocity tracking error, rad/s.
    pub angular_velocity_error: Estimate,
    /// Share of trajectories that end in a fall.
    pub fall_rate: Estimate,
}

/// Constant-command trials of one policy on one simulator.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DriftTrials {
    /// The policy's name.
    pub policy: String,
    /// Where it ran.
    pub simulator: String,
    /// One a command; commands are matched by name across policies.
    pub trials: Vec<Drift>,
}
