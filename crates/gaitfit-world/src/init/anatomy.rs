//! Feet, legs and gait of a robot, from its tree and its geoms.

use super::InitError;
use gaitfit_model::kinematics::{Frame, body_frames, lowest_point};
use gaitfit_model::rotation::{axes, dot, product, rotate, sub};
use gaitfit_model::{JointKind, Model, Shape, shown};

/// Last links whose lowest point lies within this share of the base's height of the lowest of all are legs.
pub(super) const NEAR_GROUND: f64 = 0.3;
/// Geoms of a foot lie at most this share of the base's height above the foot's lowest point.
const SAME_FOOT: f64 = 0.03;
/// Largest distance of a wheel's middle from its axis, as a share of its radius. The cosine of the angle between the
/// wheel's own axis and the joint's may be this much below 1: 26°.
const OFF_AXIS: f64 = 0.1;
/// Max number of legs: a task may have as many feet.
const MAX_LEGS: usize = 8;

/// A leg.
#[derive(Clone, Debug, PartialEq)]
pub struct Leg {
    /// The foot's name: of a geom, or of a body that stands for all its geoms.
    pub foot: String,
    /// Its geoms.
    pub geoms: Vec<usize>,
    /// Joints from the base to the foot.
    pub path: Vec<usize>,
    /// Joints of the path that no other leg has.
    pub joints: Vec<usize>,
    /// Whether its foot has a sole: a shape that must lie flat.
    pub sole: bool,
    /// Its foot in the base's frame, m.
    pub place: [f64; 3],
}

/// Legs, in the order of the joints, and how they go together.
#[derive(Clone, Debug, PartialEq)]
pub struct Anatomy {
    /// The legs.
    pub legs: Vec<Leg>,
    /// Joints of any leg that the policy gives positions, by index.
    pub moved: Vec<usize>,
    /// Joints of legs without a motor, in a file that gives others one: springs and slack.
    pub passive: Vec<usize>,
    /// Joints with a motor on which a leg's foot turns as a wheel: the policy gives them velocities.
    pub wheels: Vec<usize>,
    /// Groups of legs that move together; none where the sides do not match.
    pub gait: Vec<Vec<usize>>,
    /// Geoms of the base that may touch the ground.
    pub base_geoms: Vec<usize>,
}

impl Anatomy {
    /// Finds the legs in the pose `angles` (rad, model order).
    pub fn find(model: &Model, angles: &[f64]) -> Result<Self, InitError> {
        let frames = body_frames(model, &Frame::WORLD, angles);
        let mut contacts: Vec<usize> = model.pairs.iter().map(|pair| pair.geom).collect();
        // A geom has a pair with each plane that it may touch.
        contacts.sort_unstable();
        contacts.dedup();
        if contacts.is_empty() {
            let usual = || {
                "give the file with the floor (often `scene.xml`), or give the feet spheres, capsules, boxes or cylinders \
                 that collide"
                    .to_owned()
            };
            let why = model.feet_of_meshes().unwrap_or_else(usual);
            return Err(InitError::NoContact { robot: shown(&model.name), why });
        }
        let paths: Vec<Vec<usize>> = (0..model.bodies.len()).map(|body| path(model, body)).collect();
        let path_of = |geom: usize| &paths[model.geoms[geom].body];
        let lowest = |geom: usize| lowest_point(&model.geoms[geom], &frames[model.geoms[geom].body]);
        // A last link: nothing hangs on it by another joint.
        let last = |path: &[usize]| {
            !path.is_empty() && !paths.iter().any(|other| other.len() > path.len() && other.starts_with(path))
        };
        // Feet are the lowest geoms of last links: shanks and hands also collide.
        let mut ends: Vec<usize> = contacts.iter().copied().filter(|&geom| last(path_of(geom))).collect();
        let ground = ends.iter().map(|&geom| lowest(geom)).fold(f64::INFINITY, f64::min);
        let height = height_above(model, &frames, ground);
        ends.retain(|&geom| lowest(geom) <= ground + NEAR_GROUND * height);
        let mut legs: Vec<Leg> = Vec::new();
        for &geom in &ends {
            let path = path_of(geom).clone();
            // Several geoms on one path are one foot.
            if legs.iter().any(|leg| leg.path == path) {
                continue;
            }
            let foot_geoms: Vec<usize> =
                contacts.iter().copied().filter(|&geom| *path_of(geom) == path).collect();
            legs.push(leg(model, path, &foot_geoms, lowest, SAME_FOOT * height, &frames));
        }
        let robot = || shown(&model.name);
        if legs.len() > MAX_LEGS {
            return Err(InitError::ManyLegs { robot: robot(), legs: legs.len(), max: MAX_LEGS });
        }
        if legs.is_empty() {
            // Last links without a geom that collides.
            let ends = (0..model.bodies.len()).filter(|&body| last(&paths[body]));
            let names: Vec<String> = ends.take(4).map(|body| shown(&model.bodies[body].name)).collect();
            return Err(match names.is_empty() {
                true => InitError::NoLegs { robot: robot() },
                false => InitError::Ghosts { robot: robot(), links: names.join(", ") },
            });
        }
        // One hand or tail that hangs lowest is no leg, unless the robot has no other limb.
        let limbs = (0..model.bodies.len()).filter(|&body| last(&paths[body]));
        let limbs: std::collections::HashSet<&Vec<usize>> = limbs.map(|body| &paths[body]).collect();
        if legs.len() == 1 && limbs.len() > 1 {
            return Err(InitError::NoLegs { robot: robot() });
        }
        // Lengths of the task are shares of this height.
        if !(height > 0.0 && height.is_finite()) {
            return Err(InitError::NoLegs { robot: robot() });
        }
        // Joints of a waist may be on the paths of several legs: the policy moves them, but they belong to no leg.
        let leg_paths: Vec<Vec<usize>> = legs.iter().map(|leg| leg.path.clone()).collect();
        for (index, leg) in legs.iter_mut().enumerate() {
            let shared = |joint: &usize| {
                leg_paths.iter().enumerate().any(|(other, path)| other != index && path.contains(joint))
            };
            leg.joints = leg.path.iter().copied().filter(|joint| !shared(joint)).collect();
        }
        let wheels: Vec<usize> = legs.iter().filter_map(|leg| wheel(model, leg, &frames)).collect();
        let of_leg = |joint: &usize| leg_paths.iter().any(|path| path.contains(joint));
        let of_legs = || (0..model.joints.len()).filter(of_leg);
        let driven = |joint: &usize| model.actuators.iter().any(|actuator| actuator.joint == *joint);
        // In a file that gives no joint of a leg a motor, all of them count as driven.
        let some_driven = of_legs().any(|joint| driven(&joint));
        let limp =
            |joint: &usize| model.only_follows(*joint) || of_leg(joint) && some_driven && !driven(joint);
        let passive: Vec<usize> = (0..model.joints.len()).filter(limp).collect();
        // A wheel without a motor cannot be driven: it is only passive.
        let wheels: Vec<usize> = wheels.into_iter().filter(|joint| !passive.contains(joint)).collect();
        let moves = |joint: &usize| !wheels.contains(joint) && !passive.contains(joint);
        let moved: Vec<usize> = of_legs().filter(moves).collect();
        legs.iter_mut().for_each(|leg| leg.joints.retain(moves));
        // A touch of the base is a fall.
        let base_geoms = contacts.into_iter().filter(|&geom| path_of(geom).is_empty()).collect();
        Ok(Self { gait: gait(&legs), moved, passive, wheels, base_geoms, legs })
    }

    /// Joints that the policy gives positions or velocities, by index.
    pub fn acting(&self) -> Vec<usize> {
        let mut acting: Vec<usize> = self.moved.iter().chain(&self.wheels).copied().collect();
        acting.sort_unstable();
        acting
    }

    /// Radius of the wheel that turns on this joint, m; `None` if it is no wheel.
    pub fn wheel_radius(&self, model: &Model, joint: usize) -> Option<f64> {
        let leg = self.legs.iter().find(|leg| leg.path.last() == Some(&joint))?;
        match model.geoms[*leg.geoms.first().filter(|_| self.wheels.contains(&joint))?].shape {
            Shape::Sphere { radius } | Shape::Capsule { radius, .. } | Shape::Cylinder { radius, .. } => {
                Some(radius)
            }
            Shape::Box { .. } => None,
        }
    }

    /// Whether it walks on two legs.
    pub fn biped(&self) -> bool {
        self.legs.len() == 2
    }

    /// Whether it walks on two legs with soles, so that it can stand without steps. Wheels are no soles.
    pub fn stands_on_soles(&self) -> bool {
        self.biped() && self.wheels.is_empty() && self.legs.iter().all(|leg| leg.sole)
    }

    /// States how the feet were found.
    pub fn how(&self) -> String {
        let geoms = self.legs.iter().map(|leg| leg.geoms.len()).max().unwrap_or_default();
        let several = if geoms > 1 { format!(" ({geoms} geoms a foot)") } else { String::new() };
        format!("the lowest geoms of the last links{several}")
    }

    /// The links of feet whose geoms have names that the reader made up; `None` where none has.
    pub fn links(&self, model: &Model) -> Option<String> {
        let of_leg = |leg: &Leg| shown(&model.bodies[model.geoms[*leg.geoms.first()?].body].name).into();
        self.legs.iter().any(|leg| made_up(&leg.foot)).then(|| {
            let links: Vec<String> = self.legs.iter().filter_map(of_leg).collect();
            format!("on {}", links.join(", "))
        })
    }

    /// The gait in words.
    pub fn gait_in_words(&self) -> String {
        if self.gait.is_empty() {
            return "none: the feet of the two sides do not match; set task.gait by hand".to_owned();
        }
        let name = match self.legs.len() {
            2 => "in turn",
            4 => "trot",
            _ => "alternating",
        };
        let groups: Vec<String> = self
            .gait
            .iter()
            .map(|group| group.iter().map(|&leg| shown(&self.legs[leg].foot)).collect::<Vec<_>>().join(" + "))
            .collect();
        format!("{name}: {}; forward is x, left is y", groups.join(", then "))
    }
}

/// Share of the highest joint's height above the ground below which the base's origin does not show how tall a robot is.
const LOW_ORIGIN: f64 = 0.25;

/// How tall a robot is, m: its base above `ground`, which is seen from the base's origin. Where a file has that origin at
/// the floor, its highest joint counts.
pub(super) fn height_above(model: &Model, frames: &[Frame], ground: f64) -> f64 {
    let anchor = |joint: &gaitfit_model::Joint| frames[joint.body].point(joint.pos)[2];
    let highest = model.joints.iter().map(anchor).fold(f64::NEG_INFINITY, f64::max);
    // `ground` is negative where the base's origin is above it.
    if -ground < LOW_ORIGIN * (highest - ground) { highest - ground } else { -ground }
}

fn leg(
    model: &Model,
    path: Vec<usize>,
    own: &[usize],
    lowest: impl Fn(usize) -> f64,
    near: f64,
    frames: &[Frame],
) -> Leg {
    let bottom = own.iter().map(|&geom| lowest(geom)).fold(f64::INFINITY, f64::min);
    // Only the lowest of the link's geoms are the foot; a shank on the same link is higher.
    let mut geoms: Vec<usize> = own.iter().copied().filter(|&geom| lowest(geom) <= bottom + near).collect();
    let (foot, geoms) = match geoms[..] {
        [only] => {
            // A link's name says more than one that was made up; the link is a foot only with all its geoms.
            let geom = &model.geoms[only];
            let link = &model.bodies[geom.body].name;
            let alone = !own.iter().any(|&other| other != only && model.geoms[other].body == geom.body);
            let free = !model.geoms.iter().any(|geom| geom.name == *link);
            let name = if made_up(&geom.name) && alone && free { link } else { &geom.name };
            (name.clone(), vec![only])
        }
        _ => {
            let body = geoms.first().map_or(0, |&geom| model.geoms[geom].body);
            let of_body = own.iter().filter(|&&geom| model.geoms[geom].body == body);
            // A geom of that name would be the foot.
            let free = !model.geoms.iter().any(|geom| geom.name == model.bodies[body].name);
            if free && of_body.copied().eq(geoms.iter().copied()) {
                (model.bodies[body].name.clone(), geoms)
            } else {
                // The link's name would take in more than the foot, so the lowest geom alone stands for it.
                geoms.sort_by(|&a, &b| lowest(a).total_cmp(&lowest(b)));
                geoms.truncate(1);
                (geoms.first().map_or_else(String::new, |&geom| model.geoms[geom].name.clone()), geoms)
            }
        }
    };
    // A single ball has no extent and can roll; anything else can stand flat.
    let sole =
        geoms.len() > 1 || geoms.iter().any(|&geom| !matches!(model.geoms[geom].shape, Shape::Sphere { .. }));
    let count = geoms.len().max(1) as f64;
    let centre = |geom: usize| frames[model.geoms[geom].body].point(model.geoms[geom].pos);
    let place = std::array::from_fn(|k| geoms.iter().map(|&geom| centre(geom)[k]).sum::<f64>() / count);
    Leg { foot, geoms, path, joints: Vec::new(), sole, place }
}

/// The joint on which a leg's foot turns as a wheel: without limits, and with a foot that is round about its axis.
fn wheel(model: &Model, leg: &Leg, frames: &[Frame]) -> Option<usize> {
    let &last = leg.joints.last()?;
    let hinge = &model.joints[last];
    // Several geoms are no wheel, and a joint with limits cannot roll on.
    let (&[geom], None, JointKind::Hinge) = (&leg.geoms[..], hinge.range, hinge.kind) else { return None };
    let geom = &model.geoms[geom];
    let (joint, foot) = (&frames[hinge.body], &frames[geom.body]);
    let axis = rotate(joint.quaternion, hinge.axis);
    let arm = sub(foot.point(geom.pos), joint.point(hinge.pos));
    // The foot's centre must lie on the joint's axis; how far along it does not matter.
    let along = dot(arm, axis);
    let off_axis = (dot(arm, arm) - along * along).max(0.0).sqrt();
    let round = match geom.shape {
        // A ball is round about any axis; others must also point along it.
        Shape::Sphere { radius } => off_axis < OFF_AXIS * radius,
        Shape::Cylinder { radius, .. } | Shape::Capsule { radius, .. } => {
            let turned = axes(product(foot.quaternion, geom.quat))[2];
            off_axis < OFF_AXIS * radius && dot(turned, axis).abs() > 1.0 - OFF_AXIS
        }
        Shape::Box { .. } => false,
    };
    round.then_some(last)
}

/// Whether a geom's name is one that the reader made up: `geom6`.
pub(super) fn made_up(name: &str) -> bool {
    let digits = name.strip_prefix("geom").map(|rest| rest.trim_end_matches('_'));
    digits.is_some_and(|digits| !digits.is_empty() && digits.chars().all(|letter| letter.is_ascii_digit()))
}

/// Joints from the base to a body.
pub fn path(model: &Model, body: usize) -> Vec<usize> {
    let mut bodies: Vec<usize> =
        std::iter::successors(Some(body), |&body| model.bodies[body].parent).collect();
    bodies.reverse();
    let joints_on =
        |body: usize| (0..model.joints.len()).filter(move |&joint| model.joints[joint].body == body);
    bodies.into_iter().flat_map(joints_on).collect()
}

/// Two groups that alternate: neighbours on a side, and the two of a pair, are in different groups. With four legs this is
/// a trot, with six the tripod gait.
fn gait(legs: &[Leg]) -> Vec<Vec<usize>> {
    let side = |left: bool| {
        let mut side: Vec<usize> =
            (0..legs.len()).filter(|&leg| (legs[leg].place[1] > 0.0) == left).collect();
        // From front to hind.
        side.sort_by(|&a, &b| legs[b].place[0].total_cmp(&legs[a].place[0]));
        side
    };
    let (left, right) = (side(true), side(false));
    // Legs that are no pairs have no known gait.
    if left.len() != right.len() {
        return Vec::new();
    }
    let mut groups = vec![Vec::new(), Vec::new()];
    for (place, (&left, &right)) in left.iter().zip(&right).enumerate() {
        groups[place % 2].push(left);
        groups[(place + 1) % 2].push(right);
    }
    groups.iter_mut().for_each(|group| group.sort_unstable());
    groups
}
