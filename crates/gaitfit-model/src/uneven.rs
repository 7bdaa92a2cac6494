//! A robot of a flat world on a height field.

use crate::model::{ContactPair, Geom, Model, Shape};
use crate::rotation::{IDENTITY, Quat, Vec3, add, product, rotate};
use crate::terrain::{Ground, HeightField, Obstacle, ObstacleShape};

// A ball in a corner leaves 0.7 of its radius of the corner out: at most 15 mm.
/// Largest radius of a ball that stands for a corner, m.
const CORNER: f64 = 0.02;
/// A quarter turn that takes z to x, and one that takes z to y.
const TO_X: Quat = [std::f64::consts::FRAC_1_SQRT_2, 0.0, std::f64::consts::FRAC_1_SQRT_2, 0.0];
const TO_Y: Quat = [std::f64::consts::FRAC_1_SQRT_2, -std::f64::consts::FRAC_1_SQRT_2, 0.0, 0.0];

impl Model {
    /// The robot on the height field `field`, which is called `name` and whose origin is the world's, in the place of its
    /// planes: what may touch a plane may touch the field, with the same contact parameters.
    ///
    /// Only balls and the ends of capsules of radius up to half a cell touch a field. Balls in the corners and at the rims
    /// of other shapes, inside of them, stand for these; they have the names of the shapes.
    pub fn on_field(&self, name: &str, field: HeightField) -> Model {
        let mut model = self.clone();
        let ground = Ground::Obstacle { obstacle: model.obstacles.len() };
        let [x, y] = field.steps();
        // Half of the narrower side of a cell.
        let max = 0.5 * x.min(y);
        // Pairs with boxes and other fields stay as they are.
        model.pairs.retain(|pair| !matches!(pair.ground, Ground::Plane(_)));
        let mut met = vec![false; self.geoms.len()];
        for pair in &self.pairs {
            // A geom that may touch several planes touches the field once.
            if !matches!(pair.ground, Ground::Plane(_)) || std::mem::replace(&mut met[pair.geom], true) {
                continue;
            }
            let geom = &self.geoms[pair.geom];
            match rounded(geom.shape, max) {
                None => model.pairs.push(ContactPair { ground, ..pair.clone() }),
                Some(parts) => {
                    for Part { shape, position, quaternion } in parts {
                        // The pair names the geom that is pushed next.
                        model.pairs.push(ContactPair { geom: model.geoms.len(), ground, ..pair.clone() });
                        model.geoms.push(Geom {
                            name: geom.name.clone(),
                            body: geom.body,
                            shape,
                            pos: add(geom.pos, rotate(geom.quat, position)),
                            quat: product(geom.quat, quaternion),
                        });
                    }
                }
            }
        }
        model.planes.clear();
        model.obstacles.push(Obstacle {
            name: name.to_owned(),
            pos: [0.0; 3],
            quat: IDENTITY,
            shape: ObstacleShape::Field(field),
        });
        model
    }
}

/// A shape in the frame of the one that it stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Part {
    shape: Shape,
    position: Vec3,
    quaternion: Quat,
}

fn ball(radius: f64, position: Vec3) -> Part {
    Part { shape: Shape::Sphere { radius }, position, quaternion: IDENTITY }
}

/// Balls and capsules of at most the radius `max` inside of `shape` that stand for it; none where it may stay.
fn rounded(shape: Shape, max: f64) -> Option<Vec<Part>> {
    let small = max.min(CORNER);
    Some(match shape {
        Shape::Sphere { radius } | Shape::Capsule { radius, .. } if radius <= max => return None,
        Shape::Sphere { radius } => {
            // The small balls touch the large one from inside, where its axes end.
            let far = radius - small;
            let tip = |axis: usize, sign: f64| {
                let mut position = [0.0; 3];
                position[axis] = sign * far;
                ball(small, position)
            };
            (0..3).flat_map(|axis| [tip(axis, -1.0), tip(axis, 1.0)]).collect()
        }
        Shape::Capsule { radius, half_length } => {
            let far = radius - small;
            let end = |sign: f64| {
                let mut balls = rim(far, sign * half_length, small);
                balls.push(ball(small, [0.0, 0.0, sign * (half_length + far)]));
                balls
            };
            [end(-1.0), end(1.0)].concat()
        }
        // A capsule inside of the cylinder reaches as far along the axis and to its sides; only the rims are round.
        Shape::Cylinder { radius, half_length } if radius <= max.min(half_length) => vec![Part {
            shape: Shape::Capsule { radius, half_length: half_length - radius },
            position: [0.0; 3],
            quaternion: IDENTITY,
        }],
        // A disc that one layer of balls fills: the balls at both of its rims would be the same.
        Shape::Cylinder { radius, half_length } if half_length <= small => {
            rim(radius - half_length, 0.0, half_length)
        }
        Shape::Cylinder { radius, half_length } => {
            // Inside the cylinder, so that its outline stays the same.
            let end = |sign: f64| rim(radius - small, sign * (half_length - small), small);
            [end(-1.0), end(1.0)].concat()
        }
        Shape::Box { half_size } => {
            let mut order = [0, 1, 2];
            order.sort_by(|&a, &b| half_size[a].total_cmp(&half_size[b]));
            let [thin, middle, long] = order;
            let radius = half_size[thin];
            // Narrow enough for a single capsule along the longest side.
            if half_size[middle] <= max {
                let quaternion = [TO_X, TO_Y, IDENTITY][long];
                let half_length = half_size[long] - radius;
                let shape = Shape::Capsule { radius, half_length };
                return Some(vec![Part { shape, position: [0.0; 3], quaternion }]);
            }
            let radius = small.min(radius);
            let corner = |number: usize| {
                ball(
                    radius,
                    std::array::from_fn(|k| {
                        let sign = if number >> k & 1 == 0 { -1.0 } else { 1.0 };
                        sign * (half_size[k] - radius)
                    }),
                )
            };
            (0..8).map(corner).collect()
        }
    })
}

/// Four balls at the height `z` of an axis, `far` from it.
fn rim(far: f64, z: f64, radius: f64) -> Vec<Part> {
    [[far, 0.0], [-far, 0.0], [0.0, far], [0.0, -far]].map(|[x, y]| ball(radius, [x, y, z])).to_vec()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::kinematics::Frame;
    use crate::kinematics::lowest_point;
    use crate::rotation::axis_angle;

    fn level(cell: f64) -> HeightField {
        HeightField { rows: 5, columns: 5, half_size: [2.0 * cell; 2], heights: vec![0.0; 25] }
    }

    #[test]
    fn what_stands_for_a_shape_lies_inside_of_it_and_reaches_as_low() {
        let frame = |angle: f64| Frame {
            position: [0.0; 3],
            quaternion: product(axis_angle([0.0, 1.0, 0.0], angle), axis_angle([1.0, 0.0, 0.0], 0.7 * angle)),
        };
        let whole = |shape: Shape| Geom {
            name: String::new(),
            body: 0,
            shape,
            pos: [0.1, 0.2, 0.3],
            quat: axis_angle([0.6, 0.0, 0.8], 0.4),
        };
        // How far the lowest points may differ: rims are four points, corners are balls.
        for (shape, slack) in [
            (Shape::Sphere { radius: 0.05 }, 0.015),
            (Shape::Capsule { radius: 0.06, half_length: 0.1 }, 0.02),
            (Shape::Cylinder { radius: 0.05, half_length: 0.02 }, 0.025),
            (Shape::Cylinder { radius: 0.05, half_length: 0.012 }, 0.025),
            (Shape::Cylinder { radius: 0.02, half_length: 0.1 }, 0.02),
            (Shape::Cylinder { radius: 0.02, half_length: 0.02 }, 0.01),
            (Shape::Cylinder { radius: 0.02, half_length: 0.005 }, 0.007),
            (Shape::Cylinder { radius: 0.024, half_length: 0.022 }, 0.012),
            (Shape::Box { half_size: [0.2, 0.05, 0.06] }, 0.016),
            (Shape::Box { half_size: [0.012, 0.1, 0.017] }, 0.02),
        ] {
            let parts = rounded(shape, 0.025).unwrap();
            let twice = |(k, part): (usize, &Part)| parts[..k].contains(part);
            assert!(!parts.iter().enumerate().any(twice), "{shape:?}: {parts:?}");
            let geom = whole(shape);
            for k in 0..200 {
                let frame = frame(0.1 * f64::from(k));
                let found = parts.iter().map(|part| {
                    let geom = Geom {
                        shape: part.shape,
                        pos: add(geom.pos, rotate(geom.quat, part.position)),
                        quat: product(geom.quat, part.quaternion),
                        ..geom.clone()
                    };
                    lowest_point(&geom, &frame)
                });
                let found = found.fold(f64::INFINITY, f64::min) - lowest_point(&geom, &frame);
                assert!((-1e-9..slack).contains(&found), "{shape:?} turned {k}: {found}");
            }
        }
        assert!(rounded(Shape::Sphere { radius: 0.022 }, 0.025).is_none());
    }

    #[test]
    fn the_go2_on_a_field_keeps_its_feet_and_contact_parameters() {
        let flat = crate::builtin::go2().unwrap();
        let uneven = flat.on_field("ground", level(0.05));
        assert!(uneven.planes.is_empty() && uneven.obstacles.len() == 1);
        let foot = |model: &Model| {
            let pair = model.pairs.iter().find(|pair| model.geoms[pair.geom].name == "FL_foot").unwrap();
            (pair.friction, pair.condim, pair.solimp, pair.margin, model.geoms[pair.geom].shape)
        };
        assert_eq!(foot(&flat), foot(&uneven));
        let trunk = uneven.pairs.iter().filter(|pair| uneven.geoms[pair.geom].name == "trunk").count();
        assert_eq!(trunk, 8);
        let round = |pair: &ContactPair| match uneven.geoms[pair.geom].shape {
            Shape::Sphere { radius } | Shape::Capsule { radius, .. } => radius <= 0.025,
            _ => false,
        };
        assert!(uneven.pairs.iter().all(round));
        let before = uneven.pairs.len();
        assert_eq!(uneven.on_field("again", level(0.05)).pairs.len(), before, "no plane is left");
    }
}
