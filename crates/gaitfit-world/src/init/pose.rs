//! The pose in which a robot stands.

use super::anatomy::{Anatomy, Leg};
use super::level::Sole;
use super::sizes::Sizes;
use gaitfit_model::kinematics::{Frame, body_frames};
use gaitfit_model::rotation::{dot, quat_of, rotate, sub, unit, up};
use gaitfit_model::{JointKind, Model, shown};

/// Names of keyframes that stand, best first.
const STANDING: [&str; 5] = ["home", "stand", "standing", "default", "knees_bent"];
/// Distance from hip to foot as a share of the straight leg's length: robots on four legs bend them, robots on two
/// stand nearly straight.
const BENT: f64 = 0.8;
const NEARLY_STRAIGHT: f64 = 0.95;
/// Share of the straight leg's length below which a keyframe has folded legs: the robot lies. Unitree's own B2 has
/// 0.2, standing robots 0.6 or more.
const FOLDED: f64 = 0.35;
/// Legs that the file draws shorter than this share are folded.
const DRAWN_SHORT: f64 = 0.6;
/// How far a keyframe may be beyond the limits of a joint, rad.
const BEYOND: f64 = 0.1;
/// Sine of the angle at the knee from which a leg counts as bent as the file draws it.
const DRAWN_BENT: f64 = 0.1;
/// Share of a joint's range that a stance keeps free at each limit.
const ROOM: f64 = 0.2;
/// Steps of the search for a leg's angles, and the max number of poses that it tries.
const STEPS: usize = 400;
const MAX_POSES: usize = 8000;

/// A pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    /// rad, of slides m; model order.
    pub angles: Vec<f64>,
    /// The keyframe that has it.
    pub keyframe: Option<String>,
}

impl Pose {
    /// Source of the pose, in words.
    pub fn how(&self, sizes: &Sizes) -> String {
        match (&self.keyframe, &sizes.hanging) {
            (Some(name), _) => format!("keyframe `{}`", shown(name)),
            (None, None) => "a guess: feet under the hips, knees bent, base level".to_owned(),
            (None, Some((feet, above))) => format!(
                "a guess that does not stand level: {} up to {above:.2} m above the ground; correct it",
                feet.join(", ")
            ),
        }
    }
}

/// A keyframe that stands, or every joint at its reference as far as its range allows.
pub fn start(model: &Model) -> Pose {
    // A free joint's position (3) and quaternion (4) come first in `qpos`. A fixed base has neither, and is upright as
    // it is.
    let first = model.nq() - model.joints.len();
    // A stance beyond the joints' own limits cannot be held; bounded to them it is another one.
    let inside = |joint: &gaitfit_model::Joint, angle: &f64| {
        (within(joint, *angle) - angle).abs() <= joint.kind.like("rad", BEYOND)
    };
    let stands = |qpos: &[f64]| {
        qpos.len() == model.nq()
            && model.joints.iter().zip(&qpos[first..]).all(|(joint, angle)| inside(joint, angle))
            && qpos.iter().all(|x| x.is_finite())
            && qpos[..first].get(3..7).is_none_or(|q| {
                let q: [f32; 4] = std::array::from_fn(|k| q[k] as f32);
                // Upright within 26°.
                up(quat_of(&q))[2] > 0.9
            })
    };
    // Keyframes named after standing come before others, which may show anything.
    let named = STANDING.iter().filter_map(|name| model.keyframe(name));
    let of_joints = named.chain(&model.keyframes).find(|key| stands(&key.qpos));
    match of_joints {
        Some(key) => {
            let angles =
                model.joints.iter().zip(&key.qpos[first..]).map(|(joint, &angle)| within(joint, angle));
            Pose { angles: angles.collect(), keyframe: Some(key.name.clone()) }
        }
        None => Pose { angles: drawn(model), keyframe: None },
    }
}

/// Every joint at its reference, as the file draws the robot, as far as its range allows. rad, model order.
pub fn drawn(model: &Model) -> Vec<f64> {
    let mut angles: Vec<f64> = model.joints.iter().map(|joint| within(joint, joint.reference)).collect();
    model.couple(&mut angles);
    angles
}

fn within(joint: &gaitfit_model::Joint, angle: f64) -> f64 {
    joint.range.map_or(angle, |[low, high]| angle.clamp(low, high.max(low)))
}

/// `angle` as far as it leaves room to the joint's limits: nobody stands with a knee at its stop.
fn well_within(joint: &gaitfit_model::Joint, angle: f64) -> f64 {
    joint.range.map_or(angle, |[low, high]| {
        let room = ROOM * (high - low).max(0.0);
        angle.clamp(low + room, (high - room).max(low + room))
    })
}

/// The pose itself where a keyframe has it; else, and where the keyframe's legs are folded, every leg bent such that its foot
/// is under its hip.
pub fn standing(model: &Model, start: Pose, anatomy: &Anatomy) -> Pose {
    let folded = |leg: &Leg| share_of(model, leg, &start.angles).is_some_and(|share| share < FOLDED);
    if start.keyframe.is_some() && !anatomy.legs.iter().any(folded) {
        return start;
    }
    let mut angles = start.angles;
    let usual = if anatomy.biped() { NEARLY_STRAIGHT } else { BENT };
    for leg in &anatomy.legs {
        // Legs that the file draws bent stay as long.
        let drawn = share_of(model, leg, &angles).filter(|share| *share > DRAWN_SHORT);
        let share = drawn.map_or(usual, |drawn| drawn.min(usual));
        extend(model, leg, &mut angles);
        bend(model, leg, share, anatomy.biped(), &mut angles);
    }
    Pose { angles, keyframe: None }
}

/// Lifts the foot of a leg without knees by its slides.
fn draw_in(model: &Model, leg: &Leg, angles: &mut [f64]) {
    let slides = leg.joints.iter().filter(|&&joint| model.joints[joint].kind == JointKind::Slide);
    for &joint in slides {
        let frames = body_frames(model, &Frame::WORLD, angles);
        let (slide, at) = (&model.joints[joint], foot(model, leg, &frames));
        let hip = leg.joints.first().map_or(at, |&hip| anchor(model, hip, &frames));
        // By how much the foot rises for each metre of the slide.
        let rise = slide.axis_at(&frames[slide.body]).lever(at)[2];
        // As much as a leg with knees lifts its foot.
        let by = (1.0 - LIFTED) * (hip[2] - at[2]);
        // A slide that points more sideways than up does not lift the foot.
        if rise.abs() > 0.5 {
            angles[joint] = within(slide, angles[joint] + by / rise);
            return;
        }
    }
}

/// Puts the slides of a leg in the middle of their range: at an end a leg could not spring.
fn extend(model: &Model, leg: &Leg, angles: &mut [f64]) {
    for &joint in &leg.joints {
        if let (JointKind::Slide, Some([low, high])) = (model.joints[joint].kind, model.joints[joint].range) {
            angles[joint] = 0.5 * (low + high);
        }
    }
}

/// Distance from hip to a lifted foot, as a share of the distance in the stance.
const LIFTED: f64 = 0.88;

/// A stance with some legs lifted: their feet are nearer to their hips, as far as the legs bend. `angles`: rad, model order.
pub fn lifted(model: &Model, anatomy: &Anatomy, legs: &[usize], angles: &[f64]) -> Vec<f64> {
    let mut lifted = angles.to_vec();
    for leg in legs.iter().map(|&leg| &anatomy.legs[leg]) {
        match share_of(model, leg, angles) {
            Some(share) => bend(model, leg, LIFTED * share, anatomy.biped(), &mut lifted),
            None => draw_in(model, leg, &mut lifted),
        }
    }
    lifted
}

/// The base's sideways axis, about which knees turn.
const SIDEWAYS: [f64; 3] = [0.0, 1.0, 0.0];
/// Cosine of the angle between a leg's direction from the base and the plane of a knee that points there.
const OUTWARD: f64 = 0.4;

/// A leg as far as it bends in a vertical plane.
struct Chain {
    /// The axis about which it bends, level and of length 1: sideways, or across a leg that points away from the base.
    side: [f64; 3],
    /// Joints that turn about this axis, from the hip on.
    pitch: Vec<usize>,
    /// Joints of `pitch` that do not follow others.
    free: Vec<usize>,
    /// Length of the straight leg, m: to the foot, or to the ankle where the foot lies flat.
    reach: f64,
    /// Whether the foot lies flat.
    flat: bool,
}

impl Chain {
    /// Reads a leg with its joints at `frames`; `None` if it does not bend, or has no length.
    fn new(model: &Model, leg: &Leg, frames: &[Frame]) -> Option<Self> {
        // Joints that follow others bend the leg too, though they have no angle of their own to choose.
        let of_leg = |joint: &usize| leg.joints.contains(joint) || model.only_follows(*joint);
        let turning = |side: [f64; 3]| -> Vec<usize> {
            let turns = |joint: &usize| {
                // Within 45° of the axis.
                model.joints[*joint].kind.is_hinge() && dot(side, axis(model, *joint, frames)).abs() > 0.7
            };
            leg.path.iter().copied().filter(|joint| of_leg(joint) && turns(joint)).collect()
        };
        let (mut side, mut pitch) = (SIDEWAYS, turning(SIDEWAYS));
        if pitch.is_empty()
            && let Some(other) = across(model, leg, frames)
        {
            (side, pitch) = (other, turning(other));
        }
        let free: Vec<usize> = pitch.iter().copied().filter(|&joint| !model.only_follows(joint)).collect();
        // One joint alone cannot bring the foot nearer to the hip.
        if pitch.len() < 2 || free.is_empty() {
            return None;
        }
        let length = |a: [f64; 3], b: [f64; 3]| {
            let d = sub(a, b);
            dot(d, d).sqrt()
        };
        let joints: Vec<[f64; 3]> = pitch.iter().map(|&joint| anchor(model, joint, frames)).collect();
        let chain: f64 = joints.windows(2).map(|pair| length(pair[0], pair[1])).sum();
        // Hip and knee place the ankle; only a third joint can level the sole.
        let flat = leg.sole && pitch.len() > 2 && side == SIDEWAYS;
        let reach =
            if flat { chain } else { chain + length(joints[joints.len() - 1], foot(model, leg, frames)) };
        (reach > 0.0 && reach.is_finite()).then_some(Self { side, pitch, free, reach, flat })
    }

    /// A point or a direction in the leg's axes: x in the plane in which it bends, y along `side`, z up.
    fn in_plane(&self, v: [f64; 3]) -> [f64; 3] {
        [dot([self.side[1], -self.side[0], 0.0], v), dot(self.side, v), v[2]]
    }

    /// The leg's end: the foot, or the ankle where the foot lies flat.
    fn end(&self, model: &Model, leg: &Leg, frames: &[Frame]) -> [f64; 3] {
        match self.pitch.last() {
            Some(&last) if self.flat => anchor(model, last, frames),
            _ => foot(model, leg, frames),
        }
    }
}

/// The axis of a knee that bends towards the base or away from it, level and of length 1, such that x of the plane points to
/// the base: knees of such legs point outward, as others point backward.
fn across(model: &Model, leg: &Leg, frames: &[Frame]) -> Option<[f64; 3]> {
    let axes = leg.joints.iter().rev().filter(|&&joint| model.joints[joint].kind.is_hinge());
    let level = |axis: [f64; 3]| unit([axis[0], axis[1], 0.0]).filter(|_| axis[2].abs() < 0.7);
    let side = axes.map(|&joint| axis(model, joint, frames)).find_map(level)?;
    let outward = unit([leg.place[0], leg.place[1], 0.0])?;
    let along = side[1] * outward[0] - side[0] * outward[1];
    (along.abs() > OUTWARD).then_some(side.map(|part| -along.signum() * part))
}

/// A joint's axis, world axes.
fn axis(model: &Model, joint: usize, frames: &[Frame]) -> [f64; 3] {
    let hinge = &model.joints[joint];
    rotate(frames[hinge.body].quaternion, hinge.axis)
}

/// Position of a joint's anchor, m, world axes.
fn anchor(model: &Model, joint: usize, frames: &[Frame]) -> [f64; 3] {
    frames[model.joints[joint].body].point(model.joints[joint].pos)
}

/// Middle of a leg's foot, m, world axes.
fn foot(model: &Model, leg: &Leg, frames: &[Frame]) -> [f64; 3] {
    let count = leg.geoms.len().max(1) as f64;
    let coordinate =
        |k: usize, geom: &usize| frames[model.geoms[*geom].body].point(model.geoms[*geom].pos)[k];
    std::array::from_fn(|k| leg.geoms.iter().map(|geom| coordinate(k, geom)).sum::<f64>() / count)
}

/// Share of a straight leg's length by which the foot is below the hip.
fn share_of(model: &Model, leg: &Leg, angles: &[f64]) -> Option<f64> {
    let frames = body_frames(model, &Frame::WORLD, angles);
    let chain = Chain::new(model, leg, &frames)?;
    let hip = anchor(model, chain.pitch[0], &frames);
    Some((hip[2] - chain.end(model, leg, &frames)[2]) / chain.reach)
}

/// Bends a leg in its vertical plane. A leg that is bent as the file draws it is bent more, to the same side: so front and
/// hind knees may point to each other. Other knees point backward on four legs and forward on two, where their range lets
/// them.
fn bend(model: &Model, leg: &Leg, share: f64, forward: bool, angles: &mut [f64]) {
    let rest = body_frames(model, &Frame::WORLD, angles);
    let Some(chain) = Chain::new(model, leg, &rest) else { return };
    let (pitch, reach, flat) = (&chain.pitch, chain.reach, chain.flat);
    let (hip, last) = (pitch[0], pitch[pitch.len() - 1]);
    let axis = |joint: usize| axis(model, joint, &rest);
    let anchor = |joint: usize, frames: &[Frame]| anchor(model, joint, frames);
    let target = |frames: &[Frame]| chain.end(model, leg, frames);
    let sole = if flat { Sole::new(model, leg, &rest) } else { None };
    let level = |frames: &[Frame]| {
        if let Some(sole) = &sole {
            return sole.tilt(frames);
        }
        // As the file draws it.
        let body = model.joints[last].body;
        let before = rotate(rest[body].quaternion, [1.0, 0.0, 0.0]);
        let now = rotate(frames[body].quaternion, [1.0, 0.0, 0.0]);
        now[2] - before[2]
    };
    // The search moves the free joints; those that follow must be moved along before the pose is judged.
    let coupled = |angles: &[f64]| {
        let mut coupled = angles.to_vec();
        model.couple(&mut coupled);
        body_frames(model, &Frame::WORLD, &coupled)
    };
    // The foot shall be under the hip, at `share` of the leg's reach below it, and a sole level.
    let cost = |angles: &[f64]| {
        let frames = coupled(angles);
        let (hip, end) = (anchor(hip, &frames), target(&frames));
        let (forward, down) = (chain.in_plane(sub(end, hip))[0] / reach, (hip[2] - end[2]) / reach - share);
        let tilt = if flat { level(&frames) } else { 0.0 };
        forward * forward + down * down + tilt * tilt
    };
    let knee_ahead = |angles: &[f64]| {
        let frames = coupled(angles);
        chain.in_plane(sub(anchor(pitch[1], &frames), anchor(hip, &frames)))[0]
    };
    let [at_hip, knee, end] =
        [anchor(hip, &rest), anchor(pitch[1], &rest), target(&rest)].map(|point| chain.in_plane(point));
    let drawn = knee_forward(at_hip, knee, end);
    let forward = drawn.unwrap_or(forward);
    // The knee may bend to either side, so the search starts once on each.
    let mut best: Option<(f64, Vec<f64>)> = None;
    for sign in [1.0, -1.0] {
        let mut bent = angles.to_vec();
        for (place, &joint) in pitch.iter().enumerate().filter(|(_, joint)| chain.free.contains(joint)) {
            // With thigh and shank of equal length the foot stays under the hip if the knee turns back by twice the
            // hip's angle. The ankle takes the rest, so that the sole stays level.
            let turn = [0.6, -1.2, 0.6][place.min(2)] * sign * chain.in_plane(axis(joint))[1].signum();
            bent[joint] = well_within(&model.joints[joint], angles[joint] + turn);
        }
        let reached = descend(model, &chain.free, &mut bent, cost);
        let wrong_way = (knee_ahead(&bent) > 0.0) != forward;
        // Costs are squared shares of the leg's reach: a knee on the wrong side weighs as much as a foot that misses
        // by 3 %.
        let rated = reached + if wrong_way { 1e-3 } else { 0.0 };
        if best.as_ref().is_none_or(|(other, _)| rated < *other) {
            best = Some((rated, bent));
        }
    }
    if let Some((_, bent)) = best {
        angles.copy_from_slice(&bent);
        model.couple(angles);
    }
}

/// Whether the knee lies before the line from hip to foot; `None` if the leg is nearly straight. The leg's axes, m.
fn knee_forward(hip: [f64; 3], knee: [f64; 3], foot: [f64; 3]) -> Option<bool> {
    let (thigh, shank) = (sub(knee, hip), sub(foot, knee));
    let length = (dot(thigh, thigh) * dot(shank, shank)).sqrt();
    let sine = (thigh[0] * shank[2] - thigh[2] * shank[0]) / length;
    (sine.abs() > DRAWN_BENT).then_some(sine < 0.0)
}

/// Search along the joints, one after the other, with steps that grow where they help and shrink where they do not.
fn descend(model: &Model, joints: &[usize], angles: &mut [f64], cost: impl Fn(&[f64]) -> f64) -> f64 {
    let mut best = cost(angles);
    // Limits and couplings make the cost non-smooth, so the search takes no derivatives.
    let mut steps = vec![0.2; joints.len()];
    for _ in 0..STEPS.min(MAX_POSES / (2 * joints.len()).max(1)) {
        for (step, &joint) in steps.iter_mut().zip(joints) {
            let before = angles[joint];
            let mut better = false;
            for sign in [1.0, -1.0] {
                angles[joint] = well_within(&model.joints[joint], before + sign * *step);
                let value = cost(angles);
                if value < best {
                    (best, better) = (value, true);
                    break;
                }
                angles[joint] = before;
            }
            // Growing more slowly than shrinking: a step that is too long costs two poses each time.
            *step *= if better { 1.3 } else { 0.6 };
            // Below 1e-6 rad nothing changes. A step of more than half a radian could jump to another way of
            // bending.
            *step = step.clamp(1e-6, 0.5);
        }
    }
    best
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_model::{ReadOptions, read_mjcf_str};

    #[test]
    fn a_keyframe_of_a_fixed_base_has_the_angles_of_the_joints_alone() {
        let arm = |joints: usize, qpos: &str| {
            let bodies = "<body><joint axis=\"0 1 0\"/><geom size=\".1\"/>".repeat(joints);
            let text = format!(
                "<mujoco><worldbody>{bodies}{}</worldbody><keyframe><key name=\"home\" qpos=\"{qpos}\"/></keyframe>\
                 </mujoco>",
                "</body>".repeat(joints)
            );
            start(&read_mjcf_str(&text, &ReadOptions::default()).unwrap())
        };
        let one = arm(1, "0.4");
        assert_eq!((one.angles, one.keyframe.as_deref()), (vec![0.4], Some("home")));
        assert_eq!(arm(8, "1 2 3 4 5 6 7 8").angles, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]);
    }

    #[test]
    fn legs_bend_to_the_side_to_which_they_are_drawn() {
        // Thigh straight down, shank turned by 0.25 rad: the foot ahead of the knee, behind it, and a straight leg.
        let (hip, knee) = ([0.0, 0.0, 0.6], [0.0, 0.1, 0.3]);
        assert_eq!(knee_forward(hip, knee, [0.08, 0.1, 0.0]), Some(false));
        assert_eq!(knee_forward(hip, knee, [-0.08, 0.1, 0.0]), Some(true));
        assert_eq!(knee_forward(hip, knee, [0.01, 0.1, 0.0]), None);
        assert_eq!(knee_forward(hip, hip, hip), None);
    }
}
