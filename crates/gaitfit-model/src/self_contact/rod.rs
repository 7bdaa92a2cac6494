//! Rods in place of boxes and cylinders.
//!
//! Contact of two boxes has up to eight points, and which of them count depends on their poses. Feet and limbs are long and
//! flat, so the edge that faces the other part says nearly the same with one or two points.

use crate::kinematics::Frame;
use crate::model::{Geom, Shape};
use crate::rotation::{Quat, Vec3, add, product, rotate, rotate_back, sub};

/// Cosine and sine of half a right angle: quaternions have half angles.
const HALF: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Turns that take z to each axis.
const FROM_Z: [Quat; 3] = [[HALF, 0.0, HALF, 0.0], [HALF, -HALF, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]];

/// Two geoms, with rods in place of boxes and cylinders. `frames`: those of the robot's bodies at rest.
pub(super) fn in_place_of_both(geoms: &[Geom; 2], frames: &[Frame]) -> [Geom; 2] {
    let place = |geom: &Geom| frames[geom.body].then(&Frame { position: geom.pos, quaternion: geom.quat });
    let places = [place(&geoms[0]), place(&geoms[1])];
    std::array::from_fn(|side| {
        let (own, other) = (&places[side], &places[1 - side]);
        let toward = rotate_back(own.quaternion, sub(other.position, own.position));
        in_place_of(&geoms[side], toward).unwrap_or_else(|| geoms[side].clone())
    })
}

/// The rod that stands for a box or a cylinder. `toward`: the place of the other part in the geom's own frame, m.
///
/// A box becomes the capsule along its longest edge on the side of `toward`; its radius is half of the box's smallest size.
/// It lies inside the box. A cylinder at least as long as wide becomes the capsule inside it. `None` for other shapes.
fn in_place_of(geom: &Geom, toward: Vec3) -> Option<Geom> {
    // A rod without length is a ball: its axis would have no direction.
    let along = |length: f64, radius: f64| match length > 1e-6 * radius {
        true => Shape::Capsule { radius, half_length: length },
        false => Shape::Sphere { radius },
    };
    match geom.shape {
        Shape::Box { half_size } => {
            let mut axes = [0, 1, 2];
            // The rod lies along the longest side and is as thick as the shortest one.
            axes.sort_by(|&a, &b| half_size[b].total_cmp(&half_size[a]));
            let [long, middle, thin] = axes;
            let radius = half_size[thin];
            let mut offset = [0.0; 3];
            offset[middle] = (half_size[middle] - radius).copysign(toward[middle]);
            Some(Geom {
                shape: along(half_size[long] - radius, radius),
                pos: add(geom.pos, rotate(geom.quat, offset)),
                quat: product(geom.quat, FROM_Z[long]),
                ..geom.clone()
            })
        }
        Shape::Cylinder { radius, half_length } if half_length >= radius => {
            Some(Geom { shape: along(half_length - radius, radius), ..geom.clone() })
        }
        _ => None,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::rotation::IDENTITY;

    fn geom(shape: Shape) -> Geom {
        Geom { name: "sole".to_owned(), body: 1, shape, pos: [0.0, 0.0, -0.1], quat: IDENTITY }
    }

    #[test]
    fn a_box_becomes_the_rod_along_the_edge_that_faces_the_other_part() {
        let sole = geom(Shape::Box { half_size: [0.1, 0.04, 0.01] });
        let inner = in_place_of(&sole, [0.3, -0.2, 0.0]).unwrap();
        assert_eq!(inner.shape, Shape::Capsule { radius: 0.01, half_length: 0.1 - 0.01 });
        assert_eq!(inner.pos, [0.0, 0.01 - 0.04, -0.1]);
        let end = rotate(inner.quat, [0.0, 0.0, 1.0]);
        assert!((end[0] - 1.0).abs() < 1e-15 && end[1].abs() < 1e-15 && end[2].abs() < 1e-15, "{end:?}");
        // Along y, and turned as the box is.
        let turned =
            Geom { quat: [HALF, 0.0, 0.0, HALF], ..geom(Shape::Box { half_size: [0.02, 0.1, 0.02] }) };
        let rod = in_place_of(&turned, [1.0; 3]).unwrap();
        let end = rotate(rod.quat, [0.0, 0.0, 1.0]);
        assert!((end[0] + 1.0).abs() < 1e-15, "{end:?}");
        assert_eq!(rod.pos, turned.pos);
    }

    #[test]
    fn a_cube_becomes_a_ball_and_a_long_cylinder_a_rod() {
        let cube = in_place_of(&geom(Shape::Box { half_size: [0.1; 3] }), [0.0; 3]).unwrap();
        assert_eq!(cube.shape, Shape::Sphere { radius: 0.1 });
        let shin = in_place_of(&geom(Shape::Cylinder { radius: 0.02, half_length: 0.1 }), [0.0; 3]).unwrap();
        assert_eq!(shin.shape, Shape::Capsule { radius: 0.02, half_length: 0.1 - 0.02 });
        assert_eq!(in_place_of(&geom(Shape::Cylinder { radius: 0.1, half_length: 0.02 }), [0.0; 3]), None);
    }
}
