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
    /// File that states the joints, units and columns which the recording does not state (docs/import.md)
    #[arg(long, value_name = "FILE.toml")]
    pub mapping: Option<PathBuf>,
    /// Robot whose joint order applies if joints have numbers instead of names; `unitree-go2` is the built-in Go2
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
    /// Robot: leave out parts that the engine cannot simulate, instead of refusing the file
    #[arg(long)]
    pub lenient: bool,
    /// Policy whose interface splits recorded observation vectors, and whose joint order applies if joints have numbers
    /// instead of names
    #[arg(long, value_name = "FILE")]
    pub policy: Option<PathBuf>,
    /// Read only topics, columns or arrays whose names begin with these words, separated by commas
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub take: Vec<String>,
    /// Add this to the times of messages without joint positions, s [default: from the recorder's clock]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub clock_offset: Option<f64>,
    /// Sampling rate, Hz, if the file has no timestamps or has too coarse ones
    #[arg(long, value_name = "HZ")]
    pub rate: Option<f64>,
    /// Keep every N-th row only
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
    /// File that states the joints, units and columns which recordings do not state (as in `gaitfit import --mapping`)
    #[arg(long, value_name = "FILE.toml")]
    pub mapping: Option<PathBuf>,
    /// Position gains, N·m/rad, if the logs do not state them: a number, or a table such as '{ "*" = 40, "*_hip" = 20
    /// }'
    #[arg(long, value_name = "KP")]
    pub kp: Option<Gain>,
    /// Velocity gains, N·m·s/rad, if the logs do not state them
    #[arg(long, value_name = "KD")]
    pub kd: Option<Gain>,
    /// Leave out parts of the robot file that the engine cannot simulate, instead of refusing the file
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
    /// Write a page that compares the runs: parameters of the fits, and learning curves of the trainings
    #[arg(long, value_name = "FILE.html")]
    pub html: Option<PathBuf>,
    /// Open the page
    #[arg(long, requires = "html")]
    pub open: bool,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}
