//! Arguments of the commands about logs.

use clap::Args;
use std::path::PathBuf;

/// Arguments of `import`.
#[derive(Debug, Args)]
pub struct Import {
    /// A recording: a file, a ROS 2 bag's folder, or several files that were recorded together
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Log to write
    #[arg(long, value_name = "FILE.csv")]
    pub out: PathBuf,
    /// What the recording does not say: joints, units, columns (docs/logs.md)
    #[arg(long, value_name = "FILE.toml")]
    pub mapping: Option<PathBuf>,
    /// Robot whose joints' order numbered joints have
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
    /// Robot: drop what the engine does not honour, instead of refusing the file
    #[arg(long)]
    pub lenient: bool,
    /// Policy whose observations the recording holds: they are unpacked by its interface, and numbered joints are its own
    #[arg(long, value_name = "FILE")]
    pub policy: Option<PathBuf>,
    /// Read only these topics, columns or arrays, by the beginning of their names, separated by commas
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub take: Vec<String>,
    /// Add this to the times of what holds no joint positions, s [default: what the recorder's clock shows]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub clock_offset: Option<f64>,
    /// Samples a second of a file without times, or whose times lost their digits
    #[arg(long, value_name = "HZ")]
    pub rate: Option<f64>,
    /// Take one row of N
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub every: Option<u32>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `export-log`.
#[derive(Debug, Args)]
pub struct ExportLog {
    /// Log (.csv)
    pub log: PathBuf,
    /// MCAP file to write, of ROS 2 messages
    #[arg(long, value_name = "FILE.mcap")]
    pub out: PathBuf,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `export-theta`.
#[derive(Debug, Args)]
pub struct ExportTheta {
    /// Fitted parameters: the theta.toml of an `adapt` run
    pub theta: PathBuf,
    /// Folder for the files; it is made if it is not there
    #[arg(long, value_name = "FOLDER")]
    pub out: PathBuf,
    /// Robot (.xml, .mjcf, .urdf) that was fitted [default: the built-in Go2]
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
    /// Drop what the engine does not honour in the robot file, instead of refusing it
    #[arg(long)]
    pub lenient: bool,
    /// Position gain of the controller on every joint, N·m/rad
    #[arg(long, value_name = "KP", requires = "kd")]
    pub kp: Option<f64>,
    /// Velocity gain of the controller on every joint, N·m·s/rad
    #[arg(long, value_name = "KD", requires = "kp")]
    pub kd: Option<f64>,
    /// Policy whose gains the controller has
    #[arg(long, value_name = "POLICY", conflicts_with_all = ["kp", "kd"])]
    pub policy: Option<PathBuf>,
    /// Physics step of the simulator that takes the files, in which Isaac Lab and mjlab count delays [default: the fit's]
    #[arg(long, value_name = "SECONDS")]
    pub step: Option<f64>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}
