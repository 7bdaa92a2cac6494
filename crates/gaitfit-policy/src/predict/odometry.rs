//! Leg odometry: how the base's height and velocity follow from feet that stand.
//!
//! When a simulated robot is put where the log's sensors read, its feet would jump in place and speed, and the ground
//! would answer. So the base moves such that the feet that carry it go on as they did in the simulation, on the mean,
//! weighted by their load (Bloesch et al. 2013, "State estimation for legged robots", use the same constraint in a
//! filter). For a wheel the rim at the ground goes on as it did, so that the wheel rolls.

use gaitfit_model::kinematics::{Frame, body_frames};
use gaitfit_model::rotation::{Vec3, add, cross, dot, rotate, rotate_back, sub};
use gaitfit_model::{Model, Shape};
use gaitfit_sim::Motion;

use super::Course;
use crate::walker::{FootGeoms, Walker};

/// Share of the robot's weight that must rest on the feet; below it they say little of the base.
const CARRIED: f64 = 0.15;
/// A wheel lies on its side if the sine of the angle between its plane and the ground is not above this.
const MIN_UPRIGHT_SINE: f64 = 0.1;

/// The feet of a robot.
pub struct Feet {
    /// In the walker's order.
    pub feet: Vec<Foot>,
    /// Load from which the feet say how the base moves, N.
    pub least_load: f64,
}

/// A foot and its leg.
pub struct Foot {
    body: usize,
    /// Its centre in its body's frame, m.
    place: Vec3,
    /// Places of its geoms in [`Motion::normal_force`].
    pub forces: Vec<usize>,
    /// Joints from the base to it.
    pub joints: Vec<usize>,
    /// Its joint and radius (m), if it is a wheel whose targets are velocities.
    wheel: Option<(usize, f64)>,
}

impl Feet {
    /// The walker's feet.
    pub fn new(walker: &Walker) -> Self {
        let (batch, model) = (&walker.batch, walker.model());
        let foot = |foot: &FootGeoms| {
            let geom = &model.geoms[batch.contact_geoms()[foot.main]];
            // All joints that move the foot against the base, from the foot up.
            let mut path = Vec::new();
            let mut body = Some(geom.body);
            while let Some(at) = body {
                path.extend((0..model.joints.len()).filter(|&joint| model.joints[joint].body == at));
                body = model.bodies[at].parent;
            }
            let radius = match geom.shape {
                Shape::Sphere { radius } | Shape::Capsule { radius, .. } | Shape::Cylinder { radius, .. } => {
                    radius
                }
                // With the radius 0 a box counts by its centre.
                Shape::Box { .. } => 0.0,
            };
            // Only a driven wheel rolls. A foot that is a cylinder on a joint with angle targets stands like
            // any other.
            let mut driven = model.velocity_targets.iter().copied();
            let wheel =
                driven.find(|&joint| model.joints[joint].body == geom.body).map(|joint| (joint, radius));
            Foot { body: geom.body, place: geom.pos, forces: foot.geoms.clone(), joints: path, wheel }
        };
        let mass: f64 = model.bodies.iter().map(|body| body.mass).sum();
        let gravity = dot(model.options.gravity, model.options.gravity).sqrt();
        Self { feet: walker.feet.iter().map(foot).collect(), least_load: CARRIED * mass * gravity }
    }
}

impl Foot {
    /// The point that stands where the foot does, m, base frame: its centre, or the lowest point of a wheel's rim. `frames`: of the
    /// bodies, with the base at the origin. `base`: orientation of the base.
    fn point(&self, model: &Model, frames: &[Frame], base: [f32; 4]) -> Vec3 {
        let centre = frames[self.body].point(self.place);
        let Some((joint, radius)) = self.wheel else { return centre };
        let axis = model.joints[joint].axis_at(&frames[self.body]).axis;
        let down = rotate_back(base.map(f64::from), [0.0, 0.0, -1.0]);
        let across = sub(down, scale(dot(down, axis), axis));
        let sine = dot(across, across).sqrt();
        // `across` is the direction down within the wheel's plane, of length sine: the rim is a radius away
        // along it.
        if sine > MIN_UPRIGHT_SINE { add(centre, scale(radius / sine, across)) } else { centre }
    }
}

/// Where the feet of a log are in the base's frame, at every sample.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Legs {
    /// One entry a sample and foot.
    places: Vec<Place>,
}

#[derive(Clone, Debug, PartialEq)]
struct Place {
    /// The foot's centre, or the lowest point of a wheel's rim, m, base frame.
    at: [f32; 3],
    /// Displacement of this point by a unit of each joint of its leg, m/rad.
    columns: Vec<[f32; 3]>,
    /// The point's velocity in the base's frame, m/s.
    velocity: [f32; 3],
}

/// Change of the base's height and velocity.
pub(super) struct Change {
    /// m.
    pub height: f64,
    /// m/s, world frame.
    pub linear: Vec3,
}

fn scale(factor: f64, v: Vec3) -> Vec3 {
    v.map(|x| factor * x)
}

fn single(v: Vec3) -> [f32; 3] {
    v.map(|x| x as f32)
}

impl Legs {
    /// The legs at the joint angles and velocities of a log, `samples × joints`, and the orientations of its base.
    pub fn new(
        feet: &Feet,
        model: &Model,
        position: &[f32],
        velocity: &[f32],
        quaternion: &[[f32; 4]],
    ) -> Self {
        let joints = model.joints.len();
        let mut places = Vec::with_capacity(position.len() / joints.max(1) * feet.feet.len());
        let rows = position.chunks_exact(joints).zip(velocity.chunks_exact(joints));
        for ((angles, rates), &base) in rows.zip(quaternion) {
            let angles: Vec<f64> = angles.iter().map(|&x| f64::from(x)).collect();
            // With the base at the origin: places and velocities are in the base's axes.
            let frames = body_frames(model, &Frame::WORLD, &angles);
            for foot in &feet.feet {
                let at = foot.point(model, &frames, base);
                let column = |&joint: &usize| {
                    let joint = &model.joints[joint];
                    joint.axis_at(&frames[joint.body]).lever(at)
                };
                let columns: Vec<Vec3> = foot.joints.iter().map(column).collect();
                let mut velocity = [0.0; 3];
                for (&joint, &column) in foot.joints.iter().zip(&columns) {
                    velocity = add(velocity, scale(f64::from(rates[joint]), column));
                }
                places.push(Place {
                    at: single(at),
                    columns: columns.into_iter().map(single).collect(),
                    velocity: single(velocity),
                });
            }
        }
        Self { places }
    }

    /// All numbers, with room for `joints` joints of a leg; see [`Course::legs`].
    pub fn numbers(&self, joints: usize) -> Vec<f32> {
        let mut numbers = Vec::with_capacity(self.places.len() * (6 + 3 * joints));
        for place in &self.places {
            let end = numbers.len() + 6 + 3 * joints;
            numbers.extend(place.at.iter().chain(&place.velocity).chain(place.columns.iter().flatten()));
            numbers.resize(end, 0.0);
        }
        numbers
    }

    /// Returns the change of the base with which the standing feet go on as they do in `motion` when robot
    /// `index` is put where sample `sample` of `course` says; `None` where too little load rests on them.
    /// `base`: orientation and rates (rad/s, body frame) of the base there.
    pub fn change(
        &self,
        feet: &Feet,
        motion: &Motion,
        index: usize,
        course: &Course,
        sample: usize,
        base: ([f32; 4], [f32; 3]),
    ) -> Option<Change> {
        // Contacts of one robot: all forces, over the number of robots.
        let geoms = motion.normal_force.len() / (motion.base_position.len() / 3);
        let force = |&geom: &usize| f64::from(motion.normal_force[index * geoms + geom]);
        let load = |foot: &Foot| foot.forces.iter().map(force).sum::<f64>();
        let total: f64 = feet.feet.iter().map(load).sum();
        // A flying robot keeps the velocity and height that the simulation gives it.
        if total.is_nan() || total <= feet.least_load {
            return None;
        }
        // Each foot says how the base would have to move for it to go on; the mean weighs them by load.
        let joints = course.joints();
        let wide = |v: &[f32]| -> Vec3 { std::array::from_fn(|k| f64::from(v[k])) };
        let simulated: [f64; 4] = std::array::from_fn(|k| f64::from(motion.base_quaternion[4 * index + k]));
        let logged = base.0.map(f64::from);
        let (rates, logged_rates) = (wide(&motion.base_angular[3 * index..]), base.1.map(f64::from));
        let (mut height, mut linear) = (0.0, [0.0; 3]);
        // Places lie sample by sample, with one for each foot.
        let places = &self.places[sample * feet.feet.len()..];
        for (foot, place) in feet.feet.iter().zip(places) {
            let share = load(foot) / total;
            let (at, velocity) = (wide(&place.at), wide(&place.velocity));
            // Where and how fast the simulation has it, to first order in the joints' errors.
            let (mut there, mut moving) = (at, velocity);
            for (&joint, column) in foot.joints.iter().zip(&place.columns) {
                let error = |simulated: &[f32], read: &[f32]| {
                    f64::from(simulated[index * joints + joint]) - f64::from(read[sample * joints + joint])
                };
                let column = wide(column);
                there = add(there, scale(error(&motion.joint_position, &course.position), column));
                moving = add(moving, scale(error(motion.velocity_readings(), &course.velocity), column));
            }
            // Velocity of the foot against the base's origin, in the world: how it is now, and how it would
            // be with the sensors' readings. The base makes up the difference.
            let before = rotate(simulated, add(moving, cross(rates, there)));
            let after = rotate(logged, add(velocity, cross(logged_rates, at)));
            linear = add(linear, scale(share, sub(before, after)));
            height += share * (rotate(simulated, there)[2] - rotate(logged, at)[2]);
        }
        Some(Change { height, linear })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_model::{ReadOptions, read_mjcf_str};

    const CART: &str = r#"<mujoco><worldbody>
        <geom type="plane" size="0 0 1"/>
        <body pos="0 0 0.3"><freejoint/><geom type="box" size="0.2 0.1 0.05" mass="5"/>
            <body pos="0.1 0 -0.2"><joint name="wheel" axis="0 1 0"/>
                <geom type="cylinder" size="0.1 0.02" quat="0.70710678 0.70710678 0 0" mass="1"/></body>
        </body></worldbody></mujoco>"#;

    #[test]
    fn a_wheel_moves_at_the_lowest_point_of_its_rim() {
        let model = read_mjcf_str(CART, &ReadOptions::default()).unwrap();
        let body = model.joints[0].body;
        let foot = |wheel| Foot { body, place: [0.0; 3], forces: vec![0], joints: vec![0], wheel };
        let legs = |wheel, base: [f32; 4]| {
            let feet = Feet { feet: vec![foot(wheel)], least_load: 0.0 };
            Legs::new(&feet, &model, &[7.0], &[3.0], &[base]).places.remove(0)
        };
        let near = |a: [f32; 3], b: [f32; 3]| a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-6);
        // At 3 rad/s the lowest point of a wheel of 0.1 m moves backwards at 0.3 m/s, whatever the wheel's angle.
        let level = legs(Some((0, 0.1)), [1.0, 0.0, 0.0, 0.0]);
        assert!(
            near(level.velocity, [-0.3, 0.0, 0.0]) && near(level.columns[0], [-0.1, 0.0, 0.0]),
            "{level:?}"
        );
        assert!(near(level.at, [0.1, 0.0, -0.3]));
        // If the base pitches by 30°, the lowest point is 30° further round the wheel.
        let (sin, cos) = 15_f32.to_radians().sin_cos();
        let pitched = legs(Some((0, 0.1)), [cos, 0.0, sin, 0.0]);
        let angle = 30_f32.to_radians();
        assert!(near(pitched.velocity, [-0.3 * angle.cos(), 0.0, -0.3 * angle.sin()]), "{pitched:?}");
        // A wheel on its side, and a foot, move as their centre does.
        let (sin, cos) = 45_f32.to_radians().sin_cos();
        assert!(near(legs(Some((0, 0.1)), [cos, sin, 0.0, 0.0]).velocity, [0.0; 3]));
        assert!(near(legs(None, [1.0, 0.0, 0.0, 0.0]).velocity, [0.0; 3]));
    }
}
