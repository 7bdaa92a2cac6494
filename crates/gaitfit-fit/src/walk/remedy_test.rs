//! Tests of the parameters that effects in logs bring to a fit.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::*;
use crate::robot::joint_names;
use crate::walk::fixtures::report;
use crate::walk::swing::Standing;
use gaitfit_swing::{Effect, EffectKind};

fn estimate(value: f64, error: f64) -> Estimate {
    Estimate { value, error }
}

fn calves() -> Vec<String> {
    ["FL", "FR", "RL", "RR"].map(|leg| format!("{leg}_calf_joint")).to_vec()
}

/// Findings of logs with these effects: kind, joint or group, size, standard error, share of the residual.
fn findings(effects: &[(EffectKind, &str, f64, f64, f64)]) -> SwingFindings {
    let numbers = [estimate(0.4, 0.02), estimate(0.1, 0.02), estimate(0.03, 0.001)];
    let report = report("calf", calves(), numbers, [estimate(0.005, 0.001), estimate(1.0, 0.2)]);
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
    let none = Remedies::new(&findings(&[]), &before, &base, &joints);
    none.extend(&mut config, &joints);
    assert_eq!((none.note(), theta(&config, &joints).len()), (None, before.len()));

    let ground = (EffectKind::UnevenGround, "", 0.009, 0.0003, 1.0);
    let twist = (EffectKind::Elasticity, "thigh", 0.005, 0.0001, 0.9);
    let load = (EffectKind::LoadFriction, "calf", 0.09, 0.003, 0.7);
    let tilted = Standing { tilt: Some([estimate(0.03, 0.001), estimate(0.0, 0.001)]) };
    let effects = SwingFindings { standing: tilted, ..findings(&[ground, twist, load]) };
    let remedies = Remedies::new(&effects, &before, &base, &joints);
    remedies.extend(&mut config, &joints);
    let after = theta(&config, &joints);
    let has_impedance = |theta: &Theta| theta.entries().iter().any(|one| one.name == "ground_impedance");
    assert!(
        has_impedance(&before) && !has_impedance(&after),
        "logs do not tell softer ground from firmer feet"
    );
    let mut own = defaults().0;
    own.number.retain(|rule| rule.kind == RobotNumber::GroundImpedance);
    remedies.extend(&mut own, &joints);
    assert!(has_impedance(&theta(&own, &joints)), "what a user asks for stays");
    let new: Vec<&str> = after
        .entries()
        .iter()
        .filter(|entry| before.entries().iter().all(|old| old.name != entry.name))
        .map(|entry| entry.name.as_str())
        .collect();
    let expected =
        ["compliance_calf", "compliance_hip", "compliance_thigh", "imu_roll", "imu_pitch", "ground_softness"];
    let mut sorted = (new.clone(), expected.to_vec());
    sorted.0.sort_unstable();
    sorted.1.sort_unstable();
    assert_eq!(sorted.0, sorted.1, "friction under load is a default parameter");
    let note = remedies.note().unwrap();
    assert!(note.contains("9 mm apart") && note.contains("ground_softness"), "{note}");
    assert_eq!(Remedies::new(&effects, &after, &base, &joints).note(), None, "effects are not added twice");
    let mut soft = base.clone();
    soft.robot.ground_softness = 1.0;
    let known = Remedies::new(&findings(&[ground]), &before, &soft, &joints);
    assert_eq!(known.note(), None, "a known softness is not fitted");
}

#[test]
fn a_joint_unlike_its_siblings_brings_one_friction_for_each_of_them() {
    let (mut config, before, base, joints) = defaults();
    let odd = (EffectKind::OddFriction, "FL_calf_joint", 0.12, 0.01, 0.2);
    let remedies = Remedies::new(&findings(&[odd]), &before, &base, &joints);
    remedies.extend(&mut config, &joints);
    let after = theta(&config, &joints);
    assert_eq!(after.len(), before.len() + 3);
    let friction = |entry: &&gaitfit_adapt::Entry| entry.kind == "frictionloss";
    let names: Vec<&str> = after.entries().iter().filter(friction).map(|entry| entry.name.as_str()).collect();
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
    let shown = Remedies::new(&of_share(0.87), &before, &base, &joints);
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
    assert_eq!(Remedies::new(&of_share(0.87), &after, &base, &joints).note(), None, "it is not added twice");
    assert_eq!(shown.without_springs().single_numbers(), []);
    assert_eq!(
        Remedies::new(&of_share(0.02), &before, &base, &joints).note(),
        None,
        "it explains next to nothing"
    );
}

#[test]
fn a_joint_with_a_spring_and_a_weak_motor_brings_each_number_once() {
    let (mut config, before, base, joints) = defaults();
    let joint = "FL_calf_joint";
    let spring =
        Effect { rest: Some(-1.5), ..Effect::new(EffectKind::OddSpring, joint, estimate(30.0, 0.4), 0.87) };
    let weak = Effect::new(EffectKind::OddStrength, joint, estimate(-0.3, 0.02), 0.4);
    let with = |effects: Vec<Effect>| SwingFindings { effects, ..findings(&[]) };
    let kinds = |remedies: &Remedies| -> Vec<&'static str> {
        let mut kinds: Vec<&str> = remedies.single_numbers().iter().map(|number| number.kind).collect();
        kinds.sort_unstable();
        kinds
    };
    let both = Remedies::new(&with(vec![spring.clone(), weak.clone()]), &before, &base, &joints);
    assert_eq!(kinds(&both), ["spring_torque", "stiffness", "torque_scale"]);
    // A fit that has the spring already gets the strength alone.
    Remedies::new(&with(vec![spring.clone()]), &before, &base, &joints).extend(&mut config, &joints);
    let sprung = theta(&config, &joints);
    let more = Remedies::new(&with(vec![spring, weak]), &sprung, &base, &joints);
    assert_eq!(kinds(&more), ["torque_scale"]);
    more.extend(&mut config, &joints);
    assert_eq!(theta(&config, &joints).len(), before.len() + 3);
}

#[test]
fn a_weak_motor_brings_the_strength_of_its_joint_beside_that_of_all_others() {
    let (mut config, before, base, joints) = defaults();
    let weak = (EffectKind::OddStrength, "FL_calf_joint", -0.3, 0.02, 0.4);
    let reversed = (EffectKind::OddStrength, "FL_calf_joint", -1.2, 0.02, 0.4);
    assert_eq!(Remedies::new(&findings(&[reversed]), &before, &base, &joints).note(), None, "no weak motor");
    let remedies = Remedies::new(&findings(&[weak]), &before, &base, &joints);
    remedies.extend(&mut config, &joints);
    let after = theta(&config, &joints);
    let strengths: Vec<_> = after.entries().iter().filter(|entry| entry.kind == "torque_scale").collect();
    let [all, single] = strengths[..] else { panic!("{strengths:?}") };
    assert!(all.joints.len() == 11 && !all.joints.contains(&"FL_calf_joint".to_owned()), "{all:?}");
    assert!(single.joints == ["FL_calf_joint"] && (single.start - 0.7).abs() < 1e-12, "{single:?}");
    assert!((single.lower - 0.55).abs() < 1e-12 && (single.upper - 0.85).abs() < 1e-12, "{single:?}");
    assert_eq!(
        Remedies::new(&findings(&[weak]), &after, &base, &joints).note(),
        None,
        "it is not added twice"
    );
}

#[test]
fn a_group_with_a_parameter_of_one_joint_gets_none_for_the_others() {
    let (mut config, _, base, joints) = defaults();
    let mut rule = ParameterRule {
        per: Sharing::Joint,
        joints: vec!["FL_calf_joint".to_owned()],
        ..ParameterRule::new(JointParameter::Compliance)
    };
    rule.resolve();
    config.parameter.push(rule);
    let before = theta(&config, &joints);
    let twist = |group| findings(&[(EffectKind::Elasticity, group, 0.005, 0.0001, 0.9)]);
    assert_eq!(Remedies::new(&twist("calf"), &before, &base, &joints).note(), None);
    Remedies::new(&twist("thigh"), &before, &base, &joints).extend(&mut config, &joints);
    let after = theta(&config, &joints);
    let mut names: Vec<&str> = after
        .entries()
        .iter()
        .filter(|entry| entry.kind == "compliance")
        .map(|entry| entry.name.as_str())
        .collect();
    names.sort_unstable();
    assert_eq!(names, ["compliance_FL_calf", "compliance_hip", "compliance_thigh"]);
}
