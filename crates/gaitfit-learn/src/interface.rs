//! What a policy sees and what its outputs mean: the contract between a network, a robot and a simulator.

use serde::{Deserialize, Serialize};

/// A quantity that a policy may observe.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Angular velocity of the base, rad/s, body frame; 3.
    BaseAngularVelocity,
    /// Unit vector of gravity in the body frame, (0, 0, −1) when upright; 3.
    ProjectedGravity,
    /// Commanded velocity: forward and left (m/s), yaw rate (rad/s), in the base's heading frame; 3.
    Command,
    /// Joint position minus default pose, rad; one a joint.
    JointPosition,
    /// Joint velocity, rad/s; one a joint.
    JointVelocity,
    /// The policy's last output, before scaling; one a joint.
    LastAction,
    /// Linear velocity of the base, m/s, body frame; 3. A robot does not measure it: for critics.
    BaseLinearVelocity,
    /// Sine and cosine of the gait clock; 2.
    GaitPhase,
}

impl Quantity {
    /// Numbers it takes for a robot of `joints` joints.
    pub fn width(self, joints: usize) -> usize {
        match self {
            Self::JointPosition | Self::JointVelocity | Self::LastAction => joints,
            Self::GaitPhase => 2,
            _ => 3,
        }
    }

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::BaseAngularVelocity => "base_angular_velocity",
            Self::ProjectedGravity => "projected_gravity",
            Self::Command => "command",
            Self::JointPosition => "joint_position",
            Self::JointVelocity => "joint_velocity",
            Self::LastAction => "last_action",
            Self::BaseLinearVelocity => "base_linear_velocity",
            Self::GaitPhase => "gait_phase",
        }
    }
}

/// One part of an observation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Term {
    /// What is observed.
    pub quantity: Quantity,
    /// Factor on it: one number for all its elements, or one an element; none means 1.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub scale: Vec<f32>,
}

/// What a policy sees and what its outputs mean. Per-joint vectors are in the order of `joints`.
///
/// target = default_pose + action_scale · clamp(action, ± action_clip), held for `control_dt` by the PD controller
/// torque = kp (target − q) − kd q̇.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Interface {
    /// Name of the robot model.
    pub robot: String,
    /// Joint names, in the policy's order.
    pub joints: Vec<String>,
    /// Pose at action zero, rad.
    pub default_pose: Vec<f64>,
    /// Target change per unit action, rad.
    pub action_scale: Vec<f64>,
    /// Largest action magnitude, before scaling; none is unbounded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub action_clip: Option<f64>,
    /// Position gain, N·m/rad.
    pub kp: Vec<f64>,
    /// Velocity gain, N·m·s/rad.
    pub kd: Vec<f64>,
    /// Time between actions, s.
    pub control_dt: f64,
    /// Frequency of the gait clock, Hz; needed where [`Quantity::GaitPhase`] is observed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gait_frequency: Option<f64>,
    /// The actor's observation, part by part.
    pub observation: Vec<Term>,
    /// The critic's observation, part by part; empty for policies without a critic.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub critic_observation: Vec<Term>,
}

/// An interface that contradicts itself, a network or a robot.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct InterfaceError(pub String);

impl Interface {
    /// Numbers in the actor's observation.
    pub fn observation_width(&self) -> usize {
        width(&self.observation, self.joints.len())
    }

    /// Numbers in the critic's observation.
    pub fn critic_width(&self) -> usize {
        width(&self.critic_observation, self.joints.len())
    }
}

fn width(terms: &[Term], joints: usize) -> usize {
    terms.iter().map(|term| term.quantity.width(joints)).sum()
}
