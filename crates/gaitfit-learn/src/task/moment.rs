//! One robot at the end of a control period: what rewards and falls are judged on.

use gaitfit_physics::Real;
use gaitfit_policy::frames::{dot, to_heading, up, uprightness};

use super::Task;
use super::feet::Foot;

/// Up to this norm (m/s, rad/s) a command means standing. legged_gym (Rudin et al. 2022) has the same
/// threshold for the horizontal velocity; here the yaw rate counts too, so that turning on the spot is
/// walking.
const STANDING: f64 = 0.1;

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

/// The numbers of a [`Moment`] that follow from the base's state and the command.
pub struct BaseMoment<R> {
    /// Velocity: forward, left, up, m/s, heading frame.
    pub velocity: [R; 3],
    /// Direction of gravity in the body frame, unit.
    pub gravity: [R; 3],
    /// Angular velocity about the vertical, rad/s.
    pub yaw_rate: R,
    /// Cosine of the angle between actual and wanted posture.
    pub uprightness: R,
    /// 1 if the command asks for movement, else 0.
    pub walking: R,
}

impl<R: Real> BaseMoment<R> {
    /// Values of a base of orientation `quaternion` (wxyz, unit) that moves at `linear` (m/s, world frame)
    /// and `angular` (rad/s, body frame) under `command`; `posture`: where gravity is wanted in the body
    /// frame. Kernels are written from this.
    pub fn new(
        quaternion: [R; 4],
        linear: [R; 3],
        angular: [R; 3],
        command: [R; 3],
        posture: [R; 3],
    ) -> Self {
        let up = up(quaternion);
        // Squares are compared, which spares a root.
        let standing = R::lit(STANDING) * R::lit(STANDING);
        Self {
            velocity: to_heading(quaternion, linear),
            gravity: up.map(|x| -x),
            yaw_rate: dot(up, angular),
            uprightness: uprightness(up, posture),
            walking: R::select_lt(standing, dot(command, command), R::lit(1.0), R::zero()),
        }
    }

    /// Errors against a command: of the horizontal velocity, m/s, and of the yaw rate, rad/s. Kernels are written from
    /// this.
    pub fn errors(velocity: [R; 3], yaw_rate: R, command: [R; 3]) -> [R; 2] {
        let (x, y) = (velocity[0] - command[0], velocity[1] - command[1]);
        [(x * x + y * y).sqrt(), (yaw_rate - command[2]).abs()]
    }
}
