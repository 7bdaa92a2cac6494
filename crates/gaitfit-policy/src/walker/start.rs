//! Where a robot starts.

use gaitfit_model::kinematics::{Frame, Reach, body_frames, standing_height};
use gaitfit_model::rotation::turn;
use gaitfit_model::{Model, Shape, Surface};
use gaitfit_sim::Start;

use super::Walker;

/// Gap between the lowest foot and the ground, m, so that no foot begins in the ground, which would push it
/// out.
pub const GAP: f64 = 0.002;

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

/// As [`standing`], at `place` (x and y of the base's origin, m) on uneven ground: no geom is in it.
pub fn standing_on(
    model: &Model,
    ground: &Surface,
    place: [f64; 2],
    quaternion: [f64; 4],
    angles: &[f64],
) -> Start {
    let base = Frame { position: [place[0], place[1], 0.0], quaternion };
    let frames = body_frames(model, &base, angles);
    // The base is raised until each geom is above the highest ground within its reach.
    let mut height = f64::NEG_INFINITY;
    for geom in model.pairs.iter().map(|pair| &model.geoms[pair.geom]) {
        let frame = &frames[geom.body];
        let reach = Reach::new(geom);
        // Both ends of a capsule touch, the others' reach is as wide as it is high.
        let (ends, radius) = match geom.shape {
            Shape::Sphere { radius } => (vec![[0.0; 3]], radius),
            Shape::Capsule { radius, .. } => (vec![reach.edges[0], reach.edges[0].map(|x| -x)], radius),
            _ => (vec![[0.0; 3]], reach.drop(frame.quaternion)),
        };
        for end in ends {
            let [x, y, z] = frame.point(std::array::from_fn(|k| geom.pos[k] + end[k]));
            height = height.max(ground.highest_about(x, y, radius) + radius - z);
        }
    }
    // Without a geom that may touch the ground the base itself lies on it.
    let height = if height.is_finite() { height } else { ground.height(place[0], place[1]) };
    let flat = standing(model, quaternion, angles);
    Start { base_position: [place[0] as f32, place[1] as f32, (height + GAP) as f32], ..flat }
}

impl Walker {
    /// The start that a robot's joint sensors suggest: what they say (rad, rad/s, model order), the base in the start's
    /// posture, at rest.
    pub fn start_from_joints(&self, angles: &[f64], velocities: &[f64]) -> Start {
        // Joint sensors show nothing of the base's pitch, so it is the one in which the robot starts a task.
        let posture = turn(1, self.start_pitch.to_radians());
        let joint_velocity = velocities.iter().map(|&x| x as f32).collect();
        Start { joint_velocity, ..self.standing([0.0; 2], posture, angles) }
    }

    /// At rest at `place` (x and y of the base's origin, m) in a posture (orientation of the base, wxyz, and `angles`, rad,
    /// model order), just above the ground. Flat ground is everywhere the same, and the start at its origin.
    pub fn standing(&self, place: [f64; 2], quaternion: [f64; 4], angles: &[f64]) -> Start {
        match self.ground() {
            Some(ground) => standing_on(self.model(), ground, place, quaternion, angles),
            None => standing(self.model(), quaternion, angles),
        }
    }
}
