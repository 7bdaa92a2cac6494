//! Sizes of a robot, and what of a task goes with them.

use super::anatomy::Anatomy;
use gaitfit_model::kinematics::{Frame, body_frames, height_above_ground, lowest_point};
use gaitfit_model::rotation::{IDENTITY, dot};
use gaitfit_model::{GRAVITY, Model};

/// The Go2's leg length (m) and mass (kg) in its built-in task, whose numbers are carried over.
pub const GO2_LEG: f64 = 0.3;
pub const GO2_MASS: f64 = 15.2;
/// A hinge moves a foot sideways if a radian of it moves the foot by this share of the leg's length; a slide, if its axis points
/// this far to the side.
const ASIDE: f64 = 0.2;
/// A foot hangs if it is above the lowest one by more than this share of the leg's length.
const HANGS: f64 = 0.03;

/// Sizes of a robot. SI units.
#[derive(Clone, Debug, PartialEq)]
pub struct Sizes {
    /// Mass.
    pub mass: f64,
    /// Acceleration of free fall.
    pub gravity: f64,
    /// From hip to ground in the pose.
    pub leg: f64,
    /// Height of the base's origin in the pose.
    pub height: f64,
    /// Height of a foot's centre on the ground.
    pub foot: f64,
    /// Largest commands: forward, to the side, turning.
    pub forward: f64,
    pub sideways: f64,
    pub turning: f64,
    /// Why the robot gets no commands to the side; `None` if it does.
    pub never_aside: Option<&'static str>,
    /// A doubt about these sizes, one sentence.
    pub doubt: Option<String>,
    /// Feet that do not reach the ground in the pose, and how high the highest of them is; `None` if all do.
    pub hanging: Option<(Vec<String>, f64)>,
}

/// Whether a joint of a leg moves its foot sideways, along y of the base, in the pose of `frames`.
fn moves_aside(model: &Model, anatomy: &Anatomy, frames: &[Frame], length: f64) -> bool {
    anatomy.legs.iter().any(|leg| {
        leg.path.iter().map(|&joint| &model.joints[joint]).any(|joint| {
            let aside = joint.axis_at(&frames[joint.body]).lever(leg.place)[1].abs();
            // A radian of a hinge; the leg's length of a slide.
            aside * if joint.kind.is_hinge() { 1.0 } else { length } > ASIDE * length
        })
    })
}

/// Two significant digits.
pub fn tidy(value: f64) -> f64 {
    digits(value, 2)
}

/// So many significant digits.
pub fn digits(value: f64, count: i32) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    // Through text, because dividing by a power of ten would leave digits such as 0.30000000000000004.
    format!("{value:.*e}", (count - 1).max(0) as usize).parse().unwrap_or(value)
}

impl Sizes {
    /// Sizes in the pose `angles` (rad, model order).
    pub fn new(model: &Model, anatomy: &Anatomy, angles: &[f64]) -> Self {
        let gravity = dot(model.options.gravity, model.options.gravity).sqrt();
        // A file may switch gravity off; commands go with √(g l) and would be zero.
        let gravity = if gravity > 0.1 { gravity } else { GRAVITY };
        let frames = body_frames(model, &Frame::WORLD, angles);
        let height = height_above_ground(model, IDENTITY, angles);
        let bottom = |geom: usize| lowest_point(&model.geoms[geom], &frames[model.geoms[geom].body]);
        let count = anatomy.legs.len() as f64;
        let (mut leg, mut foot) = (0.0, 0.0);
        let mut lows = Vec::new();
        // Lengths are means over the legs.
        for one in &anatomy.legs {
            let low = one.geoms.iter().map(|&geom| bottom(geom)).fold(f64::INFINITY, f64::min);
            let hip = one.joints.first().or(one.path.first()).map_or(0.0, |&joint| {
                let hinge = &model.joints[joint];
                frames[hinge.body].point(hinge.pos)[2]
            });
            leg += (hip - low) / count;
            foot += (one.place[2] - low) / count;
            lows.push((&one.foot, low));
        }
        // Turning rates go with √(g / l) and weights with powers of 1 / l, so the length must not be zero.
        let leg = leg.max(0.02);
        let feet = anatomy.legs.iter().flat_map(|leg| &leg.geoms).map(|&geom| bottom(geom));
        let lowest_foot = feet.fold(f64::INFINITY, f64::min);
        let above: Vec<(&String, f64)> = lows
            .into_iter()
            .map(|(name, low)| (name, low - lowest_foot))
            .filter(|(_, above)| *above > HANGS * leg)
            .collect();
        let hanging = (!above.is_empty()).then(|| {
            let names: Vec<String> = above.iter().map(|(name, _)| gaitfit_model::shown(name)).collect();
            (names, above.iter().map(|(_, above)| *above).fold(0.0, f64::max))
        });
        // A robot that stands on another part than its feet would fall or be counted as fallen at once.
        let under = model
            .pairs
            .iter()
            .map(|pair| pair.geom)
            // Geoms within a millimetre of the lowest foot count as equally low.
            .filter(|&geom| bottom(geom) < lowest_foot - 1e-3)
            .min_by(|&a, &b| bottom(a).total_cmp(&bottom(b)));
        let doubt = under.map(|geom| {
            let name = gaitfit_model::shown(&model.geoms[geom].name);
            format!("geom {name} is lower than the feet in this pose: give task.policy.default_pose another")
        });
        let speed = (gravity * leg).sqrt();
        // Shares of √(g l): 0.58 is the built-in Go2's 1 m/s, and robots on two legs get about half of that.
        let (forward, sideways) = if anatomy.biped() { (0.3, 0.12) } else { (0.58, 0.58) };
        let never_aside = if !anatomy.wheels.is_empty() {
            Some("wheels do not roll sideways")
        } else if !moves_aside(model, anatomy, &frames, leg) {
            Some("no joint moves a foot sideways")
        } else {
            None
        };
        let sideways = if never_aside.is_none() { sideways } else { 0.0 };
        Self {
            mass: model.total_mass(),
            gravity,
            leg,
            height,
            foot,
            forward: tidy(forward * speed),
            sideways: tidy(sideways * speed),
            // A share of √(g / l): the built-in Go2's 1 rad/s.
            turning: tidy(0.175 * (gravity / leg).sqrt()),
            never_aside,
            doubt,
            hanging,
        }
    }

    /// How far the base is above the ground, m, or the leg is long where the base's origin lies near the ground.
    pub fn tall(&self) -> f64 {
        // An origin lower than half of the leg shows nothing of how tall the robot is.
        if self.height < 0.5 * self.leg { self.leg } else { self.height }
    }

    /// Leg length over the Go2's.
    pub fn length(&self) -> f64 {
        self.leg / GO2_LEG
    }

    /// Torque unit m g l over the Go2's.
    pub fn torque(&self) -> f64 {
        self.mass / GO2_MASS * self.length()
    }
}
