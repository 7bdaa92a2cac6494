//! Arguments of `view`.

use clap::Args;
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// Arguments of `view`.
#[derive(Debug, Args)]
pub struct View {
    /// Log (.csv): legs in the air, or a walk
    #[arg(value_name = "LOG")]
    pub log: PathBuf,
    /// Parameters of the simulated robot: theta.toml of a finished fit [default: the robot file's parameters]
    #[arg(long, value_name = "FILE")]
    pub theta: Option<PathBuf>,
    /// Configuration of the fit [default: config.toml beside theta.toml]
    #[arg(long, value_name = "FILE.toml")]
    pub config: Option<PathBuf>,
    /// Robot (.xml, .mjcf, .urdf) [default: the configuration's, or the built-in Go2]
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
    /// Policy that walked [default: the configuration's]; without it a walk has no simulation
    #[arg(long, value_name = "POLICY")]
    pub policy: Option<PathBuf>,
    /// Page to write; it replaces a file of this name [default: a new file in the current folder, the log's name with
    /// .html]
    #[arg(long, value_name = "FILE.html")]
    pub out: Option<PathBuf>,
    /// Open the page
    #[arg(long)]
    pub open: bool,
    /// Start of the shown part, s after the log's start
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    pub from: f64,
    /// Length of the shown part, s
    #[arg(long, value_name = "S", default_value_t = gaitfit::view::SHOWN_S)]
    pub seconds: f64,
    /// Change one setting of the configuration, for example gains.kp=25 (repeatable)
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Number of threads [default: one for each core]
    #[arg(long, value_name = "N", hide = true)]
    pub threads: Option<NonZeroUsize>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}
