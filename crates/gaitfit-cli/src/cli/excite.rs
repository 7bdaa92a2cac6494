//! Arguments of `excite`.

use clap::{Args, ValueEnum};
use gaitfit::excite::{ChirpSettings, CommandSettings};
use gaitfit_log::PerJoint;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// Length of a chirp's turn, and of a command sequence, s.
const CHIRP_SECONDS: f64 = 20.0;
const COMMAND_SECONDS: f64 = 4.0;

/// Arguments of `excite`.
#[derive(Debug, Args)]
pub struct Excite {
    /// Robot (.xml, .mjcf, .urdf); with --policy the configuration (.toml) of a fit of walking logs
    pub file: PathBuf,
    /// Folder for the files, made if it is absent; with --policy the file of commands (.csv)
    #[arg(long, value_name = "PATH")]
    pub out: PathBuf,
    /// Instead of a motion, choose velocity commands for this walking policy, so that its logs identify the fit's
    /// parameters as precisely as possible
    #[arg(long, value_name = "POLICY")]
    pub policy: Option<PathBuf>,
    /// With --policy: number of command sequences to choose
    #[arg(long, value_name = "N", default_value_t = 8, requires = "policy")]
    pub trajectories: usize,
    /// With --policy: number of random command sequences to choose from
    #[arg(long, value_name = "N", default_value_t = 128, requires = "policy", hide = true)]
    pub pool: usize,
    /// With --policy: largest velocity commands, as a multiple of the task's; sequences under which the policy falls in
    /// simulation are left out
    #[arg(long, value_name = "X", default_value_t = 1.0, requires = "policy", hide = true)]
    pub reach: f64,
    /// With --policy: parameters to identify, names or patterns, separated by commas [default: those that the
    /// configuration's logs do not identify; all if there are none]
    #[arg(long, value_name = "PATTERNS", value_delimiter = ',', requires = "policy")]
    pub parameters: Vec<String>,
    /// With --policy: values of the parameters, a theta.toml [default: the configuration's truth, or the search's
    /// start]
    #[arg(long, value_name = "FILE", requires = "policy")]
    pub theta: Option<PathBuf>,
    /// With --policy: standard deviation of Gaussian noise on the torque of every joint at every physics step, N·m
    #[arg(long, value_name = "NM", default_value_t = 1.0, requires = "policy", hide = true)]
    pub torque_noise: f64,
    /// With --policy: change one setting of the configuration (repeatable)
    #[arg(long = "set", value_name = "KEY=VALUE", requires = "policy", hide = true)]
    pub set: Vec<String>,
    /// Joints to move, names or patterns, separated by commas [default: all]
    #[arg(long, value_name = "PATTERNS", value_delimiter = ',', conflicts_with = "policy")]
    pub joints: Vec<String>,
    /// Which joints move at the same time; the groups move one after the other
    #[arg(long, value_enum, default_value_t = Turns::All, conflicts_with = "policy")]
    pub turns: Turns,
    /// Length of a turn, s [default: 20]; with --policy: length of a command sequence, s [default: 4]
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,
    /// First and last frequency of the chirp, Hz; the robot's limits may lower the last one
    #[arg(long, value_names = ["FROM", "TO"], num_args = 2, default_values_t = [0.1, 5.0], conflicts_with = "policy")]
    pub frequency: Vec<f64>,
    /// Amplitude, rad; the robot's limits may lower it
    #[arg(long, value_name = "RAD", default_value_t = 0.3, conflicts_with = "policy")]
    pub amplitude: f64,
    /// Rate of the position targets, Hz
    #[arg(long, value_name = "HZ", default_value_t = 200.0, conflicts_with = "policy", hide = true)]
    pub rate: f64,
    /// Time in which the amplitude rises at the start of a turn and falls at its end, s
    #[arg(long, value_name = "S", default_value_t = 1.0, conflicts_with = "policy", hide = true)]
    pub ease: f64,
    /// Position gains, N·m/rad: a number, or a table such as '{ "*" = 40, "*_hip" = 20 }' [default: the fit's, or those
    /// of `gaitfit init`]
    #[arg(long, value_name = "KP", requires = "kd", conflicts_with = "policy")]
    pub kp: Option<Gain>,
    /// Velocity gains, N·m·s/rad
    #[arg(long, value_name = "KD", requires = "kp", conflicts_with = "policy")]
    pub kd: Option<Gain>,
    /// Middle of a joint's motion, rad (repeatable) [default: the pose of `gaitfit init`, away from the ends of the
    /// ranges]
    #[arg(long, value_name = "JOINT=RAD", conflicts_with = "policy", hide = true)]
    pub pose: Vec<Angle>,
    /// Share of every limit that the motion leaves unused
    #[arg(long, value_name = "PART", default_value_t = 0.1, conflicts_with = "policy", hide = true)]
    pub margin: f64,
    /// Speed limit of all joints, rad/s; a lower limit of the robot file still holds [default: the file's, or 10]
    #[arg(long, value_name = "RAD_S", conflicts_with = "policy", hide = true)]
    pub velocity_limit: Option<f64>,
    /// Torque limit of all joints, N·m; a lower limit of the robot file still holds [default: the file's]
    #[arg(long, value_name = "NM", conflicts_with = "policy", hide = true)]
    pub torque_limit: Option<f64>,
    /// Configuration of a fit of legs in the air: the motion is tested with its gains, parameters and bounds [default:
    /// friction, armature, damping and delay]
    #[arg(long, value_name = "FILE.toml", conflicts_with = "policy")]
    pub fit: Option<PathBuf>,
    /// Expected difference between the joint angles of fitted simulator and log, relative to half of a joint's range
    #[arg(long, value_name = "X", default_value_t = 2e-3, conflicts_with = "policy", hide = true)]
    pub difference: f64,
    /// Leave out parts of the robot file that the engine cannot simulate, instead of refusing the file
    #[arg(long, conflicts_with = "policy")]
    pub lenient: bool,
    /// Overwrite files of the folder that you changed, such as a play.py with your code
    #[arg(long, conflicts_with = "policy")]
    pub force: bool,
    /// Random seed of the joints' phases and of the simulated robots
    #[arg(long, value_name = "N", default_value_t = 0, hide = true, value_parser = super::seed, allow_negative_numbers = true)]
    pub seed: u64,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
    /// Number of threads [default: one for each core]
    #[arg(long, value_name = "N", hide = true)]
    pub threads: Option<NonZeroUsize>,
}

impl Excite {
    /// Commands for `policy`, as the library takes them.
    pub fn commands(&self, policy: &Path) -> CommandSettings {
        CommandSettings {
            config: self.file.clone(),
            set: self.set.clone(),
            policy: policy.to_owned(),
            theta: self.theta.clone(),
            parameters: self.parameters.clone(),
            trajectories: self.trajectories,
            // One option with two defaults: a chirp needs time for its lowest frequency, a sequence of commands
            // does not.
            seconds: self.seconds.unwrap_or(COMMAND_SECONDS),
            pool: self.pool,
            reach: self.reach,
            torque_noise: self.torque_noise,
            seed: self.seed,
            threads: self.threads,
        }
    }

    /// A chirp, as the library takes it.
    pub fn chirp(&self) -> ChirpSettings {
        // clap asks for exactly two numbers. A missing one becomes NaN, which the library refuses, so nothing here
        // can panic.
        let end = |at: usize| self.frequency.get(at).copied().unwrap_or(f64::NAN);
        ChirpSettings {
            robot: self.file.clone(),
            lenient: self.lenient,
            fit: self.fit.clone(),
            joints: self.joints.clone(),
            turns: match self.turns {
                Turns::All => gaitfit::excite::Turns::All,
                Turns::Limbs => gaitfit::excite::Turns::Limbs,
                Turns::Joints => gaitfit::excite::Turns::Joints,
            },
            seconds: self.seconds.unwrap_or(CHIRP_SECONDS),
            frequency: [end(0), end(1)],
            amplitude: self.amplitude,
            rate: self.rate,
            ease: self.ease,
            kp: self.kp.clone().map(|gain| gain.0),
            kd: self.kd.clone().map(|gain| gain.0),
            pose: self.pose.iter().map(|one| (one.0.clone(), one.1)).collect(),
            margin: self.margin,
            velocity_limit: self.velocity_limit,
            torque_limit: self.torque_limit,
            difference: self.difference,
            seed: self.seed,
            threads: self.threads,
        }
    }
}

/// Which joints move at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Turns {
    /// All together
    All,
    /// One limb after another
    Limbs,
    /// One joint after another
    Joints,
}

/// Gains of the joints.
#[derive(Clone, Debug)]
pub struct Gain(pub PerJoint);

impl std::str::FromStr for Gain {
    type Err = String;

    /// A number, or a TOML table by joint pattern.
    fn from_str(text: &str) -> Result<Self, String> {
        #[derive(serde::Deserialize)]
        struct Holder {
            gain: PerJoint,
        }
        let gain =
            // A value of TOML is a number or an inline table, so one text reads both forms.
            toml::from_str::<Holder>(&format!("gain = {text}")).map(|holder| holder.gain).map_err(|_| {
                "give a number for all joints, or a table such as '{ \"*\" = 40, \"*_hip\" = 20 }'".to_owned()
            })?;
        // Written with `!` so that NaN is refused too: every comparison with NaN is false.
        match gain.values().iter().find(|value| !(value.is_finite() && **value >= 0.0)) {
            Some(wrong) => Err(format!("a gain is {wrong}; give numbers of at least 0")),
            None => Ok(Self(gain)),
        }
    }
}

/// An angle of joints, by name or pattern.
#[derive(Clone, Debug)]
pub struct Angle(pub String, pub f64);

impl std::str::FromStr for Angle {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        // The first `=` separates them, because an angle has none.
        let parts = text.split_once('=').map(|(joint, angle)| (joint.trim(), angle.trim().parse::<f64>()));
        match parts {
            Some((joint, Ok(angle))) if !joint.is_empty() => Ok(Self(joint.to_owned(), angle)),
            _ => Err("give JOINT=RAD, for example '*_calf=-1.8'".to_owned()),
        }
    }
}
