//! What a single joint has and the same joints of other legs do not have, as legs in the air show it: a spring (something bent,
//! a cable, a gas strut), or a motor of another strength.
//!
//! A spring adds stiffness · angle and a constant to the equation of motion of one joint (see [`crate::effects`]), and a motor of
//! another strength adds a part of its torque. Every joint gets each of them, one at a time. [`Judged`] compares it with its
//! siblings: what they share is an error of the model.

use crate::added::Equations;
use crate::effect::{Effect, EffectKind};
use crate::equations::Window;
use crate::odd::{Judged, Measured};
use crate::regression::Group;
use crate::report::SwingSettings;
use gaitfit_log::Estimate;
use gaitfit_model::Model;

/// Springs weaker than this part of the joint's position gain do not count.
const MIN_SPRING: f64 = 0.02;
/// Strengths that differ by less than this part of the torque do not count.
const MIN_STRENGTH: f64 = 0.05;
/// The least size of a joint itself, as a part of its difference from its siblings.
const OWN: f64 = 0.5;
/// Min number of windows of a joint.
const ENOUGH: usize = 100;

/// A spring of one joint, or a motor of another strength than its siblings, as swings show it.
struct Single<'a> {
    joint: usize,
    /// Stiffness of a spring, N·m/rad, or torque beyond what gains and limits state, as a part of it.
    size: Measured<'a>,
    /// The part of what the equations leave that it explains.
    share: f64,
    /// Torque of a spring at angle 0, N·m; 0 for a strength.
    torque: f64,
}

/// Springs and motor strengths of single joints, of all groups; one effect and one joint at a time.
#[derive(Default)]
pub(crate) struct Singles<'a> {
    springs: Vec<Single<'a>>,
    strengths: Vec<Single<'a>>,
}

/// The windows of a group's joints. They have at least `clearance_m`. A spring may keep a foot low, so a joint with too few such
/// windows has its own limit: the largest clearance that enough of its windows exceed.
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

impl<'a> Singles<'a> {
    /// Adds the joints of a group. `steps`: the delay in steps.
    pub fn add(&mut self, name: &'a str, joints: &[usize], group: &Group<'_>, steps: f64) {
        let Some(equations) = Equations::new(group, steps) else { return };
        let Some(base) = equations.base() else { return };
        // The column of one joint: the others of its group get 0, so the effect belongs to this joint alone.
        let column = |joint: usize, of: &dyn Fn(&Window) -> f64| -> Vec<f64> {
            group.windows.iter().map(|one| if one.joint == joint { of(one) } else { 0.0 }).collect()
        };
        let spring = |&joint: &usize| {
            let angle = column(joint, &|one| one.angle);
            let (size, share) = base.added(&angle)?;
            let gain = column(joint, &|one| one.stiffness).into_iter().fold(0.0, f64::max);
            // The joint's offset with the spring's part removed.
            let without: Vec<f64> =
                equations.known.iter().zip(&angle).map(|(known, angle)| known - size.value * angle).collect();
            // The motor gives the offset against the spring's torque, hence the minus.
            let torque = -base.values(&without)[group.offset(joint)?];
            let size =
                Measured { group: name, value: size.value, deviation: size.error, min: MIN_SPRING * gain };
            Some(Single { joint, size, share, torque })
        };
        let strength = |&joint: &usize| {
            let motor = column(joint, &|one| one.motor + one.driven_at(steps));
            let (size, share) = base.added(&motor)?;
            // More torque than asked for stands on the known side.
            let size = Measured { group: name, value: -size.value, deviation: size.error, min: MIN_STRENGTH };
            Some(Single { joint, size, share, torque: 0.0 })
        };
        self.springs.extend(joints.iter().filter_map(spring));
        self.strengths.extend(joints.iter().filter_map(strength));
    }

    /// The effects that the same joints of other legs do not have. A joint has one of them: a weak motor also looks like a
    /// spring.
    pub fn odd(&self, model: &Model) -> Vec<Effect> {
        let mut effects = odd(model, &self.springs, EffectKind::OddSpring);
        for strength in odd(model, &self.strengths, EffectKind::OddStrength) {
            match effects.iter_mut().find(|spring| spring.of == strength.of) {
                Some(spring) if spring.share < strength.share => *spring = strength,
                Some(_) => {}
                None => effects.push(strength),
            }
        }
        effects
    }
}

/// Those of `singles` that differ from at least two siblings. With one sibling nothing says which of the two is odd; and without
/// siblings what the model lacks would count as the joint's own.
fn odd(model: &Model, singles: &[Single<'_>], kind: EffectKind) -> Vec<Effect> {
    let sizes: Vec<Measured<'_>> = singles.iter().map(|single| single.size).collect();
    let judged = Judged::new(&sizes);
    let siblings = |at: usize| sizes.iter().filter(|one| one.group == sizes[at].group).count() - 1;
    // Beside two springs a healthy joint differs from its siblings too. It has no size of its own.
    let has_own = |at: usize| sizes[at].value.abs() >= OWN * judged.off[at].abs();
    let effect = |at: usize| {
        let Single { joint, size, share, torque } = &singles[at];
        let difference = Estimate { value: judged.off[at], error: judged.limit[at] / Judged::LIMIT };
        // The spring is at rest where its torque at angle 0 and stiffness · angle cancel.
        let rest = (kind == EffectKind::OddSpring).then(|| torque / size.value);
        Effect { rest, ..Effect::new(kind, &model.joints[*joint].name, difference, *share) }
    };
    judged.odd().into_iter().filter(|&at| siblings(at) > 1 && has_own(at)).map(effect).collect()
}
