//! Where a robot starts.

use gaitfit_model::Model;
use gaitfit_model::kinematics::standing_height;
use gaitfit_model::rotation::turn;
use gaitfit_sim::Start;

use super::Walker;

/// Gap between the lowest foot and the ground, m.
const GAP: f64 = 0.002;

/// At rest in a posture (orientation of the base, wxyz, and `angles`, rad, model order), feet just above the ground.
pub fn standing(model: &Model, quaternion: [f64; 4], angles: &[f64]) -> Start {
    Start {
        base_position: [0.0, 0.0, (standing_height(model, quaternion, angles) + GAP) as f32],
        base_quaternion: quaternion.map(|x| x as f32),
        base_linear: [0.0; 3],
        base_angular: [0.0; 3],
        joint_position: angles.iter().map(|&x| x as f32).collect(),
        joint_velocity: vec![0.0; angles.len()],
    }
}

impl Walker {
    /// The start that a robot's joint sensors suggest: what they say (rad, rad/s, model order), the base in the start's
    /// posture, at rest.
    pub fn start_from_joints(&self, angles: &[f64], velocities: &[f64]) -> Start {
        let posture = turn(1, self.start_pitch.to_radians());
        Start {
            joint_velocity: velocities.iter().map(|&x| x as f32).collect(),
            ..standing(self.model(), posture, angles)
        }
    }
}
