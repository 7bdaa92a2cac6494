//! Where a robot's bodies are at given joint positions.

use crate::model::{Body, Geom, Model, Shape};
use crate::rotation::{IDENTITY, Quat, Vec3, add, product, rotate};

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
    pub fn new(body: &Body) -> Self {
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

/// Frames of all bodies for the root body at `base` and joint positions `q` (rad, of slides m; model order): the same
/// frame as `base` is given in.
pub fn body_frames(model: &Model, base: &Frame, q: &[f64]) -> Vec<Frame> {
    let mut frames: Vec<Frame> = Vec::with_capacity(model.bodies.len());
    for (index, body) in model.bodies.iter().enumerate() {
        // Depth first: a parent's frame is there before its children's.
        let mut frame = match body.parent {
            Some(parent) => frames[parent].then(&Frame::new(body)),
            None => *base,
        };
        // Several joints of one body act in list order, as in MuJoCo.
        for (joint, &position) in model.joints.iter().zip(q).filter(|(joint, _)| joint.body == index) {
            frame = joint.moved(&frame, position);
        }
        frames.push(frame);
    }
    frames
}

/// Frames of all bodies in the world as the file places them, every joint at its reference.
pub fn rest_frames(model: &Model) -> Vec<Frame> {
    let base = model.bodies.first().map_or(Frame::WORLD, Frame::new);
    let reference: Vec<f64> = model.joints.iter().map(|joint| joint.reference).collect();
    body_frames(model, &base, &reference)
}

/// How far a shape reaches from its centre: Σ |e·n| over its edges e, and `radius`, and `rim` times the sine of the angle
/// between n and `axis`, in direction n (unit). Vectors are in the frame of the geom's body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// Half edges of a box; half the axis of a capsule or a cylinder, m.
    pub edges: [Vec3; 3],
    /// Radius of spheres and capsules, m; 0 for other shapes.
    pub radius: f64,
    /// Radius of a cylinder, m; 0 for other shapes.
    pub rim: f64,
    /// Axis of the cylinder, unit.
    pub axis: Vec3,
}

impl Reach {
    /// The reach of a geom.
    pub fn new(geom: &Geom) -> Self {
        let along = |k: usize, length: f64| {
            let mut edge = [0.0; 3];
            edge[k] = length;
            rotate(geom.quat, edge)
        };
        let none = Self { edges: [[0.0; 3]; 3], radius: 0.0, rim: 0.0, axis: [0.0; 3] };
        match geom.shape {
            Shape::Sphere { radius } => Self { radius, ..none },
            Shape::Capsule { radius, half_length } => {
                Self { edges: [along(2, half_length), [0.0; 3], [0.0; 3]], radius, ..none }
            }
            Shape::Cylinder { radius, half_length } => Self {
                edges: [along(2, half_length), [0.0; 3], [0.0; 3]],
                rim: radius,
                axis: along(2, 1.0),
                ..none
            },
            Shape::Box { half_size: [x, y, z] } => {
                Self { edges: [along(0, x), along(1, y), along(2, z)], ..none }
            }
        }
    }

    /// Height of the centre above the lowest point, m, for the body at orientation `body` (wxyz).
    pub fn drop(&self, body: Quat) -> f64 {
        // These shapes are sums of segments, a disk and a ball, and so are their reaches in any direction.
        let rise = |edge: Vec3| rotate(body, edge)[2].abs();
        let edges = rise(self.edges[0]) + rise(self.edges[1]) + rise(self.edges[2]);
        let slope = rotate(body, self.axis)[2];
        // Rounding may bring the slope of an upright axis above 1.
        edges + self.rim * (1.0 - slope * slope).max(0.0).sqrt() + self.radius
    }
}

/// Height of a geom's lowest point, m, where its body has `frame`.
pub fn lowest_point(geom: &Geom, frame: &Frame) -> f64 {
    frame.point(geom.pos)[2] - Reach::new(geom).drop(frame.quaternion)
}

/// Height of the base's origin in the world at which the lowest geom touches the ground, m, for the base at orientation
/// `quaternion` and joint angles `q`.
pub fn standing_height(model: &Model, quaternion: Quat, q: &[f64]) -> f64 {
    // Of several planes the first one counts.
    let ground = model.planes.first().map_or(0.0, |plane| plane.pos[2]);
    ground + height_above_ground(model, quaternion, q)
}

/// As [`standing_height`], above the ground instead of in the world.
pub fn height_above_ground(model: &Model, quaternion: Quat, q: &[f64]) -> f64 {
    // With the base at height 0 the lowest point says how far the base must rise.
    let frames = body_frames(model, &Frame { position: [0.0; 3], quaternion }, q);
    let mut lowest = f64::INFINITY;
    for pair in &model.pairs {
        let geom = &model.geoms[pair.geom];
        lowest = lowest.min(lowest_point(geom, &frames[geom.body]));
    }
    // Without a pair nothing can touch, and the base's origin is put on the ground.
    if lowest.is_finite() { -lowest } else { 0.0 }
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

    #[test]
    fn a_robot_stands_on_the_lowest_point_of_any_shape() {
        let turned = |shape: &str| {
            let text = format!(
                r#"<mujoco><worldbody><geom type="plane" size="1 1 1"/>
                <body><freejoint/><geom {shape} euler="0 30 0"/></body></worldbody></mujoco>"#
            );
            let model = read_mjcf_str(&text, &ReadOptions::default()).unwrap();
            standing_height(&model, IDENTITY, &[])
        };
        let (sin, cos) = (0.5, 0.75f64.sqrt());
        for (shape, height) in [
            (r#"type="sphere" size=".1""#, 0.1),
            (r#"type="box" size=".3 .2 .1""#, 0.3 * sin + 0.1 * cos),
            (r#"type="capsule" size=".1 .3""#, 0.1 + 0.3 * cos),
            (r#"type="cylinder" size=".1 .3""#, 0.1 * sin + 0.3 * cos),
        ] {
            let found = turned(shape);
            assert!((found - height).abs() < 1e-12, "{shape}: {found}, not {height}");
        }
    }

    #[test]
    fn the_go2_stands_on_its_feet_whichever_shapes_count() {
        let model = crate::builtin::go2().unwrap();
        let spheres = Model {
            pairs: model
                .pairs
                .iter()
                .filter(|pair| matches!(model.geoms[pair.geom].shape, Shape::Sphere { .. }))
                .cloned()
                .collect(),
            ..model.clone()
        };
        // Poses around both built-in tasks': on four legs, and nose up.
        let upright = crate::rotation::turn(1, -90f64.to_radians());
        let poses = [(IDENTITY, [0.8, -1.5], [1.0, -1.5]), (upright, [1.2, -2.2], [2.35, -1.5])];
        for (quaternion, front, hind) in poses {
            for k in 0..400 {
                let shake = |j: usize| 0.2 * ((k * 12 + j) as f64 * 0.7391).sin();
                let mut q: Vec<f64> =
                    [front, front, hind, hind].iter().flat_map(|&[thigh, calf]| [0.0, thigh, calf]).collect();
                q.iter_mut().enumerate().for_each(|(j, angle)| *angle += shake(j));
                let all = standing_height(&model, quaternion, &q);
                assert_eq!(all.to_bits(), standing_height(&spheres, quaternion, &q).to_bits());
            }
        }
    }
}
