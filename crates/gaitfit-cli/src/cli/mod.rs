//! The command line.

#[cfg(test)]
mod advice_test;
mod bench;
mod choices;
mod excite;
mod logs;
mod parse;
mod robot;
mod run;
mod world;

pub use bench::{Bench, BenchPhysics, BenchTrain, Geoms, OwnParts};
pub use choices::{Config, ConfigOf, Preset};
pub use excite::Excite;
pub use gaitfit::device::{Device, Devices};
pub use logs::{ExportLog, ExportTheta, Import};
pub use robot::{Drift, LinkArgs, PATIENCE, RobotKind, Run};
pub use run::{Adapt, Finetune, Loop, Reproduce, RunArgs, Sensitivity, Train, Validate};
pub use world::{Collect, Evaluate};

use clap::{Args, Parser, Subcommand};
use clap_complete::Shell;
use gaitfit_isa::Isa;
use std::path::PathBuf;

/// Fits a legged robot's simulator to the real robot from its joint sensors.
///
/// Results go to standard output, progress to standard error. Exit codes: 0 done, 1 failed or a file
/// that was given is broken, 2 wrong usage or configuration, 3 ran but a stated check failed, 4 hardware or library missing,
/// 130 interrupted.
#[derive(Debug, Parser)]
#[command(name = "gaitfit", version, propagate_version = true, arg_required_else_help = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Vector instructions to use: avx512, avx2 or portable [default: the best of this machine]
    #[arg(long, global = true, value_name = "SET", env = gaitfit_isa::VARIABLE, hide_env_values = true)]
    pub isa: Option<Isa>,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show what a robot file, a log, a folder of logs or a policy holds, and what is wrong with it
    Inspect(Inspect),
    /// Read a recording of another program (MCAP, ROS 2 bag, Parquet, Arrow, HDF5, npz, pickle, PyTorch, CSV) and write it as a log
    Import(Import),
    /// Look at a robot and write a task for it, ready to train
    Init(Init),
    /// Fit the simulator's parameters to logs of a robot
    Adapt(Adapt),
    /// Say how precisely logs can tell each parameter of a fit, without fitting
    Sensitivity(Sensitivity),
    /// Write a chirp for legs in the air that shows a fit what it looks for, within the robot's limits
    Excite(Box<Excite>),
    /// Check how well a finished fit predicts other logs, without fitting again
    Validate(Validate),
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
    /// Write a log as MCAP, for Foxglove and PlotJuggler
    ExportLog(ExportLog),
    /// Write fitted parameters for other simulators: MuJoCo, Isaac Lab, mjlab
    ExportTheta(ExportTheta),
    /// Measure how well a policy walks in a simulator
    Evaluate(Evaluate),
    /// Run a policy in a simulator and write its logs
    Collect(Collect),
    /// Run a policy on a robot: stand up, walk, lie down, with logs
    Run(Box<Run>),
    /// Read the filled forms of drift trials (`run --drift`) and print their table
    Drift(Drift),
    /// Measure speed
    #[command(subcommand)]
    Bench(Bench),
    /// Print every setting with its default
    Config(Config),
    /// Show what this machine offers
    Doctor(Doctor),
    /// Print what completes commands in a shell
    Completions(Completions),
    /// Write the manual pages into a folder
    Man(Man),
}

/// Arguments of `inspect`.
#[derive(Debug, Args)]
pub struct Inspect {
    /// Robot (.xml, .mjcf, .urdf), log (.csv), folder of logs, or policy (.safetensors, .onnx, .toml, run folder of a
    /// training)
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
    /// Log: open the picture
    #[arg(long, requires = "plot")]
    pub open: bool,
}

/// Arguments of `init`.
#[derive(Debug, Args)]
pub struct Init {
    /// Robot (.xml, .mjcf, .urdf)
    pub robot: PathBuf,
    /// Configuration to write [default: the robot's name with .toml, in the current folder]
    #[arg(long, value_name = "FILE.toml")]
    pub out: Option<PathBuf>,
    /// Write over a file that is there
    #[arg(long)]
    pub force: bool,
    /// Drop what the engine does not honour in the robot file, instead of refusing it
    #[arg(long)]
    pub lenient: bool,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
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
    /// Policy: .safetensors, .onnx, a .toml that describes one trained elsewhere, or the run folder of a training
    pub policy: PathBuf,
    /// Write the actor as an ONNX graph, the interface in its metadata
    #[arg(long, value_name = "FILE.onnx")]
    pub onnx: Option<PathBuf>,
    /// Write the whole policy in the project's own format
    #[arg(long, value_name = "FILE.safetensors")]
    pub safetensors: Option<PathBuf>,
    /// Write a folder for programs that run the policy without gaitfit: ONNX, controller.yaml for ROS 2, and
    /// deploy.yaml of unitree_rl_lab
    #[arg(long, value_name = "FOLDER")]
    pub bundle: Option<PathBuf>,
    /// Write the policy as C++17, the network inside: policy.hpp, and example.cpp that uses it
    #[arg(long, value_name = "FOLDER")]
    pub cpp: Option<PathBuf>,
    /// Robot (.xml, .mjcf, .urdf) whose effort limits the bundle and the C++ have [default: that of the policy's training,
    /// or the built-in Go2, for its policies]
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
    /// Drop what the engine does not honour in the robot file, instead of refusing it
    #[arg(long)]
    pub lenient: bool,
    /// Write over files of an earlier bundle or C++ folder
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `doctor`.
#[derive(Debug, Args)]
pub struct Doctor {
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `completions`.
#[derive(Debug, Args)]
pub struct Completions {
    /// The shell
    pub shell: Shell,
}

/// Arguments of `man`.
#[derive(Debug, Args)]
pub struct Man {
    /// Folder for the pages; it is made if it is not there
    pub folder: PathBuf,
}
