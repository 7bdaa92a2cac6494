//! Distance of two parts at given joint angles.

use super::SelfPair;
use crate::kinematics::Frame;
use crate::model::{Geom, Shape};
use crate::rotation::{Vec3, dot, rotate, rotate_back, sub};

impl SelfPair {
    /// Distance of the two surfaces, m; negative where the shapes overlap. `frames`: those of all bodies
    /// ([`crate::kinematics::body_frames`]).
    pub fn distance(&self, frames: &[Frame]) -> f64 {
        let [first, second] = &self.geoms;
        let place =
            |geom: &Geom| frames[geom.body].then(&Frame { position: geom.pos, quaternion: geom.quat });
        let [a, b] = [place(first), place(second)];
        match (first.shape, second.shape) {
            // A box touches spheres only, and a pair's geoms are sorted by type: the sphere comes first.
            (Shape::Sphere { radius }, Shape::Box { half_size }) => {
                from_box(rotate_back(b.quaternion, sub(a.position, b.position)), half_size) - radius
            }
            _ => between(rod(first, &a), rod(second, &b)) - thickness(first) - thickness(second),
        }
    }
}

/// Centre and half axis of a rod; of a ball the axis is zero.
fn rod(geom: &Geom, frame: &Frame) -> [Vec3; 2] {
    let half = match geom.shape {
        Shape::Capsule { half_length, .. } => half_length,
        _ => 0.0,
    };
    [frame.position, rotate(frame.quaternion, [0.0, 0.0, half])]
}

fn thickness(geom: &Geom) -> f64 {
    match geom.shape {
        Shape::Sphere { radius } | Shape::Capsule { radius, .. } | Shape::Cylinder { radius, .. } => radius,
        Shape::Box { .. } => 0.0,
    }
}

/// Distance of two line segments of centres and half axes (Ericson, Real-Time Collision Detection, 2005, 5.1.9).
fn between([a, along]: [Vec3; 2], [b, other]: [Vec3; 2]) -> f64 {
    let apart = sub(a, b);
    let (aa, bb, ab) = (dot(along, along), dot(other, other), dot(along, other));
    let (at, bt) = (dot(along, apart), dot(other, apart));
    // Parallel rods have many nearest points, and a ball has no length: the middle will do.
    let ratio = |top: f64, bottom: f64| if bottom > 0.0 { (top / bottom).clamp(-1.0, 1.0) } else { 0.0 };
    let first = ratio(ab * bt - bb * at, aa * bb - ab * ab);
    let second = ratio(ab * first + bt, bb);
    // The second place may have been clamped, so the first one is solved again for it.
    let first = ratio(ab * second - at, aa);
    let line: Vec3 = std::array::from_fn(|k| apart[k] + first * along[k] - second * other[k]);
    dot(line, line).sqrt()
}

/// Distance of a point from a box about the origin; negative inside.
fn from_box(point: Vec3, half: Vec3) -> f64 {
    let beyond: [f64; 3] = std::array::from_fn(|k| point[k].abs() - half[k]);
    let outside = beyond.map(|x| x.max(0.0));
    // Inside, all three are negative and the nearest face is the largest of them.
    dot(outside, outside).sqrt() + beyond.into_iter().fold(f64::MIN, f64::max).min(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_are_as_far_apart_as_their_nearest_points() {
        let along_x = |y: f64| [[0.0, y, 0.0], [1.0, 0.0, 0.0]];
        let along_y = |x: f64| [[x, 0.0, 0.5], [0.0, 1.0, 0.0]];
        for (a, b, expected) in [
            (along_x(0.0), along_x(0.3), 0.3),
            (along_x(0.0), along_y(0.2), 0.5),
            (along_x(0.0), along_y(1.4), 0.5_f64.hypot(0.4)),
            (along_x(2.0), along_y(1.4), 1.0_f64.hypot(0.4).hypot(0.5)),
            ([[0.0; 3]; 2], [[0.0, 0.0, 2.0], [0.0; 3]], 2.0),
            ([[0.2, 0.0, 0.7], [0.0; 3]], along_x(0.0), 0.7),
        ] {
            assert!((between(a, b) - expected).abs() < 1e-12, "{a:?} {b:?}: {}", between(a, b));
            assert!((between(b, a) - expected).abs() < 1e-12, "{b:?} {a:?}: {}", between(b, a));
        }
    }

    #[test]
    fn a_point_is_as_far_from_a_box_as_its_surface() {
        let half = [0.1, 0.2, 0.3];
        assert!((from_box([0.4, 0.6, 0.0], half) - 0.5).abs() < 1e-12);
        assert!((from_box([0.0, 0.15, 0.0], half) + 0.05).abs() < 1e-12);
    }
}
