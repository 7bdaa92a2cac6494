//! The command line.

#[cfg(test)]
mod advice_test;
mod bench;
mod choices;
mod excite;
mod export;
mod groups;
mod logs;
mod parse;
mod preflight;
mod robot;
mod run;
mod view;
mod world;

pub use bench::{Bench, BenchPhysics, BenchTrain, Geoms, OwnParts, Products};
pub use choices::{Config, ConfigOf, Preset};
pub use excite::Excite;
pub use export::Export;
pub use gaitfit::device::{Device, Devices};
pub use groups::{command, from_variable, meant};
pub use logs::{Import, New, Runs};
pub use preflight::Preflight;
pub use robot::{Drift, LinkArgs, PATIENCE, Record, RobotKind, Run};
pub use run::{Finetune, Fit, Loop, Reproduce, RunArgs, Sensitivity, Train, Validate};
pub use view::View;
pub use world::{Collect, DRIFT, Evaluate};

use clap::{Args, Parser, Subcommand};
use clap_complete::Shell;
use gaitfit_isa::Isa;
use groups::seed;
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// Fits a legged robot's simulator to the real robot from its joint sensors.
#[derive(Debug, Parser)]
#[command(name = "gaitfit", version, propagate_version = true, arg_required_else_help = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Vector instructions: avx512, avx2 or portable [default: the best of this machine]
    #[arg(long, global = true, value_name = "SET", env = gaitfit_isa::VARIABLE, hide_env_values = true, hide = true)]
    pub isa: Option<Isa>,
}

/// What to do. [`groups`] lists the commands in the order of work.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show a robot, log, folder or policy, with its faults
    Inspect(Inspect),
    /// Check a suspended robot: joints, sensors, network
    Preflight(Preflight),
    /// Record a robot's ROS 2 topics as a log, without ROS
    Record(Record),
    /// Convert a recording (MCAP, ROS bag, npz, CSV) to a log
    Import(Import),
    /// Find effects in walking logs that the robot's model lacks
    Explain(Explain),
    /// Play a log and its simulation side by side, in 3-D
    View(View),
    /// List runs with their results
    Runs(Runs),
    /// Show what this machine offers
    Doctor(Doctor),
    /// Write the configuration of a fit or a loop for your robot
    New(New),
    /// Fit the simulator's parameters to logs of a robot
    #[command(alias = "adapt")]
    Fit(Fit),
    /// Predict how precisely logs identify each parameter
    Sensitivity(Sensitivity),
    /// Write a motion, or commands, for logs that identify much
    Excite(Box<Excite>),
    /// Check how well a finished fit predicts other logs
    Validate(Validate),
    /// Write a walking task for a robot, ready to train
    Init(Init),
    /// Train a policy by PPO
    Train(Train),
    /// Train a policy further in a fitted simulator
    Finetune(Finetune),
    /// The whole method: collect, fit, finetune, evaluate; repeat
    Loop(Loop),
    /// Measure how well a policy walks in a simulator
    Evaluate(Evaluate),
    /// Compute drift errors from the forms that `run` wrote
    Drift(Drift),
    /// Write a policy, log or theta.toml for other programs
    #[command(aliases = ["export-log", "export-theta"])]
    Export(Box<Export>),
    /// Run a policy in a simulator or on a robot; write logs
    Collect(Collect),
    /// Run a policy on a robot: stand up, walk, lie down
    Run(Box<Run>),
    /// Print every setting with its default
    Config(Config),
    /// Compute one physics step from given states
    Forward(Forward),
    /// Measure speed
    #[command(subcommand)]
    Bench(Bench),
    /// Repeat an experiment of Dao and Fern's paper (simulator adaptation by proprioceptive distribution matching), and
    /// print its table beside the paper's numbers
    Reproduce(Reproduce),
    /// Print tab completions for a shell
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
    /// Robot: leave out parts that the engine cannot simulate, and list them, instead of refusing the file
    #[arg(long)]
    pub lenient: bool,
    /// Log: check it against this robot's joints and limits; `unitree-go2` is the built-in Go2
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
    /// Log: check that this policy gives the logged actions; if it does not, try other joint orders, signs and scales
    #[arg(long, value_name = "POLICY")]
    pub policy: Option<PathBuf>,
    /// Log: write a picture of the joint signals (.svg), or a page (.html) that fits a phone
    #[arg(long, value_name = "FILE")]
    pub plot: Option<PathBuf>,
    /// Log: open the picture
    #[arg(long, requires = "plot")]
    pub open: bool,
}

/// Arguments of `explain`.
#[derive(Debug, Args)]
#[command(
    after_help = "The effects are play, compliance and load-dependent friction of gears, a joint whose friction, \
                        spring or strength differs from the same joint of the other legs, soft ground, and errors of \
                        sensors. Those that change the motion most stand first (docs/real-robots.md)."
)]
pub struct Explain {
    /// Log of a walk (.csv), or folder of logs of one robot
    pub logs: PathBuf,
    /// Robot (.xml, .mjcf, .urdf); `unitree-go2` is the built-in Go2
    #[arg(long, value_name = "FILE")]
    pub robot: PathBuf,
    /// Policy that walked. With it, the same walks are simulated without such effects, and what these logs show is
    /// subtracted (under a minute)
    #[arg(long, value_name = "POLICY")]
    pub policy: Option<PathBuf>,
    /// Leave out parts of the robot file that the engine cannot simulate, instead of refusing the file
    #[arg(long)]
    pub lenient: bool,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `init`.
#[derive(Debug, Args)]
pub struct Init {
    /// Robot (.xml, .mjcf, .urdf)
    pub robot: PathBuf,
    /// Configuration to write [default: the robot's name with .toml, in the current folder]
    #[arg(long, value_name = "FILE.toml")]
    pub out: Option<PathBuf>,
    /// Overwrite an existing file
    #[arg(long)]
    pub force: bool,
    /// Leave out parts of the robot file that the engine cannot simulate, instead of refusing the file
    #[arg(long)]
    pub lenient: bool,
    /// Fit the feet to the robot's meshes, even if other shapes of it touch the ground
    #[arg(long)]
    pub feet_from_mesh: bool,
    /// Write the robot as one MJCF file, without includes and meshes, even if gaitfit can read its own file
    #[arg(long)]
    pub one_file: bool,
    /// Write no page of the stance
    #[arg(long, hide = true)]
    pub no_picture: bool,
    /// Train a policy for the task. If it does not learn to walk, train with the next guess of the gains; if no guess
    /// walks, train the best one further
    #[arg(long)]
    pub train: bool,
    /// With --train, train the best guess further only if that should end within N minutes of the start (0: never)
    #[arg(long, value_name = "N", requires = "train", default_value_t = 10.0, value_parser = minutes)]
    pub minutes: f64,
    /// With --train, change one setting of the trainings, for example --set train.iterations=200 (repeatable)
    #[arg(long, value_name = "KEY=VALUE", requires = "train", hide = true)]
    pub set: Vec<String>,
    /// With --train, the device: cpu, cuda, cuda:N or auto [default: auto]
    #[arg(long, value_name = "DEVICE", requires = "train", hide = true)]
    pub device: Option<Devices>,
    /// With --train, threads [default: one for each core]
    #[arg(long, value_name = "N", requires = "train", hide = true)]
    pub threads: Option<NonZeroUsize>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Reads a number of minutes: finite and at least 0.
fn minutes(text: &str) -> Result<f64, String> {
    // Infinity would train for ever, and NaN compares with nothing.
    let number = text.parse().ok().filter(|number: &f64| number.is_finite() && *number >= 0.0);
    number.ok_or_else(|| "expected a number of minutes, at least 0".to_owned())
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
    /// Accuracy of the contact solver
    #[arg(long, value_enum, default_value_t = Preset::Converged)]
    pub preset: Preset,
    /// Leave out parts of the robot file that the engine cannot simulate, instead of refusing the file
    #[arg(long)]
    pub lenient: bool,
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
    /// Folder for the pages; it is made if it is absent
    pub folder: PathBuf,
}
