//! Where a robot's bodies are at given joint angles.

use gaitfit_model::{Model, Shape};

/// Pose of a frame: position (m) and orientation (wxyz).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Position, m.
    pub position: [f64; 3],
    /// Orientation, wxyz, unit.
    pub quaternion: [f64; 4],
}

impl Frame {
    /// The world's own frame.
    pub const WORLD: Self = Self { position: [0.0; 3], quaternion: [1.0, 0.0, 0.0, 0.0] };

    /// The frame that has pose `inner` in this one.
    pub fn then(&self, inner: &Frame) -> Frame {
        Frame {
            position: add(self.position, rotate(self.quaternion, inner.position)),
            quaternion: product(self.quaternion, inner.quaternion),
        }
    }
}

/// Frames of all bodies for the root body at `base` and joint angles `q` (rad, model order): the same frame as
/// `base` is given in.
pub fn body_frames(model: &Model, base: &Frame, q: &[f64]) -> Vec<Frame> {
    let mut frames: Vec<Frame> = Vec::with_capacity(model.bodies.len());
    for (index, body) in model.bodies.iter().enumerate() {
        let mut frame = match body.parent {
            Some(parent) => frames[parent].then(&Frame { position: body.pos, quaternion: body.quat }),
            None => *base,
        };
        for (joint, &angle) in model.joints.iter().zip(q).filter(|(joint, _)| joint.body == index) {
            // A turn about the anchor: the anchor stays where it is.
            let turn = axis_angle(joint.axis, angle - joint.reference);
            let anchor = add(frame.position, rotate(frame.quaternion, joint.pos));
            frame.quaternion = product(frame.quaternion, turn);
            let arm = rotate(frame.quaternion, joint.pos);
            frame.position = std::array::from_fn(|k| anchor[k] - arm[k]);
        }
        frames.push(frame);
    }
    frames
}

/// Height of the base's origin above the ground at which the lowest contact sphere touches, m, for the base at
/// orientation `quaternion` and joint angles `q`.
pub fn standing_height(model: &Model, quaternion: [f64; 4], q: &[f64]) -> f64 {
    let frames = body_frames(model, &Frame { position: [0.0; 3], quaternion }, q);
    let mut lowest = f64::INFINITY;
    for pair in &model.pairs {
        let geom = &model.geoms[pair.geom];
        if let Shape::Sphere { radius } = geom.shape {
            let center = add(frames[geom.body].position, rotate(frames[geom.body].quaternion, geom.pos));
            lowest = lowest.min(center[2] - radius);
        }
    }
    let ground = model.planes.first().map_or(0.0, |plane| plane.pos[2]);
    if lowest.is_finite() { ground - lowest } else { ground }
}

fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] + b[k])
}

fn axis_angle(axis: [f64; 3], angle: f64) -> [f64; 4] {
    let (sin, cos) = (0.5 * angle).sin_cos();
    [cos, axis[0] * sin, axis[1] * sin, axis[2] * sin]
}

/// Product of two quaternions, wxyz: first `b`, then `a`.
pub fn product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

/// `v` turned by the unit quaternion `q` (wxyz).
pub fn rotate(q: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let u = [q[1], q[2], q[3]];
    let t = cross(u, v).map(|x| 2.0 * x);
    let w = cross(u, t);
    std::array::from_fn(|k| v[k] + q[0] * t[k] + w[k])
}
