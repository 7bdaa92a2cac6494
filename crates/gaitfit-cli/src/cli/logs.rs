//! Arguments of the commands about logs and runs.

use super::excite::Gain;
use clap::Args;
use std::path::PathBuf;

/// Arguments of `import`.
#[derive(Debug, Default, Args)]
pub struct Import {
    /// A recording: a file, a ROS 2 bag's folder, or several files that were recorded together
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Log to write
    #[arg(long, value_name = "FILE.csv")]
    pub out: PathBuf,
    /// Joints, units and columns that the recording does not state (docs/import.md)
    #[arg(long, value_name = "FILE.toml")]
    pub mapping: Option<PathBuf>,
    /// Robot that gives the order of numbered joints; `unitree-go2` is the built-in Go2
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
    /// Robot: drop what the engine cannot simulate, instead of refusing the file
    #[arg(long)]
    pub lenient: bool,
    /// Policy that unpacks recorded observations, and gives the order of numbered joints
    #[arg(long, value_name = "FILE")]
    pub policy: Option<PathBuf>,
    /// Read only these topics, columns or arrays, by the beginning of their names, separated by commas
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub take: Vec<String>,
    /// Add this to the times of messages without joint positions, s [default: from the recorder's clock]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub clock_offset: Option<f64>,
    /// Samples a second of a file without times, or with times that lost their digits
    #[arg(long, value_name = "HZ")]
    pub rate: Option<f64>,
    /// Take one row of N
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub every: Option<u32>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `new`.
#[derive(Debug, Args)]
pub struct New {
    /// Robot (.xml, .mjcf, .urdf); `unitree-go2` is the built-in Go2
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
    /// Policy that walked: .safetensors, .onnx, or a .toml; without it the logs are of legs in the air
    #[arg(long, value_name = "POLICY")]
    pub policy: Option<PathBuf>,
    /// Logs (.csv), recordings of other programs, or folders of them
    #[arg(long, value_name = "PATH", num_args = 1..)]
    pub logs: Vec<PathBuf>,
    /// Configuration to write
    #[arg(long, value_name = "FILE.toml")]
    pub out: Option<PathBuf>,
    /// Joints, units and columns that recordings do not state (see `gaitfit import --mapping`)
    #[arg(long, value_name = "FILE.toml")]
    pub mapping: Option<PathBuf>,
    /// Position gains, N·m/rad, if the logs do not state them: a number, or a table such as '{ "*" = 40, "*_hip" = 20 }'
    #[arg(long, value_name = "KP")]
    pub kp: Option<Gain>,
    /// Velocity gains, N·m·s/rad, if the logs do not state them
    #[arg(long, value_name = "KD")]
    pub kd: Option<Gain>,
    /// Drop what the engine cannot simulate in the robot file, instead of refusing it
    #[arg(long)]
    pub lenient: bool,
    /// Overwrite an existing file
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `runs`.
#[derive(Debug, Args)]
pub struct Runs {
    /// Folder of the run folders
    #[arg(default_value = "runs", value_name = "FOLDER")]
    pub folder: PathBuf,
    /// Write a page: parameters of the fits side by side, learning curves of the trainings in common charts
    #[arg(long, value_name = "FILE.html")]
    pub html: Option<PathBuf>,
    /// Open the page
    #[arg(long, requires = "html")]
    pub open: bool,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}
