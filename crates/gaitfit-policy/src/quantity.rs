//! What a policy may observe: one table, from which files, layouts, exports and imports follow.
//!
//! A new quantity touches three files: its lines here (its row in the table, and what is sensed of a robot), where the
//! simulator has it ([`crate::walker::Walker::sense`]), and the same for GPUs (`observe.cu` of `gaitfit-cuda`).

use gaitfit_log::column_names::{BASE_RATES, COMMAND, PROJECTED_GRAVITY};
use serde::{Deserialize, Serialize};

use crate::{BaseSample, MotionPlace, frames};

/// How many numbers a quantity has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    /// As many for every robot.
    Numbers(usize),
    /// One for each joint of the policy.
    Joints,
}

/// Who knows a quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Sensors of every robot.
    Sensors,
    /// Who commands the robot, and the policy itself.
    Policy,
    /// A simulator. A robot does not measure it: it is for critics.
    Simulation,
}

/// The columns of a log that hold a quantity's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Columns {
    /// None: logs have it otherwise, or not at all.
    Absent,
    Named(&'static [&'static str]),
    /// One for each joint: this, then the joint's name.
    Joints(&'static str),
}

/// A quantity that follows from the base's motion. A log may lack it.
#[derive(Clone, Copy, Debug)]
pub struct OfBase {
    /// Spread about 0 on a robot that walks, in the quantity's unit: one for each number that does not follow from the others.
    pub spreads: &'static [f64],
    /// Its numbers; absent where the log lacks them.
    pub read: fn(&BaseSample) -> Option<[f64; 3]>,
    /// Puts its numbers into what is sensed.
    pub sense: fn(&mut Sensed, [f64; 3]),
}

macro_rules! quantities {
    ($($(#[doc = $doc:literal])+ $variant:ident $name:literal {
        width: $width:expr,
        source: $source:ident,
        write: $write:expr,
        isaac: [$($isaac:literal),+],
        columns: $columns:expr,
        cxx: $cxx:literal,
        base: $base:expr,
    })*) => {
        /// A quantity that a policy may observe.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
        pub enum Quantity {
            $($(#[doc = $doc])+ #[serde(rename = $name)] $variant,)*
        }

        impl Quantity {
            /// All.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)*];

            /// Its name in files.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)* }
            }

            /// What it is, in a sentence.
            pub fn doc(self) -> &'static str {
                match self { $(Self::$variant => concat!($($doc),+).trim_ascii(),)* }
            }

            /// How many numbers it has.
            pub const fn numbers(self) -> Width {
                match self { $(Self::$variant => $width,)* }
            }

            /// Who knows it.
            pub const fn source(self) -> Source {
                match self { $(Self::$variant => Source::$source,)* }
            }

            /// Its names as an observation term of Isaac Lab and its relatives. unitree_rl_lab's deployment has the first.
            pub const fn foreign(self) -> &'static [&'static str] {
                match self { $(Self::$variant => &[$($isaac),+],)* }
            }

            const fn columns(self) -> Columns {
                match self { $(Self::$variant => $columns,)* }
            }

            /// Its number `i` as a C++ expression, of `Sensed sensed` and the policy's own state.
            pub const fn cxx(self) -> &'static str {
                match self { $(Self::$variant => $cxx,)* }
            }

            /// How it follows from the base's motion; `None` if it does not.
            pub const fn base(self) -> Option<OfBase> {
                match self { $(Self::$variant => $base,)* }
            }

            /// Writes its present value, before noise and scale. `pose`: the joints' angles at action zero, rad.
            #[inline]
            pub(crate) fn write(self, sensed: &Sensed, pose: &[f32], out: &mut [f32]) {
                match self {
                    $(Self::$variant => {
                        let write: fn(&Sensed, &[f32], &mut [f32]) = $write;
                        write(sensed, pose, out);
                    })*
                }
            }
        }
    };
}

quantities! {
    /// Angular velocity of the base, rad/s, body frame; 3.
    BaseAngularVelocity "base_angular_velocity" {
        width: Width::Numbers(3),
        source: Sensors,
        write: |sensed, _, out| out.copy_from_slice(&sensed.base_angular_velocity),
        isaac: ["base_ang_vel"],
        columns: Columns::Named(&BASE_RATES),
        cxx: "sensed.base_angular_velocity[i]",
        base: Some(OfBase {
            spreads: &[0.6; 3],
            read: |base| base.angular_velocity,
            sense: |sensed, value| sensed.base_angular_velocity = value.map(|x| x as f32),
        }),
    }
    /// Unit vector of gravity in the body frame, (0, 0, −1) when upright; 3.
    ProjectedGravity "projected_gravity" {
        width: Width::Numbers(3),
        source: Sensors,
        write: |sensed, _, out| out.copy_from_slice(&sensed.projected_gravity),
        isaac: ["projected_gravity"],
        columns: Columns::Named(&PROJECTED_GRAVITY),
        cxx: "sensed.projected_gravity[i]",
        base: Some(OfBase {
            // The third number follows from its length.
            spreads: &[0.1; 2],
            read: |base| base.to_body([0.0, 0.0, -1.0]),
            sense: |sensed, value| sensed.projected_gravity = value.map(|x| x as f32),
        }),
    }
    /// Commanded velocity: forward and left (m/s), yaw rate (rad/s), in the base's heading frame; 3.
    Command "command" {
        width: Width::Numbers(3),
        source: Policy,
        write: |sensed, _, out| out.copy_from_slice(&sensed.command),
        isaac: ["velocity_commands", "command"],
        columns: Columns::Named(&COMMAND),
        cxx: "sensed.command[i]",
        base: None,
    }
    /// Joint position minus default pose, rad; one a joint.
    JointPosition "joint_position" {
        width: Width::Joints,
        source: Sensors,
        write: |sensed, pose, out| {
            out.copy_from_slice(&sensed.joint_position);
            out.iter_mut().zip(pose).for_each(|(value, home)| *value -= home);
        },
        isaac: ["joint_pos_rel", "joint_pos"],
        columns: Columns::Joints("q_"),
        cxx: "sensed.joint_position[i] - kDefaultPose[i]",
        base: None,
    }
    /// Joint velocity, rad/s; one a joint.
    JointVelocity "joint_velocity" {
        width: Width::Joints,
        source: Sensors,
        write: |sensed, _, out| out.copy_from_slice(&sensed.joint_velocity),
        isaac: ["joint_vel_rel", "joint_vel"],
        columns: Columns::Joints("dq_"),
        cxx: "sensed.joint_velocity[i]",
        base: None,
    }
    /// The policy's last output, before scaling; one a joint.
    LastAction "last_action" {
        width: Width::Joints,
        source: Policy,
        write: |sensed, _, out| out.copy_from_slice(&sensed.last_action),
        isaac: ["last_action", "actions"],
        columns: Columns::Absent,
        cxx: "action_[i]",
        base: None,
    }
    /// Linear velocity of the base, m/s, body frame; 3.
    BaseLinearVelocity "base_linear_velocity" {
        width: Width::Numbers(3),
        source: Simulation,
        write: |sensed, _, out| out.copy_from_slice(&sensed.base_linear_velocity),
        isaac: ["base_lin_vel"],
        columns: Columns::Absent,
        cxx: "sensed.base_linear_velocity[i]",
        base: Some(OfBase {
            spreads: &[0.6; 3],
            read: |base| base.to_body(base.linear_velocity?),
            sense: |sensed, value| sensed.base_linear_velocity = value.map(|x| x as f32),
        }),
    }
    /// Height of the base's origin above the ground under it, m; 1.
    BaseHeight "base_height" {
        width: Width::Numbers(1),
        source: Simulation,
        write: |sensed, _, out| out.fill(sensed.base_height),
        isaac: ["base_pos_z"],
        columns: Columns::Absent,
        cxx: "sensed.base_height",
        base: Some(OfBase {
            spreads: &[0.3],
            // Of flat ground at 0, as walks are recorded.
            read: |base| Some([base.position?[2], 0.0, 0.0]),
            sense: |sensed, value| sensed.base_height = value[0] as f32,
        }),
    }
    /// Sine and cosine of the gait clock; 2.
    GaitPhase "gait_phase" {
        width: Width::Numbers(2),
        source: Policy,
        write: |sensed, _, out| {
            let (sin, cos) = (std::f32::consts::TAU * sensed.clock).sin_cos();
            out.copy_from_slice(&[sin, cos]);
        },
        isaac: ["gait_phase"],
        columns: Columns::Absent,
        cxx: "i == 0 ? std::sin(clock) : std::cos(clock)",
        base: None,
    }
    /// Sine of the gait clock; 1. Scales of 1 and −1 make the clocks of the feet of a trot, a pace or a bound.
    GaitSine "gait_sine" {
        width: Width::Numbers(1),
        source: Policy,
        write: |sensed, _, out| out.fill((std::f32::consts::TAU * sensed.clock).sin()),
        isaac: ["clock_inputs"],
        columns: Columns::Absent,
        cxx: "std::sin(clock)",
        base: None,
    }
    /// The number 1, which the scale makes any other; 1. A setting that a policy observes and nobody changes.
    Constant "constant" {
        width: Width::Numbers(1),
        source: Policy,
        write: |_, _, out| out.fill(1.0),
        isaac: ["constant"],
        columns: Columns::Absent,
        cxx: "1.0f",
        base: None,
    }
    /// The policy's output before the last, before scaling; one a joint. Observed beside the last one.
    EarlierAction "earlier_action" {
        width: Width::Joints,
        source: Policy,
        // The layout takes it from the row before.
        write: |_, _, out| out.fill(0.0),
        isaac: ["last_last_action"],
        columns: Columns::Absent,
        cxx: "0.0f",
        base: None,
    }
    /// Joint position in the reference motion, rad, not relative to the pose; one a joint.
    ReferenceJointPosition "reference_joint_position" {
        width: Width::Joints,
        source: Policy,
        // The layout takes this and what follows from the motion.
        write: |_, _, out| out.fill(0.0),
        isaac: ["motion_joint_pos"],
        columns: Columns::Absent,
        cxx: "0.0f",
        base: None,
    }
    /// Joint velocity in the reference motion, rad/s; one a joint.
    ReferenceJointVelocity "reference_joint_velocity" {
        width: Width::Joints,
        source: Policy,
        write: |_, _, out| out.fill(0.0),
        isaac: ["motion_joint_vel"],
        columns: Columns::Absent,
        cxx: "0.0f",
        base: None,
    }
    /// Rotation from the robot's anchor to that of the reference motion: the first two columns of its matrix, row by row; 6.
    ReferenceOrientation "reference_orientation" {
        width: Width::Numbers(6),
        source: Sensors,
        write: |_, _, out| out.fill(0.0),
        isaac: ["motion_anchor_ori_b"],
        columns: Columns::Absent,
        cxx: "0.0f",
        base: None,
    }
    /// Share of the reference motion that is over, 0 to 1; 1.
    ReferencePhase "reference_phase" {
        width: Width::Numbers(1),
        source: Policy,
        write: |_, _, out| out.fill(0.0),
        isaac: ["motion_phase"],
        columns: Columns::Absent,
        cxx: "0.0f",
        base: None,
    }
}

impl Quantity {
    /// Numbers it takes for a robot of `joints` joints.
    pub fn width(self, joints: usize) -> usize {
        match self.numbers() {
            Width::Numbers(count) => count,
            Width::Joints => joints,
        }
    }

    /// The quantity of a term as Isaac Lab, mjlab and unitree_rl_lab name it in their velocity tasks.
    pub fn from_foreign(name: &str) -> Option<Self> {
        // Their gait clocks differ in period and start, and constants have no value here.
        let others = [Self::GaitPhase, Self::GaitSine, Self::Constant, Self::EarlierAction];
        let known =
            Self::ALL.iter().filter(|quantity| !others.contains(quantity) && !quantity.is_of_reference());
        known.copied().find(|quantity| quantity.foreign().contains(&name))
    }

    /// Whether it is read from the gait clock.
    pub fn is_of_clock(self) -> bool {
        matches!(self, Self::GaitPhase | Self::GaitSine)
    }

    /// Whether it is read from the motion that the policy follows.
    pub fn is_of_reference(self) -> bool {
        use Quantity::{
            ReferenceJointPosition, ReferenceJointVelocity, ReferenceOrientation, ReferencePhase,
        };
        matches!(
            self,
            ReferenceJointPosition | ReferenceJointVelocity | ReferenceOrientation | ReferencePhase
        )
    }

    /// The columns of a log that hold its numbers, for a policy of these joints; `None` if logs have it otherwise or not
    /// at all.
    pub fn log_columns(self, joints: &[String]) -> Option<Vec<String>> {
        match self.columns() {
            Columns::Absent => None,
            Columns::Named(names) => Some(names.iter().map(|&name| name.to_owned()).collect()),
            Columns::Joints(prefix) => Some(joints.iter().map(|joint| format!("{prefix}{joint}")).collect()),
        }
    }
}

/// What one robot senses at one moment: everything that an observation can be made of. Joints are in the policy's
/// order. Kept between calls, so that nothing is allocated for each row.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensed {
    /// Angular velocity of the base, rad/s, body frame.
    pub base_angular_velocity: [f32; 3],
    /// Direction of gravity, unit, body frame; (0, 0, −1) upright.
    pub projected_gravity: [f32; 3],
    /// Linear velocity of the base, m/s, body frame.
    pub base_linear_velocity: [f32; 3],
    /// Height of the base's origin above the ground under it, m.
    pub base_height: f32,
    /// Commanded velocity: forward, left (m/s), yaw rate (rad/s), heading frame.
    pub command: [f32; 3],
    /// Joint positions as the encoders report them, rad.
    pub joint_position: Vec<f32>,
    /// Joint velocities, rad/s.
    pub joint_velocity: Vec<f32>,
    /// The policy's last output, before scaling and clipping; see [`crate::observation::LastAction`].
    pub last_action: Vec<f32>,
    /// Phase of the gait clock, 0 to 1.
    pub clock: f32,
    /// Orientation of the base, wxyz.
    pub orientation: [f32; 4],
    /// Where the robot is in the motion that the policy follows.
    pub motion: MotionPlace,
}

impl Sensed {
    /// A level robot of `joints` joints at rest, all angles 0.
    pub fn new(joints: usize) -> Self {
        Self {
            base_angular_velocity: [0.0; 3],
            projected_gravity: [0.0, 0.0, -1.0],
            base_linear_velocity: [0.0; 3],
            base_height: 0.0,
            command: [0.0; 3],
            joint_position: vec![0.0; joints],
            joint_velocity: vec![0.0; joints],
            last_action: vec![0.0; joints],
            clock: 0.0,
            orientation: [1.0, 0.0, 0.0, 0.0],
            motion: MotionPlace::default(),
        }
    }

    /// Sets the numbers of a quantity that is read; false for one that is not, or of another number of numbers. Joint positions
    /// are the encoders'.
    pub fn set(&mut self, quantity: Quantity, numbers: &[f32]) -> bool {
        let height = std::slice::from_mut(&mut self.base_height);
        let into: &mut [f32] = match quantity {
            Quantity::BaseAngularVelocity => &mut self.base_angular_velocity,
            Quantity::ProjectedGravity => &mut self.projected_gravity,
            Quantity::BaseLinearVelocity => &mut self.base_linear_velocity,
            Quantity::BaseHeight => height,
            Quantity::Command => &mut self.command,
            Quantity::JointPosition => &mut self.joint_position,
            Quantity::JointVelocity => &mut self.joint_velocity,
            Quantity::LastAction => &mut self.last_action,
            _ => return false,
        };
        let fits = into.len() == numbers.len();
        if fits {
            into.copy_from_slice(numbers);
        }
        fits
    }

    /// Sets where gravity is for a base with this orientation, wxyz, unit.
    pub fn orient(&mut self, quaternion: [f32; 4]) {
        self.projected_gravity = frames::up(quaternion).map(|x| -x);
        self.orientation = quaternion;
    }
}
