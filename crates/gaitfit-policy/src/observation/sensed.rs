//! What one robot senses at one moment.

use gaitfit_model::rotation::up;

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
    /// Commanded velocity: forward, left (m/s), yaw rate (rad/s), heading frame.
    pub command: [f32; 3],
    /// Joint positions as the encoders report them, rad.
    pub joint_position: Vec<f32>,
    /// Joint velocities, rad/s.
    pub joint_velocity: Vec<f32>,
    /// The policy's last output, before scaling and clipping; see [`super::LastAction`].
    pub last_action: Vec<f32>,
    /// Phase of the gait clock, 0 to 1.
    pub clock: f32,
}

impl Sensed {
    /// A level robot of `joints` joints at rest, all angles 0.
    pub fn new(joints: usize) -> Self {
        Self {
            base_angular_velocity: [0.0; 3],
            projected_gravity: [0.0, 0.0, -1.0],
            base_linear_velocity: [0.0; 3],
            command: [0.0; 3],
            joint_position: vec![0.0; joints],
            joint_velocity: vec![0.0; joints],
            last_action: vec![0.0; joints],
            clock: 0.0,
        }
    }

    /// Sets where gravity is for a base with this orientation, wxyz, unit.
    pub fn orient(&mut self, quaternion: [f32; 4]) {
        self.projected_gravity = up(quaternion).map(|x| -x);
    }
}
