//! The configuration of `gaitfit train`: its settings and their defaults. `gaitfit config train` prints them.

use super::Preset;
use super::load::Configuration;
use super::task::{self, Task};
use gaitfit_learn::TrainingSettings;
use gaitfit_learn::ppo;
use gaitfit_model::Cone;
use serde::{Deserialize, Serialize};
use toml::de::DeTable;

/// All settings of one training run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainConfig {
    /// Name of the run and of its folder; the configuration file's stem, or else the task's name, when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Robot file (MJCF or URDF); the built-in Go2 when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robot: Option<String>,
    /// Drop what the engine cannot simulate in the robot file instead of refusing it.
    pub lenient: bool,
    /// Folder that holds the run folders.
    pub runs: String,
    /// One training each, one after the other.
    pub seeds: Vec<u64>,
    /// Seconds between checkpoints.
    pub checkpoint_seconds: f64,
    /// Solver effort of the physics.
    #[serde(with = "super::preset")]
    pub preset: Preset,
    /// Friction cones of the physics; those of the robot file when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cone: Option<Cone>,
    /// How much is trained.
    pub train: TrainingSettings,
    /// Networks and optimisation.
    pub ppo: ppo::Settings,
    /// What is trained.
    pub task: Task,
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            name: None,
            robot: None,
            lenient: false,
            runs: "runs".to_owned(),
            seeds: vec![1],
            checkpoint_seconds: 30.0,
            preset: Preset::Fast,
            cone: None,
            train: TrainingSettings::default(),
            ppo: ppo::Settings::default(),
            task: Task::default(),
        }
    }
}

impl Configuration for TrainConfig {
    const PRINTED_BY: &'static str = "gaitfit config train";
    const EXAMPLE: &'static str = "train.iterations=600";

    fn complete(table: &mut DeTable<'_>) {
        task::complete(table);
    }
}
