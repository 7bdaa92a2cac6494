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
    /// Height of the base's origin, m.
    pub height: f32,
    /// Joint positions, rad.
    pub joint_position: &'a [f32],
    /// Joint velocities, rad/s.
    pub joint_velocity: &'a [f32],
    /// Joint accelerations, rad/s².
    pub joint_acceleration: &'a [f32],
    /// Motor torques, N·m.
    pub torque: &'a [f32],
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

/// Velocity (world frame) in the heading frame: forward, left, up. The heading is square to the body's left
/// axis, which stays level on four legs and on two.
///
/// `quaternion`: orientation of the body, wxyz.
pub fn heading_velocity(quaternion: &[f32], world: &[f32]) -> [f32; 3] {
    let left = left_axis(quaternion);
    let length = (left[0] * left[0] + left[1] * left[1]).sqrt().max(1e-6);
    let (lx, ly) = (left[0] / length, left[1] / length);
    [ly * world[0] - lx * world[1], lx * world[0] + ly * world[1], world[2]]
}

/// The body's y axis in the world.
fn left_axis(q: &[f32]) -> [f32; 3] {
    let (w, x, y, z) = (q[0], q[1], q[2], q[3]);
    [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)]
}

/// The world's z axis in the body frame.
pub(super) fn up_axis(q: &[f32]) -> [f32; 3] {
    let (w, x, y, z) = (q[0], q[1], q[2], q[3]);
    [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaitfit_sim::kinematics::{product, rotate};

    fn turn(axis: [f64; 3], angle: f64) -> [f64; 4] {
        let (s, c) = (0.5 * angle).sin_cos();
        [c, axis[0] * s, axis[1] * s, axis[2] * s]
    }

    #[test]
    fn headings_agree_on_four_legs_and_on_two() {
        let yaw = turn([0.0, 0.0, 1.0], 0.7);
        let reared = product(yaw, turn([0.0, 1.0, 0.0], -std::f64::consts::FRAC_PI_2));
        let world = rotate(yaw, [0.3, -0.2, 0.1]);
        for q in [yaw, reared] {
            let got = heading_velocity(&q.map(|x| x as f32), &world.map(|x| x as f32));
            for (got, want) in got.into_iter().zip([0.3, -0.2, 0.1]) {
                assert!((got - want).abs() < 1e-6);
            }
        }
    }
}
