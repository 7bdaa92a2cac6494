//! Content of the report of a training run, filled in by whoever ran it.

use crate::gait::GaitPicture;
use crate::replay::Replay;
use crate::{Doubt, Link, Setting};

/// Everything `report.html` shows of one training run, over one or several seeds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrainingReport {
    /// Heading, e.g. the name of the run folder.
    pub title: String,
    /// Robot and task, e.g. `go2, velocity tracking`.
    pub robot: String,
    /// Time at which the run ended, as it is to be printed.
    pub created: String,
    /// Wall-clock time of all seeds together, s.
    pub wall_seconds: f64,
    /// Doubts about the result.
    pub doubts: Vec<Doubt>,
    /// What [`SeedResult`] was measured on, e.g. `10,000 trajectories of 4 s with random commands` or `the last 20
    /// iterations of training`.
    pub measured_on: String,
    /// One a seed, in the order to list them.
    pub seeds: Vec<SeedCurve>,
    /// The gait of one policy, e.g. the first seed's.
    pub gait: Option<GaitPicture>,
    /// Policy and command of the gait, for its caption; may be empty.
    pub gait_caption: String,
    /// A policy at work, e.g. the first seed's; at most 6,000 frames are kept. One that cannot be drawn is left out with
    /// a warning that says why.
    pub replay: Option<Replay>,
    /// Files beside the report to look at.
    pub links: Vec<Link>,
    /// Short facts for the head of the page: environments, steps an iteration, action rate, …
    pub facts: Vec<Setting>,
    /// Warnings that the reader must know before trusting the numbers.
    pub warnings: Vec<String>,
    /// The resolved configuration, as the text of its TOML file.
    pub configuration: String,
    /// Versions, hashes, hardware.
    pub versions: Vec<Setting>,
}

/// One seed: how it ended and how it came there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SeedCurve {
    /// The seed.
    pub seed: u64,
    /// Result at the end.
    pub result: SeedResult,
    /// Iteration numbers, ascending; every series has one value for each.
    pub iteration: Vec<u32>,
    /// Curves by which learning is judged: mean reward, velocity tracking errors, episode length, fall rate.
    pub progress: Vec<Series>,
    /// Terms of the reward, one by one.
    pub rewards: Vec<Series>,
    /// Diagnostics of the learner: KL, clip fraction, explained variance, entropy, learning rate, losses.
    pub diagnostics: Vec<Series>,
}

/// Result of one seed; unknown numbers stay NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeedResult {
    /// Mean summed reward of a trajectory.
    pub reward: f64,
    /// Mean linear-velocity tracking error, m/s.
    pub linear_velocity_error: f64,
    /// Mean angular-velocity tracking error, rad/s.
    pub angular_velocity_error: f64,
    /// Share of trajectories that ended in a fall, 0 to 1.
    pub fall_rate: f64,
    /// Iterations done.
    pub iterations: u32,
    /// Wall-clock time of this seed, s.
    pub wall_seconds: f64,
    /// Simulated control steps a second of training, over all environments.
    pub samples_per_second: f64,
}

/// A number over the iterations. Series of one name are drawn in one chart, whatever the seed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// Name, as it is to be printed.
    pub name: String,
    /// Its unit; empty when it has none.
    pub unit: String,
    /// One value an iteration.
    pub values: Vec<f64>,
    /// Draw it on a logarithmic axis (only where all values are positive).
    pub log: bool,
}

impl Default for SeedResult {
    fn default() -> Self {
        SeedResult {
            reward: f64::NAN,
            linear_velocity_error: f64::NAN,
            angular_velocity_error: f64::NAN,
            fall_rate: f64::NAN,
            iterations: 0,
            wall_seconds: f64::NAN,
            samples_per_second: f64::NAN,
        }
    }
}
