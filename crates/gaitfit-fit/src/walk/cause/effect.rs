//! The cause behind an effect of joints or ground: one function a kind, with the limits that it must pass and its
//! sentence.

use super::{Cause, CauseKind, matters};
use gaitfit_log::Estimate;
use gaitfit_swing::{Effect, EffectKind, SwingReport};

/// The size of an effect is sure if it is this many standard errors from 0. There are many effects of joints, so each
/// of them needs more (`SURER`).
const SURE: f64 = 4.0;
const SURER: f64 = 8.0;
/// Shares of the residual that an effect must explain.
const OF_SWINGS: f64 = 0.1;
const OF_ONE_JOINT: f64 = 0.08;
const OF_HEIGHTS: f64 = 0.3;
/// Play must explain less, because it changes the heights of feet little.
const OF_PLAY: f64 = 0.02;
/// Joints with much play respond less to their motors in swings than their masses imply: by this share of the torque.
/// This explains at least the second share of the swings' residual.
const SLACK: [f64; 2] = [-0.25, 0.25];
/// A larger estimate of play has another cause, rad.
const MAX_PLAY: f64 = 0.1;
/// Max friction under load of a gear, N·m for each N·m. A larger estimate has another cause.
const MAX_LOAD_FRICTION: f64 = 0.4;
/// If the friction of a joint differs by more than this many times its group's, the reason is another one.
const TOO_ODD: f64 = 3.0;
/// A motor that lacks more than this part of its torque does not swing a leg. A larger lack has another cause.
const WEAKEST: f64 = -0.9;

/// What an effect is named as.
struct Named {
    kind: CauseKind,
    unit: &'static str,
    /// Smallest size that changes how a robot walks.
    matters: f64,
    text: String,
}

/// The cause that an effect shows; absent if it is not sure, explains little, is small, or has another reason.
/// `swings`: estimates of joints from legs in the air.
pub fn of_effect(effect: &Effect, swings: Option<&SwingReport>) -> Option<Cause> {
    let named = match effect.kind {
        EffectKind::LoadFriction => load_friction(effect),
        EffectKind::Elasticity => elasticity(effect),
        EffectKind::Backlash => play_of_stances(effect),
        EffectKind::Strength => play_of_swings(effect),
        EffectKind::OddFriction => odd_friction(effect, swings),
        EffectKind::OddSpring => odd_spring(effect),
        EffectKind::OddStrength => odd_strength(effect),
        EffectKind::UnevenGround => ground(effect),
    }?;
    let Named { kind, unit, matters, text } = named;
    let size = effect.beyond();
    let weight = size.value.abs() / matters;
    Some(Cause { kind, of: effect.of.clone(), size, unit: unit.to_owned(), weight, text })
}

/// The joint group whose twist under load `effects` show most surely, if they show any.
pub fn twisting(effects: &[Effect], swings: Option<&SwingReport>) -> Option<String> {
    let twists =
        |effect: &&Effect| effect.kind == EffectKind::Elasticity && of_effect(effect, swings).is_some();
    let surest = |a: &&Effect, b: &&Effect| a.sure().total_cmp(&b.sure());
    effects.iter().filter(twists).max_by(surest).map(|effect| effect.of.clone())
}

/// Springs and strengths of single joints among the causes that `effects` show.
pub fn singles<'a>(
    effects: &'a [Effect],
    swings: Option<&'a SwingReport>,
) -> impl Iterator<Item = &'a Effect> {
    let is_cause = move |effect: &&Effect| of_effect(effect, swings).is_some();
    let is_single = |effect: &&Effect| matches!(effect.kind, EffectKind::OddSpring | EffectKind::OddStrength);
    effects.iter().filter(is_single).filter(is_cause)
}

/// Whether `size` is above `min`, and the effect is surer than `sure` errors and explains more than `share`.
fn passes(effect: &Effect, size: f64, min: f64, sure: f64, share: f64) -> bool {
    size > min && effect.sure() > sure && effect.share > share
}

/// Whether one joint differs enough from its siblings, in either direction.
fn joint_differs(effect: &Effect, min: f64) -> bool {
    passes(effect, effect.beyond().value.abs(), min, SURER, OF_ONE_JOINT)
}

/// The part that the effect explains, %.
fn percent(effect: &Effect) -> f64 {
    100.0 * effect.share
}

/// How much of the residual of a signal the effect explains, as the end of a sentence. The part belongs to the whole
/// size, so it is left out of a comparison.
fn explains(effect: &Effect, signal: &str) -> String {
    match effect.without {
        Some(_) => String::new(),
        None => format!(", which explains {:.0} % of the residual of {signal}", percent(effect)),
    }
}

fn more_or_less(value: f64) -> &'static str {
    if value > 0.0 { "more" } else { "less" }
}

fn load_friction(effect: &Effect) -> Option<Named> {
    let Estimate { value, error } = effect.beyond();
    if !passes(effect, value, matters::LOAD, SURER, OF_SWINGS) || value >= MAX_LOAD_FRICTION {
        return None;
    }
    let text = format!(
        "dry friction of {} grows by {value:.3} ± {error:.3} N·m for each N·m of the motor's torque{} (fit it: load_friction)",
        effect.of,
        explains(effect, "legs in the air")
    );
    Some(Named { kind: CauseKind::LoadFriction, unit: "-", matters: matters::LOAD, text })
}

fn elasticity(effect: &Effect) -> Option<Named> {
    let Estimate { value, error } = effect.beyond();
    if !passes(effect, value, matters::TWIST, SURER, OF_HEIGHTS) {
        return None;
    }
    let text = format!(
        "{} joints twist between motor and link by {value:.4} ± {error:.4} rad for each N·m, or {:.0} N·m/rad{} (fit it: \
         compliance)",
        effect.of,
        1.0 / value,
        explains(effect, "the heights of standing feet")
    );
    Some(Named { kind: CauseKind::Elasticity, unit: "rad/(N·m)", matters: matters::TWIST, text })
}

/// Play as heights of standing feet show it. Without simulated robots, it cannot be told from the geometry of standing
/// legs.
fn play_of_stances(effect: &Effect) -> Option<Named> {
    let Estimate { value, error } = effect.beyond();
    effect.without?;
    if !passes(effect, value, matters::PLAY, SURE, OF_PLAY) || value >= MAX_PLAY {
        return None;
    }
    let text = format!(
        "{} joints have about {value:.3} ± {error:.3} rad of play between motor and link: the heights of standing feet show \
         this much more than those of simulated robots without play (fit it: play)",
        effect.of
    );
    Some(Named { kind: CauseKind::Backlash, unit: "rad", matters: matters::PLAY, text })
}

/// Play as legs in the air show it: they respond less to their motors.
fn play_of_swings(effect: &Effect) -> Option<Named> {
    let Estimate { value, error } = effect.beyond();
    effect.without?;
    let [slack, share] = SLACK;
    // Play makes the response smaller, so the sign counts: a joint that responds more has no play.
    let shows = value < slack && effect.sure() > SURE && effect.share > share;
    if !shows {
        return None;
    }
    let text = format!(
        "{} joints respond {:.0} ± {:.0} % less to their motors in swings than those of simulated robots without play: they \
         have play between motor and link, or weak motors (fit it: play)",
        effect.of,
        -100.0 * value,
        100.0 * error
    );
    Some(Named { kind: CauseKind::Backlash, unit: "-", matters: matters::STRENGTH, text })
}

fn odd_friction(effect: &Effect, swings: Option<&SwingReport>) -> Option<Named> {
    let Estimate { value, error } = effect.beyond();
    if !joint_differs(effect, matters::FRICTION) {
        return None;
    }
    let siblings = swings?.groups.iter().find(|group| group.joints.contains(&effect.of))?;
    // At least the smallest size that matters: a group with almost no friction would make any difference too
    // odd.
    if value.abs() >= TOO_ODD * siblings.friction.value.max(matters::FRICTION) {
        return None;
    }
    let text = format!(
        "{} has {:.2} ± {error:.2} N·m {} dry friction than the same joint of the other legs (fit it: frictionloss with per = \
         \"joint\")",
        effect.of,
        value.abs(),
        more_or_less(value)
    );
    Some(Named { kind: CauseKind::OddFriction, unit: "N·m", matters: matters::FRICTION, text })
}

fn odd_spring(effect: &Effect) -> Option<Named> {
    let Estimate { value, error } = effect.beyond();
    if !joint_differs(effect, matters::SPRING) {
        return None;
    }
    let text = format!(
        "{} has a spring of {value:.1} ± {error:.1} N·m/rad, at rest at {:.2} rad; the same joint of most other legs has \
         none{}; it explains {:.0} % of the residual of legs in the air (fit it: stiffness and spring_torque of this joint)",
        effect.of,
        effect.rest.unwrap_or_default(),
        if value > 0.0 { "" } else { " (a weak motor may look so)" },
        percent(effect)
    );
    Some(Named { kind: CauseKind::OddSpring, unit: "N·m/rad", matters: matters::SPRING, text })
}

fn odd_strength(effect: &Effect) -> Option<Named> {
    let Estimate { value, error } = effect.beyond();
    if !joint_differs(effect, matters::STRENGTH) || value <= WEAKEST {
        return None;
    }
    let text = format!(
        "the motor of {} gives {:.0} ± {:.0} % {} torque than the same joint of most other legs, or its gains are wrong; it \
         explains {:.0} % of the residual of legs in the air (fit it: torque_scale of this joint)",
        effect.of,
        100.0 * value.abs(),
        100.0 * error,
        more_or_less(value),
        percent(effect)
    );
    Some(Named { kind: CauseKind::OddStrength, unit: "-", matters: matters::STRENGTH, text })
}

fn ground(effect: &Effect) -> Option<Named> {
    let value = effect.beyond().value;
    if !passes(effect, value, matters::HEIGHT, SURER, 0.0) {
        return None;
    }
    let text = format!(
        "feet that stand together are {:.0} mm apart in height: the ground gives way (fit it: ground_softness), or is uneven",
        1e3 * value
    );
    Some(Named { kind: CauseKind::Ground, unit: "m", matters: matters::HEIGHT, text })
}
