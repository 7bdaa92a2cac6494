//! A simple shape in the place of a mesh's lowest part: a ball, a lying rod, a flat sole, or a wheel.
//!
//! What touches the ground is the lowest part of a foot. Two slices of it tell its form: the footprint of a ball grows with the
//! square root of the slice's height along both directions, that of a lying rod along one, and that of a sole not at all.

use gaitfit_model::Shape;
use gaitfit_model::rotation::{IDENTITY, Quat, Vec3, add, cross, dot, from_axes, sub, unit};

/// Height of a slice as a share of the foot's, and its bounds, m.
const SLICE: f64 = 0.15;
const SLICE_BOUNDS: [f64; 2] = [3e-3, 0.02];
/// The lower slice's height as a share of the slice's: a ball's footprint has half the width there.
const LOW: f64 = 0.25;
/// Width in the lower slice over that in the whole slice from which a side counts as flat: between a ball's 0.5 and a
/// sole's 1.
const FLAT: f64 = 0.75;
/// A rod shorter than this share of its radius is a ball.
const SHORT_ROD: f64 = 0.3;
/// A ball or a rod is about as wide as twice its radius; what is wider is a sole with round edges.
const WIDE: f64 = 2.6;
/// A footprint narrower than this share of the leg is no sole.
const SMALL: f64 = 0.12;
/// Directions in which the smallest rectangle around a footprint is looked for: steps of 2.5° in a quarter turn,
/// after which rectangles repeat.
const DIRECTIONS: usize = 36;
/// Share of a wheel's radius by which its rim may differ.
const ROUND: f64 = 0.06;
/// Parts of the rim that are compared.
const SECTORS: usize = 12;

/// A shape with its pose, in the axes of the points that it was fitted to.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// Shape and size.
    pub shape: Shape,
    /// Its centre, m.
    pub pos: Vec3,
    /// Its orientation, wxyz.
    pub quat: Quat,
    /// Kind of shape, in words.
    pub what: &'static str,
}

/// The smallest rectangle around points in the plane: centre, direction of its longer side (rad), lengths of both sides.
struct Footprint {
    centre: [f64; 2],
    yaw: f64,
    sides: [f64; 2],
}

/// Extents of points along a direction and across it: lowest and highest of both.
fn extents(points: &[Vec3], yaw: f64) -> [[f64; 2]; 2] {
    let (sine, cosine) = yaw.sin_cos();
    let mut extents = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    for [x, y, _] in points {
        for ([low, high], value) in extents.iter_mut().zip([cosine * x + sine * y, cosine * y - sine * x]) {
            (*low, *high) = (low.min(value), high.max(value));
        }
    }
    extents
}

impl Footprint {
    fn new(points: &[Vec3]) -> Self {
        let quarter = std::f64::consts::FRAC_PI_2;
        let area = |yaw: f64| extents(points, yaw).iter().map(|[low, high]| high - low).product::<f64>();
        let yaws = (0..DIRECTIONS).map(|step| quarter * step as f64 / DIRECTIONS as f64);
        // Rectangles along the axes come first: among equals they are what a file means.
        let best = yaws.fold((0.0, f64::INFINITY), |(best, least), yaw| {
            let area = area(yaw);
            // A turned rectangle must be at least 2 % smaller, or rounding would turn symmetric feet.
            if area < 0.98 * least { (yaw, area) } else { (best, least) }
        });
        Self::along(points, best.0)
    }

    /// With a side along `yaw`.
    fn along(points: &[Vec3], yaw: f64) -> Self {
        let [along, across] = extents(points, yaw);
        let (sine, cosine) = yaw.sin_cos();
        let middle = [along, across].map(|[low, high]| 0.5 * (low + high));
        let centre = [cosine * middle[0] - sine * middle[1], sine * middle[0] + cosine * middle[1]];
        let sides = [along, across].map(|[low, high]| high - low);
        match sides[0] >= sides[1] {
            true => Self { centre, yaw, sides },
            false => Self { centre, yaw: yaw + std::f64::consts::FRAC_PI_2, sides: [sides[1], sides[0]] },
        }
    }
}

/// The shape of a foot's lowest part. `points`: of its surface, m, z up; `leg`: the leg's length, m; `soles`: whether feet may
/// be flat, as those of two legs; `None` without points that span a height.
pub fn foot(points: &[Vec3], leg: f64, soles: bool) -> Option<Fitted> {
    let (low, high) = points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), point| {
        (low.min(point[2]), high.max(point[2]))
    });
    let tall = high - low;
    if !(tall > 0.0 && tall.is_finite() && leg > 0.0) {
        return None;
    }
    // The foot's lowest slice is what touches. A second, thinner one shows whether the slice is flat or round
    // below.
    let [thin, thick] = SLICE_BOUNDS;
    // More than half of a thin foot would include its upper side.
    let height = (SLICE * tall).clamp(thin, thick).min(0.5 * tall);
    let below = |height: f64| -> Vec<Vec3> {
        points.iter().copied().filter(|point| point[2] <= low + height).collect()
    };
    let (lowest, slice) = (below(LOW * height), below(height));
    let print = Footprint::new(&slice);
    // Where the slice's own highest points are: a mesh has few of them.
    let rim = slice.iter().map(|point| point[2] - low).fold(0.0, f64::max);
    let rim = if rim > LOW * height { rim } else { height };
    let inner = Footprint::along(&lowest, print.yaw);
    // Along the slice's sides, whichever of the inner ones is longer.
    let [along, across] = extents(&lowest, print.yaw).map(|[low, high]| high - low);
    let flat = [along >= FLAT * print.sides[0], across >= FLAT * print.sides[1]];
    // From the width of a slice to the radius of a circle through its rim and its lowest point.
    let radius = |width: f64| {
        let half = 0.5 * width;
        // A circle's segment with chord w and height h has the radius (w²/4 + h²) / (2 h).
        ((half * half + rim * rim) / (2.0 * rim)).min(0.5 * tall).min(SMALL * leg)
    };
    let ball = |radius: f64| Fitted {
        shape: Shape::Sphere { radius },
        pos: [inner.centre[0], inner.centre[1], low + radius],
        quat: IDENTITY,
        what: "ball",
    };
    let small = print.sides[0] < SMALL * leg;
    let round = |radius: f64| (radius > 0.0).then(|| ball(radius));
    // A sole with round edges looks like a rod or a ball below them.
    let whole = Footprint::along(points, print.yaw).sides[1];
    let edged = soles && !small && flat != [true, true] && whole > WIDE * radius(print.sides[1]);
    // Flat both ways is a sole, round both ways a ball, and flat one way a rod that lies along it.
    match flat {
        _ if soles && !small && (flat == [true, true] || edged) => {
            let (sine, cosine) = print.yaw.sin_cos();
            let half = [0.5 * print.sides[0], 0.5 * print.sides[1], 0.5 * height];
            let thick_enough = half.iter().all(|side| *side > 0.0);
            thick_enough.then(|| Fitted {
                shape: Shape::Box { half_size: half },
                pos: [print.centre[0], print.centre[1], low + 0.5 * height],
                quat: from_axes([cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]),
                what: "flat sole",
            })
        }
        // Flat, but small or on many legs: a ball as wide as the print stands for it.
        [true, true] => round((0.5 * print.sides[0]).max(thin).min(0.5 * tall).min(SMALL * leg)),
        [false, false] => round(radius((print.sides[0] * print.sides[1]).sqrt())),
        [long, _] => {
            let (length, width, yaw) = match long {
                true => (print.sides[0], print.sides[1], print.yaw),
                false => (print.sides[1], print.sides[0], print.yaw + std::f64::consts::FRAC_PI_2),
            };
            let radius = radius(width);
            let half_length = 0.5 * length - radius;
            if !(half_length > SHORT_ROD * radius && soles) {
                return round(radius);
            }
            let (sine, cosine) = yaw.sin_cos();
            let axis = [cosine, sine, 0.0];
            Some(Fitted {
                shape: Shape::Capsule { radius, half_length },
                pos: [inner.centre[0], inner.centre[1], low + radius],
                // A capsule lies along its own z; its x points down.
                quat: from_axes([0.0, 0.0, -1.0], cross(axis, [0.0, 0.0, -1.0]), axis),
                what: "lying rod",
            })
        }
    }
}

/// A wheel that turns about an axis through `anchor`: its rim has the same radius all around; `None` of another body.
pub fn wheel(points: &[Vec3], anchor: Vec3, axis: Vec3) -> Option<Fitted> {
    let axis = unit(axis)?;
    // Any direction across the axis will do. A helper far from parallel keeps the product well conditioned.
    let side = unit(cross(axis, if axis[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] }))?;
    let other = cross(axis, side);
    let mut rim = [0.0_f64; SECTORS];
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    // The farthest point in each sector about the axis is the rim.
    for point in points {
        let arm = sub(*point, anchor);
        let (x, y) = (dot(arm, side), dot(arm, other));
        let turn = (y.atan2(x) / std::f64::consts::TAU).rem_euclid(1.0);
        let sector = ((turn * SECTORS as f64) as usize).min(SECTORS - 1);
        rim[sector] = rim[sector].max(x.hypot(y));
        (low, high) = (low.min(dot(arm, axis)), high.max(dot(arm, axis)));
    }
    let radius = rim.iter().copied().fold(0.0, f64::max);
    let even = rim.iter().all(|one| *one >= (1.0 - ROUND) * radius);
    let width = high - low;
    // What is longer than wide is a thigh or an arm that turns about itself.
    (radius > 0.0 && even && width > 0.0 && width < 2.0 * radius).then(|| Fitted {
        shape: Shape::Cylinder { radius, half_length: 0.5 * width },
        pos: add(anchor, axis.map(|x| x * 0.5 * (low + high))),
        quat: from_axes(side, other, axis),
        what: "wheel",
    })
}

/// A box around points along the axes; `None` of a flat set.
pub fn around(points: &[Vec3]) -> Option<Fitted> {
    let span = |k: usize| {
        points.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], point| {
            [low.min(point[k]), high.max(point[k])]
        })
    };
    let spans = [span(0), span(1), span(2)];
    let half_size = spans.map(|[low, high]| 0.5 * (high - low));
    half_size.iter().all(|half| *half > 0.0 && half.is_finite()).then(|| Fitted {
        shape: Shape::Box { half_size },
        pos: spans.map(|[low, high]| 0.5 * (low + high)),
        quat: IDENTITY,
        what: "box",
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a ball, of a rod along y, and of a box, each with its lowest point at −0.3.
    fn ball(radius: f64) -> Vec<Vec3> {
        let points = (0..40).flat_map(|i| (0..40).map(move |k| (i as f64 * 0.081, k as f64 * 0.16)));
        let place = |(polar, turn): (f64, f64)| {
            [
                radius * polar.sin() * turn.cos(),
                radius * polar.sin() * turn.sin(),
                radius - 0.3 - radius * polar.cos(),
            ]
        };
        points.map(place).collect()
    }

    fn block(half: Vec3) -> Vec<Vec3> {
        let corner = |k: usize, bit: usize| if k >> bit & 1 == 0 { -1.0 } else { 1.0 };
        (0..8)
            .map(|k| [half[0] * corner(k, 0), half[1] * corner(k, 1), half[2] * (1.0 + corner(k, 2)) - 0.3])
            .collect()
    }

    #[test]
    #[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
    fn a_ball_a_rod_and_a_sole_are_told_apart() {
        let fitted = foot(&ball(0.02), 0.4, true).unwrap();
        let Shape::Sphere { radius } = fitted.shape else { panic!("{fitted:?}") };
        assert!((radius - 0.02).abs() < 0.002 && (fitted.pos[2] - radius + 0.3).abs() < 1e-4, "{fitted:?}");

        let rod: Vec<Vec3> = [-0.05, 0.0, 0.05]
            .iter()
            .flat_map(|y| ball(0.02).into_iter().map(move |p| [p[0], p[1] + y, p[2]]))
            .collect();
        let fitted = foot(&rod, 0.4, true).unwrap();
        let Shape::Capsule { radius, half_length } = fitted.shape else { panic!("{fitted:?}") };
        assert!((radius - 0.02).abs() < 0.004 && (half_length - 0.045).abs() < 0.01, "{fitted:?}");
        assert!(gaitfit_model::rotation::axes(fitted.quat)[2][1].abs() > 0.99, "{fitted:?}");

        let sole = block([0.1, 0.04, 0.03]);
        let fitted = foot(&sole, 0.8, true).unwrap();
        let Shape::Box { half_size: [a, b, c] } = fitted.shape else { panic!("{fitted:?}") };
        assert!(
            (a - 0.1).abs() < 1e-9 && (b - 0.04).abs() < 1e-9 && (fitted.pos[2] - c + 0.3).abs() < 1e-9,
            "{fitted:?}"
        );
        // Four legs stand on balls.
        assert!(matches!(foot(&sole, 0.4, false).unwrap().shape, Shape::Sphere { .. }));
        assert_eq!(foot(&[[0.0; 3]; 4], 0.4, true), None);
    }

    #[test]
    #[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
    fn a_wheel_is_round_about_its_axis() {
        let ring = |radius: f64, y: f64| {
            (0..48)
                .map(move |k| [radius * (k as f64 * 0.131).cos(), y, radius * (k as f64 * 0.131).sin() - 0.3])
        };
        let points: Vec<Vec3> = ring(0.08, -0.02).chain(ring(0.08, 0.02)).collect();
        let fitted = wheel(&points, [0.0, 0.0, -0.3], [0.0, 1.0, 0.0]).unwrap();
        let Shape::Cylinder { radius, half_length } = fitted.shape else { panic!("{fitted:?}") };
        assert!((radius - 0.08).abs() < 1e-9 && (half_length - 0.02).abs() < 1e-9, "{fitted:?}");
        assert_eq!(wheel(&block([0.1, 0.02, 0.03]), [0.0, 0.0, -0.27], [0.0, 1.0, 0.0]), None);
        assert_eq!(wheel(&points, [0.05, 0.0, -0.3], [0.0, 1.0, 0.0]), None, "not about its middle");
    }
}
