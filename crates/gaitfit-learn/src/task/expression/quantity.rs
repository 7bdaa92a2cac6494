//! What expressions may name.

use gaitfit_model::patterns::{Pattern, PatternError};
use gaitfit_policy::walker::Walker;

use super::operator::flag;
use crate::task::{Foot, Moment, Task, TaskSettings};

/// Names of the elements of rows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Names<'a> {
    /// The robot's joints, in its order.
    pub joints: Vec<&'a str>,
    /// Those of `joints` whose targets are velocities, by place: their angles are not part of a pose.
    pub velocity_joints: Vec<usize>,
    /// The policy's joints, in its order.
    pub actions: Vec<&'a str>,
    /// The feet, as the task lists them.
    pub feet: Vec<&'a str>,
}

impl<'a> Names<'a> {
    /// Names of a task's robot.
    pub fn new(settings: &'a TaskSettings, walker: &'a Walker) -> Self {
        Self {
            joints: walker.model().joints.iter().map(|joint| joint.name.as_str()).collect(),
            velocity_joints: walker.model().velocity_targets.clone(),
            actions: walker.interface.joints.iter().map(String::as_str).collect(),
            feet: settings.feet.iter().map(String::as_str).collect(),
        }
    }
}

/// Parts of the robot that the numbers of a quantity belong to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Elements {
    /// It is a single number.
    None,
    /// Axes `x`, `y`, `z`.
    Axes,
    /// Directions of a command: `x`, `y`, `yaw`.
    Directions,
    /// Joints of the robot.
    Joints,
    /// Joints of the policy.
    Actions,
    /// Feet.
    Feet,
}

impl Elements {
    /// The elements' names; a single number has no names.
    pub fn names<'a>(self, names: &Names<'a>) -> Vec<&'a str> {
        match self {
            Self::None => Vec::new(),
            Self::Axes => vec!["x", "y", "z"],
            Self::Directions => vec!["x", "y", "yaw"],
            Self::Joints => names.joints.clone(),
            Self::Actions => names.actions.clone(),
            Self::Feet => names.feet.clone(),
        }
    }
}

impl Quantity {
    /// Places of the quantity's numbers where an expression picks none. Angles are those of joints with position
    /// targets: wheels turn without end.
    pub(super) fn places(self, names: &Names<'_>) -> Vec<usize> {
        let angles = matches!(self, Self::Qpos | Self::DefaultPose | Self::Target);
        let count = match self.elements() {
            Elements::None => 1,
            elements => elements.names(names).len(),
        };
        (0..count).filter(|place| !(angles && names.velocity_joints.contains(place))).collect()
    }
}

/// Places of the `names` that a pattern covers. A pattern is a glob, as for joints, or a whole name.
pub(super) fn covered(pattern: &str, names: &[&str]) -> Result<Vec<usize>, PatternError> {
    let glob = Pattern::new(pattern)?;
    // A name may contain characters that are special in a pattern, so equal text also counts.
    Ok((0..names.len()).filter(|&k| names[k] == pattern || glob.covers(names[k])).collect())
}

macro_rules! quantities {
    (
        task { $($(#[doc = $task_doc:literal])+ $task:ident $task_name:literal $task_elements:ident = $setting:expr;)* }
        moment { $($(#[doc = $doc:literal])+ $variant:ident $name:literal $elements:ident = $value:expr;)* }
    ) => {
        /// A quantity of a robot's moment, or of its task.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum Quantity { $($(#[doc = $doc])+ $variant,)* $($(#[doc = $task_doc])+ $task,)* }

        impl Quantity {
            /// All: first those of a moment, then those of a task.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)* $(Self::$task,)*];

            /// Its name in expressions. The kernels have a function `quantity_NAME` for each that changes from step to
            /// step.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)* $(Self::$task => $task_name,)* }
            }

            /// What its numbers are of.
            pub fn elements(self) -> Elements {
                match self { $(Self::$variant => Elements::$elements,)* $(Self::$task => Elements::$task_elements,)* }
            }

            /// Number `place` of a quantity that is the same for all robots and times; `None` for others.
            pub fn constant(self, task: &Task, place: usize) -> Option<f32> {
                match self {
                    $(Self::$task => {
                        let value: fn(&Task, usize) -> f32 = $setting;
                        Some(value(task, place))
                    })*
                    _ => None,
                }
            }

            /// Writes number `place` of each moment into the first places of `lane`; NaN for moments without this
            /// number.
            pub(super) fn load(self, moments: &[Moment<'_>], place: usize, lane: &mut [f32]) {
                match self {
                    $(Self::$variant => {
                        let value: fn(&Moment<'_>, usize) -> f32 = $value;
                        lane.iter_mut().zip(moments).for_each(|(slot, moment)| *slot = value(moment, place));
                    })*
                    _ => {
                        // Quantities of the task are the same for all robots: one number fills the lane.
                        let value = moments.first().and_then(|moment| self.constant(moment.task, place));
                        lane.fill(value.unwrap_or(f32::NAN));
                    }
                }
            }
        }
    };
}

fn at(row: &[f32], place: usize) -> f32 {
    row.get(place).copied().unwrap_or(f32::NAN)
}

fn foot(moment: &Moment<'_>, place: usize, value: fn(&Foot) -> f32) -> f32 {
    moment.feet.get(place).map_or(f32::NAN, value)
}

quantities! {
    task {
        /// Joint positions of the default pose, rad.
        DefaultPose "default_pose" Joints = |task, k| at(&task.walker.default_pose, k);
        /// Number of the gait group of a foot, from 0; −1 for feet outside the gait.
        GaitGroup "gait_group" Feet = |task, k| task.gait_group.get(k).map_or(f32::NAN, |group| {
            group.map_or(-1.0, |group| group as f32)
        });
        /// Width of the tracking reward of the velocity, m/s.
        TrackingWidth "tracking_width" None = |task, _| task.settings.tracking_width as f32;
        /// Width of the tracking reward of the yaw rate, rad/s.
        YawTrackingWidth "yaw_tracking_width" None = |task, _| task.settings.yaw_tracking_width as f32;
        /// Wanted height of the base's origin, m: the task's `height`.
        WantedHeight "wanted_height" None = |task, _| task.settings.height as f32;
        /// Wanted height of a foot's centre in mid-swing, m.
        SwingHeight "swing_height" None = |task, _| task.settings.swing_height as f32;
        /// Wanted time of a foot in the air, s.
        SwingSeconds "swing_seconds" None = |task, _| task.settings.swing_seconds as f32;
        /// Time between actions, s.
        Dt "dt" None = |task, _| task.walker.interface.control_dt as f32;
    }
    moment {
        /// Commanded velocity: forward, left, m/s; yaw rate, rad/s.
        Command "command" Directions = |m, k| at(&m.command, k);
        /// Velocity of the base: forward, left, up, m/s, heading frame.
        Velocity "velocity" Axes = |m, k| at(&m.velocity, k);
        /// Angular velocity of the base, rad/s, body frame.
        AngularVelocity "angular_velocity" Axes = |m, k| at(&m.angular_velocity, k);
        /// Angular velocity about the vertical, rad/s.
        YawRate "yaw_rate" None = |m, _| m.yaw_rate;
        /// Direction of gravity in the body frame, unit.
        Gravity "gravity" Axes = |m, k| at(&m.gravity, k);
        /// Cosine of the angle between actual and wanted posture.
        Uprightness "uprightness" None = |m, _| m.uprightness;
        /// Height of the base's origin, m.
        Height "height" None = |m, _| m.height;
        /// Joint positions, rad.
        Qpos "qpos" Joints = |m, k| at(m.joint_position, k);
        /// Joint velocities, rad/s.
        Qvel "qvel" Joints = |m, k| at(m.joint_velocity, k);
        /// Joint accelerations, rad/s².
        Qacc "qacc" Joints = |m, k| at(m.joint_acceleration, k);
        /// Motor torques, N·m.
        Tau "tau" Joints = |m, k| at(m.torque, k);
        /// Position targets of this period, rad.
        Target "target" Joints = |m, k| at(m.target, k);
        /// The action of this period.
        Action "action" Actions = |m, k| at(m.action, k);
        /// The action before.
        LastAction "last_action" Actions = |m, k| at(m.last_action, k);
        /// 1 for feet on the ground, else 0.
        Contact "contact" Feet = |m, k| foot(m, k, |foot| flag(foot.touching));
        /// 1 for feet that came down in this period, else 0.
        Landed "landed" Feet = |m, k| foot(m, k, |foot| flag(foot.landed));
        /// Height of a foot's centre, m.
        FootHeight "foot_height" Feet = |m, k| foot(m, k, |foot| foot.height);
        /// Horizontal speed of a foot, m/s.
        FootSpeed "foot_speed" Feet = |m, k| foot(m, k, |foot| foot.speed);
        /// Time since a foot left the ground, s; 0 on the ground.
        AirTime "air_time" Feet = |m, k| foot(m, k, |foot| foot.air);
        /// Time since a foot met the ground, s; 0 in the air.
        ContactTime "contact_time" Feet = |m, k| foot(m, k, |foot| foot.contact);
        /// Length of a foot's last flight, s.
        LastAirTime "last_air_time" Feet = |m, k| foot(m, k, |foot| foot.last_air);
        /// Geoms on the ground that are neither feet nor a fall.
        BodyContacts "body_contacts" None = |m, _| m.body_contacts as f32;
        /// 1 if the command asks for movement, else 0.
        Walking "walking" None = |m, _| flag(m.walking);
        /// 1 in the period of a fall, else 0.
        Fallen "fallen" None = |m, _| flag(m.fallen);
        /// Phase of the gait clock, 0 to 1; 0 without one.
        Clock "clock" None = |m, _| m.clock;
    }
}
