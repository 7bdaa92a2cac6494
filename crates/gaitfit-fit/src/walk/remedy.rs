//! Adds parameters to a default fit for effects that the logs show without a simulation.
//!
//! They are added before the search, without a first fit that lacks them. This does little harm: if the robot does not have
//! the effect, these parameters end near 0 and the other values stay (docs, "Effects that the model lacks").

use super::explain::{Cause, CauseKind, causes, covered, has_joint};
use super::singles::single_numbers;
use super::swing::{Estimate, SwingFindings, SwingNumber};
use crate::settings::{AdaptConfig, walk_defaults};
use gaitfit_adapt::{JointParameter, ParameterRule, RobotNumber, RobotRule, Sharing, Theta};
use gaitfit_model::patterns::compile;
use gaitfit_sim::Candidate;
use gaitfit_swing::{GroupEstimate, usual_group};

/// The numbers of a spring.
const SPRING: [JointParameter; 2] = [JointParameter::Stiffness, JointParameter::SpringTorque];

/// Parameters that a fit gets besides the default ones, and the effects that are the reason.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Remedies {
    /// Rules to add, each with one value for each joint group.
    parameter: Vec<ParameterRule>,
    /// Numbers of the whole robot to add.
    number: Vec<RobotRule>,
    /// Groups whose dry friction is fitted joint by joint: joint names, and the largest difference of a joint, N·m.
    split_groups: Vec<(Vec<String>, f64)>,
    /// Numbers of single joints: stiffness and torque of springs, strengths of motors.
    singles: Vec<SwingNumber>,
    /// One sentence for each effect.
    effects: Vec<(CauseKind, String)>,
}

impl Remedies {
    /// The same without springs, for a fit that looks for joints with springs itself (`odd_joints`).
    #[must_use]
    pub fn without_springs(mut self) -> Self {
        self.singles.retain(|number| number.kind == JointParameter::TorqueScale.name());
        self.effects.retain(|(kind, _)| *kind != CauseKind::OddSpring);
        self
    }

    /// Remedies for the effects in `findings`, except those that `theta` or `base` covers. `joints`: names of all joints of
    /// the robot.
    pub fn new(findings: &SwingFindings, theta: &Theta, base: &Candidate, joints: &[String]) -> Self {
        let mut remedies = Self::default();
        for cause in causes(findings).iter().filter(|cause| !covered(cause, theta, base, joints)) {
            if remedies.add(cause, findings) {
                remedies.effects.push((cause.kind, cause.effect().to_owned()));
            }
        }
        for rule in &mut remedies.parameter {
            // Groups with a joint that has the parameter are left out: they count as covered, and their entry has a name.
            let kind = rule.kind;
            let has = |joint: &&String| has_joint(kind, joint, theta, base, joints);
            let groups: Vec<String> = joints.iter().filter(has).map(|joint| usual_group(joint)).collect();
            if !groups.is_empty() {
                let lacks = |joint: &&String| !groups.contains(&usual_group(joint));
                rule.joints = joints.iter().filter(lacks).cloned().collect();
            }
        }
        remedies.parameter.retain(|rule| !rule.joints.is_empty());
        remedies
    }

    /// Adds the remedy for a cause. Returns false if the cause has none.
    fn add(&mut self, cause: &Cause, findings: &SwingFindings) -> bool {
        use RobotNumber::{GroundSoftness, GyroBiasX, GyroBiasY, GyroBiasZ, ImuPitch, ImuRoll, VelocityLag};
        match cause.kind {
            CauseKind::Backlash => self.joints(JointParameter::Play),
            CauseKind::Elasticity => self.joints(JointParameter::Compliance),
            CauseKind::LoadFriction => self.joints(JointParameter::LoadFriction),
            CauseKind::Tilt => self.numbers(&[ImuRoll, ImuPitch]),
            CauseKind::GyroBias => self.numbers(&[GyroBiasX, GyroBiasY, GyroBiasZ]),
            CauseKind::VelocityLag => self.numbers(&[VelocityLag]),
            CauseKind::Ground => self.numbers(&[GroundSoftness]),
            // If one joint of a leg differs, its other joints may differ too, but the logs show them less well.
            CauseKind::OddFriction => {
                let groups = findings.swings.as_ref().map_or(&[][..], |report| report.groups.as_slice());
                let causes = causes(findings);
                let largest = |group: &GroupEstimate| {
                    let is_odd_friction = |other: &&Cause| {
                        other.kind == CauseKind::OddFriction && group.joints.contains(&other.of)
                    };
                    causes
                        .iter()
                        .filter(is_odd_friction)
                        .map(|other| other.size.value.abs())
                        .fold(0.0, f64::max)
                };
                // All groups are split, also those without an odd joint: `largest` is 0 there and widens nothing.
                self.split_groups =
                    groups.iter().map(|group| (group.joints.clone(), largest(group))).collect();
            }
            CauseKind::OddSpring => self.of_joint(findings, &cause.of, &SPRING),
            CauseKind::OddStrength => self.of_joint(findings, &cause.of, &[JointParameter::TorqueScale]),
            // No parameter of a fit stands for the steps of an encoder.
            CauseKind::EncoderStep => return false,
        }
        true
    }

    fn joints(&mut self, kind: JointParameter) {
        if self.parameter.iter().all(|rule| rule.kind != kind) {
            self.parameter.push(ParameterRule::new(kind));
        }
    }

    /// Adds the numbers of these kinds of one joint: a joint may have both a spring and another strength.
    fn of_joint(&mut self, findings: &SwingFindings, joint: &str, kinds: &[JointParameter]) {
        let wanted = |number: &SwingNumber| {
            number.joints == [joint] && kinds.iter().any(|kind| kind.name() == number.kind)
        };
        self.singles.extend(single_numbers(findings).into_iter().filter(wanted));
    }

    fn numbers(&mut self, kinds: &[RobotNumber]) {
        self.number.extend(kinds.iter().map(|kind| RobotRule::new(*kind)));
    }

    /// Adds the rules to those of `config` and fills in their defaults. `joints`: names of all joints of the robot.
    pub fn extend(&self, config: &mut AdaptConfig, joints: &[String]) {
        // The added parameters cover the same joints as the default ones.
        // Rules over groups were limited to joints that the policy moves, see `rule_joints`.
        let group_rule = config.parameter.iter().find(|rule| rule.per == Sharing::Group);
        let covered = group_rule.map(|rule| rule.joints.clone());
        for rule in &self.parameter {
            let mut rule = rule.clone();
            if let Some(covered) = &covered {
                if rule.joints == ["*"] {
                    rule.joints.clone_from(covered);
                } else {
                    let patterns = compile(covered).unwrap_or_default();
                    rule.joints.retain(|joint| patterns.iter().any(|pattern| pattern.covers(joint)));
                }
            }
            if rule.joints.is_empty() {
                continue;
            }
            // Defaults are filled in here, because those of the configuration were filled in before.
            rule.resolve();
            config.parameter.push(rule);
        }
        // Logs do not tell a softer ground from firmer feet. The effect that they show stays, the default number goes.
        let kinds = |rules: &[RobotRule]| rules.iter().map(|rule| rule.kind).collect::<Vec<_>>();
        let is_default = kinds(&config.number) == kinds(&walk_defaults().number);
        if is_default && self.number.iter().any(|rule| rule.kind == RobotNumber::GroundSoftness) {
            config.number.retain(|rule| rule.kind != RobotNumber::GroundImpedance);
        }
        for rule in &self.number {
            let mut rule = rule.clone();
            rule.resolve();
            config.number.push(rule);
        }
        for (group, _) in &self.split_groups {
            split(config, group, joints);
        }
        // A joint with a strength of its own leaves the rule that it shared, or two entries would set it.
        for number in &self.singles {
            if number.kind == JointParameter::TorqueScale.name() {
                leave_out(config, JointParameter::TorqueScale, &number.joints, joints);
            }
        }
        config.parameter.extend(self.singles.iter().filter_map(single_rule));
    }

    /// The estimates for single joints, which are priors of the added parameters.
    pub fn single_numbers(&self) -> &[SwingNumber] {
        &self.singles
    }

    /// Adds the difference between joints to the error of a group's friction. The estimate is of the whole group, and becomes
    /// the prior of its single joints.
    pub fn widen_priors(&self, numbers: &mut [SwingNumber]) {
        for (group, size) in &self.split_groups {
            let friction = |number: &&mut SwingNumber| {
                number.kind == JointParameter::FrictionLoss.name() && number.joints == *group
            };
            for number in numbers.iter_mut().filter(friction) {
                number.estimate.error = number.estimate.error.hypot(*size);
            }
        }
    }

    /// The added parameters and the reason, for the user; absent without remedies.
    pub fn note(&self) -> Option<String> {
        let mut kinds: Vec<&str> = self.parameter.iter().map(|rule| rule.kind.name()).collect();
        kinds.extend(self.number.iter().map(|rule| rule.kind.name()));
        if !self.split_groups.is_empty() {
            kinds.push("frictionloss joint by joint");
        }
        let has = |kind: JointParameter| self.singles.iter().any(|number| number.kind == kind.name());
        if has(JointParameter::Stiffness) {
            kinds.push("stiffness and spring_torque of the joint with the spring");
        }
        if has(JointParameter::TorqueScale) {
            kinds.push("torque_scale of the joint with the other strength");
        }
        let effects: Vec<&str> = self.effects.iter().map(|(_, effect)| effect.as_str()).collect();
        (!kinds.is_empty()).then(|| {
            format!(
                "the logs show effects that the default parameters do not cover: {}. So the fit also has the parameters {}. \
                 `effects = false` leaves them out",
                effects.join("; "),
                kinds.join(", ")
            )
        })
    }
}

/// A number of a single joint is searched this many standard errors around its estimate.
const SINGLE_RANGE: f64 = 5.0;
/// Lower bound of a motor's strength in a search.
const MIN_SEARCHED: f64 = 0.05;

/// The rule of one number of a single joint.
fn single_rule(number: &SwingNumber) -> Option<ParameterRule> {
    let kind = [JointParameter::Stiffness, JointParameter::SpringTorque, JointParameter::TorqueScale];
    let kind = kind.into_iter().find(|kind| kind.name() == number.kind)?;
    let Estimate { value, error } = number.estimate;
    let half = SINGLE_RANGE * error;
    // A motor without strength would not move its joint. Springs may have negative numbers.
    let least = if kind == JointParameter::TorqueScale { MIN_SEARCHED } else { f64::NEG_INFINITY };
    let mut rule = ParameterRule {
        per: Sharing::Joint,
        joints: number.joints.clone(),
        lower: Some((value - half).max(least)),
        upper: Some(value + half),
        start: Some(value),
        deviation: Some(error),
        ..ParameterRule::new(kind)
    };
    rule.resolve();
    Some(rule)
}

/// Takes `single` joints from the rules of a kind that give several joints one value. `joints`: names of all joints.
fn leave_out(config: &mut AdaptConfig, kind: JointParameter, single: &[String], joints: &[String]) {
    for rule in config.parameter.iter_mut().filter(|rule| rule.kind == kind && rule.per != Sharing::Joint) {
        let patterns = compile(&rule.joints).unwrap_or_default();
        let covers = |joint: &&String| patterns.iter().any(|pattern| pattern.covers(joint));
        rule.joints = joints.iter().filter(covers).filter(|joint| !single.contains(joint)).cloned().collect();
        if rule.per == Sharing::All {
            // The entry keeps its usual name, although the rule does not cover all joints any more.
            rule.name.get_or_insert_with(|| kind.name().to_owned());
        }
    }
    config.parameter.retain(|rule| !rule.joints.is_empty());
}

/// Replaces the one dry friction of `group` by one for each of its joints.
fn split(config: &mut AdaptConfig, group: &[String], joints: &[String]) {
    let friction =
        |rule: &&mut ParameterRule| rule.kind == JointParameter::FrictionLoss && rule.per == Sharing::Group;
    let Some(rule) = config.parameter.iter_mut().find(friction) else { return };
    let patterns = compile(&rule.joints).unwrap_or_default();
    let covers = |joint: &&String| patterns.iter().any(|pattern| pattern.covers(joint));
    let (single, rest): (Vec<&String>, Vec<&String>) =
        joints.iter().filter(covers).partition(|joint| group.contains(joint));
    let mut each = rule.clone();
    each.per = Sharing::Joint;
    each.joints = single.into_iter().cloned().collect();
    rule.joints = rest.into_iter().cloned().collect();
    // Beside the rule from which it was taken, so that frictions stay together in tables.
    let place = config.parameter.iter().position(|rule| rule.kind == JointParameter::FrictionLoss);
    let place = place.map_or(0, |place| place + 1);
    config.parameter.insert(place, each);
    config.parameter.retain(|rule| !rule.joints.is_empty());
}

#[cfg(test)]
#[path = "remedy_test.rs"]
mod tests;
