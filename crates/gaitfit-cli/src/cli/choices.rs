//! Choices by name.

use clap::{Args, ValueEnum};
use gaitfit::settings::TaskName;

/// Solver effort.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Preset {
    /// Two Newton iterations
    Fast,
    /// Four Newton iterations with line search
    Accurate,
    /// Until converged
    Converged,
}

impl From<Preset> for gaitfit_physics::Preset {
    fn from(preset: Preset) -> Self {
        match preset {
            Preset::Fast => Self::Fast,
            Preset::Accurate => Self::Accurate,
            Preset::Converged => Self::Converged,
        }
    }
}

/// Arguments of `config`.
#[derive(Debug, Args)]
pub struct Config {
    /// Which command's settings
    #[arg(value_enum, default_value_t = ConfigOf::Fit)]
    pub of: ConfigOf,
    /// With `train`: the built-in task to start from
    #[arg(long, value_enum, default_value_t = Task::Velocity)]
    pub task: Task,
}

/// Commands with a configuration.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum ConfigOf {
    /// Settings of `gaitfit fit`
    #[value(alias = "adapt")]
    Fit,
    /// Settings of `gaitfit train`
    Train,
    /// Settings of `gaitfit finetune`
    Finetune,
    /// Settings of `gaitfit loop`
    Loop,
}

/// A built-in task.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Task {
    /// Velocity tracking on flat ground at a trot
    Velocity,
    /// Walking on the hind legs
    Biped,
}

impl From<Task> for TaskName {
    fn from(task: Task) -> Self {
        match task {
            Task::Velocity => Self::Velocity,
            Task::Biped => Self::Biped,
        }
    }
}
