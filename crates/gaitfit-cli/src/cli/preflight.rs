//! Arguments of the command that checks a robot that hangs.

use super::RobotKind;
use clap::Args;
use std::path::PathBuf;

/// Arguments of `preflight`.
#[derive(Debug, Args)]
pub struct Preflight {
    /// The robot, as `run` takes it: unitree-go2, unitree-go2w, unitree-b2, unitree-g1 or unitree-h1-2; a robot's file
    /// (.toml); simulated: a Go2 that hangs in gaitfit's own engine, in real time
    #[arg(long, value_name = "ROBOT")]
    pub robot: RobotKind,
    /// Network interface that leads to the robot, for example eth0; lo for a simulator on this machine
    #[arg(long, value_name = "NAME")]
    pub interface: Option<String>,
    /// DDS domain: 0 for robots, 1 for simulators
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u16).range(0..=232))]
    pub domain: u16,
    /// Robot file (.xml, .mjcf, .urdf), for masses and inertias; `unitree-go2` is the built-in Go2 [default: the Go2's
    /// for a Go2, none for other robots]
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// How long to listen to the robot before it moves, s
    #[arg(long, value_name = "S", default_value_t = 5.0)]
    pub seconds: f64,
    /// Ask you to tilt the robot by hand, to check the axes and signs of its IMU
    #[arg(long)]
    pub tilt: bool,
    /// Move each joint a little, first one by one, then all together. The robot must hang with its feet off the ground
    #[arg(long = "move")]
    pub moves: bool,
    /// Do not ask before the robot moves; only for simulators, which use a DDS domain other than 0
    #[arg(long, requires = "moves")]
    pub yes: bool,
    /// Stop if a robot's state is older than this, or the control loop is later, ms; more than 20 only for simulators
    /// on busy machines
    #[arg(long, value_name = "MS", default_value_t = super::PATIENCE, value_parser = clap::value_parser!(u16).range(20..=1000), hide = true)]
    pub patience: u16,
    /// Folder for the result and the logs; it must not contain those of an earlier check
    #[arg(long, value_name = "FOLDER")]
    pub out: PathBuf,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}
