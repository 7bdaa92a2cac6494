//! Everything a training needs, read and checked before anything is written.

use crate::config::TrainConfig;
use crate::exit::Failure;
use crate::inputs::Inputs;
use crate::robot::Hold;
use crate::{paths, robot};
use gaitfit_learn::task::Scene;
use gaitfit_learn::{Origin, Training, TrainingError};
use gaitfit_model::Model;
use std::path::Path;

/// Everything a training needs.
pub struct Setup {
    /// The robot.
    pub model: Model,
    /// The task on it.
    pub scene: Scene,
    /// What the result depends on.
    pub inputs: Inputs,
    /// Threads.
    pub threads: usize,
}

/// Most seeds in one call.
const MOST_SEEDS: usize = 1000;

/// Reads the robot and checks the settings.
pub fn setup(config: &TrainConfig, path: Option<&Path>, threads: usize) -> Result<Setup, Failure> {
    check(config).map_err(|wrong| Failure::usage(advice(path, &wrong)))?;
    config.train.check().map_err(|error| refused(path, &error))?;
    let robot_path = match &config.robot {
        Some(named) => Some(paths::find(named, "robot", path.unwrap_or(Path::new("--set")))?),
        None => None,
    };
    let model = match &robot_path {
        Some(path) => robot::read(path, config.lenient, Hold::File)?,
        None => robot::go2()?,
    };
    let scene = Scene::new(&model, &config.task.settings, config.preset.into())
        .map_err(|error| refused(path, &error.into()))?;
    scene
        .interface
        .check()
        .map_err(|error| Failure::usage(advice(path, &format!("task.policy: {error}"))))?;
    if scene.interface.critic_observation.is_empty() {
        let wrong = "task.policy.critic_observation has no terms; list what the critic sees";
        return Err(Failure::usage(advice(path, wrong)));
    }
    Training::fresh_learner(&scene, &config.ppo, 0).map_err(|error| refused(path, &error))?;
    let inputs = Inputs::new(robot_path.as_deref(), &model, &settings(config))?;
    Ok(Setup { model, scene, inputs, threads })
}

/// The settings without those that do not change what an iteration does: where results go, how often they are
/// saved, how many seeds and iterations there are. The robot counts as what it is, not by its file's name.
pub fn settings(config: &TrainConfig) -> TrainConfig {
    let mut settings = config.clone();
    settings.name = None;
    settings.robot = None;
    settings.lenient = false;
    settings.runs = String::new();
    settings.seeds = Vec::new();
    settings.checkpoint_seconds = 0.0;
    settings.train.iterations = 0;
    settings
}

impl Setup {
    /// What a checkpoint of `seed` belongs to.
    pub fn origin(&self, seed: u64) -> Origin {
        Origin {
            robot: self.model.name.clone(),
            model: self.inputs.model.clone(),
            settings: self.inputs.settings.clone(),
            seed,
        }
    }
}

fn check(config: &TrainConfig) -> Result<(), String> {
    let seeds = &config.seeds;
    let samples = config.train.environments.saturating_mul(config.train.steps);
    let wrong = if seeds.is_empty() || seeds.len() > MOST_SEEDS {
        format!("`seeds` has {} numbers; give 1 to {MOST_SEEDS}", seeds.len())
    } else if let Some(twice) = (1..seeds.len()).find(|&index| seeds[..index].contains(&seeds[index])) {
        format!("`seeds` has {} twice", seeds[twice])
    } else if config.runs.is_empty() {
        "`runs` names no folder; \".\" is the current one".to_owned()
    } else if !(config.checkpoint_seconds >= 0.0 && config.checkpoint_seconds.is_finite()) {
        "`checkpoint_seconds` must be at least 0".to_owned()
    } else if config.train.iterations == 0 {
        "`train.iterations` must be at least 1".to_owned()
    } else if samples > 0 && samples < config.ppo.minibatches {
        format!(
            "{} samples a rollout (`train.environments` × `train.steps`) cannot fill {} minibatches; raise \
             either, or lower `ppo.minibatches`",
            samples, config.ppo.minibatches
        )
    } else {
        return Ok(());
    };
    Err(wrong)
}

fn advice(path: Option<&Path>, wrong: &str) -> String {
    let wrong = wrong.trim_end_matches('.');
    let place = path.map(|path| format!("{}: ", path.display())).unwrap_or_default();
    format!("{place}{wrong}. `gaitfit config train` shows every setting.")
}

/// A setting that cannot be, or a robot that does not fit the task.
fn refused(path: Option<&Path>, error: &TrainingError) -> Failure {
    let text = match error {
        TrainingError::Learner(error) => format!("[ppo] {error}"),
        error => error.to_string(),
    };
    Failure::usage(advice(path, &text))
}
