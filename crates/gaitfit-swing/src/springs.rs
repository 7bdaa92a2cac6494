//! Springs on single joints that the same joints of other legs do not have, as legs in the air show them: something bent, a
//! cable, a gas strut.
//!
//! The torque of a spring adds stiffness · angle and a constant to the equation of motion of one joint (see [`crate::effects`]).
//! Every joint gets such a spring, one at a time. [`Judged`] compares it with those of its siblings: what they share is an error
//! of the model.

use crate::effects::{Effect, EffectKind, Equations};
use crate::equations::Window;
use crate::odd::{Judged, Stiffness};
use crate::regression::Group;
use crate::report::SwingSettings;
use gaitfit_log::Estimate;
use gaitfit_model::Model;

/// Springs weaker than this part of the joint's position gain do not count.
const MIN_SPRING: f64 = 0.02;
/// So many windows of a joint are enough to see its spring.
const ENOUGH: usize = 100;

/// A spring on one joint beside the model's own, as swings show it.
pub(crate) struct Spring<'a> {
    joint: usize,
    /// Stiffness, N·m/rad, with the joint's group and the smallest difference from its siblings that counts.
    stiffness: Stiffness<'a>,
    /// The part of what the equations leave that it explains.
    share: f64,
    /// Torque at angle 0, N·m: stiffness times rest angle.
    torque: f64,
}

/// The windows of a group's joints with at least `clearance_m`. A spring may keep a foot low: its joint's windows have the largest
/// clearance that enough of them have.
pub(crate) fn seen<'a>(
    windows: &'a [Window],
    joints: &[usize],
    settings: &SwingSettings,
    clearance_m: f64,
) -> Vec<&'a Window> {
    let of_joint = |joint: usize| {
        let windows: Vec<&Window> = windows.iter().filter(|window| window.joint == joint).collect();
        let above = |least: f64| windows.iter().copied().filter(move |window| window.clearance > least);
        let tried = settings.clearances_m.iter().copied().filter(|least| *least <= clearance_m);
        let least = tried.rev().find(|least| above(*least).count() >= ENOUGH).unwrap_or(clearance_m);
        above(least).collect::<Vec<&Window>>()
    };
    joints.iter().flat_map(|&joint| of_joint(joint)).collect()
}

/// A spring for each joint of a group, one at a time.
pub(crate) fn of_group<'a>(
    name: &'a str,
    joints: &[usize],
    group: &Group<'_>,
    steps: f64,
) -> Vec<Spring<'a>> {
    let Some(equations) = Equations::new(group, steps) else { return Vec::new() };
    let Some(base) = equations.base() else { return Vec::new() };
    let spring = |joint: usize| {
        let of_joint = |one: &&&Window| one.joint == joint;
        let angle = |one: &&Window| if one.joint == joint { one.angle } else { 0.0 };
        let angle: Vec<f64> = group.windows.iter().map(angle).collect();
        let (size, share) = base.added(&angle)?;
        let gain = group.windows.iter().filter(of_joint).map(|one| one.stiffness);
        let min = MIN_SPRING * gain.fold(0.0, f64::max);
        // The spring takes −stiffness · angle + torque from what the joint's offset says without it.
        let without: Vec<f64> =
            equations.known.iter().zip(&angle).map(|(known, angle)| known - size.value * angle).collect();
        let torque = -base.values(&without)[group.offset(joint)?];
        let stiffness = Stiffness { group: name, value: size.value, deviation: size.error, min };
        Some(Spring { joint, stiffness, share, torque })
    };
    joints.iter().filter_map(|&joint| spring(joint)).collect()
}

/// Springs that the joint's siblings do not have.
pub(crate) fn odd(model: &Model, springs: &[Spring<'_>]) -> Vec<Effect> {
    let stiffness: Vec<Stiffness<'_>> = springs.iter().map(|spring| spring.stiffness).collect();
    let judged = Judged::new(&stiffness);
    // A joint without siblings is compared with nothing, so what the model lacks would count as a spring. Of two siblings each
    // differs from the other, and the stiffer one has the spring.
    let is_alone_or_softer = |at: usize| {
        let own = stiffness[at];
        let siblings =
            stiffness.iter().enumerate().filter(|(other, one)| *other != at && one.group == own.group);
        let siblings: Vec<f64> = siblings.map(|(_, one)| one.value.abs()).collect();
        match siblings[..] {
            [] => true,
            [other] => other > own.value.abs(),
            _ => false,
        }
    };
    let effect = |at: usize| {
        let Spring { joint, stiffness, share, torque } = &springs[at];
        let size = Estimate { value: judged.off[at], error: judged.limit[at] / Judged::LIMIT };
        let rest = Some(torque / stiffness.value);
        Effect { rest, ..Effect::new(EffectKind::OddSpring, &model.joints[*joint].name, size, *share) }
    };
    judged.odd().into_iter().filter(|&at| !is_alone_or_softer(at)).map(effect).collect()
}
