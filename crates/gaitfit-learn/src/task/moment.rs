//! One robot at the end of a control period: what rewards and falls are judged on.

use super::Task;
use super::feet::Foot;

/// One robot at the end of a control period. Joint vectors are in the model's order, actions in the policy's.
pub struct Moment<'a> {
    /// The task.
    pub task: &'a Task,
    /// Commanded velocity: forward, left (m/s), yaw rate (rad/s).
    pub command: [f32; 3],
    /// Whether the command asks for movement.
    pub walking: bool,
    /// Velocity of the base: forward, left, up, m/s, heading frame.
    pub velocity: [f32; 3],
    /// Angular velocity of the base, rad/s, body frame.
    pub angular_velocity: [f32; 3],
    /// Angular velocity about the vertical, rad/s.
    pub yaw_rate: f32,
    /// Direction of gravity in the body frame, unit.
    pub gravity: [f32; 3],
    /// Cosine of the angle between actual and wanted posture.
    pub uprightness: f32,
    /// Height of the base's origin above the ground under it, m.
    pub height: f32,
    /// Joint positions, rad.
    pub joint_position: &'a [f32],
    /// Joint velocities, rad/s.
    pub joint_velocity: &'a [f32],
    /// Joint accelerations, rad/s².
    pub joint_acceleration: &'a [f32],
    /// Motor torques, N·m.
    pub torque: &'a [f32],
    /// Position targets of this period, rad.
    pub target: &'a [f32],
    /// The action of this period.
    pub action: &'a [f32],
    /// The action before.
    pub last_action: &'a [f32],
    /// The feet, as the task lists them.
    pub feet: &'a [Foot],
    /// Geoms on the ground that are neither feet nor a fall.
    pub body_contacts: usize,
    /// Phase of the gait clock, 0 to 1; 0 without one.
    pub clock: f32,
    /// Whether the robot fell in this period.
    pub fallen: bool,
}
