//! Adds parameters to a default fit for effects that the logs show without a simulation.
//!
//! They are added before the search, without a first fit that lacks them. This does little harm: if the robot does not have
//! the effect, these parameters end near 0 and the other values stay (docs, "Effects that the model lacks").

use super::explain::{Cause, CauseKind, causes, covered};
use super::singles::single_numbers;
use super::swing::{Estimate, SwingFindings, SwingNumber};
use crate::settings::AdaptConfig;
use gaitfit_adapt::{JointParameter, ParameterRule, RobotNumber, RobotRule, Sharing, Theta};
use gaitfit_model::patterns::compile;
use gaitfit_sim::Candidate;
use gaitfit_swing::GroupEstimate;

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

    /// Remedies for the effects in `findings`, except those that `theta` or `base` covers.
    pub fn new(findings: &SwingFindings, theta: &Theta, base: &Candidate) -> Self {
        let mut remedies = Self::default();
        for cause in causes(findings).iter().filter(|cause| !covered(cause, theta, base)) {
            if remedies.add(cause, findings) {
                remedies.effects.push((cause.kind, cause.effect().to_owned()));
            }
        }
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
            CauseKind::OddSpring | CauseKind::OddStrength => {
                let of_joint = |number: &SwingNumber| number.joints == [cause.of.as_str()];
                self.singles.extend(single_numbers(findings).into_iter().filter(of_joint));
            }
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
            rule.joints = covered.clone().unwrap_or(rule.joints);
            // Defaults are filled in here, because those of the configuration were filled in before.
            rule.resolve();
            config.parameter.push(rule);
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
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::robot::joint_names;
    use crate::settings::walk_defaults;
    use crate::walk::swing::Standing;
    use gaitfit_swing::{Effect, EffectKind};
    use gaitfit_swing::{FrictionLaw, SwingReport};

    fn estimate(value: f64, error: f64) -> Estimate {
        Estimate { value, error }
    }

    fn calves() -> Vec<String> {
        ["FL", "FR", "RL", "RR"].map(|leg| format!("{leg}_calf_joint")).to_vec()
    }

    /// Findings of logs with these effects: kind, joint or group, size, standard error, share of the residual.
    fn findings(effects: &[(EffectKind, &str, f64, f64, f64)]) -> SwingFindings {
        let group = GroupEstimate {
            group: "calf".into(),
            joints: calves(),
            friction: estimate(0.4, 0.02),
            damping: estimate(0.1, 0.02),
            armature: estimate(0.03, 0.001),
            by_strength: [0.0; 3],
            by_load: [0.0; 3],
            swings: 100,
            windows: 1000,
            residual: 0.4,
        };
        let report = SwingReport {
            groups: vec![group],
            delay: estimate(0.005, 0.001),
            delay_by_strength: 0.0,
            strength: estimate(1.0, 0.2),
            law: FrictionLaw::Coulomb,
            clearance_m: 0.012,
            logs: 12,
            unseen: vec![],
        };
        let effect = |&(kind, of, value, error, share): &(EffectKind, &str, f64, f64, f64)| {
            Effect::new(kind, of, estimate(value, error), share)
        };
        let effects = effects.iter().map(effect).collect();
        SwingFindings { effects, swings: Some(report), ..SwingFindings::default() }
    }

    /// The settings and θ of a walking Go2's default fit.
    fn defaults() -> (AdaptConfig, Theta, Candidate, Vec<String>) {
        let model = crate::robot::go2().unwrap();
        let joints = joint_names(&model);
        let mut config = walk_defaults();
        config.parameter.iter_mut().for_each(ParameterRule::resolve);
        config.number.iter_mut().for_each(RobotRule::resolve);
        let theta = theta(&config, &joints);
        (config, theta, Candidate::nominal(&model), joints)
    }

    fn theta(config: &AdaptConfig, joints: &[String]) -> Theta {
        config.rules().theta(&config.groups(joints), joints, &vec![0.0; joints.len()]).unwrap()
    }

    #[test]
    fn effects_bring_their_parameters_and_no_others() {
        let (mut config, before, base, joints) = defaults();
        let none = Remedies::new(&findings(&[]), &before, &base);
        none.extend(&mut config, &joints);
        assert_eq!((none.note(), theta(&config, &joints).len()), (None, before.len()));

        let ground = (EffectKind::UnevenGround, "", 0.009, 0.0003, 1.0);
        let twist = (EffectKind::Elasticity, "thigh", 0.005, 0.0001, 0.9);
        let load = (EffectKind::LoadFriction, "calf", 0.09, 0.003, 0.7);
        let tilted = Standing { tilt: Some([estimate(0.03, 0.001), estimate(0.0, 0.001)]) };
        let effects = SwingFindings { standing: tilted, ..findings(&[ground, twist, load]) };
        let remedies = Remedies::new(&effects, &before, &base);
        remedies.extend(&mut config, &joints);
        let after = theta(&config, &joints);
        let new: Vec<&str> = after
            .entries()
            .iter()
            .filter(|entry| before.entries().iter().all(|old| old.name != entry.name))
            .map(|entry| entry.name.as_str())
            .collect();
        let expected = [
            "compliance_calf",
            "compliance_hip",
            "compliance_thigh",
            "imu_roll",
            "imu_pitch",
            "ground_softness",
        ];
        let mut sorted = (new.clone(), expected.to_vec());
        sorted.0.sort_unstable();
        sorted.1.sort_unstable();
        assert_eq!(sorted.0, sorted.1, "friction under load is a default parameter");
        let note = remedies.note().unwrap();
        assert!(note.contains("9 mm apart") && note.contains("ground_softness"), "{note}");
        assert_eq!(Remedies::new(&effects, &after, &base).note(), None, "effects are not added twice");
        let mut soft = base.clone();
        soft.robot.ground_softness = 1.0;
        let known = Remedies::new(&findings(&[ground]), &before, &soft);
        assert_eq!(known.note(), None, "a known softness is not fitted");
    }

    #[test]
    fn a_joint_unlike_its_siblings_brings_one_friction_for_each_of_them() {
        let (mut config, before, base, joints) = defaults();
        let odd = (EffectKind::OddFriction, "FL_calf_joint", 0.12, 0.01, 0.2);
        let remedies = Remedies::new(&findings(&[odd]), &before, &base);
        remedies.extend(&mut config, &joints);
        let after = theta(&config, &joints);
        assert_eq!(after.len(), before.len() + 3);
        let friction = |entry: &&gaitfit_adapt::Entry| entry.kind == "frictionloss";
        let names: Vec<&str> =
            after.entries().iter().filter(friction).map(|entry| entry.name.as_str()).collect();
        assert!(names.contains(&"frictionloss_hip") && names.contains(&"frictionloss_FL_calf"), "{names:?}");
        assert!(!names.contains(&"frictionloss_calf"), "{names:?}");
        let number = SwingNumber {
            kind: "frictionloss",
            joints: calves(),
            estimate: estimate(0.4, 0.05),
            by_strength: 0.0,
            by_load: 0.0,
        };
        let mut numbers = [number];
        remedies.widen_priors(&mut numbers);
        assert_eq!(numbers[0].estimate, estimate(0.4, 0.13));
    }

    #[test]
    fn a_spring_brings_its_stiffness_and_torque_around_their_estimates() {
        let (mut config, before, base, joints) = defaults();
        let spring = EffectKind::OddSpring;
        let of_share = |share: f64| SwingFindings {
            effects: vec![Effect {
                rest: Some(-1.5),
                ..Effect::new(spring, "RR_calf_joint", estimate(30.0, 0.4), share)
            }],
            ..findings(&[])
        };
        let shown = Remedies::new(&of_share(0.87), &before, &base);
        shown.extend(&mut config, &joints);
        let after = theta(&config, &joints);
        let of_spring = |kind: &str| {
            let entry = after.entries().iter().find(|entry| entry.kind == kind).unwrap();
            assert_eq!(entry.joints, ["RR_calf_joint"]);
            (entry.lower, entry.start, entry.upper)
        };
        assert_eq!(of_spring("stiffness"), (15.0, 30.0, 45.0), "the error is at least a tenth");
        assert_eq!(of_spring("spring_torque"), (-67.5, -45.0, -22.5));
        assert_eq!(shown.single_numbers().len(), 2);
        let note = shown.note().unwrap();
        assert!(note.contains("spring of 30.0 ± 0.4 N·m/rad, at rest at -1.50 rad"), "{note}");
        assert_eq!(Remedies::new(&of_share(0.87), &after, &base).note(), None, "it is not added twice");
        assert_eq!(shown.without_springs().single_numbers(), []);
        assert_eq!(
            Remedies::new(&of_share(0.02), &before, &base).note(),
            None,
            "it explains next to nothing"
        );
    }

    #[test]
    fn a_weak_motor_brings_the_strength_of_its_joint_beside_that_of_all_others() {
        let (mut config, before, base, joints) = defaults();
        let weak = (EffectKind::OddStrength, "FL_calf_joint", -0.3, 0.02, 0.4);
        let reversed = (EffectKind::OddStrength, "FL_calf_joint", -1.2, 0.02, 0.4);
        assert_eq!(Remedies::new(&findings(&[reversed]), &before, &base).note(), None, "no weak motor");
        let remedies = Remedies::new(&findings(&[weak]), &before, &base);
        remedies.extend(&mut config, &joints);
        let after = theta(&config, &joints);
        let strengths: Vec<_> = after.entries().iter().filter(|entry| entry.kind == "torque_scale").collect();
        let [all, single] = strengths[..] else { panic!("{strengths:?}") };
        assert!(all.joints.len() == 11 && !all.joints.contains(&"FL_calf_joint".to_owned()), "{all:?}");
        assert!(single.joints == ["FL_calf_joint"] && (single.start - 0.7).abs() < 1e-12, "{single:?}");
        assert!((single.lower - 0.55).abs() < 1e-12 && (single.upper - 0.85).abs() < 1e-12, "{single:?}");
        assert_eq!(Remedies::new(&findings(&[weak]), &after, &base).note(), None, "it is not added twice");
    }
}
