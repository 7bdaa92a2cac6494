//! Whether a foot lies flat: the line along its sole.

use super::anatomy::Leg;
use gaitfit_model::kinematics::Frame;
use gaitfit_model::rotation::{add, rotate, sub};
use gaitfit_model::{Model, Shape};

/// Shortest line that counts as a sole, m.
const MIN_SOLE: f64 = 0.01;

/// The two ends of a sole, each as a body and a point in its frame, m.
pub struct Sole([(usize, [f64; 3]); 2]);

impl Sole {
    /// The longest lying line of a leg's foot in the vertical plane in which the leg bends: along a rod, an edge of a box, or
    /// from one shape to another. `frames`: the robot as its file draws it. `None` if the foot has no such line, as a ball.
    pub fn new(model: &Model, leg: &Leg, frames: &[Frame]) -> Option<Self> {
        let mut lines: Vec<[(usize, [f64; 3]); 2]> = Vec::new();
        for (place, &geom) in leg.geoms.iter().enumerate() {
            let geom = &model.geoms[geom];
            let mut along = |half: [f64; 3]| {
                let half = rotate(geom.quat, half);
                lines.push([sub(geom.pos, half), add(geom.pos, half)].map(|end| (geom.body, end)));
            };
            match geom.shape {
                Shape::Sphere { .. } => {}
                Shape::Capsule { half_length, .. } | Shape::Cylinder { half_length, .. } => {
                    along([0.0, 0.0, half_length]);
                }
                Shape::Box { half_size: [x, y, z] } => {
                    [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]].into_iter().for_each(&mut along);
                }
            }
            // Two balls, as under heel and toe, span a line as well.
            let others = leg.geoms[..place].iter().map(|&other| &model.geoms[other]);
            lines.extend(others.map(|other| [(other.body, other.pos), (geom.body, geom.pos)]));
        }
        let span = |line: &[(usize, [f64; 3]); 2]| {
            let [from, to] = line.map(|(body, point)| frames[body].point(point));
            // The plane in which the leg bends is that of x and z.
            [to[0] - from[0], to[2] - from[2]]
        };
        let length = |line: &[(usize, [f64; 3]); 2]| {
            let [x, z] = span(line);
            x.hypot(z)
        };
        // An upright rod is a shank.
        let lies = |line: &[(usize, [f64; 3]); 2]| {
            let [x, z] = span(line);
            // Flatter than 45°.
            z.abs() < x.abs()
        };
        let longest = lines.into_iter().filter(lies).max_by(|a, b| length(a).total_cmp(&length(b)))?;
        (length(&longest) >= MIN_SOLE).then_some(Self(longest))
    }

    /// Sine of the angle by which the sole is tilted, up to its sign.
    pub fn tilt(&self, frames: &[Frame]) -> f64 {
        let [from, to] = self.0.map(|(body, point)| frames[body].point(point));
        let line = sub(to, from);
        line[2] / line.iter().map(|x| x * x).sum::<f64>().sqrt()
    }
}
