//! How an episode starts.

use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::Start;
use gaitfit_sim::kinematics::{product, standing_height};

use super::Scene;
use super::command::within;

/// Gap between the lowest foot and the ground, m.
const GAP: f64 = 0.002;

/// The start of an episode of `environment` that begins at `step`.
pub(super) fn start(scene: &Scene, seed: u64, environment: u32, step: u32) -> Start {
    let settings = &scene.settings.start;
    let stream = Stream::new(seed, Purpose::RESET).environment(environment).step(step);
    let either = |draw: u32, half: f64| within(stream, draw, [-half, half]);
    let yaw = either(0, std::f64::consts::PI);
    let tilt = settings.tilt.to_radians();
    let turn = |axis: usize, angle: f64| {
        let mut quaternion = [(0.5 * angle).cos(), 0.0, 0.0, 0.0];
        quaternion[1 + axis] = (0.5 * angle).sin();
        quaternion
    };
    let posture = product(turn(1, settings.pitch.to_radians() + either(1, tilt)), turn(0, either(2, tilt)));
    let quaternion = product(turn(2, yaw), posture);
    let joints = scene.start_pose.len() as u32;
    let model = scene.batch.model();
    let mut angles = Vec::with_capacity(scene.start_pose.len());
    for (j, (&angle, joint)) in scene.start_pose.iter().zip(&model.joints).enumerate() {
        let drawn = angle as f64 + either(8 + j as u32, settings.joint_position);
        angles.push(joint.range.map_or(drawn, |[low, high]| drawn.clamp(low, high)));
    }
    let height = standing_height(model, quaternion, &angles) + GAP;
    Start {
        base_position: [0.0, 0.0, height as f32],
        base_quaternion: quaternion.map(|x| x as f32),
        base_linear: [
            either(3, settings.linear_velocity) as f32,
            either(4, settings.linear_velocity) as f32,
            0.0,
        ],
        base_angular: std::array::from_fn(|k| either(5 + k as u32, settings.angular_velocity) as f32),
        joint_velocity: (0..joints).map(|j| either(8 + joints + j, settings.joint_velocity) as f32).collect(),
        joint_position: angles.into_iter().map(|x| x as f32).collect(),
    }
}
