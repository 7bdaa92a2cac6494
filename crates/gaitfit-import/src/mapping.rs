//! What the user says about files that do not say it themselves.

use crate::ImportError;
use gaitfit_log::{FindingKind, ImuSettings, PerJoint, TimeUnit};
use gaitfit_model::with_meant;
use serde::Deserialize;
use std::collections::BTreeMap;

/// Largest mapping file, bytes.
pub const MAX_MAPPING_BYTES: u64 = 1 << 20;

/// What an import may know beyond the files, as a TOML file says it. Everything is optional.
///
/// ```toml
/// joints = ["FR_hip", "FR_thigh", "FR_calf"]   # the order of numbered joints
/// unit = "deg"                                 # of hinges' positions, velocities and targets; default rad
/// rate_hz = 50                                 # where there is no time column
/// clock_offset_s = 0.003                       # added to the times of what holds no positions
/// kp = 20
/// kd = 0.5
///
/// [time]
/// column = "stamp"
/// unit = "milliseconds"
///
/// [columns]
/// position = "motor_{index}_angle"             # {index}: number from 0; {joint}: name; or the name of an array
/// velocity = ["w0", "w1", "w2"]                # or one name a joint
/// command = ["joy_x", "joy_y", "joy_yaw"]
///
/// [joint_names]
/// "VR1" = "FR_hip_joint"                       # the recording's name = the robot's
///
/// [streams]
/// take = ["/joint_states", "/joint_commands"]  # leave out all others
/// target = ["/joint_commands"]                 # their positions are targets
/// drop_zeros = true                            # zeros of a second publisher are left out
///
/// [imu]
/// frame = "world"                              # of the rates; order, unit, negated, mounting
/// ```
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Mapping {
    /// Names of numbered joints, number 0 first.
    pub joints: Option<Vec<String>>,
    /// The robot's names of joints that the recording calls otherwise: its name on the left.
    pub joint_names: BTreeMap<String, String>,
    /// Unit of joint positions, velocities and targets; `slides` are in m whatever it is.
    pub unit: AngleUnit,
    /// Unit of the IMU's angles and rates.
    pub imu_unit: AngleUnit,
    /// Sample rate, Hz, of files without times, or whose times lost their digits.
    pub rate_hz: Option<f64>,
    /// Take one row of so many, the first among them: of recordings that are longer or faster than a fit needs.
    pub every: Option<usize>,
    /// The robot's name.
    pub robot: Option<String>,
    /// Position gains while recording, N·m/rad; stronger than what files say.
    pub kp: Option<PerJoint>,
    /// Velocity gains while recording, N·m·s/rad; stronger than what files say.
    pub kd: Option<PerJoint>,
    /// Added to the times of every stream without positions, s, instead of what the recorder's clock suggests.
    pub clock_offset_s: Option<f64>,
    /// How the inertial unit's columns are to be read.
    pub imu: ImuSettings,
    /// Findings that do not keep a recording from being written as a log.
    pub allow: Vec<FindingKind>,
    /// What each number of a policy's observation is, where the caller knows the policy; absent for those that a log does
    /// not hold.
    #[serde(skip)]
    pub observation: Option<Vec<Option<ObservedNumber>>>,
    /// Whether the mapping itself states `joints`, and not the caller by its robot.
    #[serde(skip)]
    pub states_joints: bool,
    /// Joints of the robot that slide, whose positions are in m; absent if the caller knows no robot.
    #[serde(skip)]
    pub slides: Option<Vec<String>>,
    /// Sample rate, Hz, of files without times where nobody states one.
    #[serde(skip)]
    pub usual_rate_hz: Option<f64>,
    /// The time column.
    pub time: TimeColumn,
    /// Which columns are what.
    pub columns: ColumnNames,
    /// Which streams are what.
    pub streams: StreamNames,
    /// Topics that `gaitfit record` listens to, with their types; an import does not look at them.
    pub topics: BTreeMap<String, String>,
}

/// What a number of an observation is: number / scale + offset is the log's.
#[derive(Clone, Debug, PartialEq)]
pub struct ObservedNumber {
    /// The log's column, such as `q_FL_hip` or `wx`.
    pub column: String,
    /// The factor that the observation has; not 0.
    pub scale: f64,
    /// What was taken away before.
    pub offset: f64,
}

/// Unit of angles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
pub enum AngleUnit {
    /// rad, rad/s
    #[default]
    #[serde(rename = "rad")]
    Radians,
    /// °, °/s
    #[serde(rename = "deg")]
    Degrees,
}

impl AngleUnit {
    /// rad in one unit.
    pub(crate) fn radians(self) -> f64 {
        match self {
            AngleUnit::Radians => 1.0,
            AngleUnit::Degrees => 1f64.to_radians(),
        }
    }
}

/// The time column.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TimeColumn {
    /// Its name, where it is not one of the usual.
    pub column: Option<String>,
    /// Its unit, where neither name nor values tell: seconds, milliseconds, microseconds, nanoseconds.
    pub unit: Option<UnitName>,
}

/// Unit of a time column, by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UnitName {
    /// s
    #[serde(alias = "s")]
    Seconds,
    /// ms
    #[serde(alias = "ms")]
    Milliseconds,
    /// µs
    #[serde(alias = "us")]
    Microseconds,
    /// ns
    #[serde(alias = "ns")]
    Nanoseconds,
}

impl From<UnitName> for TimeUnit {
    fn from(name: UnitName) -> TimeUnit {
        match name {
            UnitName::Seconds => TimeUnit::Seconds,
            UnitName::Milliseconds => TimeUnit::Milliseconds,
            UnitName::Microseconds => TimeUnit::Microseconds,
            UnitName::Nanoseconds => TimeUnit::Nanoseconds,
        }
    }
}

/// Which columns are what.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ColumnNames {
    /// Joint positions.
    pub position: Option<Names>,
    /// Joint velocities.
    pub velocity: Option<Names>,
    /// Position targets.
    pub target: Option<Names>,
    /// Policy actions.
    pub action: Option<Names>,
    /// Commands: vx, vy, yaw rate.
    pub command: Option<Names>,
    /// Orientation of the base: w, x, y, z.
    pub quaternion: Option<Names>,
    /// Orientation of the base: roll, pitch, yaw.
    pub rpy: Option<Names>,
    /// Angular velocity of the base in its own frame: x, y, z.
    pub angular_velocity: Option<Names>,
}

/// Names of columns.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Names {
    /// A pattern with `{joint}` or `{index}`, or the name of an array.
    One(String),
    /// One name a joint or component.
    Each(Vec<String>),
}

/// Which streams (topics, files) are what.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StreamNames {
    /// If not empty, only these are read.
    pub take: Vec<String>,
    /// Their positions are targets.
    pub target: Vec<String>,
    /// Their positions are actions.
    pub action: Vec<String>,
    /// Rows whose positions are all exactly 0 are a second publisher's, and are left out.
    pub drop_zeros: bool,
}

impl Mapping {
    /// Reads a mapping's text.
    ///
    /// # Errors
    /// What is not TOML, and keys or values that a mapping does not have.
    pub fn parse(text: &str) -> Result<Mapping, ImportError> {
        let mut mapping: Mapping = toml::from_str(text)
            .map_err(|error| ImportError::Mapping { problem: in_a_line(&error, text) })?;
        mapping.states_joints = mapping.joints.is_some();
        let refuse = |problem: String| Err(ImportError::Mapping { problem });
        if let Some(rate) = mapping.rate_hz.filter(|rate| !(rate.is_finite() && *rate > 0.0)) {
            return refuse(format!("rate_hz is {rate}; give a positive number of samples a second"));
        }
        if mapping.every == Some(0) {
            return refuse("every is 0; give a number of rows of which one is taken, such as 10".into());
        }
        if let Some(offset) = mapping.clock_offset_s.filter(|offset| !offset.is_finite()) {
            return refuse(format!("clock_offset_s is {offset}; give seconds"));
        }
        if let Some(joints) = &mapping.joints {
            for (i, joint) in joints.iter().enumerate() {
                // A name that is there twice would make one column of two joints.
                if joint.is_empty() || joints[..i].contains(joint) {
                    return refuse(format!(
                        "joints: `{joint}` is empty or there twice; name each joint once"
                    ));
                }
            }
        }
        Ok(mapping)
    }
}

/// A TOML error's message with its line and column, without the picture of several lines.
fn in_a_line(error: &toml::de::Error, text: &str) -> String {
    let message = with_meant(error.message()).replace('\n', "; ");
    let Some(before) = error.span().and_then(|span| text.get(..span.start)) else { return message };
    let line = before.matches('\n').count() + 1;
    let column = before.chars().rev().take_while(|c| *c != '\n').count() + 1;
    format!("line {line}, column {column}: {message}")
}
