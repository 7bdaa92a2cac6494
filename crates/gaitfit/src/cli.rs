//! The command line.

use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Fits a legged robot's simulator to the real robot from its joint sensors.
///
/// Results go to standard output, progress to standard error. Exit codes: 0 done, 1 failed, 2 wrong usage or
/// configuration, 3 ran but a stated check failed, 4 hardware or library missing, 130 interrupted.
#[derive(Debug, Parser)]
#[command(name = "gaitfit", version, propagate_version = true, arg_required_else_help = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show what a robot file (MJCF, URDF) or a log (CSV) holds, and what is wrong with it
    Inspect(Inspect),
    /// Fit the simulator's parameters to logs of a robot
    Adapt(Adapt),
    /// Evaluate one physics step at given states
    Forward(Forward),
    /// Show a policy and write it as ONNX or safetensors
    Export(Export),
    /// Measure speed
    #[command(subcommand)]
    Bench(Bench),
    /// Print every setting with its default
    Config(Config),
    /// Show what this machine offers
    Doctor(Doctor),
}

/// Arguments of `inspect`.
#[derive(Debug, Args)]
pub struct Inspect {
    /// Robot (.xml, .mjcf, .urdf) or log (.csv)
    pub file: PathBuf,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
    /// Robot: drop what the engine does not honour and list it, instead of refusing the file
    #[arg(long)]
    pub lenient: bool,
    /// Log: check it against this robot's joints and limits
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
    /// Log: write a picture of the joint signals
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
}

/// Arguments of `adapt`.
#[derive(Debug, Args)]
pub struct Adapt {
    /// Configuration (TOML); `gaitfit config` prints one with every default
    pub config: PathBuf,
    /// Change one setting, for example --set optimizer.seeds=3 (repeatable)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Continue the latest run of this name from its checkpoint
    #[arg(long)]
    pub resume: bool,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
    /// Threads [default: one for each core]
    #[arg(long, value_name = "N")]
    pub threads: Option<std::num::NonZeroUsize>,
    /// Name of the run and its folder [default: the configuration's name]
    #[arg(long)]
    pub name: Option<String>,
}

/// Arguments of `forward`.
#[derive(Debug, Args)]
pub struct Forward {
    /// Robot (.xml, .mjcf, .urdf)
    pub model: PathBuf,
    /// States: arrays qpos, qvel, ctrl; one row a state; MuJoCo's layout
    pub states: PathBuf,
    /// Output: arrays M, qfrc_bias, qacc, next_qpos, next_qvel
    pub out: PathBuf,
    /// Solver effort
    #[arg(long, value_enum, default_value_t = Preset::Converged)]
    pub preset: Preset,
    /// Drop what the engine does not honour, instead of refusing the file
    #[arg(long)]
    pub lenient: bool,
}

/// Arguments of `export`.
#[derive(Debug, Args)]
pub struct Export {
    /// Policy: .safetensors, .onnx, or a .toml that describes one trained elsewhere
    pub policy: PathBuf,
    /// Write the actor as an ONNX graph, the interface in its metadata
    #[arg(long, value_name = "FILE.onnx")]
    pub onnx: Option<PathBuf>,
    /// Write the whole policy in the project's own format
    #[arg(long, value_name = "FILE.safetensors")]
    pub safetensors: Option<PathBuf>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// What to measure.
#[derive(Debug, Subcommand)]
pub enum Bench {
    /// Physics substeps a second of a trotting Go2
    Physics(BenchPhysics),
}

/// Arguments of `bench physics`.
#[derive(Debug, Args)]
pub struct BenchPhysics {
    /// Solver effort
    #[arg(long, value_enum, default_value_t = Preset::Fast)]
    pub preset: Preset,
    /// Which geoms may touch the ground
    #[arg(long, value_enum, default_value_t = Geoms::Feet)]
    pub geoms: Geoms,
    /// Threads
    #[arg(long, value_name = "N", default_value = "1")]
    pub threads: std::num::NonZeroUsize,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `config`.
#[derive(Debug, Args)]
pub struct Config {
    /// Which command's settings
    #[arg(value_enum, default_value_t = ConfigOf::Adapt)]
    pub of: ConfigOf,
}

/// Commands with a configuration.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum ConfigOf {
    /// Settings of `gaitfit adapt`
    Adapt,
}

/// Arguments of `doctor`.
#[derive(Debug, Args)]
pub struct Doctor {
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

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

/// Which geoms may touch the ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Geoms {
    /// The feet only
    Feet,
    /// Every collision geom
    All,
}
