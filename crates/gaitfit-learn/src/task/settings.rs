//! The settings of a task; every one of them is in the configuration file.

use gaitfit_model::SelfContact;
use gaitfit_policy::walker::FallSettings;
use gaitfit_policy::{History, Quantity};
use indexmap::IndexMap;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};

use super::{JointNumber, TerrainSettings};

/// A number for each joint by pattern over joint names, for example `"*_hip_joint" = 0.1`, as
/// [`gaitfit_model::patterns`] says: a plain name goes before patterns, of several patterns the last one counts.
pub type JointTable = IndexMap<String, f64>;

/// A closed interval `[smallest, largest]`.
pub type Interval = [f64; 2];

/// What the robot is asked to do, how it starts and ends, what is randomised, and what it is paid for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TaskSettings {
    /// Longest episode, s.
    pub episode_seconds: f64,
    /// Time between actions, s.
    pub control_dt: f64,
    /// Physics steps between actions.
    pub substeps: usize,
    /// Physics step of the robot that the simulation stands for, s: forces that depend on velocity act half of it late.
    /// Absent: the simulation's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot_timestep: Option<f64>,
    /// The feet: names of geoms, or of bodies, whose geoms are one foot together.
    pub feet: Vec<String>,
    /// Feet that should move together in the gait, for example the diagonals of a trot; groups alternate.
    pub gait: Vec<Vec<String>>,
    /// Which of the robot's own parts touch each other; absent: none.
    #[serde(default, skip_serializing_if = "SelfContact::is_off")]
    pub self_contact: SelfContact,
    /// Direction of gravity in the body frame in the wanted posture, unit: (0, 0, −1) on four legs.
    pub posture: [f64; 3],
    /// Height of the base's origin above the ground that the rewards want, m.
    pub height: f64,
    /// Height of a foot's centre above the ground in mid-swing that the rewards want, m.
    pub swing_height: f64,
    /// Time a foot is off the ground in a step that the rewards want, s.
    pub swing_seconds: f64,
    /// Width of the velocity tracking reward, exp(−error²/width²), m/s.
    pub tracking_width: f64,
    /// The same of the yaw rate, rad/s.
    #[serde(default = "half")]
    pub yaw_tracking_width: f64,
    /// The policy's interface.
    pub policy: PolicySettings,
    /// Commands.
    pub command: CommandSettings,
    /// When an episode ends as a fall.
    pub fall: FallSettings,
    /// How an episode starts.
    pub start: StartSettings,
    /// Half range of the uniform noise on the actor's observation.
    pub noise: NoiseSettings,
    /// What differs between the robots.
    pub randomisation: RandomisationSettings,
    /// Pushes.
    pub push: PushSettings,
    /// Reward terms of one's own by name: expressions, as [`crate::task::expression`] says; their weights are in `rewards`.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub terms: IndexMap<String, String>,
    /// Uneven ground in the place of the robot file's planes; absent: the robot file's ground.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub terrain: Option<TerrainSettings>,
    /// Weight of each reward term; a step pays the weight times the term times `control_dt`.
    pub rewards: IndexMap<String, f64>,
}

/// How a new policy sees and moves the robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicySettings {
    /// The actor's observation, part by part.
    pub observation: Vec<gaitfit_policy::Term>,
    /// The critic's observation, part by part.
    pub critic_observation: Vec<gaitfit_policy::Term>,
    /// Patterns over the joints that the policy moves; all of them if there is none. The others are held in the default
    /// pose by their gains.
    #[serde(default, skip_serializing_if = "Vec::is_empty", deserialize_with = "some_patterns")]
    pub joints: Vec<String>,
    /// Names or patterns of joints with velocity targets, rad/s, such as wheels: torque = kd (target − velocity). Their kp and
    /// their pose are 0, and the policy does not observe their positions.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub velocity_joints: Vec<String>,
    /// How past frames lie in a row, where terms have a history.
    #[serde(default, skip_serializing_if = "is_usual")]
    pub history: History,
    /// Pose at action zero, rad; 0 where no pattern matches.
    pub default_pose: JointTable,
    /// Target change per unit action, rad; rad/s for `velocity_joints`.
    pub action_scale: JointNumber,
    /// Largest action magnitude, before scaling; absent: not limited.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub action_clip: Option<JointNumber>,
    /// Position gain, N·m/rad.
    pub kp: JointNumber,
    /// Velocity gain, N·m·s/rad.
    pub kd: JointNumber,
    /// Frequency of the gait clock, Hz, for policies that observe it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gait_frequency: Option<f64>,
}

/// A list that has something: an empty one would be taken for all joints.
fn some_patterns<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<String>, D::Error> {
    let patterns = Vec::<String>::deserialize(deserializer)?;
    if patterns.is_empty() {
        return Err(D::Error::custom(
            "`joints` is empty, and a policy moves some joints; leave it out for all of them",
        ));
    }
    Ok(patterns)
}

/// Whether policies' files need not say how past frames lie.
fn is_usual(history: &History) -> bool {
    *history == History::default()
}

/// Velocity commands in the heading frame, drawn uniformly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandSettings {
    /// Forward, m/s.
    pub x: Interval,
    /// To the left, m/s.
    pub y: Interval,
    /// Yaw rate, rad/s.
    pub yaw: Interval,
    /// Time until the next command, s.
    pub seconds: f64,
    /// Share of commands that are zero.
    pub standing: f64,
    /// How the ranges grow in a training; without it they are the same from the start.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub curriculum: Option<CurriculumSettings>,
}

/// Commands of a training that begin in smaller ranges and grow to those of [`CommandSettings`]. One of `tracking` and
/// `iterations` says when.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurriculumSettings {
    /// Forward at first, m/s; without it the final range.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub x: Option<Interval>,
    /// To the left at first, m/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub y: Option<Interval>,
    /// Yaw rate at first, rad/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub yaw: Option<Interval>,
    /// Ranges grow by a step when the tracking rewards pass this share of their greatest value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracking: Option<f64>,
    /// Such a step, as a share of the way from the first ranges to the final ones.
    #[serde(default = "tenth")]
    pub step: f64,
    /// Ranges grow evenly over this many iterations.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub iterations: Option<u32>,
}

impl CommandSettings {
    /// The ranges at a share of the way from a curriculum's first to the final ones: forward, left, yaw rate.
    pub fn ranges(&self, level: f64) -> [Interval; 3] {
        let last = [self.x, self.y, self.yaw];
        // At the end of the way the final ranges themselves, without the rounding of an interpolation.
        let Some(curriculum) = self.curriculum.as_ref().filter(|_| level < 1.0) else { return last };
        let first = [curriculum.x, curriculum.y, curriculum.yaw];
        std::array::from_fn(|k| {
            // A direction without a first range has its final one from the start.
            let first = first[k].unwrap_or(last[k]);
            std::array::from_fn(|end| first[end] + level * (last[k][end] - first[end]))
        })
    }
}

fn tenth() -> f64 {
    0.1
}

/// How an episode starts: at rest in a pose, plus uniform deviations.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StartSettings {
    /// Joint angles, rad; the default pose where no pattern matches. Joints that follow others start where their leaders
    /// put them.
    pub pose: JointTable,
    /// Pitch of the base, degrees; −90 is nose up.
    pub pitch: f64,
    /// Half range of the heading, degrees.
    #[serde(default = "any_heading")]
    pub yaw: f64,
    /// Half range of joint angles about the pose, rad.
    pub joint_position: f64,
    /// Half range of joint velocities, rad/s.
    pub joint_velocity: f64,
    /// Half range of the base's linear velocity along x and y, m/s.
    pub linear_velocity: f64,
    /// Half range of the base's angular velocity, rad/s.
    pub angular_velocity: f64,
    /// Half range of roll and pitch about the start's orientation, degrees.
    pub tilt: f64,
}

fn half() -> f64 {
    0.5
}

fn any_heading() -> f64 {
    180.0
}

/// Half range of the uniform noise on each quantity of the actor's observation, in its unit, before scaling; quantities
/// that are not named have none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct NoiseSettings {
    /// By quantity.
    pub half_ranges: IndexMap<Quantity, f64>,
}

impl NoiseSettings {
    /// Half the range of the uniform noise on `quantity`, in its unit; 0 for what has none.
    pub fn half_range(&self, quantity: Quantity) -> f32 {
        self.half_ranges.get(&quantity).copied().unwrap_or_default() as f32
    }

    /// Sets the half range of the noise on `quantity`.
    pub fn set(&mut self, quantity: Quantity, half_range: f64) {
        self.half_ranges.insert(quantity, half_range);
    }
}

/// What differs between the robots, drawn uniformly once a robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RandomisationSettings {
    /// Mass added to the base, kg.
    pub base_mass: Interval,
    /// Shift of the base's centre of mass along each axis: half range, m.
    pub base_com: f64,
    /// Factor on all position gains.
    pub kp: Interval,
    /// Factor on all velocity gains.
    pub kd: Interval,
    /// Factor on the friction between feet and ground.
    pub floor_friction: Interval,
    /// Dry friction torque of the joints, N·m.
    pub frictionloss: Interval,
    /// Reflected rotor inertia of the joints, kg·m².
    pub armature: Interval,
    /// Delay from a target to the motors, added to the robot's own, s.
    #[serde(default, skip_serializing_if = "is_none")]
    pub delay: Interval,
}

/// Whether an interval of something added adds nothing: then policies' files do not name it.
fn is_none(interval: &Interval) -> bool {
    *interval == [0.0; 2]
}

/// Pushes: the base's velocity jumps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PushSettings {
    /// Time between pushes, s; 0 is never.
    pub seconds: f64,
    /// Half range of the jump along x and y, m/s.
    pub velocity: f64,
}

impl TaskSettings {
    /// As [`Self::calm`], but with the smallest rotor inertia of the training. Gains of a file without rotors would shake light
    /// links otherwise. For robots whose rotors nobody fitted.
    pub fn nominal(&self) -> Self {
        let mut nominal = self.calm();
        nominal.randomisation.armature = [self.randomisation.armature[0].max(0.0); 2];
        nominal
    }

    /// The task as it is evaluated: the nominal robot without noise, pushes and velocities at the start, on the robot file's
    /// ground. Commands and other deviations of the start stay.
    pub fn calm(&self) -> Self {
        let mut calm = self.clone();
        calm.noise.half_ranges.values_mut().for_each(|half_range| *half_range = 0.0);
        // All fields are named, so that a new one cannot be left on by mistake.
        calm.randomisation = RandomisationSettings {
            base_mass: [0.0; 2],
            base_com: 0.0,
            kp: [1.0; 2],
            kd: [1.0; 2],
            floor_friction: [1.0; 2],
            frictionloss: [0.0; 2],
            armature: [0.0; 2],
            delay: [0.0; 2],
        };
        calm.push = PushSettings { seconds: 0.0, velocity: 0.0 };
        calm.start = StartSettings {
            joint_velocity: 0.0,
            linear_velocity: 0.0,
            angular_velocity: 0.0,
            ..self.start.clone()
        };
        // Evaluations tell no share of the robots to stand.
        calm.command.standing = 0.0;
        calm.terrain = None;
        calm
    }
}
