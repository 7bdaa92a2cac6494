//! Settings of a robot that can be run from here: `[target]` of a loop.

use super::Preset;
use crate::Spring;
use gaitfit_adapt::{JointParameter, RobotNumber};
use gaitfit_model::shown_number;
use serde::{Deserialize, Serialize};

/// A robot that can be run from here.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetConfig {
    /// How it is run.
    pub kind: TargetKind,
    /// Trajectories recorded each round.
    #[serde(default = "trajectories")]
    pub trajectories: usize,
    /// Length of each, s.
    #[serde(default = "seconds")]
    pub seconds: f64,
    /// Seed of the first round's commands and noise; later rounds take the next ones.
    #[serde(default = "first_seed")]
    pub seed: u64,
    /// Simulated: a `theta.toml` with numbers of the true robot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub theta: Option<String>,
    /// Simulated: springs, written `JOINT=STIFFNESS` or `JOINT=STIFFNESS@REST`, N·m/rad and rad.
    #[serde(default)]
    pub spring: Vec<Spring>,
    /// Simulated: standard deviation of Gaussian torques at every joint and physics step, N·m.
    #[serde(default)]
    pub torque_noise: f64,
    /// Simulated: each log begins this long after the robot, drawn between the two, s.
    #[serde(default)]
    pub log_shift: [f64; 2],
    /// Simulated: solver effort.
    #[serde(default = "accurate", with = "super::preset")]
    pub preset: Preset,
    /// Command: how long each call of a program may take, s; then it is stopped.
    #[serde(default = "timeout_seconds")]
    pub timeout_seconds: f64,
    /// Command: a program that ends well if the robot is there, and its arguments; if it is not, the loop continues
    /// without a target. Without one the robot must be there.
    #[serde(default)]
    pub probe: Vec<String>,
    /// Command: the program that records, and its arguments.
    #[serde(default)]
    pub collect: Vec<String>,
    /// Command: the program that measures, and its arguments.
    #[serde(default)]
    pub evaluate: Vec<String>,
    /// Robot: its name or its file (`.toml`), as `gaitfit run --robot` takes it.
    #[serde(default = "go2")]
    pub robot: String,
    /// Robot: network interface to it, for example `eth0`.
    #[serde(default)]
    pub interface: String,
    /// Robot: DDS domain; robots are in 0, simulators in others.
    #[serde(default)]
    pub domain: u16,
    /// Robot: how long it stands between trajectories, s.
    #[serde(default = "pause")]
    pub pause: f64,
    /// Robot: how old a state and how late a loop may be, ms; a real one has 20.
    #[serde(default = "patience")]
    pub patience: u16,
    /// Robot: nobody is asked before it moves; for simulators only.
    #[serde(default)]
    pub yes: bool,
    /// Robot: whether the last policy walks too, under the commands of the first round.
    #[serde(default = "yes")]
    pub last_walk: bool,
    /// Simulated: true values of joints.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameter: Vec<TrueParameter>,
    /// Simulated: true values of the robot as a whole.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub number: Vec<TrueNumber>,
}

/// How a target is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TargetKind {
    /// In this engine, with other numbers.
    Simulated,
    /// By another program.
    Command,
    /// A robot of the link, or a simulator that speaks as one, over DDS.
    #[serde(alias = "unitree-go2")]
    Robot,
    /// A Go2 in this engine, run on the clock as the real one is: a rehearsal.
    #[serde(rename = "simulated-go2")]
    SimulatedGo2,
}

impl TargetKind {
    /// Whether it is run as `gaitfit collect --robot` runs it.
    pub fn is_robot(self) -> bool {
        matches!(self, Self::Robot | Self::SimulatedGo2)
    }
}

/// A value of some joints of a simulated target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrueParameter {
    /// Quantity.
    pub kind: JointParameter,
    /// Patterns over joint names.
    #[serde(default = "every_joint")]
    pub joints: Vec<String>,
    /// Its value on these joints, in the quantity's unit.
    pub value: f64,
}

/// A number of a simulated target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrueNumber {
    /// Which number.
    pub kind: RobotNumber,
    /// Its value.
    pub value: f64,
}

/// As many and as long as in the paper's tables (Dao and Fern).
fn trajectories() -> usize {
    64
}

fn seconds() -> f64 {
    4.0
}

fn timeout_seconds() -> f64 {
    3600.0
}

fn first_seed() -> u64 {
    1
}

fn pause() -> f64 {
    2.0
}

/// Max age of a state and max delay of a loop on a real robot, ms.
pub const PATIENCE: u16 = 20;

fn patience() -> u16 {
    PATIENCE
}

fn go2() -> String {
    crate::robot::GO2.to_owned()
}

fn yes() -> bool {
    true
}

fn accurate() -> Preset {
    Preset::Accurate
}

fn every_joint() -> Vec<String> {
    vec!["*".to_owned()]
}

impl TargetConfig {
    /// Whether a program measures that cannot be told how fast drift trials are.
    pub fn has_no_drift_speeds(&self) -> bool {
        // Without a program there is none that must be told.
        !self.evaluate.is_empty() && self.evaluate.iter().all(|word| !word.contains("{drift_speeds}"))
    }

    /// Names a fault of the settings, in words.
    pub fn wrong(&self) -> Option<String> {
        let (simulated, command) = (self.kind == TargetKind::Simulated, self.kind == TargetKind::Command);
        let [low, high] = self.log_shift;
        if let Err(wrong) = check_torque_noise("target.torque_noise", self.torque_noise) {
            return Some(wrong);
        }
        // Ranges first, then settings that belong to another kind of target.
        // Ranges are written as `!(a && b)`, which refuses NaN too.
        let wrong = if self.trajectories == 0 || self.trajectories > 100_000 {
            "`target.trajectories` must be 1 to 100000"
        } else if !(self.seconds > 0.0 && self.seconds <= 3600.0) {
            "`target.seconds` must be above 0 and at most 3600"
        } else if !(self.timeout_seconds > 0.0 && self.timeout_seconds.is_finite()) {
            "`target.timeout_seconds` must be above 0"
        } else if !(command || self.probe.is_empty() && self.collect.is_empty() && self.evaluate.is_empty()) {
            "`target.probe`, `target.collect` and `target.evaluate` are for kind = \"command\""
        } else if !(0.0 <= low && low <= high && high <= 10.0) {
            "`target.log_shift` takes two times from 0 to 10 s, the shorter first"
        } else if !simulated
            && (self.theta.is_some()
                || !(self.spring.is_empty() && self.parameter.is_empty() && self.number.is_empty())
                || self.torque_noise != 0.0
                || high != 0.0)
        {
            "`target.theta`, `spring`, `torque_noise`, `log_shift`, [[target.parameter]] and [[target.number]] are \
             for kind = \"simulated\"; any other robot has its own numbers"
        } else if !self.kind.is_robot() && self.has_link() {
            "`target.robot`, `interface`, `domain`, `pause`, `patience`, `yes` and `last_walk` are for kind = \"robot\""
        } else if self.kind.is_robot()
            && let Some(wrong) = self.wrong_link()
        {
            return Some(wrong);
        } else if command && self.collect.is_empty() {
            "`target.collect` names no program; give a list such as [\"python\", \"robot.py\", \"{onnx}\", \"{folder}\"]"
        } else {
            return None;
        };
        Some(wrong.to_owned())
    }
}

impl TargetConfig {
    /// Whether anything is set that only a robot has.
    fn has_link(&self) -> bool {
        !self.interface.is_empty()
            || self.robot != crate::robot::GO2
            || self.domain != 0
            || self.pause != pause()
            || self.patience != PATIENCE
            || self.yes
            || !self.last_walk
    }

    /// Names a fault of a robot's link or walks, in words.
    fn wrong_link(&self) -> Option<String> {
        let real = self.kind == TargetKind::Robot;
        // There is no pause after the last trajectory.
        let length = self.trajectories as f64 * (self.seconds + self.pause) - self.pause;
        let wrong = if real && self.interface.is_empty() {
            "`target.interface` is missing: the network interface to the robot, for example \"eth0\"; \"lo\" for a \
             simulator on this machine"
        } else if !(real || self.interface.is_empty() && self.domain == 0 && self.robot == crate::robot::GO2)
        {
            "`target.robot`, `target.interface` and `target.domain` are for kind = \"robot\""
        } else if self.domain > 232 {
            // DDS computes its ports from the domain, 7400 + 250 for each. Beyond 232 there is no such port.
            "`target.domain` must be 0 to 232; robots are in 0, simulators in 1"
        // Domain 0 is where real robots are, so nothing may make a run less careful there.
        } else if real && self.domain == 0 && self.yes {
            "`target.yes` is for simulators only, which are in another domain than 0: before a robot moves a person types a \
             word"
        } else if real && self.domain == 0 && self.patience != PATIENCE {
            "`target.patience` is for simulators only, which are in another domain than 0: a robot has 20 ms"
        } else if !(20..=1000).contains(&self.patience) {
            "`target.patience` must be 20 to 1000 ms"
        } else if !(0.5..=60.0).contains(&self.pause) {
            "`target.pause` must be 0.5 to 60 s"
        } else if self.seconds < 1.0 {
            "`target.seconds` must be at least 1 on a robot"
        } else if length > 3600.0 {
            "`target.trajectories` with their pauses take longer than an hour; take fewer or shorter ones"
        } else {
            return None;
        };
        Some(wrong.to_owned())
    }
}

/// Largest deviation of torques, N·m.
const MAX_TORQUE_NOISE: f64 = 1000.0;

/// Refuses a deviation of torques that cannot be, in words; `key` names the setting.
pub fn check_torque_noise(key: &str, noise: f64) -> Result<(), String> {
    if (0.0..=MAX_TORQUE_NOISE).contains(&noise) {
        return Ok(());
    }
    let option = if key == "torque_noise" { " (--torque-noise)" } else { "" };
    Err(format!("`{key}`{option} is {} and must be from 0 to {MAX_TORQUE_NOISE} N·m", shown_number(noise)))
}
