//! How an episode starts.

use gaitfit_model::Model;
use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::Start;
use gaitfit_sim::kinematics::{product, standing_height};

use super::Scene;
use super::command::within;

/// Gap between the lowest foot and the ground, m.
const GAP: f64 = 0.002;

/// At rest in a posture (wxyz, `angles` in rad, model order), feet just above the ground.
fn standing(model: &Model, quaternion: [f64; 4], angles: &[f64]) -> Start {
    Start {
        base_position: [0.0, 0.0, (standing_height(model, quaternion, angles) + GAP) as f32],
        base_quaternion: quaternion.map(|x| x as f32),
        base_linear: [0.0; 3],
        base_angular: [0.0; 3],
        joint_position: angles.iter().map(|&x| x as f32).collect(),
        joint_velocity: vec![0.0; angles.len()],
    }
}

/// The start that a robot's joint sensors suggest: what they say (rad, rad/s, model order), the base in the task's
/// start posture, at rest.
pub fn start_from_joints(scene: &Scene, angles: &[f64], velocities: &[f64]) -> Start {
    let posture = turn(1, scene.settings.start.pitch.to_radians());
    Start {
        joint_velocity: velocities.iter().map(|&x| x as f32).collect(),
        ..standing(scene.batch.model(), posture, angles)
    }
}

/// A turn about x, y or z (0, 1, 2), rad.
fn turn(axis: usize, angle: f64) -> [f64; 4] {
    let mut quaternion = [(0.5 * angle).cos(), 0.0, 0.0, 0.0];
    quaternion[1 + axis] = (0.5 * angle).sin();
    quaternion
}

/// The start of an episode of `environment` that begins at `step`.
pub(super) fn start(scene: &Scene, seed: u64, environment: u32, step: u32) -> Start {
    let settings = &scene.settings.start;
    let stream = Stream::new(seed, Purpose::RESET).environment(environment).step(step);
    let either = |draw: u32, half: f64| within(stream, draw, [-half, half]);
    let yaw = either(0, settings.yaw.to_radians());
    let tilt = settings.tilt.to_radians();
    let posture = product(turn(1, settings.pitch.to_radians() + either(1, tilt)), turn(0, either(2, tilt)));
    let quaternion = product(turn(2, yaw), posture);
    let joints = scene.start_pose.len() as u32;
    let model = scene.batch.model();
    let mut angles = Vec::with_capacity(scene.start_pose.len());
    for (j, (&angle, joint)) in scene.start_pose.iter().zip(&model.joints).enumerate() {
        let drawn = angle as f64 + either(8 + j as u32, settings.joint_position);
        angles.push(joint.range.map_or(drawn, |[low, high]| drawn.clamp(low, high)));
    }
    Start {
        base_linear: [
            either(3, settings.linear_velocity) as f32,
            either(4, settings.linear_velocity) as f32,
            0.0,
        ],
        base_angular: std::array::from_fn(|k| either(5 + k as u32, settings.angular_velocity) as f32),
        joint_velocity: (0..joints).map(|j| either(8 + joints + j, settings.joint_velocity) as f32).collect(),
        ..standing(model, quaternion, &angles)
    }
}
