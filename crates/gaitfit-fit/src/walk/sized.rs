//! Default search bounds of walks. They were chosen for a Go2; here they are scaled to robots of other sizes.

use super::swing::{Estimate, SwingNumber};
use crate::robot::joint_names;
use crate::settings::AdaptConfig;
use gaitfit_adapt::{JointParameter, ParameterRule, RobotNumber, RobotRule};
use gaitfit_model::{JointKind, Model};

/// Mass of the robot for which the default bounds were chosen, kg.
const MASS_KG: f64 = 15.0;
/// Motor torque of that robot, the median of its joints, N·m.
const TORQUE_NM: f64 = 23.7;
/// Max share of the base's mass that a fit removes.
const LIGHTER: f64 = 0.5;
/// Standard deviation of a motor's position gain relative to the stated one.
const KP_SCALE: f64 = 0.1;
/// Standard deviation of the encoders' zeros of a biped, rad.
const ZERO_RAD: f64 = 0.01;
/// Standard deviation of the distance of a biped's load from the base, along each axis, m.
const LOAD_DISTANCE_M: f64 = 0.15;
/// Feet of a biped.
const BIPED: usize = 2;
/// Contacts that begin with this impedance are firm: MuJoCo's default of 0.9, less what mixing two of them rounds away.
const FIRM: f64 = 0.9 - 1e-9;
/// Upper bounds are at least this many times the model's own value.
const OWN: f64 = 3.0;

/// Whether a robot with this number of feet is a biped.
pub fn is_biped(feet: usize) -> bool {
    feet <= BIPED
}

/// Size of a robot relative to the Go2, in powers of two, so that small differences keep the default bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Scale {
    mass: f64,
    torque: f64,
}

impl Scale {
    /// The scale by the motors of the joints `moved` of one kind.
    fn new(model: &Model, moved: &[usize], kind: JointKind) -> Self {
        let mass: f64 = model.bodies.iter().map(|body| body.mass).sum();
        let mut torques: Vec<f64> = moved
            .iter()
            .filter(|&&joint| model.joints[joint].kind == kind)
            .filter_map(|&joint| model.effort(joint))
            .collect();
        // The median, because a robot may have a few joints with far larger or smaller motors.
        torques.sort_by(f64::total_cmp);
        let usual = kind.like("N·m", TORQUE_NM);
        let torque = torques.get(torques.len() / 2).copied().unwrap_or(usual);
        Self { mass: power(mass / MASS_KG), torque: power(torque / usual) }
    }

    fn joint(self, kind: JointParameter) -> f64 {
        match kind {
            JointParameter::FrictionLoss | JointParameter::Damping => self.torque,
            JointParameter::Armature => self.mass,
            _ => 1.0,
        }
    }

    fn number(self, kind: RobotNumber) -> f64 {
        match kind {
            RobotNumber::BaseMass | RobotNumber::PayloadMass => self.mass,
            RobotNumber::TorqueNoise => self.torque,
            _ => 1.0,
        }
    }
}

/// The power of two nearest to a ratio, between 1/64 and 64.
fn power(ratio: f64) -> f64 {
    let exponent = ratio.log2().round();
    // A model without mass or with an infinite torque limit has no ratio, and keeps the default bounds.
    if exponent.is_finite() { exponent.clamp(-6.0, 6.0).exp2() } else { 1.0 }
}

/// Scales the bounds, deviations and starts that `given` leaves to the defaults to the robot of `model`. `config` has the
/// same rules with every default filled in. Values of the robot's file (damping 3 N·m·s/rad, say) lie inside the bounds and are
/// where the search starts.
/// A robot without soft contacts gets no number for firmer ones, because it would do nothing.
/// A biped with the default numbers gets a load with a position instead of a heavier base: the position decides whether it
/// falls. A biped with the default parameters keeps the stated gains, because its many joint groups would leave each gain
/// unknown.
pub fn fit_to(config: &mut AdaptConfig, given: &AdaptConfig, model: &Model, feet: usize) {
    let names = joint_names(model);
    // Given settings are compared with what the defaults become on this robot, whose slides have other units.
    let defaults: AdaptConfig = crate::settings::walk_defaults();
    let usual = defaults.by_kind(model).unwrap_or(defaults);
    for (rule, given) in config.parameter.iter_mut().zip(&given.parameter) {
        let covered: Vec<usize> =
            names.iter().enumerate().filter(|(_, name)| covers(rule, name)).map(|(joint, _)| joint).collect();
        let scale = Scale::new(model, &covered, rule.joint_kind).joint(rule.kind);
        let bare = ParameterRule { joint_kind: rule.joint_kind, ..ParameterRule::new(rule.kind) };
        // A rule that repeats the defaults counts as one that leaves its numbers to them.
        let given = if usual.parameter.contains(given) { &bare } else { given };
        // The file's own values: the largest must lie inside the bounds, the middle one is the start.
        let mut values: Vec<f64> =
            covered.iter().filter_map(|&joint| value(model, rule.kind, joint)).collect();
        values.sort_by(f64::total_cmp);
        let middle = values.get(values.len() / 2).copied().unwrap_or_default();
        let largest = values.last().copied().unwrap_or_default();
        let upper = rule.upper.unwrap_or_default();
        // Three times the file's value, so that a search can move it in both directions.
        let wider = (upper * scale).max(OWN * largest);
        if given.upper.is_none() {
            rule.upper = Some(wider);
        }
        if given.deviation.is_none() && upper > 0.0 {
            // The deviation keeps its share of the range.
            rule.deviation = rule.deviation.map(|deviation| deviation * (wider / upper));
        }
        if given.start.is_none() && middle > 0.0 {
            rule.start = Some(middle);
        }
    }
    let every: Vec<usize> = (0..names.len()).collect();
    for (rule, given) in config.number.iter_mut().zip(&given.number) {
        let scale = Scale::new(model, &every, JointKind::Hinge).number(rule.kind);
        let given = if usual.number.contains(given) { &RobotRule::new(rule.kind) } else { given };
        let scaled = |chosen: Option<f64>, value: &mut Option<f64>| {
            if chosen.is_none() {
                *value = value.map(|value| value * scale);
            }
        };
        scaled(given.lower, &mut rule.lower);
        scaled(given.upper, &mut rule.upper);
        scaled(given.deviation, &mut rule.deviation);
        // The base may become lighter by a part of its own mass at most, or it would have none.
        if rule.kind == RobotNumber::BaseMass && given.lower.is_none() {
            rule.lower = rule.lower.map(|lower| lower.max(-LIGHTER * base_mass(model)));
        }
    }
    // What a user wrote stays, even if it is a gain of a biped.
    if is_biped(feet) && usual.parameter == given.parameter {
        config.parameter.retain(|rule| rule.kind != JointParameter::KpScale);
    }
    if usual.number == given.number && !has_soft_contacts(model) {
        config.number.retain(|rule| rule.kind != RobotNumber::GroundImpedance);
    }
    let base = RobotRule::new(RobotNumber::BaseMass);
    if is_biped(feet) && usual.number == given.number && usual.number.contains(&base) {
        config.number.retain(|rule| rule.kind != base.kind);
        let scale = Scale::new(model, &every, JointKind::Hinge).mass;
        for kind in [RobotNumber::PayloadMass, RobotNumber::PayloadX, RobotNumber::PayloadZ] {
            let mut rule = RobotRule::new(kind);
            rule.resolve();
            if kind == RobotNumber::PayloadMass {
                rule.upper = rule.upper.map(|upper| upper * scale);
            }
            config.number.push(rule);
        }
    }
}

/// Priors that no log gives. Position gains are those stated within about a tenth; without this prior they trade against the
/// motors' strength and the encoders' zeros. A biped's encoder zeros are right within about 0.01 rad, and its load is near the
/// base: the logs show how the biped leans, but not why. A light load far away, a heavy load nearby, or wrong zeros of hips,
/// knees and ankles explain it equally well.
pub fn usual_priors(feet: usize) -> Vec<SwingNumber> {
    let prior = |kind: &'static str, value: f64, error: f64| SwingNumber {
        kind,
        joints: Vec::new(),
        estimate: Estimate { value, error },
        by_strength: 0.0,
        by_load: 0.0,
    };
    let mut priors = vec![prior(JointParameter::KpScale.name(), 1.0, KP_SCALE)];
    if is_biped(feet) {
        priors.push(prior(JointParameter::EncoderBias.name(), 0.0, ZERO_RAD));
        priors.push(prior(RobotNumber::PayloadX.name(), 0.0, LOAD_DISTANCE_M));
        priors.push(prior(RobotNumber::PayloadZ.name(), 0.0, LOAD_DISTANCE_M));
    }
    priors
}

/// Whether a contact with the ground begins softly and gets firmer with depth.
fn has_soft_contacts(model: &Model) -> bool {
    model.pairs.iter().any(|pair| {
        let [first, last, width, ..] = pair.solimp;
        first < FIRM && first < last && width > 0.0
    })
}

/// Mass of the base itself, kg.
fn base_mass(model: &Model) -> f64 {
    model.bodies.first().map_or(0.0, |body| body.mass)
}

fn covers(rule: &ParameterRule, name: &str) -> bool {
    gaitfit_model::patterns::compile(&rule.joints)
        .is_ok_and(|patterns| patterns.iter().any(|pattern| pattern.covers(name)))
}

/// The robot file's values of a parameter that the scale changes.
fn value(model: &Model, kind: JointParameter, joint: usize) -> Option<f64> {
    let joint = &model.joints[joint];
    match kind {
        JointParameter::FrictionLoss => Some(joint.frictionloss),
        JointParameter::Damping => Some(joint.damping),
        JointParameter::Armature => Some(joint.armature),
        _ => None,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    fn defaults(model: &Model) -> AdaptConfig {
        let given = crate::settings::walk_defaults();
        let mut config = given.clone();
        config.parameter.iter_mut().for_each(ParameterRule::resolve);
        config.number.iter_mut().for_each(RobotRule::resolve);
        fit_to(&mut config, &given, model, 4);
        config
    }

    fn rule(config: &AdaptConfig, kind: JointParameter) -> ParameterRule {
        config.parameter.iter().find(|rule| rule.kind == kind).unwrap().clone()
    }

    #[test]
    fn the_go2_keeps_its_bounds() {
        let config = defaults(&crate::robot::go2().unwrap());
        let mut resolved = crate::settings::walk_defaults();
        resolved.parameter.iter_mut().for_each(ParameterRule::resolve);
        resolved.number.iter_mut().for_each(RobotRule::resolve);
        assert_eq!((config.parameter, config.number), (resolved.parameter, resolved.number));
    }

    #[test]
    fn firm_feet_need_no_number_for_firmer_ones() {
        let mut model = crate::robot::go2().unwrap();
        model.pairs.iter_mut().for_each(|pair| pair.solimp = [0.9, 0.95, 0.001, 0.5, 2.0]);
        let given = crate::settings::walk_defaults();
        let kinds = |config: &AdaptConfig| -> Vec<RobotNumber> {
            config
                .number
                .iter()
                .map(|rule| rule.kind)
                .filter(|&kind| kind == RobotNumber::GroundImpedance)
                .collect()
        };
        assert!(kinds(&defaults(&model)).is_empty() && kinds(&given).len() == 1);
        let stated = AdaptConfig {
            number: vec![RobotRule::new(RobotNumber::GroundImpedance)],
            ..AdaptConfig::default()
        };
        let mut config = stated.clone();
        fit_to(&mut config, &stated, &model, 4);
        assert_eq!(kinds(&config).len(), 1, "what a user asks for stays");
    }

    #[test]
    fn a_heavier_robot_with_damping_of_its_own_gets_wider_bounds() {
        let mut model = crate::robot::go2().unwrap();
        model.bodies.iter_mut().for_each(|body| body.mass *= 2.1);
        model.joints.iter_mut().for_each(|joint| joint.damping = 3.0);
        let config = defaults(&model);
        let damping = rule(&config, JointParameter::Damping);
        assert_eq!((damping.start, damping.upper), (Some(3.0), Some(9.0)));
        assert_eq!(rule(&config, JointParameter::Armature).upper, Some(0.2));
        assert_eq!(rule(&config, JointParameter::FrictionLoss).upper, Some(2.0), "its motors are the same");
        let mass = config.number.iter().find(|rule| rule.kind == RobotNumber::BaseMass).unwrap();
        assert_eq!((mass.lower, mass.upper), (Some(-4.0), Some(10.0)));
    }

    #[test]
    fn a_biped_gets_a_load_with_a_place_and_keeps_the_stated_gains() {
        let given = crate::settings::walk_defaults();
        let mut config = given.clone();
        config.parameter.iter_mut().for_each(ParameterRule::resolve);
        config.number.iter_mut().for_each(RobotRule::resolve);
        fit_to(&mut config, &given, &crate::robot::go2().unwrap(), 2);
        let kinds: Vec<RobotNumber> = config.number.iter().map(|rule| rule.kind).collect();
        assert!(
            kinds.contains(&RobotNumber::PayloadX) && !kinds.contains(&RobotNumber::BaseMass),
            "{kinds:?}"
        );
        assert!(config.parameter.iter().all(|rule| rule.kind != JointParameter::KpScale));
    }

    #[test]
    fn stated_bounds_stay() {
        let mut model = crate::robot::go2().unwrap();
        model.joints.iter_mut().for_each(|joint| joint.damping = 3.0);
        let rule = ParameterRule {
            upper: Some(5.0),
            start: Some(1.0),
            ..ParameterRule::new(JointParameter::Damping)
        };
        let given = AdaptConfig { parameter: vec![rule], number: Vec::new(), ..AdaptConfig::default() };
        let mut config = given.clone();
        config.parameter.iter_mut().for_each(ParameterRule::resolve);
        fit_to(&mut config, &given, &model, 4);
        assert_eq!((config.parameter[0].start, config.parameter[0].upper), (Some(1.0), Some(5.0)));
    }
}
