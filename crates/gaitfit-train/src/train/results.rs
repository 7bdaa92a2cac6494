//! Results of a training: the one document that `--json` prints, `result.json` keeps, and table and report
//! show.

use super::metrics::Metric;
use super::seed::Files;
use gaitfit_learn::evaluate::GaitSummary;
use gaitfit_view::{Doubt, DoubtKind};
use serde::{Deserialize, Serialize};

/// Iterations at the end that results are means of.
pub const LAST: usize = 20;

/// The result of one training run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// Whether the policy's actions were trained; false if all updates taught the critic alone.
    #[serde(default = "yes")]
    pub trained: bool,
    /// Why the result must not be taken as it stands.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub doubts: Vec<Doubt>,
    /// What to know before trusting the result.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Name of the run.
    pub name: String,
    /// Robot name.
    pub robot: String,
    /// The built-in task it started from.
    pub task: String,
    /// Robots at once.
    pub environments: usize,
    /// Control steps of a rollout.
    pub steps: usize,
    /// What it went on from; absent where it began with new networks on the robot of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parent: Option<Parent>,
    /// SHA-256 of the settings, as in the policies.
    pub configuration_hash: String,
    /// One a seed.
    pub seeds: Vec<SeedResult>,
    /// Where the files are.
    pub run_folder: String,
    /// Wall time of all seeds, over all sessions, s.
    pub wall_seconds: f64,
}

impl Results {
    /// A sentence if the policy does not walk; absent if it does.
    pub fn unlearnt(&self) -> Option<String> {
        let doubt = self.doubts.iter().find(|doubt| doubt.kind == DoubtKind::NotLearnt)?;
        Some(format!(
            "the trained policy does not walk: {} All results are in {}",
            doubt.text, self.run_folder
        ))
    }
}

/// Default of [`Results::trained`]: earlier versions did not write it.
fn yes() -> bool {
    true
}

/// Policy and simulator that a training continued from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Parent {
    /// The policy's file.
    pub policy: String,
    /// SHA-256 of the policy as the program writes it, hexadecimal.
    pub policy_sha256: String,
    /// The file of fitted parameters.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub theta: Option<String>,
    /// Its SHA-256, hexadecimal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub theta_sha256: Option<String>,
    /// The simulator in a few words.
    pub simulator: String,
    /// Whether the policy had no critic, so that a new one was trained.
    pub new_critic: bool,
}

/// Result of one seed: means over its last iterations.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeedResult {
    /// The seed.
    pub seed: u64,
    /// Iterations done.
    pub iterations: u32,
    /// Control steps of all robots.
    pub samples: u64,
    /// Mean reward of a control step.
    pub reward: f64,
    /// Mean summed reward of an episode; absent where none ended.
    pub episode_return: Option<f64>,
    /// Mean length of an episode, s.
    pub episode_seconds: Option<f64>,
    /// Share of episodes that ended in a fall.
    pub fall_rate: Option<f64>,
    /// Episodes of the whole training that ended because the simulation diverged.
    #[serde(default)]
    pub diverged: u64,
    /// Mean horizontal velocity error, m/s.
    pub linear_velocity_error: f64,
    /// Mean yaw-rate error, rad/s.
    pub angular_velocity_error: f64,
    /// The gait of the policy, shown at work without variation.
    pub gait: GaitSummary,
    /// Control steps of all robots a second: median over all iterations.
    pub samples_per_second: f64,
    /// Wall time, s.
    pub wall_seconds: f64,
    /// The policy's file.
    pub policy: String,
    /// The page that plays it; written with the feature `report`.
    pub replay: String,
}

impl SeedResult {
    /// The result of a seed's metrics; `folder`: where its files are.
    pub fn new(seed: u64, metrics: &[Metric], gait: GaitSummary, folder: &std::path::Path) -> Self {
        // A training with fewer iterations than `LAST` is the mean of all of them.
        let last = &metrics[metrics.len().saturating_sub(LAST)..];
        let mean = |value: fn(&Metric) -> f64| last.iter().map(value).sum::<f64>() / last.len().max(1) as f64;
        let episodes: f64 = last.iter().map(|metric| metric.episodes as f64).sum();
        let of_episodes = |value: fn(&Metric) -> Option<f64>| {
            let sum =
                last.iter().filter_map(|metric| Some(value(metric)? * metric.episodes as f64)).sum::<f64>();
            // Iterations count by their episodes: in some of them few robots end one.
            (episodes > 0.0).then(|| sum / episodes)
        };
        // The median: single slow iterations, as on a busy machine, do not move it.
        let mut speeds: Vec<f64> = metrics.iter().map(|metric| metric.times.samples_per_second).collect();
        speeds.sort_by(f64::total_cmp);
        let end = metrics.last();
        let files = Files::new(seed);
        let path = |name: &str| folder.join(name).display().to_string();
        Self {
            seed,
            iterations: end.map_or(0, |metric| metric.iteration),
            samples: end.map_or(0, |metric| metric.samples),
            reward: mean(|metric| metric.reward),
            episode_return: of_episodes(|metric| metric.episode_return),
            episode_seconds: of_episodes(|metric| metric.episode_seconds),
            fall_rate: of_episodes(|metric| metric.fall_rate),
            diverged: metrics.iter().map(|metric| metric.diverged).sum(),
            linear_velocity_error: mean(|metric| metric.linear_velocity_error),
            angular_velocity_error: mean(|metric| metric.angular_velocity_error),
            gait,
            samples_per_second: speeds.get(speeds.len() / 2).copied().unwrap_or(0.0),
            wall_seconds: end.map_or(0.0, |metric| metric.times.wall_seconds),
            policy: path(&files.policy),
            replay: path(&files.replay),
        }
    }
}
