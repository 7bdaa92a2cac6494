//! How an episode starts.

use gaitfit_model::rotation::{product, turn};
use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::Start;

use super::Task;
use super::command::within;

/// The start of an episode of `environment` that begins at `step` at `place` (x, y, m) of uneven ground.
pub(super) fn start(task: &Task, seed: u64, environment: u32, step: u32, place: [f64; 2]) -> Start {
    let settings = &task.settings.start;
    let stream = Stream::new(seed, Purpose::RESET).environment(environment).step(step);
    // Draws 0 to 7 are the base's, joint angles follow, then joint velocities.
    let either = |draw: u32, half: f64| within(stream, draw, [-half, half]);
    let yaw = either(0, settings.yaw.to_radians());
    let tilt = settings.tilt.to_radians();
    // About the world's axes: the roll first, then the pitch, then the turn about the vertical.
    let posture = product(turn(1, settings.pitch.to_radians() + either(1, tilt)), turn(0, either(2, tilt)));
    let quaternion = product(turn(2, yaw), posture);
    let joints = task.start_pose.len() as u32;
    let model = task.walker.model();
    let mut angles = Vec::with_capacity(task.start_pose.len());
    for (j, (&angle, joint)) in task.start_pose.iter().zip(&model.joints).enumerate() {
        let drawn = angle as f64 + either(8 + j as u32, settings.joint_position);
        // A start outside the range would begin with the push of a joint limit.
        angles.push(joint.range.map_or(drawn, |[low, high]| drawn.clamp(low, high)));
    }
    // Joints that follow others start where their leaders put them.
    model.couple(&mut angles);
    let mut velocities: Vec<f64> =
        (0..joints).map(|j| either(8 + joints + j, settings.joint_velocity)).collect();
    model.couple_velocities(&angles, &mut velocities);
    Start {
        // The feet stand on the ground, so the base gets no vertical velocity.
        base_linear: [
            either(3, settings.linear_velocity) as f32,
            either(4, settings.linear_velocity) as f32,
            0.0,
        ],
        base_angular: std::array::from_fn(|k| either(5 + k as u32, settings.angular_velocity) as f32),
        joint_velocity: velocities.iter().map(|&velocity| velocity as f32).collect(),
        ..task.walker.standing(place, quaternion, &angles)
    }
}
