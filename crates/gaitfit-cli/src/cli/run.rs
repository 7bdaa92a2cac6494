//! Arguments of the commands that work in a run folder.

use clap::{Arg, Args};
use gaitfit::run::manifest::last_devices;
use gaitfit::settings::{AdaptConfig, Configuration, FinetuneConfig, LoopConfig, TrainConfig};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// Arguments of all commands that work in a run folder.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// Change one setting (repeatable)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Continue the latest run of this name, to the same result as without the interruption
    #[arg(long)]
    pub resume: bool,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
    /// Open the report in the browser when the run ends
    #[arg(long)]
    pub open: bool,
    /// Number of threads [default: one for each core]
    #[arg(long, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
    /// Name of the run and its folder [default: the configuration's name]
    #[arg(long)]
    pub name: Option<String>,
}

impl RunArgs {
    /// The device of the run `name` in the folder `runs`.
    pub fn devices(&self, asked: Option<&super::Devices>, runs: &str, name: &str) -> super::Devices {
        // A run that resumes stays on its devices, unless the command line names others.
        let last = self.resume.then(|| last_devices(Path::new(runs), name)).flatten();
        super::Devices::choose(asked.cloned(), last.as_deref())
    }

    /// Threads asked for, or one for each core.
    pub fn threads(&self) -> usize {
        self.threads.map_or_else(gaitfit::machine::threads, NonZeroUsize::get)
    }
}

/// The help of `--set` in a command whose configuration is a `C`.
fn set_help<C: Configuration>(set: Arg) -> Arg {
    // The example differs from command to command, so it is filled in for each.
    set.help(format!("Change one setting, for example --set {} (repeatable)", C::EXAMPLE))
}

/// Arguments of `fit`.
#[derive(Debug, Args)]
#[command(mut_arg("set", set_help::<AdaptConfig>))]
pub struct Fit {
    /// Configuration (TOML); `gaitfit config` prints one with every default
    pub config: PathBuf,
    /// Device of the simulations: cpu, cuda (the first GPU), cuda:N, cuda:0,1 (several GPUs share the candidates), or
    /// auto (a GPU if one can be used); a run may resume on another device [default: auto; with --resume the run's]
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<super::Devices>,
    /// How it runs.
    #[command(flatten)]
    pub run: RunArgs,
}

/// Arguments of `sensitivity`.
#[derive(Debug, Args)]
pub struct Sensitivity {
    /// Configuration (TOML) of a fit; its robot, logs, parameters and first cost are used
    pub config: PathBuf,
    /// Values of the parameters: the theta.toml of a fit [default: the configuration's truth, or the search's start]
    #[arg(long, value_name = "FILE")]
    pub theta: Option<PathBuf>,
    /// Expected difference between the joint signals of fitted simulator and logs, relative to half of a joint's range
    /// [default: the difference at these values]
    #[arg(long, value_name = "X")]
    pub difference: Option<f64>,
    /// Change one setting, for example --set simulation.timestep=0.0025 (repeatable)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
    /// Number of threads [default: one for each core]
    #[arg(long, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
}

/// Arguments of `validate`.
#[derive(Debug, Args)]
pub struct Validate {
    /// Fitted parameters: the theta.toml of a fit
    pub theta: PathBuf,
    /// Logs to validate on: files; of a walking robot also folders and patterns
    #[arg(required = true)]
    pub logs: Vec<String>,
    /// The fit's configuration [default: config.toml beside the parameters]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Change one of its settings, for example --set check.rmse_rad=0.02 (repeatable)
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
    /// Number of threads [default: one for each core]
    #[arg(long, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
}

/// Arguments of `train`.
#[derive(Debug, Args)]
#[command(mut_arg("set", set_help::<TrainConfig>))]
pub struct Train {
    /// Configuration (TOML); `gaitfit config train` prints one with every default
    pub config: Option<PathBuf>,
    /// Robot (.xml, .mjcf, .urdf) [default: the configuration's, or the built-in Go2]
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
    /// Number of seeds (3: the seeds 1, 2, 3), or a list (4,9) [default: the configuration's]
    #[arg(long, value_name = "N|LIST")]
    pub seeds: Option<Seeds>,
    /// Device of the training: cpu, cuda (the first GPU), cuda:N, cuda:0,1 (several GPUs share the robots), or auto (a
    /// GPU if one can be used); a run may resume on another device [default: auto; with --resume the run's]
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<super::Devices>,
    /// How it runs.
    #[command(flatten)]
    pub run: RunArgs,
}

/// Arguments of `finetune`.
#[derive(Debug, Args)]
#[command(mut_arg("set", set_help::<FinetuneConfig>))]
pub struct Finetune {
    /// Policy: .safetensors, .onnx, a .toml that describes one trained elsewhere, or the run folder of a training
    /// [default: the configuration's]
    pub policy: Option<PathBuf>,
    /// Fitted parameters: the theta.toml of a fit
    #[arg(long, value_name = "FILE")]
    pub theta: Option<PathBuf>,
    /// Robot (.xml, .mjcf, .urdf) [default: the configuration's, that of the policy's training, or the built-in Go2]
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
    /// Leave out parts of the robot file that the engine cannot simulate, instead of refusing the file
    #[arg(long)]
    pub lenient: bool,
    /// Add a spring to a joint: its stiffness, N·m/rad, and its rest angle, rad [default: the joint's default angle]
    /// (repeatable)
    #[arg(long, value_name = "JOINT=STIFFNESS[@REST]")]
    pub spring: Vec<gaitfit::Spring>,
    /// Standard deviation of Gaussian noise on the torque of every joint at every physics step, N·m
    #[arg(long, value_name = "NM")]
    pub torque_noise: Option<f64>,
    /// Task: velocity, biped, or a file with a task's settings [default: the policy's own]
    #[arg(long, value_name = "TASK")]
    pub task: Option<String>,
    /// Configuration (TOML); `gaitfit config finetune` prints one with every default
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Number of seeds (3: the seeds 1, 2, 3), or a list (4,9) [default: the configuration's]
    #[arg(long, value_name = "N|LIST")]
    pub seeds: Option<Seeds>,
    /// Device of the training: cpu, cuda (the first GPU), cuda:N, cuda:0,1 (several GPUs share the robots), or auto (a
    /// GPU if one can be used); a run may resume on another device [default: auto; with --resume the run's]
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<super::Devices>,
    /// How it runs.
    #[command(flatten)]
    pub run: RunArgs,
}

/// Arguments of `loop`.
#[derive(Debug, Args)]
#[command(mut_arg("set", set_help::<LoopConfig>))]
pub struct Loop {
    /// Configuration (TOML); `gaitfit config loop` prints one with every default
    pub config: PathBuf,
    /// Device of fit and training: cpu, cuda (the first GPU), cuda:N, cuda:0,1 (several GPUs share a fit's candidates
    /// and a training's robots), or auto (a GPU if one can be used) [default: auto; with --resume the run's]
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<super::Devices>,
    /// How it runs.
    #[command(flatten)]
    pub run: RunArgs,
}

/// Arguments of `reproduce`.
#[derive(Debug, Args)]
pub struct Reproduce {
    /// Name of the table; `list` prints all names and how long they take
    pub table: String,
    /// Run at the paper's scale; the default scale suits two cores
    #[arg(long)]
    pub full: bool,
    /// Number of repetitions of every cell, each with another seed
    #[arg(long, value_name = "N", default_value = "1")]
    pub seeds: std::num::NonZeroU32,
    /// Run only the cells (rows) of the table with such names, for example '*-wass'
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
    /// Open the plot when the run ends
    #[arg(long)]
    pub open: bool,
    /// Device of fits and trainings: cpu, cuda (the first GPU), cuda:N, cuda:0,1 (several GPUs share the cells), or
    /// auto (a GPU if one can be used)
    #[arg(long, value_name = "DEVICE", default_value = "auto")]
    pub device: super::Devices,
    /// Number of cells to run at the same time; one fit alone does not keep a GPU busy [default: one for each device]
    #[arg(long, value_name = "N")]
    pub jobs: Option<std::num::NonZeroUsize>,
    /// Number of threads [default: one for each core]
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
                // Each seed is a whole training. A larger number is more likely meant as one seed.
                count @ 1..=1000 => Ok(Self((1..=count).collect())),
                count => Err(format!("{count} seeds; give 1 to 1000, or a list such as 4,9")),
            };
        }
        // The comma at the end makes a list of one seed; without it the number would be a count.
        let list = text.strip_suffix(',').unwrap_or(text);
        list.split(',').map(number).collect::<Result<_, _>>().map(Self)
    }
}
