//! Robots of the link, one file each: joints and their motors, limits, gains, poses, messages and topics.

mod built_in;
mod file;
mod ros2;

use std::sync::Arc;
use std::time::Duration;

use gaitfit_policy::Interface;
use serde::Deserialize;

use crate::guard::{GuardSettings, Limits};
use crate::per_motor::{MAX_MOTORS, PerMotor};
use crate::supervisor::Postures;
use crate::{RobotError, unitree};

pub use built_in::BUILT_IN;
pub use ros2::{CommandPart, CommandType, Ros2};

/// A robot that can be walked over a link. `robots/*.toml` in this crate are the built-in ones, and examples for others.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Robot {
    /// Its name in logs, for example `go2`.
    pub name: String,
    /// Its name in messages, for example `Unitree Go2`.
    pub title: String,
    /// A policy's robot is this one if its name contains one of these, in small letters.
    pub policies: Vec<String>,
    /// The messages that it speaks.
    pub messages: Messages,
    /// Whether it must hang before and after the walk: nothing else holds a humanoid then.
    #[serde(default)]
    pub hangs: bool,
    /// Topic of its states; absent: [`Robot::state_topic`] says which.
    pub state_topic: Option<String>,
    /// Topic of its inertial unit, with [`Messages::Ros2`].
    pub imu_topic: Option<String>,
    /// Topic of the commands to it; absent: [`Robot::command_topic`] says which.
    pub command_topic: Option<String>,
    /// Type of its commands, with [`Messages::Ros2`].
    pub command_type: Option<CommandType>,
    /// Numbers of each joint in commands without names.
    pub command_order: Option<Vec<CommandPart>>,
    /// Limits that lead to damping.
    pub guard: Rules,
    /// Its motors, motor order.
    pub motors: Vec<Motor>,
}

/// A family of messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Messages {
    /// `unitree_go` `LowState_` and `LowCmd_`: 20 slots, battery in the state.
    UnitreeGo,
    /// `unitree_hg` `LowState_` and `LowCmd_`: 35 slots, no battery in the state.
    UnitreeHg,
    /// ROS 2's `sensor_msgs` `JointState` and `Imu`: joints by name, no battery and no temperatures.
    Ros2,
}

impl Messages {
    /// Whether robots of this kind have Unitree's motion service, which must release the motors.
    pub fn has_motion_service(self) -> bool {
        self != Self::Ros2
    }

    /// Whether messages have the buttons and sticks of the robot's remote.
    pub fn has_remote(self) -> bool {
        self != Self::Ros2
    }

    /// Whether messages have the motors' temperatures.
    pub fn has_temperatures(self) -> bool {
        self != Self::Ros2
    }

    /// Slots for motors; of messages with names, max motors.
    pub fn slots(self) -> usize {
        match self {
            Self::UnitreeGo => unitree::SLOTS,
            Self::UnitreeHg => unitree::hg::SLOTS,
            Self::Ros2 => MAX_MOTORS,
        }
    }
}

/// Limits that lead to damping, and gains that no command may exceed.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rules {
    /// Largest angle between the base's z axis and the world's, degrees.
    pub tilt: f32,
    /// Hottest motor, °C; absent where messages have no temperatures.
    pub temperature: Option<i16>,
    /// Least charge of the battery, %; absent where the state has no battery.
    pub charge: Option<u8>,
    /// Largest position gain, N·m/rad.
    pub kp: f32,
    /// Largest velocity gain, N·m·s/rad.
    pub kd: f32,
}

/// A motor and its joint.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motor {
    /// The joint's name, without `_joint`.
    pub joint: String,
    /// Other names of the joint, without `_joint`.
    #[serde(default)]
    pub aliases: Vec<String>,
    /// The joint's name in messages with names; absent: `joint`, also with `_joint`.
    pub topic_name: Option<String>,
    /// Its slot in the messages; absent: its place in the list.
    pub slot: Option<usize>,
    /// Least and largest angle, rad; absent for wheels.
    pub range: Option<[f32; 2]>,
    /// Largest speed, rad/s.
    pub speed: f32,
    /// Largest torque, N·m.
    pub torque: f32,
    /// Position gain of standing up and lying down, N·m/rad.
    pub kp: f32,
    /// Velocity gain of standing up and lying down, N·m·s/rad.
    pub kd: f32,
    /// Velocity gain of damping, N·m·s/rad.
    pub damping: f32,
    /// Angle at rest, before and after the walk, rad.
    pub lying: f32,
    /// Angle about which `preflight` moves it while the robot hangs, rad; absent: `lying`, at least 0.15 rad inside its range.
    pub hanging: Option<f32>,
    /// Angle at which it is kept with `kp` and `kd` if the policy does not move it, rad; absent: a policy must move it.
    pub held: Option<f32>,
}

/// How far a robot that hangs is kept from the stops of its joints, rad.
const STOPS: f32 = 0.15;

impl Motor {
    /// Whether this is a name of its joint, with or without `_joint`.
    fn moves(&self, joint: &str) -> bool {
        let name = joint.strip_suffix("_joint").unwrap_or(joint);
        self.joint == name || self.aliases.iter().any(|alias| alias == name)
    }

    /// Whether it may turn without end: it has no range and no position gain.
    pub fn is_wheel(&self) -> bool {
        self.range.is_none() && self.kp == 0.0
    }
}

impl Robot {
    /// Topic of its states.
    pub fn state_topic(&self) -> &str {
        let default = if self.messages == Messages::Ros2 { "/joint_states" } else { "rt/lowstate" };
        self.state_topic.as_deref().unwrap_or(default)
    }

    /// Topic of the commands to it.
    pub fn command_topic(&self) -> &str {
        let default = if self.messages == Messages::Ros2 { "/joint_commands" } else { "rt/lowcmd" };
        self.command_topic.as_deref().unwrap_or(default)
    }

    /// Joints, motor order.
    pub fn joints(&self) -> Arc<[String]> {
        self.motors.iter().map(|motor| motor.joint.clone()).collect()
    }

    /// A value of each motor.
    pub fn each<T: Copy + Default>(&self, value: impl Fn(&Motor) -> T) -> PerMotor<T> {
        PerMotor::from_fn(self.motors.len(), |motor| value(&self.motors[motor]))
    }

    /// For each motor, its slot in the messages.
    pub fn slots(&self) -> PerMotor<usize> {
        PerMotor::from_fn(self.motors.len(), |motor| self.motors[motor].slot.unwrap_or(motor))
    }

    /// Returns the limits of its motors and joints.
    pub fn limits(&self) -> Limits {
        let Rules { kp, kd, .. } = self.guard;
        Limits {
            lower: self.each(|motor| motor.range.map_or(f32::NEG_INFINITY, |[low, _]| low)),
            upper: self.each(|motor| motor.range.map_or(f32::INFINITY, |[_, high]| high)),
            speed: self.each(|motor| motor.speed),
            torque: self.each(|motor| motor.torque),
            kp,
            kd,
        }
    }

    /// Where the joints are about which it is moved while it hangs, rad.
    pub fn hanging(&self) -> PerMotor<f32> {
        self.each(|motor| match (motor.hanging, motor.range) {
            (Some(angle), _) => angle,
            (None, Some([low, high])) if high - low > 2.0 * STOPS => {
                motor.lying.clamp(low + STOPS, high - STOPS)
            }
            // In a range this narrow `clamp` would panic. The middle is furthest from both stops.
            (None, Some([low, high])) => 0.5 * (low + high),
            (None, None) => motor.lying,
        })
    }

    /// Returns the settings of the guard, under a policy that acts every `control_dt`.
    pub fn guard(&self, control_dt: Duration) -> GuardSettings {
        GuardSettings::new(self, control_dt)
    }

    /// For each of `joints`, its motor. A `_joint` suffix does not matter.
    ///
    /// # Errors
    /// A joint that the robot lacks, one that is named twice, or a motor that must be moved and is not.
    pub fn motors_of(&self, joints: &[String]) -> Result<Vec<usize>, RobotError> {
        let mut indices: Vec<usize> = Vec::with_capacity(self.motors.len());
        for joint in joints {
            let motor = self.motors.iter().position(|motor| motor.moves(joint));
            // Two names of one motor name it twice.
            match motor.filter(|motor| !indices.contains(motor)) {
                Some(motor) => indices.push(motor),
                None => {
                    return Err(RobotError::Joint {
                        joint: joint.clone(),
                        robot: self.title.clone(),
                        joints: self.joints().join(", "),
                    });
                }
            }
        }
        // A motor that nobody commands would be limp, so it needs an angle at which it is held.
        let mut motors = self.motors.iter().enumerate();
        match motors.find(|(motor, it)| it.held.is_none() && !indices.contains(motor)) {
            Some((_, motor)) => Err(RobotError::Joints {
                count: joints.len(),
                robot: self.title.clone(),
                motors: self.motors.len(),
                joint: motor.joint.clone(),
            }),
            None => Ok(indices),
        }
    }

    /// Its postures and gains under a policy. Motors that the policy does not move are kept where the policy's file, or else
    /// the robot's, says. If the policy states a larger gain for them than the guard allows, they get the guard's.
    ///
    /// # Errors
    /// A policy for other joints.
    pub fn postures(&self, interface: &Interface) -> Result<Postures, RobotError> {
        let motors = self.motors_of(&interface.joints)?;
        // First all motors as if they were held; the policy's own follow below.
        let mut postures = Postures {
            lying: self.each(|motor| motor.lying),
            standing: self.each(|motor| motor.held.unwrap_or(motor.lying)),
            stand_kp: self.each(|motor| motor.kp),
            stand_kd: self.each(|motor| motor.kd),
            kp: self.each(|motor| motor.kp),
            kd: self.each(|motor| motor.kd),
            damping: self.each(|motor| motor.damping),
            rolls: self.each(|_| false),
        };
        for (joint, &motor) in interface.joints.iter().zip(&motors) {
            postures.rolls[motor] = interface.velocity_joints.contains(joint);
        }
        let rows = [&interface.default_pose, &interface.kp, &interface.kd];
        let slots = [&mut postures.standing, &mut postures.kp, &mut postures.kd];
        for (slot, row) in slots.into_iter().zip(rows) {
            for (&motor, &value) in motors.iter().zip(row) {
                slot[motor] = value as f32;
            }
        }
        for held in &interface.held {
            // A joint that the policy moves has its pose already.
            let motor = self.motors.iter().position(|motor| motor.moves(&held.joint));
            if let Some(motor) = motor.filter(|motor| !motors.contains(motor)) {
                postures.standing[motor] = held.position as f32;
                // NaN stays NaN and is refused later.
                let within = |gain: f64, max: f32| if gain > f64::from(max) { max } else { gain as f32 };
                postures.kp[motor] = within(held.kp, self.guard.kp);
                postures.kd[motor] = within(held.kd, self.guard.kd);
            }
        }
        Ok(postures)
    }
}
