//! Where a robot's bodies are at given joint angles.

use crate::model::{Body, Model, Shape};
use crate::rotation::{IDENTITY, Quat, Vec3, add, axis_angle, product, rotate, sub};

/// Pose of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Position, m.
    pub position: Vec3,
    /// Orientation, wxyz, unit.
    pub quaternion: Quat,
}

impl Frame {
    /// The world's own frame.
    pub const WORLD: Self = Self { position: [0.0; 3], quaternion: IDENTITY };

    /// The pose that the file gives a body: in its parent, of the root in the world.
    pub fn of(body: &Body) -> Self {
        Self { position: body.pos, quaternion: body.quat }
    }

    /// The frame that has pose `inner` in this one.
    pub fn then(&self, inner: &Frame) -> Frame {
        Frame { position: self.point(inner.position), quaternion: product(self.quaternion, inner.quaternion) }
    }

    /// A point of this frame (m), seen from where the frame's pose is given.
    pub fn point(&self, inner: Vec3) -> Vec3 {
        add(self.position, rotate(self.quaternion, inner))
    }
}

/// Frames of all bodies for the root body at `base` and joint angles `q` (rad, model order): the same frame as
/// `base` is given in.
pub fn body_frames(model: &Model, base: &Frame, q: &[f64]) -> Vec<Frame> {
    let mut frames: Vec<Frame> = Vec::with_capacity(model.bodies.len());
    for (index, body) in model.bodies.iter().enumerate() {
        let mut frame = match body.parent {
            Some(parent) => frames[parent].then(&Frame::of(body)),
            None => *base,
        };
        for (joint, &angle) in model.joints.iter().zip(q).filter(|(joint, _)| joint.body == index) {
            // A turn about the anchor: the anchor stays where it is.
            let anchor = frame.point(joint.pos);
            frame.quaternion = product(frame.quaternion, axis_angle(joint.axis, angle - joint.reference));
            frame.position = sub(anchor, rotate(frame.quaternion, joint.pos));
        }
        frames.push(frame);
    }
    frames
}

/// Frames of all bodies in the world as the file places them, every joint at its reference.
pub fn rest_frames(model: &Model) -> Vec<Frame> {
    let base = model.bodies.first().map_or(Frame::WORLD, Frame::of);
    let reference: Vec<f64> = model.joints.iter().map(|joint| joint.reference).collect();
    body_frames(model, &base, &reference)
}

/// Height of the base's origin above the ground at which the lowest contact sphere touches, m, for the base at
/// orientation `quaternion` and joint angles `q`.
pub fn standing_height(model: &Model, quaternion: Quat, q: &[f64]) -> f64 {
    let frames = body_frames(model, &Frame { position: [0.0; 3], quaternion }, q);
    let mut lowest = f64::INFINITY;
    for pair in &model.pairs {
        let geom = &model.geoms[pair.geom];
        if let Shape::Sphere { radius } = geom.shape {
            lowest = lowest.min(frames[geom.body].point(geom.pos)[2] - radius);
        }
    }
    let ground = model.planes.first().map_or(0.0, |plane| plane.pos[2]);
    if lowest.is_finite() { ground - lowest } else { ground }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::{ReadOptions, read_mjcf_str};

    /// A crank: a hinge about y, whose anchor lies 0.1 m above the body's origin, and a ball at the far end.
    const CRANK: &str = r#"<mujoco><compiler angle="radian"/><worldbody>
        <geom type="plane" pos="0 0 0.5" size="1 1 1"/>
        <body pos="0 0 3"><freejoint/><geom type="box" size=".1 .1 .1"/>
          <body pos="0.2 0 0"><joint pos="0 0 0.1" axis="0 1 0" ref="0.3"/><geom size="0.05" pos="1 0 0.1"/></body>
        </body></worldbody></mujoco>"#;

    #[test]
    fn a_hinge_turns_about_its_anchor() {
        let model = read_mjcf_str(CRANK, &ReadOptions::default()).unwrap();
        let frames = rest_frames(&model);
        let near = |found: Vec3, wanted: Vec3| {
            assert!(
                found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-15),
                "{found:?}, not {wanted:?}"
            );
        };
        near(frames[1].position, [0.2, 0.0, 3.0]);
        // A quarter turn about y takes x to -z.
        let quarter = 0.3 + std::f64::consts::FRAC_PI_2;
        let frames = body_frames(&model, &Frame::WORLD, &[quarter]);
        near(frames[1].point([0.0, 0.0, 0.1]), [0.2, 0.0, 0.1]);
        near(frames[1].point([1.0, 0.0, 0.1]), [0.2, 0.0, -0.9]);
        // The ball touches the plane at z = 0.5 when its centre is 0.05 m higher.
        let height = standing_height(&model, IDENTITY, &[quarter]);
        assert!((height - (0.5 + 0.05 + 0.9)).abs() < 1e-15, "{height}");
    }
}
