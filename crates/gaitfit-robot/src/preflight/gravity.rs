//! Weight and inertia that a joint carries, by the robot's file.

use gaitfit_model::GRAVITY;
use gaitfit_model::Model;
use gaitfit_model::kinematics::{Frame, body_frames};
use gaitfit_model::rotation::{IDENTITY, Vec3, dot, inverse, product, rotate};

/// Step of the central difference, rad.
const STEP: f64 = 1e-4;

/// Load of a joint at one pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Load {
    /// Torque that holds it, N·m; of a slide force, N.
    pub(super) torque: f64,
    /// Change of this torque with the joint's position, N·m/rad or N/m.
    pub(super) slope: f64,
    /// Inertia about the joint's axis without the rotor's, kg·m²; of a slide mass, kg.
    pub(super) inertia: f64,
}

/// Computes the load of joint `joint` of `model` at angles `q` (rad, model order); `up`: against gravity, base frame.
pub(super) fn load(model: &Model, joint: usize, q: &[f64], up: Vec3) -> Load {
    let at = |by: f64| {
        let mut q = q.to_vec();
        q[joint] += by;
        about(model, joint, &q, up)
    };
    // With 1e-4 rad a central difference is off by about 1e-8 of the torque from curvature and 1e-12 from
    // rounding.
    let ([low, _], [high, _]) = (at(-STEP), at(STEP));
    let [torque, inertia] = at(0.0);
    Load { torque, slope: (high - low) / (2.0 * STEP), inertia }
}

/// Holding torque and inertia about a joint's axis.
fn about(model: &Model, joint: usize, q: &[f64], up: Vec3) -> [f64; 2] {
    let base = Frame { position: [0.0; 3], quaternion: IDENTITY };
    let frames = body_frames(model, &base, q);
    let body = model.joints[joint].body;
    let axis = model.joints[joint].axis_at(&frames[body]);
    let mut sums = [0.0; 2];
    // Only bodies beyond the joint load it.
    for (index, part) in model.bodies.iter().enumerate() {
        if !carries(model, body, index) {
            continue;
        }
        let lever = axis.lever(frames[index].point(part.ipos));
        sums[0] += part.mass * GRAVITY * dot(up, lever);
        // The joint's axis in the frame in which the body's inertia is diagonal.
        let principal = rotate(inverse(product(frames[index].quaternion, part.iquat)), axis.turn());
        let inertia: f64 = principal.iter().zip(&part.inertia).map(|(a, i)| a * a * i).sum();
        // The parallel-axis theorem.
        sums[1] += part.mass * dot(lever, lever) + inertia;
    }
    sums
}

/// Whether `body` hangs on `root` or is it.
fn carries(model: &Model, root: usize, body: usize) -> bool {
    let mut at = Some(body);
    while let Some(index) = at {
        if index == root {
            return true;
        }
        at = model.bodies[index].parent;
    }
    false
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_model::{ReadOptions, read_mjcf_str};

    #[test]
    fn a_pendulum_is_held_by_its_weight_times_its_lever() {
        let text = r#"<mujoco><worldbody><body name="base" pos="0 0 1"><freejoint/>
            <inertial pos="0 0 0" mass="5" diaginertia="1 1 1"/>
            <body name="leg"><joint name="knee" axis="0 1 0"/>
            <inertial pos="0 0 -0.3" mass="2" diaginertia="0.01 0.02 0.03"/></body></body></worldbody></mujoco>"#;
        let model = read_mjcf_str(text, &ReadOptions::default()).unwrap();
        let load = load(&model, 0, &[0.5], [0.0, 0.0, 1.0]);
        let (weight, lever) = (2.0 * 9.81, 0.3);
        assert!((load.torque - weight * lever * 0.5f64.sin()).abs() < 1e-9, "{load:?}");
        assert!((load.slope - weight * lever * 0.5f64.cos()).abs() < 1e-5, "{load:?}");
        assert!((load.inertia - (0.02 + 2.0 * 0.09)).abs() < 1e-9, "{load:?}");
    }
}
