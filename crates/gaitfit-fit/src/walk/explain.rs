//! A ranked list of what a robot has and its model lacks, as walks show it without a simulation, with evidence.
//!
//! A cause is named if the logs show it surely, if it explains a good part of the signal that shows it, and if it is large
//! enough to change how a robot walks. Causes are ranked by their size divided by the smallest size that changes a walk. The
//! limits were set with robots in MuJoCo that have one cause each (`tools/mujoco_effects.py`). With these limits a robot without
//! a cause has none.

use super::swing::{Estimate, SwingFindings};
use gaitfit_adapt::{JointParameter, Theta};
use gaitfit_sim::Candidate;
use gaitfit_swing::{Effect, EffectKind};
use serde::{Deserialize, Serialize};

/// The kind of a cause.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CauseKind {
    /// Joint velocities are read late or through a filter.
    VelocityLag,
    /// The gyro reads a rate at rest.
    GyroBias,
    /// The inertial unit is tilted, or the floor slopes.
    Tilt,
    /// Joint positions come in steps.
    EncoderStep,
    /// Dry friction grows with the motor's torque.
    LoadFriction,
    /// Joints twist between motor and link.
    Elasticity,
    /// Joints have play between motor and link.
    Backlash,
    /// One joint has other friction than the same joint of other legs.
    OddFriction,
    /// One joint has a spring that the same joint of other legs does not have.
    OddSpring,
    /// The motor of one joint gives more or less torque than the same joint of other legs.
    OddStrength,
    /// The ground gives way, or is uneven.
    Ground,
}

/// Something that the robot has and its model lacks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cause {
    /// The kind.
    pub kind: CauseKind,
    /// The joint group or joint that has it; empty where it is of the whole robot.
    pub of: String,
    /// Its size, in `unit`, and the standard error.
    pub size: Estimate,
    /// Unit of the size.
    pub unit: String,
    /// The size over the smallest one that changes how a robot walks; the list is ordered by it.
    pub weight: f64,
    /// The cause with its evidence and its remedy, in a sentence.
    pub text: String,
}

impl Cause {
    /// The sentence without its remedy.
    pub fn effect(&self) -> &str {
        self.text.split(REMEDY).next().unwrap_or_default()
    }
}

/// The words before a remedy.
const REMEDY: &str = " (fit it";

/// Smallest sizes that change how a robot walks.
mod matters {
    /// s
    pub const LAG: f64 = 1e-3;
    /// rad/s
    pub const GYRO: f64 = 0.003;
    /// rad
    pub const TILT: f64 = 0.005;
    /// rad
    pub const STEP: f64 = 0.0015;
    /// N·m for each N·m
    pub const LOAD: f64 = 0.03;
    /// rad for each N·m
    pub const TWIST: f64 = 0.002;
    /// rad
    pub const PLAY: f64 = 0.006;
    /// N·m
    pub const FRICTION: f64 = 0.05;
    /// N·m/rad
    pub const SPRING: f64 = 2.0;
    /// Part of the torque.
    pub const STRENGTH: f64 = 0.12;
    /// m
    pub const HEIGHT: f64 = 0.006;
}

/// Standard errors from which on a size is sure. Effects of joints are many, so theirs must be surer.
const SURE: f64 = 4.0;
const SURER: f64 = 8.0;
/// A tilt must be surer still: on soft ground standing feet show one of a few errors.
const SUREST: f64 = 10.0;
/// Parts of what is left that an effect must explain.
const OF_SWINGS: f64 = 0.1;
const OF_ONE_JOINT: f64 = 0.08;
const OF_HEIGHTS: f64 = 0.3;
/// Play explains little of the heights, and makes swinging links respond less than their masses imply: by this share of the
/// torque, which explains this part of what swings leave.
const SLACK: [f64; 2] = [-0.25, 0.25];
/// Play above this is no play, rad.
const MAX_PLAY: f64 = 0.1;
/// Max friction under load of a gear, N·m for each N·m. A larger estimate has another cause.
const MAX_LOAD_FRICTION: f64 = 0.4;
/// If the friction of a joint differs by more than this many times its group's, the reason is another one.
const TOO_ODD: f64 = 3.0;
/// A motor that lacks more than this part of its torque does not swing a leg. A larger lack has another cause.
const WEAKEST: f64 = -0.9;

/// The causes that `found` shows, the largest weight first.
pub fn causes(found: &SwingFindings) -> Vec<Cause> {
    let mut causes = sensors(found);
    let effects = &found.effects;
    for effect in effects {
        causes.extend(of_effect(effect, found, effects));
    }
    // A joint that twists or rubs under load looks as if it had play, too.
    let others: Vec<String> = causes
        .iter()
        .filter(|cause| matches!(cause.kind, CauseKind::Elasticity | CauseKind::LoadFriction))
        .map(|cause| cause.of.clone())
        .collect();
    causes.retain(|cause| cause.kind != CauseKind::Backlash || !others.contains(&cause.of));
    causes.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    causes
}

/// Springs and strengths of single joints among the causes.
pub fn singles(found: &SwingFindings) -> impl Iterator<Item = &Effect> {
    let is_cause = |effect: &&Effect| of_effect(effect, found, &found.effects).is_some();
    let is_single = |effect: &&Effect| matches!(effect.kind, EffectKind::OddSpring | EffectKind::OddStrength);
    found.effects.iter().filter(is_single).filter(is_cause)
}

/// A sentence about the effects that the fitted simulator lacks; absent if it lacks none. `base`: the robot that θ changes,
/// with its known values.
pub fn missing(causes: &[Cause], theta: &Theta, base: &Candidate) -> Option<String> {
    // No fitted value of a joint compensates for these.
    let harmless = [CauseKind::GyroBias, CauseKind::EncoderStep];
    let listed: Vec<&str> = causes
        .iter()
        .filter(|cause| !harmless.contains(&cause.kind) && !covered(cause, theta, base))
        .take(NAMED)
        .map(|cause| cause.text.as_str())
        .collect();
    (!listed.is_empty()).then(|| {
        format!(
            "The logs show effects that the fitted simulator lacks: {}. Its values compensate for them.",
            listed.join("; ")
        )
    })
}

/// Whether the fitted simulator has an effect: θ contains its parameters, or `base` has values for them.
pub fn covered(cause: &Cause, theta: &Theta, base: &Candidate) -> bool {
    let Candidate { robot, sensors, .. } = base;
    let some = |numbers: &[f64]| numbers.iter().any(|number| *number != 0.0);
    let has = |kind: &str| theta.entries().iter().any(|entry| entry.kind == kind);
    let alone = |kind: JointParameter| {
        theta.entries().iter().any(|entry| entry.kind == kind.name() && entry.joints == [cause.of.as_str()])
    };
    match cause.kind {
        CauseKind::GyroBias => {
            ["gyro_bias_x", "gyro_bias_y", "gyro_bias_z"].iter().all(|kind| has(kind))
                || some(&sensors.gyro_bias)
        }
        CauseKind::EncoderStep => false,
        CauseKind::VelocityLag => has("velocity_lag") || robot.velocity_lag != 0.0,
        CauseKind::Tilt => (has("imu_roll") && has("imu_pitch")) || some(&sensors.imu_tilt),
        CauseKind::LoadFriction => has("load_friction") || some(&robot.load_friction),
        CauseKind::OddFriction => alone(JointParameter::FrictionLoss),
        CauseKind::OddSpring => {
            let of_joint = |entry: &gaitfit_adapt::Entry| {
                let kinds = [JointParameter::Stiffness, JointParameter::SpringTorque];
                kinds.iter().any(|kind| kind.name() == entry.kind) && entry.joints.contains(&cause.of)
            };
            theta.entries().iter().any(of_joint) || some(&robot.stiffness)
        }
        CauseKind::OddStrength => {
            alone(JointParameter::TorqueScale) || robot.torque_scale.iter().any(|scale| *scale != 1.0)
        }
        CauseKind::Backlash => has("play") || some(&robot.play),
        CauseKind::Elasticity => has("compliance") || some(&robot.compliance),
        CauseKind::Ground => has("ground_softness") || robot.ground_softness != 0.0,
    }
}

/// Causes that a doubt names.
const NAMED: usize = 3;

fn sensors(found: &SwingFindings) -> Vec<Cause> {
    let mut causes = Vec::new();
    let mut add = |kind, size: Estimate, unit: &str, matters: f64, text: String| {
        let weight = size.value.abs() / matters;
        causes.push(Cause { kind, of: String::new(), size, unit: unit.to_owned(), weight, text });
    };
    let sensors = &found.sensors;
    if let Some(lag) = sensors.velocity_lag.filter(|lag| lag.matters(matters::LAG)) {
        let text = format!(
            "joint velocities lag positions by {:.1} ms (a filter, or a late reading; fit it: velocity_lag)",
            1e3 * lag.value
        );
        add(CauseKind::VelocityLag, lag, "s", matters::LAG, text);
    }
    let largest =
        |axes: [Estimate; 2]| if axes[0].value.abs() > axes[1].value.abs() { axes[0] } else { axes[1] };
    if let Some(bias) = sensors.gyro_bias {
        let max = largest([largest([bias[0], bias[1]]), bias[2]]);
        if max.matters(matters::GYRO) {
            let text = format!(
                "the gyro reads {:.3} rad/s at rest on one axis (fit it: gyro_bias_x, gyro_bias_y, gyro_bias_z)",
                max.value
            );
            add(CauseKind::GyroBias, max, "rad/s", matters::GYRO, text);
        }
    }
    if let Some(tilt) = found.standing.tilt {
        let max = largest(tilt);
        if max.value.abs() > matters::TILT && max.value.abs() > SUREST * max.error {
            let [roll, pitch] = tilt.map(|axis| axis.value.to_degrees());
            let text = format!(
                "the inertial unit is tilted by {roll:.1}° of roll and {pitch:.1}° of pitch against the standing feet (fit \
                 it: imu_roll, imu_pitch), or the floor slopes"
            );
            add(CauseKind::Tilt, max, "rad", matters::TILT, text);
        }
    }
    if let Some(step) = sensors.position_step.filter(|step| *step >= matters::STEP) {
        let size = Estimate { value: step, error: 0.0 };
        let text = format!("joint positions come in steps of {step:.4} rad");
        add(CauseKind::EncoderStep, size, "rad", matters::STEP, text);
    }
    causes
}

fn of_effect(effect: &Effect, found: &SwingFindings, all: &[Effect]) -> Option<Cause> {
    let Estimate { value, error } = effect.size;
    let (of, part) = (&effect.of, 100.0 * effect.share);
    let enough =
        |min: f64, sure: f64, share: f64| value > min && effect.sure() > sure && effect.share > share;
    let group_friction = || {
        let groups = &found.swings.as_ref()?.groups;
        groups.iter().find(|group| group.joints.contains(of)).map(|group| group.friction.value)
    };
    let (kind, unit, min, text) = match effect.kind {
        EffectKind::LoadFriction if enough(matters::LOAD, SURER, OF_SWINGS) && value < MAX_LOAD_FRICTION => (
            CauseKind::LoadFriction,
            "-",
            matters::LOAD,
            format!(
                "dry friction of {of} grows by {value:.3} ± {error:.3} N·m for each N·m of the motor's torque, which \
                 explains {part:.0} % of the residual of legs in the air (fit it: load_friction)"
            ),
        ),
        EffectKind::Elasticity if enough(matters::TWIST, SURER, OF_HEIGHTS) => (
            CauseKind::Elasticity,
            "rad/(N·m)",
            matters::TWIST,
            format!(
                "{of} joints twist between motor and link by {value:.4} ± {error:.4} rad for each N·m ({:.0} \
                 N·m/rad), which explains {part:.0} % of the residual of the heights of standing feet \
                 (fit it: compliance)",
                1.0 / value
            ),
        ),
        EffectKind::Backlash if enough(matters::PLAY, SURE, 0.0) && value < MAX_PLAY && slack(of, all) => (
            CauseKind::Backlash,
            "rad",
            matters::PLAY,
            format!(
                "{of} joints have about {value:.3} ± {error:.3} rad of play between motor and link: standing feet \
                 show it, and swinging links respond less than their masses imply (fit it: play)"
            ),
        ),
        EffectKind::OddFriction
            if value.abs() > matters::FRICTION
                && effect.sure() > SURER
                && effect.share > OF_ONE_JOINT
                && value.abs() < TOO_ODD * group_friction()?.max(matters::FRICTION) =>
        {
            let than = if value > 0.0 { "more" } else { "less" };
            (
                CauseKind::OddFriction,
                "N·m",
                matters::FRICTION,
                format!(
                    "{of} has {:.2} ± {error:.2} N·m {than} dry friction than the same joint of the other legs (fit it: \
                     frictionloss with per = \"joint\")",
                    value.abs()
                ),
            )
        }
        EffectKind::OddSpring
            if value.abs() > matters::SPRING && effect.sure() > SURER && effect.share > OF_ONE_JOINT =>
        {
            let rest = effect.rest.unwrap_or_default();
            let weak = if value > 0.0 { "" } else { " (a weak motor may look so)" };
            (
                CauseKind::OddSpring,
                "N·m/rad",
                matters::SPRING,
                format!(
                    "{of} has a spring of {value:.1} ± {error:.1} N·m/rad, at rest at {rest:.2} rad; the same joint of \
                     most other legs has none{weak}; it explains {part:.0} % of the residual of legs in the air (fit it: \
                     stiffness and spring_torque of this joint)"
                ),
            )
        }
        EffectKind::OddStrength
            if value.abs() > matters::STRENGTH
                && value > WEAKEST
                && effect.sure() > SURER
                && effect.share > OF_ONE_JOINT =>
        {
            let than = if value > 0.0 { "more" } else { "less" };
            (
                CauseKind::OddStrength,
                "-",
                matters::STRENGTH,
                format!(
                    "the motor of {of} gives {:.0} ± {:.0} % {than} torque than the same joint of most other legs, or its gains \
                     are wrong; it explains {part:.0} % of the residual of legs in the air (fit it: torque_scale of this joint)",
                    100.0 * value.abs(),
                    100.0 * error
                ),
            )
        }
        EffectKind::UnevenGround if enough(matters::HEIGHT, SURER, 0.0) => (
            CauseKind::Ground,
            "m",
            matters::HEIGHT,
            format!(
                "feet that stand together are {:.0} mm apart in height: the ground gives way (fit it: ground_softness), or is \
                 uneven",
                1e3 * value
            ),
        ),
        _ => return None,
    };
    let weight = value.abs() / min;
    Some(Cause { kind, of: of.clone(), size: effect.size, unit: unit.to_owned(), weight, text })
}

/// Whether swinging links of a group answer to their motors as those with play do.
fn slack(group: &str, effects: &[Effect]) -> bool {
    let [strength, share] = SLACK;
    effects.iter().any(|one| {
        one.kind == EffectKind::Strength && one.of == group && one.size.value < strength && one.share > share
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::walk::swing::Standing;
    use gaitfit_adapt::{ParameterRule, RobotNumber, RobotRule, Rules, Sharing};
    use gaitfit_log::Sensors;

    fn findings(effects: &[(EffectKind, &str, f64, f64, f64)]) -> SwingFindings {
        let effect = |&(kind, of, value, error, share): &(EffectKind, &str, f64, f64, f64)| {
            Effect::new(kind, of, Estimate { value, error }, share)
        };
        SwingFindings { effects: effects.iter().map(effect).collect(), ..SwingFindings::default() }
    }

    #[test]
    fn a_cause_is_sure_large_and_explains_something() {
        let kinds = |effects: &[_]| -> Vec<CauseKind> {
            causes(&findings(effects)).iter().map(|cause| cause.kind).collect()
        };
        let load = |value, error, share| (EffectKind::LoadFriction, "calf", value, error, share);
        assert_eq!(kinds(&[load(0.09, 0.003, 0.7)]), [CauseKind::LoadFriction]);
        assert_eq!(kinds(&[load(0.09, 0.02, 0.7), load(0.02, 0.001, 0.7), load(0.09, 0.003, 0.05)]), []);
        assert_eq!(kinds(&[load(0.68, 0.06, 0.7)]), [], "a gear does not lose two thirds of its torque");
        let play = (EffectKind::Backlash, "thigh", 0.015, 0.002, 0.03);
        let strength = |value| (EffectKind::Strength, "thigh", value, 0.03, 0.4);
        assert_eq!(kinds(&[play, strength(-0.05)]), [], "links answer as they should");
        assert_eq!(kinds(&[play, strength(-0.38)]), [CauseKind::Backlash]);
        let twist = (EffectKind::Elasticity, "thigh", 0.005, 0.0001, 0.9);
        assert_eq!(kinds(&[play, strength(-0.38), twist]), [CauseKind::Elasticity]);
        let ground = (EffectKind::UnevenGround, "", 0.009, 0.0003, 1.0);
        assert_eq!(kinds(&[ground, load(0.3, 0.003, 0.7)]), [CauseKind::LoadFriction, CauseKind::Ground]);
    }

    #[test]
    fn what_is_fitted_or_known_is_not_missing() {
        let model = crate::robot::go2().unwrap();
        let base = Candidate::nominal(&model);
        let found = causes(&findings(&[
            (EffectKind::LoadFriction, "calf", 0.09, 0.003, 0.7),
            (EffectKind::UnevenGround, "", 0.009, 0.0003, 1.0),
        ]));
        let text = missing(&found, &Theta::default(), &base).unwrap_or_default();
        assert!(text.contains("grows by 0.090") && text.contains("9 mm apart"), "{text}");
        assert_eq!(missing(&[], &Theta::default(), &base), None);
        // A simulator whose unit is tilted does not lack the tilt.
        let standing = Standing { tilt: Some([Estimate { value: 0.03, error: 0.001 }; 2]) };
        let tilted = causes(&SwingFindings { standing, ..SwingFindings::default() });
        let theta = |kinds: &[RobotNumber]| {
            let robot = kinds.iter().map(|kind| RobotRule::new(*kind)).collect();
            Rules { robot, ..Rules::default() }.theta(&[], &[], &[]).unwrap_or_default()
        };
        let doubt = missing(&tilted, &theta(&[RobotNumber::BaseMass]), &base).unwrap_or_default();
        assert!(
            doubt.contains("tilted by 1.7° of roll") && doubt.contains("fit it: imu_roll, imu_pitch"),
            "{doubt}"
        );
        assert_eq!(missing(&tilted, &theta(&[RobotNumber::ImuRoll, RobotNumber::ImuPitch]), &base), None);
        let mut known = base.clone();
        known.sensors.imu_tilt = [0.03, 0.03];
        assert_eq!(missing(&tilted, &Theta::default(), &known), None);
        let velocity_lag = Some(Estimate { value: 0.004, error: 0.0001 });
        let sensors = Sensors { velocity_lag, ..Sensors::default() };
        let late = causes(&SwingFindings { sensors, ..SwingFindings::default() });
        let doubt = missing(&late, &theta(&[RobotNumber::ImuRoll]), &base).unwrap_or_default();
        assert!(doubt.contains("by 4.0 ms") && doubt.contains("fit it: velocity_lag"), "{doubt}");
        assert_eq!(missing(&late, &theta(&[RobotNumber::VelocityLag]), &base), None);
    }

    #[test]
    fn friction_of_another_joint_does_not_cover_the_odd_one() {
        let base = Candidate::nominal(&crate::robot::go2().unwrap());
        let joints = ["FL_calf_joint".to_owned(), "waist_joint".to_owned()];
        let theta = |joint: &str| {
            let rule = ParameterRule {
                per: Sharing::Joint,
                joints: vec![joint.to_owned()],
                ..ParameterRule::new(JointParameter::FrictionLoss)
            };
            Rules { parameter: vec![rule], ..Rules::default() }.theta(&[], &joints, &[]).unwrap()
        };
        let odd = Cause {
            kind: CauseKind::OddFriction,
            of: "FL_calf_joint".to_owned(),
            size: Estimate { value: 0.12, error: 0.01 },
            unit: "N·m".to_owned(),
            weight: 1.0,
            text: "odd".to_owned(),
        };
        assert!(covered(&odd, &theta("FL_calf_joint"), &base));
        assert!(!covered(&odd, &theta("waist_joint"), &base), "a group of one joint is another joint's");
    }
}
