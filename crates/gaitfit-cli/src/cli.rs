//! The command line.

use clap::{Args, Parser, Subcommand, ValueEnum};
use gaitfit::settings::{PresetName, TaskName};
use gaitfit::world::WorldSettings;
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
    /// Train a policy by PPO
    Train(Train),
    /// Go on training a policy in an adapted simulator
    Finetune(Finetune),
    /// The whole method: collect, adapt, fine-tune, evaluate, repeated while it helps
    Loop(Loop),
    /// Run a table of the paper from its experiment files, with the paper's numbers beside
    Reproduce(Reproduce),
    /// Evaluate one physics step at given states
    Forward(Forward),
    /// Show a policy and write it as ONNX or safetensors
    Export(Export),
    /// Measure how well a policy walks in a simulator
    Evaluate(Evaluate),
    /// Run a policy in a simulator and write its logs
    Collect(Collect),
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

/// Arguments of `train`.
#[derive(Debug, Args)]
pub struct Train {
    /// Configuration (TOML); `gaitfit config train` prints one with every default
    pub config: Option<PathBuf>,
    /// Change one setting, for example --set train.iterations=600 (repeatable)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Continue the latest run of this name from its checkpoints; train.iterations and seeds may grow
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
    /// How many seeds, from 1 on (3), or which ones (4,9) [default: the configuration's]
    #[arg(long, value_name = "N|LIST")]
    pub seeds: Option<Seeds>,
}

/// Arguments of `finetune`.
#[derive(Debug, Args)]
pub struct Finetune {
    /// Policy: .safetensors, .onnx, or a .toml that describes one trained elsewhere [default: the configuration's]
    pub policy: Option<PathBuf>,
    /// Fitted parameters: the theta.toml of an `adapt` run
    #[arg(long, value_name = "FILE")]
    pub theta: Option<PathBuf>,
    /// Robot (.xml, .mjcf, .urdf) [default: the built-in Go2]
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
    /// Drop what the engine does not honour in the robot file, instead of refusing it
    #[arg(long)]
    pub lenient: bool,
    /// A spring on a joint, N·m/rad, about its default angle or REST, rad (repeatable)
    #[arg(long, value_name = "JOINT=STIFFNESS[@REST]")]
    pub spring: Vec<String>,
    /// Standard deviation of Gaussian torques at every joint and physics step, N·m
    #[arg(long, value_name = "NM", allow_negative_numbers = true)]
    pub torque_noise: Option<f64>,
    /// Task: velocity, biped, or a file with a task's settings [default: the policy's own]
    #[arg(long, value_name = "TASK")]
    pub task: Option<String>,
    /// Configuration (TOML); `gaitfit config finetune` prints one with every default
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Change one setting, for example --set train.iterations=300 (repeatable)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Continue the latest run of this name from its checkpoints; train.iterations and seeds may grow
    #[arg(long)]
    pub resume: bool,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
    /// Threads [default: one for each core]
    #[arg(long, value_name = "N")]
    pub threads: Option<std::num::NonZeroUsize>,
    /// Name of the run and its folder [default: the configuration's name, or `finetune`]
    #[arg(long)]
    pub name: Option<String>,
    /// How many seeds, from 1 on (3), or which ones (4,9) [default: the configuration's]
    #[arg(long, value_name = "N|LIST")]
    pub seeds: Option<Seeds>,
}

/// Arguments of `loop`.
#[derive(Debug, Args)]
pub struct Loop {
    /// Configuration (TOML); `gaitfit config loop` prints one with every default
    pub config: PathBuf,
    /// Change one setting, for example --set adapt.optimizer.generations=50 (repeatable)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Continue the latest run of this name where it was left; rounds may grow
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

/// Arguments of `reproduce`.
#[derive(Debug, Args)]
pub struct Reproduce {
    /// Which table; `list` names them and says what each takes
    pub table: String,
    /// The paper's scale instead of one for two cores
    #[arg(long)]
    pub full: bool,
    /// Repetitions of every cell with other seeds
    #[arg(long, value_name = "N", default_value = "1")]
    pub seeds: std::num::NonZeroU32,
    /// Cells to run, for example '*-wass'; the others are left out of the table
    #[arg(long, value_name = "GLOB")]
    pub only: Option<String>,
    /// Change one setting of every cell, for example --set policy=my.safetensors (repeatable)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Folder of the experiment files
    #[arg(long, value_name = "FOLDER", default_value = "experiments")]
    pub experiments: PathBuf,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
    /// Threads [default: one for each core]
    #[arg(long, value_name = "N")]
    pub threads: Option<std::num::NonZeroUsize>,
}

/// Seeds of trainings.
#[derive(Clone, Debug)]
pub struct Seeds(pub Vec<u64>);

impl std::str::FromStr for Seeds {
    type Err = String;

    /// `3` is 1, 2, 3; `4,9` these two; `7,` seed 7 alone.
    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| {
            text.trim().parse::<u64>().map_err(|_| format!("`{text}` is no number; give 3 or 4,9"))
        };
        if !text.contains(',') {
            return match number(text)? {
                count @ 1..=1000 => Ok(Self((1..=count).collect())),
                count => Err(format!("{count} seeds; give 1 to 1000, or a list such as 4,9")),
            };
        }
        let list = text.strip_suffix(',').unwrap_or(text);
        list.split(',').map(number).collect::<Result<_, _>>().map(Self)
    }
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

/// A policy and the simulator it runs in.
#[derive(Debug, Args)]
pub struct WorldArgs {
    /// Policy: .safetensors, .onnx, or a .toml that describes one trained elsewhere
    pub policy: PathBuf,
    /// Robot (.xml, .mjcf, .urdf) [default: the built-in Go2]
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
    /// Drop what the engine does not honour in the robot file, instead of refusing it
    #[arg(long)]
    pub lenient: bool,
    /// Task: velocity, biped, or a file with a task's settings [default: the policy's own]
    #[arg(long, value_name = "TASK")]
    pub task: Option<String>,
    /// Fitted parameters: the theta.toml of an `adapt` run
    #[arg(long, value_name = "FILE")]
    pub theta: Option<PathBuf>,
    /// A spring on a joint, N·m/rad, about its default angle or REST, rad (repeatable)
    #[arg(long, value_name = "JOINT=STIFFNESS[@REST]")]
    pub spring: Vec<String>,
    /// Standard deviation of Gaussian torques at every joint and physics step, N·m
    #[arg(long, value_name = "NM", allow_negative_numbers = true, default_value_t = 0.0)]
    pub torque_noise: f64,
    /// Vary robots, starts and observations as in training, with pushes
    #[arg(long)]
    pub randomised: bool,
    /// Solver effort
    #[arg(long, value_enum, default_value_t = Preset::Fast)]
    pub preset: Preset,
    /// Seed of commands, starts and noise
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Threads [default: one for each core]
    #[arg(long, value_name = "N")]
    pub threads: Option<std::num::NonZeroUsize>,
}

impl WorldArgs {
    /// As the library takes them.
    pub fn settings(&self) -> WorldSettings {
        WorldSettings {
            policy: self.policy.clone(),
            robot: self.robot.clone(),
            lenient: self.lenient,
            task: self.task.clone(),
            theta: self.theta.clone(),
            spring: self.spring.clone(),
            torque_noise: self.torque_noise,
            randomised: self.randomised,
            preset: self.preset.into(),
            seed: self.seed,
            threads: self.threads,
        }
    }
}

/// Arguments of `evaluate`.
#[derive(Debug, Args)]
pub struct Evaluate {
    /// The policy and its simulator
    #[command(flatten)]
    pub world: WorldArgs,
    /// Trajectories with random commands
    #[arg(long, value_name = "N", default_value = "10000")]
    pub trajectories: std::num::NonZeroUsize,
    /// Length of each, s
    #[arg(long, value_name = "S", default_value_t = 4.0)]
    pub seconds: f64,
    /// Robots in each constant-command drift trial; 0 leaves them out
    #[arg(long, value_name = "N", default_value_t = 64)]
    pub drift: usize,
    /// Write a page with pictures
    #[arg(long, value_name = "FILE.html")]
    pub report: Option<PathBuf>,
    /// Write a 3-D replay
    #[arg(long, value_name = "FILE.html")]
    pub replay: Option<PathBuf>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `collect`.
#[derive(Debug, Args)]
pub struct Collect {
    /// The policy and its simulator
    #[command(flatten)]
    pub world: WorldArgs,
    /// Folder for the logs, one CSV a trajectory
    #[arg(long, value_name = "FOLDER")]
    pub out: PathBuf,
    /// Trajectories
    #[arg(long, value_name = "N", default_value = "64")]
    pub trajectories: std::num::NonZeroUsize,
    /// Length of each, s
    #[arg(long, value_name = "S", default_value_t = 4.0)]
    pub seconds: f64,
    /// Begin each log this long after the robot, drawn between the two times, s
    #[arg(long, value_names = ["FROM", "TO"], num_args = 1..=2, default_values_t = [0.0])]
    pub log_shift: Vec<f64>,
    /// Record the base's pose and velocity too, which a robot does not measure
    #[arg(long)]
    pub privileged: bool,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// What to measure.
#[derive(Debug, Subcommand)]
pub enum Bench {
    /// Physics substeps a second of a trotting Go2
    Physics(BenchPhysics),
    /// Iterations of PPO on the default task
    Train(BenchTrain),
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

/// Arguments of `bench train`.
#[derive(Debug, Args)]
pub struct BenchTrain {
    /// Robots at once
    #[arg(long, value_name = "N", default_value_t = 4096)]
    pub environments: usize,
    /// Control steps of a rollout
    #[arg(long, value_name = "N", default_value_t = 24)]
    pub steps: usize,
    /// Iterations that are measured, after two that are not
    #[arg(long, value_name = "N", default_value = "10")]
    pub iterations: std::num::NonZeroU32,
    /// Threads [default: one for each core]
    #[arg(long, value_name = "N")]
    pub threads: Option<std::num::NonZeroUsize>,
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
    /// With `train`: the built-in task to start from
    #[arg(long, value_enum, default_value_t = Task::Velocity)]
    pub task: Task,
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

/// Commands with a configuration.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum ConfigOf {
    /// Settings of `gaitfit adapt`
    Adapt,
    /// Settings of `gaitfit train`
    Train,
    /// Settings of `gaitfit finetune`
    Finetune,
    /// Settings of `gaitfit loop`
    Loop,
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

impl From<Preset> for PresetName {
    fn from(preset: Preset) -> Self {
        match preset {
            Preset::Fast => Self::Fast,
            Preset::Accurate => Self::Accurate,
            Preset::Converged => Self::Converged,
        }
    }
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
