//! Metrics of every iteration: a line of `metrics.jsonl` and scalars for TensorBoard.

use crate::Error;
use crate::run::RunFolder;
use gaitfit_learn::Iteration;
use gaitfit_learn::ppo::Diagnostics;
use gaitfit_learn::task::Task;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

/// One line of the metrics. What is known only of episodes that ended is absent where none did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metric {
    /// Iterations done.
    pub iteration: u32,
    /// Control steps of all robots so far.
    pub samples: u64,
    /// Mean reward of a control step.
    pub reward: f64,
    /// Episodes that ended.
    pub episodes: u64,
    /// Their mean summed reward.
    pub episode_return: Option<f64>,
    /// Their mean length, s.
    pub episode_seconds: Option<f64>,
    /// Share of them that ended in a fall.
    pub fall_rate: Option<f64>,
    /// How many of them ended because the simulation diverged; they count as falls. Absent where none did.
    #[serde(default, skip_serializing_if = "is_none_of_them")]
    pub diverged: u64,
    /// Mean horizontal velocity error, m/s.
    pub linear_velocity_error: f64,
    /// Mean yaw-rate error, rad/s.
    pub angular_velocity_error: f64,
    /// Mean level of the ground that robots are on, from 0; absent without levels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub terrain_level: Option<f64>,
    /// Reward terms, weighted, a second.
    pub rewards: IndexMap<String, f64>,
    /// Share of the way from the first ranges of commands to the final ones; absent unless they grow.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub command_level: Option<f64>,
    /// Share of their greatest value that the tracking rewards came to, of growing commands.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub command_tracking: Option<f64>,
    /// The update.
    #[serde(flatten)]
    pub ppo: Diagnostics,
    /// Times, the only entries that differ between runs of one seed.
    #[serde(flatten)]
    pub times: Times,
}

/// Wall-clock times.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Times {
    /// The rollout, s.
    pub rollout_seconds: f64,
    /// The update, s.
    pub update_seconds: f64,
    /// Control steps of all robots a second.
    pub samples_per_second: f64,
    /// Since the seed's training began, over all its sessions, s.
    pub wall_seconds: f64,
}

fn is_none_of_them(count: &u64) -> bool {
    *count == 0
}

impl Metric {
    /// The metrics of an iteration on a scene; `steps`: control steps of a rollout, all robots.
    pub fn new(iteration: &Iteration, scene: &Task, wall_seconds: f64) -> Self {
        let tally = &iteration.tally;
        // Means over episodes exist only if one ended; a short rollout may see none end.
        let ended = |sum: f64| (tally.episodes > 0.0).then(|| sum / tally.episodes);
        let dt = scene.walker.interface.control_dt;
        let names = scene.reward_names();
        let terms = names.iter().zip(&tally.terms);
        Self {
            // Numbers of iterations done, so the first is 1.
            iteration: iteration.number + 1,
            samples: u64::from(iteration.number + 1) * tally.steps as u64,
            reward: tally.reward / tally.steps,
            // Tallies are sums of floating-point numbers, but counts in them are whole.
            episodes: tally.episodes as u64,
            episode_return: ended(tally.episode_return),
            episode_seconds: ended(tally.episode_steps * dt),
            fall_rate: ended(tally.falls),
            diverged: tally.diverged as u64,
            linear_velocity_error: tally.tracking[0] / tally.steps,
            angular_velocity_error: tally.tracking[1] / tally.steps,
            terrain_level: scene.course.is_some().then(|| tally.levels / tally.steps),
            // Per second: a step pays its weight times the control period.
            rewards: terms.map(|(name, sum)| ((*name).to_owned(), sum / tally.steps / dt)).collect(),
            command_level: iteration.commands.map(|commands| commands.level),
            command_tracking: iteration.commands.and_then(|commands| commands.tracking),
            ppo: iteration.diagnostics,
            times: Times {
                rollout_seconds: iteration.rollout_seconds,
                update_seconds: iteration.update_seconds,
                samples_per_second: tally.steps / (iteration.rollout_seconds + iteration.update_seconds),
                wall_seconds,
            },
        }
    }

    /// Returns its line of `metrics.jsonl`.
    pub fn line(&self) -> Result<String, Error> {
        let line = serde_json::to_string(self)
            .map_err(|error| Error::failed(format!("cannot write the metrics: {error}")))?;
        Ok(line + "\n")
    }

    /// Tags and values for TensorBoard.
    pub fn scalars(&self) -> Vec<(String, f64)> {
        let mut scalars = vec![("train/reward".to_owned(), self.reward)];
        let mut add = |tag: String, value: f64| scalars.push((tag, value));
        let known = [
            ("episode_return", self.episode_return),
            ("episode_seconds", self.episode_seconds),
            ("fall_rate", self.fall_rate),
            ("command_level", self.command_level),
            ("command_tracking", self.command_tracking),
        ];
        known.iter().filter_map(|(name, value)| Some((name, (*value)?))).for_each(|(name, value)| {
            add(format!("train/{name}"), value);
        });
        // These exist in every iteration; the ones above only if an episode ended or commands grow.
        add("train/linear_velocity_error".to_owned(), self.linear_velocity_error);
        add("train/angular_velocity_error".to_owned(), self.angular_velocity_error);
        if let Some(level) = self.terrain_level {
            add("train/terrain_level".to_owned(), level);
        }
        self.rewards.iter().for_each(|(name, value)| add(format!("reward/{name}"), *value));
        for (name, value) in diagnostics(&self.ppo) {
            add(format!("ppo/{name}"), value);
        }
        add("speed/samples_per_second".to_owned(), self.times.samples_per_second);
        add("speed/rollout_seconds".to_owned(), self.times.rollout_seconds);
        add("speed/update_seconds".to_owned(), self.times.update_seconds);
        scalars
    }
}

/// The learner's diagnostics by name.
pub fn diagnostics(ppo: &Diagnostics) -> [(&'static str, f64); 12] {
    [
        ("kl", ppo.kl),
        ("kl_last", ppo.kl_last),
        ("approx_kl_k1", ppo.approx_kl_k1),
        ("approx_kl_k3", ppo.approx_kl_k3),
        ("clip_fraction", ppo.clip_fraction),
        ("explained_variance", ppo.explained_variance),
        ("entropy", ppo.entropy),
        ("mean_std", ppo.mean_std),
        ("learning_rate", ppo.learning_rate),
        ("policy_loss", ppo.policy_loss),
        ("value_loss", ppo.value_loss),
        ("gradient_norm", ppo.gradient_norm),
    ]
}

/// The whole lines of a file up to an iteration; a line torn by a crash is none.
pub fn read(folder: &RunFolder, name: &str, last: u32) -> Result<Vec<Metric>, Error> {
    let text = folder.read_bytes(name)?.unwrap_or_default();
    let lines = text.split(|&byte| byte == b'\n');
    let metrics = lines.filter_map(|line| serde_json::from_slice::<Metric>(line).ok());
    Ok(metrics.filter(|metric| metric.iteration <= last).collect())
}
