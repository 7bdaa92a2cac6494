//! Arguments of the commands that run a policy in a simulator.

use super::{LinkArgs, Preset, RobotKind};
use clap::Args;
use gaitfit::world::WorldSettings;
use std::path::{Path, PathBuf};

/// A policy and the simulator it runs in.
#[derive(Debug, Args)]
pub struct WorldArgs {
    /// Policy: .safetensors, .onnx, a .toml that describes one trained elsewhere, or the run folder of a training
    pub policy: PathBuf,
    /// Robot (.xml, .mjcf, .urdf) [default: that of the policy's training, or the built-in Go2]
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
    /// Leave out parts of the robot file that the engine cannot simulate, instead of refusing the file
    #[arg(long, hide = true)]
    pub lenient: bool,
    /// Task: velocity, biped, or a file with a task's settings [default: the policy's own]
    #[arg(long, value_name = "TASK")]
    pub task: Option<String>,
    /// Fitted parameters: the theta.toml of a fit
    #[arg(long, value_name = "FILE")]
    pub theta: Option<PathBuf>,
    /// Add a spring to a joint: its stiffness, N·m/rad, and its rest angle, rad [default: the joint's default angle]
    /// (repeatable)
    #[arg(long, value_name = "JOINT=STIFFNESS[@REST]", hide = true)]
    pub spring: Vec<gaitfit::Spring>,
    /// Standard deviation of Gaussian noise on the torque of every joint at every physics step, N·m
    #[arg(long, value_name = "NM", default_value_t = 0.0, hide = true)]
    pub torque_noise: f64,
    /// Randomise robots, initial states and observations as in training, and push the robots
    #[arg(long, hide = true)]
    pub randomised: bool,
    /// Accuracy of the contact solver
    #[arg(long, value_enum, default_value_t = Preset::Fast, hide = true)]
    pub preset: Preset,
    /// Random seed of commands, initial states and noise
    #[arg(long, value_name = "N", default_value_t = 0, hide = true, value_parser = super::seed, allow_negative_numbers = true)]
    pub seed: u64,
    /// Number of threads [default: one for each core]
    #[arg(long, value_name = "N", hide = true)]
    pub threads: Option<std::num::NonZeroUsize>,
}

impl WorldArgs {
    /// The files that are read, and a task's name, which may be one.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        let named = [&self.robot, &self.theta].into_iter().flatten().map(PathBuf::as_path);
        std::iter::once(self.policy.as_path()).chain(named).chain(self.task.as_deref().map(Path::new))
    }

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

/// Robots in each drift trial of `evaluate` by default.
pub const DRIFT: usize = 64;

/// Arguments of `evaluate`.
#[derive(Debug, Args)]
pub struct Evaluate {
    /// The policy and its simulator
    #[command(flatten)]
    pub world: WorldArgs,
    /// Number of trajectories with random commands
    #[arg(long, value_name = "N", default_value = "10000")]
    pub trajectories: std::num::NonZeroUsize,
    /// Length of each trajectory, s [default: 4, or the length of the motion that the policy follows]
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,
    /// Number of robots in each drift trial, a walk under a constant command; 0: no such trials [default: 64]
    #[arg(long, value_name = "N")]
    pub drift: Option<usize>,
    /// Speeds of the drift trials: forward and sideways, m/s, and yaw, rad/s [default: half of the task's largest
    /// commands]
    #[arg(
        long,
        value_name = "X,Y,YAW",
        value_delimiter = ',',
        num_args = 1,
        allow_hyphen_values = true,
        hide = true
    )]
    pub drift_speeds: Vec<f64>,
    /// Robots also cross uneven ground: its kinds (flat, slopes, stairs, rough) separated by commas, a .toml file with
    /// a table [terrain], `none`, or `own` (the task's)
    #[arg(long, value_name = "GROUND", default_value = "own", hide = true)]
    pub terrain: String,
    /// Number of robots on each cell of the uneven ground
    #[arg(long, value_name = "N", default_value_t = 32, hide = true)]
    pub terrain_robots: usize,
    /// Device of the simulation: cpu, cuda (the first GPU), cuda:N, or auto (a GPU for 1,000 robots or more, if one can
    /// be used)
    #[arg(long, value_name = "DEVICE", default_value = "cpu")]
    pub device: super::Device,
    /// Write a page with pictures
    #[arg(long, value_name = "FILE.html")]
    pub report: Option<PathBuf>,
    /// Write a 3-D replay: on the uneven ground, if there is any
    #[arg(long, value_name = "FILE.html")]
    pub replay: Option<PathBuf>,
    /// Open the page when it is written, or the replay if there is no page
    #[arg(long)]
    pub open: bool,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `collect`.
#[derive(Debug, Args)]
#[command(mut_arg("robot", |robot| robot.value_name("FILE|ROBOT").help(
    "Robot to simulate (.xml, .mjcf, .urdf); or a real robot, as in `gaitfit run`, for example unitree-go2; or \
     `simulated`, which rehearses a real Go2 in real time [default: the robot of the policy's training, or the \
     built-in Go2]"
)))]
pub struct Collect {
    /// The policy and its simulator
    #[command(flatten)]
    pub world: WorldArgs,
    /// Folder for the logs, one CSV for each trajectory
    #[arg(long, value_name = "FOLDER")]
    pub out: PathBuf,
    /// Number of trajectories
    #[arg(long, value_name = "N", default_value = "64")]
    pub trajectories: std::num::NonZeroUsize,
    /// Play these commands instead of random ones: a file that `gaitfit excite --policy` wrote, with one command
    /// sequence for each trajectory
    #[arg(long, value_name = "FILE.csv", conflicts_with = "trajectories")]
    pub commands: Option<PathBuf>,
    /// Length of each trajectory, s
    #[arg(long, value_name = "S", default_value_t = 4.0)]
    pub seconds: f64,
    /// Start each log this long after the start of the simulation, s; with two numbers, a random time between them for
    /// each log. So the log begins in the middle of a walk, at an unknown time, as a real one does
    #[arg(long, value_names = ["FROM", "TO"], num_args = 1..=2, default_values_t = [0.0], hide = true)]
    pub log_shift: Vec<f64>,
    /// Also record the position and velocity of the base, which a real robot does not measure
    #[arg(long, hide = true)]
    pub privileged: bool,
    /// Device of the simulation: cpu, cuda (the first GPU), cuda:N, or auto (a GPU for 1,000 trajectories
    /// or more, if one can be used)
    #[arg(long, value_name = "DEVICE", default_value = "cpu")]
    pub device: super::Device,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
    /// The link to a robot.
    #[command(flatten)]
    pub link: LinkArgs,
}

impl Collect {
    /// The robot that is asked for in the place of a robot file.
    pub fn on_robot(&self) -> Option<RobotKind> {
        // A file with the name of a robot wins: `--robot` means a file first.
        let robot = self.world.robot.as_deref().filter(|path| !path.exists())?;
        // A word that names no robot is left to the reader of robot files, which reports it.
        robot.to_str()?.parse().ok()
    }
}
