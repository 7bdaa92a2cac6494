//! Arguments of the command that runs a policy on a robot.

use clap::Args;
pub use gaitfit::settings::PATIENCE;
use gaitfit_robot::robot::BUILT_IN;
use gaitfit_robot::{Robot, RobotError, Times};
use std::num::NonZeroUsize;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

/// Times that a robot may stand before the policy acts, s.
const STAND_S: RangeInclusive<f64> = 0.5..=120.0;
/// Least time for a robot that hangs, s. A person lowers it in this time.
const LOWERED_LEAST_S: f64 = 3.0;
/// Default for a robot that hangs, s.
const LOWERED_S: f64 = 10.0;

/// A robot that a policy may run on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RobotKind {
    /// A robot, or a simulator with its messages, over DDS: a built-in robot's name, or a robot's file.
    Linked(String),
    /// A Go2 in gaitfit's own engine, in real time.
    Simulated,
}

impl FromStr for RobotKind {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = BUILT_IN.iter().any(|(name, _)| *name == text);
        match text {
            "simulated" => Ok(Self::Simulated),
            // The file is not opened here: an error inside it deserves a better message than a wrong word on the
            // command line.
            _ if known || text.ends_with(".toml") => Ok(Self::Linked(text.to_owned())),
            _ => {
                let names: Vec<&str> = BUILT_IN.iter().map(|(name, _)| *name).collect();
                Err(format!(
                    "no such robot; it is simulated, {}, or a robot's file (.toml)",
                    names.join(", ")
                ))
            }
        }
    }
}

impl RobotKind {
    /// The robot: a simulated one is a Go2.
    ///
    /// # Errors
    /// A robot's file that cannot be used.
    pub fn robot(&self) -> Result<Robot, RobotError> {
        match self {
            Self::Simulated => Robot::built_in("unitree-go2"),
            // No built-in robot's name ends so.
            Self::Linked(name) if name.ends_with(".toml") => Robot::read(Path::new(name)),
            Self::Linked(name) => Robot::built_in(name),
        }
    }
}

/// The link to a robot, and how it is armed: for `run`, and for `collect` on a robot.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "On a robot")]
pub struct LinkArgs {
    /// Network interface that leads to the robot, for example eth0; lo for a simulator on this machine
    #[arg(long, value_name = "NAME")]
    pub interface: Option<String>,
    /// DDS domain: 0 for robots, 1 for simulators
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u16).range(0..=232), hide = true)]
    pub domain: u16,
    /// How long the policy lets the robot stand (zero command) between trajectories, s [default: 2]
    #[arg(long, value_name = "S", hide = true)]
    pub pause: Option<f64>,
    /// How long the robot holds the policy's default pose before the policy takes over, s. Lower a suspended robot to
    /// the ground in this time [default: 0.5; robots that start suspended: 10, at least 3]
    #[arg(long, value_name = "S", hide = true)]
    pub stand: Option<f64>,
    /// Read the robot's state and run the policy, but send no motor commands; the logs go into the folder dry-run in
    /// --out
    #[arg(long)]
    pub dry_run: bool,
    /// Do not ask before the robot moves; only for simulators, which use a DDS domain other than 0
    #[arg(long, hide = true)]
    pub yes: bool,
    /// Stop if a robot's state is older than this, or the control loop is later, ms; more than 20 only for simulators
    /// on busy machines
    #[arg(long, value_name = "MS", default_value_t = PATIENCE, value_parser = clap::value_parser!(u16).range(20..=1000), hide = true)]
    pub patience: u16,
}

impl LinkArgs {
    /// How long the robot stands between trajectories, s.
    pub fn pause(&self) -> f64 {
        self.pause.unwrap_or(2.0)
    }

    /// How long `robot` stands before the policy acts.
    ///
    /// # Errors
    /// A time out of range, in a sentence.
    pub fn stand(&self, robot: &Robot) -> Result<Duration, String> {
        // Other robots stand up by themselves, so they need only the time to come to rest.
        let (usual, least, why) = match robot.hangs {
            true => (LOWERED_S, LOWERED_LEAST_S, ": a person must lower the robot in this time"),
            false => (Times::default().settle.as_secs_f64(), *STAND_S.start(), ""),
        };
        let (seconds, most) = (self.stand.unwrap_or(usual), *STAND_S.end());
        match (least..=most).contains(&seconds) {
            true => Ok(Duration::from_secs_f64(seconds)),
            false => Err(format!("--stand takes {least} to {most} s{why}")),
        }
    }
}

/// Arguments of `run`.
#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("who").required(true).args(["commands", "random", "remote", "keyboard", "drift"]))]
pub struct Run {
    /// Policy: .safetensors, .onnx, or a .toml that describes one trained elsewhere
    pub policy: PathBuf,
    /// The robot: unitree-go2, unitree-go2w, unitree-b2, unitree-g1 or unitree-h1-2 over DDS, or a simulator with its
    /// messages; a robot's file (.toml); simulated: a Go2 in gaitfit's own engine, in real time
    #[arg(long, value_name = "ROBOT")]
    pub robot: RobotKind,
    /// Commands from a file with the columns t,vx,vy,wz (s, m/s, m/s, rad/s); its last row ends the walk. Or a file of
    /// `excite --policy` with several trajectories, each a walk of --seconds with its own log
    #[arg(long, value_name = "FILE.csv")]
    pub commands: Option<PathBuf>,
    /// Walk under random commands for this time, s; they are drawn from the policy's task as in `collect`
    #[arg(long, value_name = "S")]
    pub random: Option<f64>,
    /// Length of each trajectory of a file of `excite --policy`, s [default: 4]
    #[arg(long, value_name = "S", conflicts_with_all = ["random", "remote", "keyboard", "drift"])]
    pub seconds: Option<f64>,
    /// Commands from the robot's own remote control: the left stick walks, the right stick turns, A lies the robot
    /// down, B stops it with damped joints
    #[arg(long)]
    pub remote: bool,
    /// Commands from the keyboard: W A S D or arrows walk and turn, J and L step sideways, Space stands, Q lies down,
    /// Esc stops the robot with damped joints
    #[arg(long)]
    pub keyboard: bool,
    /// Number of drift trials in each direction: stand, a constant command for 4 s, stand. The robot waits for Enter
    /// between trials. A form for your measurements is written into --out, for `gaitfit drift`
    #[arg(long, value_name = "N")]
    pub drift: Option<usize>,
    /// Speeds of the drift trials: forward and sideways, m/s, and yaw, rad/s; 0 leaves a direction out [default:
    /// 1,1,0.3925, those of Dao and Fern]
    #[arg(long, value_name = "X,Y,YAW", requires = "drift", value_delimiter = ',', num_args = 1, allow_hyphen_values = true,
        conflicts_with_all = ["commands", "random", "remote", "keyboard"], hide = true)]
    pub drift_speeds: Vec<f32>,
    /// Number of random walks, with pauses between them; each has its own log
    #[arg(long, value_name = "N", requires = "random", conflicts_with_all = ["commands", "remote", "keyboard", "drift"])]
    pub trajectories: Option<NonZeroUsize>,
    /// Seed of the random commands
    #[arg(
        long,
        value_name = "N",
        default_value_t = 0,
        conflicts_with_all = ["commands", "remote", "keyboard", "drift"],
        hide = true,
        value_parser = super::seed,
        allow_negative_numbers = true
    )]
    pub seed: u64,
    /// Folder for the logs and the summary; it must not contain an earlier run
    #[arg(long, value_name = "FOLDER")]
    pub out: PathBuf,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
    /// Also play commands beyond the range of the policy's training
    #[arg(long, conflicts_with_all = ["random", "remote", "keyboard"], hide = true)]
    pub beyond_training: bool,
    /// Whether `collect` asks: its options have other names.
    #[arg(skip)]
    pub of_collect: bool,
    /// The link.
    #[command(flatten)]
    pub link: LinkArgs,
}

/// Arguments of `record`.
#[derive(Debug, Args)]
pub struct Record {
    /// File with a table [topics]: the topics to record and their types; its other keys are the same as in `gaitfit
    /// import
    /// --mapping`
    #[arg(value_name = "TOPICS.toml")]
    pub topics: PathBuf,
    /// Network interface to the robot, for example eth0; lo for a program on this machine
    #[arg(long, value_name = "NAME")]
    pub interface: String,
    /// DDS domain (ROS_DOMAIN_ID)
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u16).range(0..=232))]
    pub domain: u16,
    /// Length of the recording from the first message on, s [default: until Ctrl-C]
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,
    /// Robot whose joint order applies if joints have numbers instead of names; `unitree-go2` is the built-in Go2
    #[arg(long, value_name = "FILE")]
    pub robot: Option<PathBuf>,
    /// Log to write; the raw messages go into a .mcap file beside it
    #[arg(long, value_name = "FILE.csv")]
    pub out: PathBuf,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `drift`.
#[derive(Debug, Args)]
pub struct Drift {
    /// Forms of `gaitfit run --drift` with your measurements; one for each policy compares the policies
    #[arg(required = true, value_name = "FORM.csv")]
    pub forms: Vec<PathBuf>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn a_person_has_time_to_lower_a_robot_that_hangs() {
        let link = |stand| LinkArgs {
            interface: None,
            domain: 0,
            pause: None,
            stand,
            dry_run: false,
            yes: false,
            patience: PATIENCE,
        };
        let stands = |name: &str, stand| link(stand).stand(&Robot::built_in(name).unwrap());
        assert_eq!(stands("unitree-go2", Some(0.5)), Ok(Duration::from_millis(500)));
        assert_eq!(stands("unitree-g1", None), Ok(Duration::from_secs(10)));
        let refused = stands("unitree-g1", Some(0.5)).unwrap_err();
        assert_eq!(refused, "--stand takes 3 to 120 s: a person must lower the robot in this time");
    }
}
