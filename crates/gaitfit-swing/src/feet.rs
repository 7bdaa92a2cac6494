//! Which limbs bear weight, which are in the air, and how fast the base moves over the feet that stand.

use crate::poses::{End, Tip};
use crate::torques::{Bump, Drag, Needed};
use crate::walk::Walk;
use gaitfit_model::rotation::Vec3;
use gaitfit_model::{GRAVITY, Model, Root};
use nalgebra::{Matrix3, Vector3};

/// Time over which the force at a foot is averaged, s.
const FORCE_S: f64 = 0.03;
/// Shares of the robot's weight from which a foot counts as standing, in part and fully.
const STANDS: [f64; 2] = [0.10, 0.25];
/// Velocities of two standing feet differ by less than about this, m/s: encoders and slip.
const ALIKE: [f64; 4] = [2.0, 1.0, 0.5, 0.5];
/// Standing feet are within about this height, m: slopes, steps, and an IMU that is tilted.
const LOW_M: f64 = 0.03;
/// Error of the velocity that a standing foot gives the base, m/s, and how long it lasts, s: encoders, vibration, slip.
const FOOT_RATE: f64 = 0.1;
const FOOT_S: f64 = 0.01;
/// Error of the acceleration that forces at the feet give, m/s², and how long it lasts, s: friction, impacts, mass.
const PUSH: f64 = 2.0;
const PUSH_S: f64 = 0.02;
/// Largest error with which the base's velocity counts as known, m/s.
const KNOWN: f64 = 0.3;

/// Heights and loads of limbs, and the base's motion, at every grid point.
#[derive(Clone, Debug)]
pub struct Ground {
    /// Height of the lowest point of what a joint moves above the robot's lowest point, m; infinite where it cannot touch
    /// anything; `len × joints`.
    pub clearance: Vec<f64>,
    /// Degree to which what a joint moves stands, from 0 to 1; 0 where nothing can touch; `len × joints`.
    pub stands: Vec<f64>,
    /// Velocity of the base's origin, m/s, world axes; not finite where no foot stands.
    pub velocity: Vec<Vec3>,
    /// Feet, one entry a grid point and end of a limb, in the order of the walk's poses.
    pub feet: Vec<Vec<Foot>>,
    /// Momenta and torques that joints without drag need at that velocity.
    pub(crate) needed: Needed,
}

/// The end of a limb at one moment.
#[derive(Clone, Copy, Debug)]
pub struct Foot {
    /// Its lowest point, m, world axes, from the base's origin.
    pub point: Vec3,
    /// Velocity of the base's origin with which that point stands, m/s, world axes.
    pub velocity: Vec3,
    /// Force on it by the torques of its limb, over the robot's mass, m/s², world axes; NaN where it is not known.
    pub force: Vec3,
    /// Upward force on it by the torques of its limb, as a share of the robot's weight; NaN where it is not known.
    pub load: f64,
    /// Degree to which it stands, from 0 to 1: it bears weight and moves as the other standing feet do.
    pub stands: f64,
}

impl Ground {
    /// Examines a walk whose targets act after `delay` s. The base of a clamped robot rests and its limbs touch
    /// nothing.
    pub fn new(model: &Model, walk: &Walk, delay: f64, drag: &[Drag], before: Option<&Self>) -> Self {
        let (points, joints) = (walk.points(), walk.joints);
        let poses = &walk.poses;
        // How the base moves matters less for a leg that stands than for one that swings, so the first pass takes the base to be at rest.
        let at_rest = || Needed::new(model, walk, &vec![[0.0; 3]; points]);
        if model.root == Root::Fixed {
            return Self {
                clearance: vec![f64::INFINITY; points * joints],
                stands: vec![0.0; points * joints],
                velocity: vec![[0.0; 3]; points],
                feet: vec![Vec::new(); points],
                needed: at_rest(),
            };
        }
        let ends = &poses.ends;
        // Ends that each joint moves.
        let moved: Vec<Vec<usize>> = (0..joints)
            .map(|joint| (0..ends.len()).filter(|&end| ends[end].chain.contains(&joint)).collect())
            .collect();
        let needed = before.map_or_else(at_rest, |before| before.needed.clone()).with_drag(model, walk, drag);
        let bump = Bump::new(FORCE_S, walk.step);
        let mass = model.bodies.iter().map(|body| body.mass).sum::<f64>();
        let weight = mass * GRAVITY;
        let mut clearance = vec![f64::INFINITY; points * joints];
        let mut feet: Vec<Vec<Foot>> = Vec::with_capacity(points);
        for point in 0..points {
            // The force at a foot follows from what the limb's joint torques leave beyond inertia and gravity, by
            // the Jacobian's transpose.
            let foot = |(end, tip): (&End, &Tip)| {
                // Joints without gains are left out: their torque is not known.
                let left = |(&joint, &lever): (&usize, &Vec3)| {
                    let known = walk.gains[joint][0].is_finite();
                    known.then(|| (lever, needed.left(walk, &bump, joint, point, delay)))
                };
                let force = force(end.chain.iter().zip(poses.levers(point, end)).filter_map(left));
                Foot {
                    point: tip.point,
                    // A foot stands if the base's velocity cancels its velocity relative to the base.
                    velocity: tip.velocity.map(|x| -x),
                    force: force.map(|f| f / mass),
                    load: force[2] / weight,
                    stands: 0.0,
                }
            };
            let mut here: Vec<Foot> = ends.iter().zip(poses.tips_at(point)).map(foot).collect();
            // Heights are relative: the lowest foot is taken to be on the ground.
            let ground = here.iter().map(|foot| foot.point[2]).fold(f64::INFINITY, f64::min);
            for (joint, moved) in moved.iter().enumerate() {
                let place = point * joints + joint;
                for &end in moved {
                    clearance[place] = clearance[place].min(here[end].point[2] - ground);
                }
            }
            // First guess by load and height alone: velocities can be compared only when a base velocity is
            // known.
            here.iter_mut().for_each(|foot| foot.stands = bears(foot.load) * low(foot.point[2] - ground));
            feet.push(here);
        }
        // The momentum of the whole robot over its mass, with the base's origin at rest.
        let relative = &poses.com_velocity;
        let mut velocity = base_velocity(walk, &feet, relative);
        let mut stands = vec![0.0; points * joints];
        // A foot that swings fast may push as one that stands does, but it does not move as the others do. Bounds that
        // narrow step by step do not depend on the foot that is looked at first.
        for alike in ALIKE {
            for (point, feet) in feet.iter_mut().enumerate() {
                let ground = feet.iter().map(|foot| foot.point[2]).fold(f64::INFINITY, f64::min);
                for foot in feet.iter_mut() {
                    foot.stands = bears(foot.load)
                        * low(foot.point[2] - ground)
                        * near(velocity[point], foot.velocity, alike);
                }
            }
            velocity = base_velocity(walk, &feet, relative);
        }
        // What a joint moves stands if any of its ends does.
        for (point, feet) in feet.iter().enumerate() {
            for (joint, moved) in moved.iter().enumerate() {
                let max = moved.iter().map(|&end| feet[end].stands).fold(0.0, f64::max);
                stands[point * joints + joint] = max;
            }
        }
        // With the base's velocity the momenta of swinging legs are right as well.
        let needed = Needed::new(model, walk, &velocity);
        Self { clearance, stands, velocity, feet, needed }
    }
}

/// How much a foot with this share of the weight stands, from 0 to 1.
fn bears(load: f64) -> f64 {
    let [low, high] = STANDS;
    if load.is_finite() { ((load - low) / (high - low)).clamp(0.0, 1.0) } else { 0.0 }
}

/// 1 for equal velocities, near 0 for those further apart than `alike`, m/s.
fn near(a: Vec3, b: Vec3, alike: f64) -> f64 {
    let apart: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
    if apart.is_finite() { (-apart / alike.powi(2)).exp() } else { 0.0 }
}

/// 1 for a foot on the ground, near 0 for one that is higher above the lowest foot than [`LOW_M`].
fn low(height: f64) -> f64 {
    (-(height / LOW_M).powi(2)).exp()
}

/// Force at a point (N, world axes) that takes what motion leaves of the motors' torques: Jᵀ F = −torques by least
/// squares. `levers`: column of J and torque of each joint.
fn force(levers: impl Iterator<Item = (Vec3, f64)>) -> Vec3 {
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for (lever, torque) in levers {
        let lever = Vector3::from(lever);
        normal += lever * lever.transpose();
        right -= lever * torque;
    }
    // A straight leg has no lever along itself.
    normal += Matrix3::identity() * (1e-3 * normal.trace() + 1e-12);
    normal.try_inverse().map_or([f64::NAN; 3], |inverse| (inverse * right).into())
}

/// Velocity of the base's origin by a Kalman smoother (Rauch, Tung & Striebel 1965) for each axis. Its state is the
/// velocity of the centre of mass; forces at the feet drive it, and feet that stand measure it. `relative`: velocity of the
/// centre of mass if the base's origin rests, m/s.
fn base_velocity(walk: &Walk, feet: &[Vec<Foot>], relative: &[Vec3]) -> Vec<Vec3> {
    let step = walk.step;
    // Forces at the feet bear the robot on the mean, whatever its mass and its motors' strength are.
    let mut borne = (0.0, 0.0);
    let push =
        |foot: &Foot| if foot.stands > 0.0 { foot.force.map(|f| foot.stands.sqrt() * f) } else { [0.0; 3] };
    for feet in feet.iter().zip(&walk.valid).filter(|(_, valid)| **valid).map(|(feet, _)| feet) {
        borne = (borne.0 + feet.iter().map(|foot| push(foot)[2]).sum::<f64>(), borne.1 + 1.0);
    }
    // Without a foot that stands `borne.0` is near 0; the bounds keep the scale usable then.
    let scale = (GRAVITY * borne.1 / borne.0.max(1e-9)).clamp(0.7, 1.5);
    let points = feet.len();
    let mut velocity = vec![[f64::NAN; 3]; points];
    // An error that lasts `FOOT_S` is white noise of the same integral: its variance at a grid point grows as the
    // step shrinks.
    let variance = FOOT_RATE * FOOT_RATE * (FOOT_S / step);
    // The error of the acceleration, as white noise of the same integral, makes the velocity a random walk.
    let drift = PUSH * PUSH * PUSH_S * step;
    // Samples that lack are gaps: each stretch between them is smoothed alone.
    let mut begin = 0;
    while begin < points {
        if !walk.valid[begin] {
            begin += 1;
            continue;
        }
        // A stretch is filtered forwards, then smoothed backwards.
        let end = (begin..points).find(|&point| !walk.valid[point]).unwrap_or(points);
        for axis in 0..3 {
            let gravity = if axis == 2 { GRAVITY } else { 0.0 };
            // (10 m/s)²: nothing is known of the velocity before the first standing foot.
            let mut state = (0.0, 100.0);
            let mut predicted = Vec::with_capacity(end - begin);
            let mut filtered = Vec::with_capacity(end - begin);
            for point in begin..end {
                if point > begin {
                    let force: f64 = feet[point - 1].iter().map(|foot| push(foot)[axis]).sum();
                    state = (state.0 + step * (scale * force - gravity), state.1 + drift);
                }
                predicted.push(state);
                // Feet err independently, so they measure one after another. One that hardly stands has no weight
                // and is left out.
                for foot in feet[point].iter().filter(|foot| foot.stands > 1e-3) {
                    let gain = state.1 / (state.1 + variance / foot.stands);
                    // The filter's state is the centre of mass, the foot's velocity is that of the base's origin.
                    let seen = foot.velocity[axis] + relative[point][axis];
                    state = (state.0 + gain * (seen - state.0), (1.0 - gain) * state.1);
                }
                filtered.push(state);
            }
            // The backward pass. The state is carried over unchanged but for the push, so the smoother's gain is a
            // ratio of variances.
            for k in (0..filtered.len().saturating_sub(1)).rev() {
                let gain = filtered[k].1 / predicted[k + 1].1;
                filtered[k].0 += gain * (filtered[k + 1].0 - predicted[k + 1].0);
                filtered[k].1 += gain * gain * (filtered[k + 1].1 - predicted[k + 1].1);
            }
            for (k, (value, variance)) in filtered.into_iter().enumerate() {
                // Elsewhere the velocity stays NaN, and no window there counts.
                if variance < KNOWN * KNOWN {
                    // Back from the centre of mass to the base's origin.
                    velocity[begin + k][axis] = value - relative[begin + k][axis];
                }
            }
        }
        begin = end;
    }
    velocity
}
