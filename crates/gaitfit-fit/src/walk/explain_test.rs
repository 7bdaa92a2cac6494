//! Tests of the named effects, and of the doubt about effects that a fitted simulator lacks.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::*;
use crate::walk::fixtures::report;
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
    let play = (EffectKind::Backlash, "thigh", 0.035, 0.002, 0.03);
    assert_eq!(kinds(&[play]), [], "it was not compared with robots without play");
    let ground = (EffectKind::UnevenGround, "", 0.009, 0.0003, 1.0);
    assert_eq!(kinds(&[ground, load(0.3, 0.003, 0.7)]), [CauseKind::LoadFriction, CauseKind::Ground]);
}

#[test]
fn effects_count_beyond_those_of_robots_without_them() {
    let beside = |kind, size, without: [f64; 2]| {
        let mut findings = findings(&[(kind, "thigh", size, 0.002, 0.2)]);
        findings.effects[0].without = Some(Estimate { value: without[0], error: without[1] });
        causes(&findings)
            .iter()
            .map(|cause| (cause.kind, (1e3 * cause.size.value).round()))
            .collect::<Vec<_>>()
    };
    assert_eq!(beside(EffectKind::Backlash, 0.035, [0.005, 0.001]), [(CauseKind::Backlash, 30.0)]);
    assert_eq!(beside(EffectKind::Backlash, 0.035, [0.028, 0.001]), []);
    assert_eq!(beside(EffectKind::Backlash, 0.035, [0.005, 0.02]), [], "such robots differ as much");
    let load = EffectKind::LoadFriction;
    assert_eq!(beside(load, 0.02, [-0.05, 0.001]), [(CauseKind::LoadFriction, 70.0)]);
    assert_eq!(beside(load, 0.09, [0.07, 0.001]), []);
}

#[test]
fn swings_show_much_play_if_feet_do_not() {
    let strength = (EffectKind::Strength, "calf", -0.5, 0.03, 0.6);
    let kinds = |effects: &[_], without: f64| -> Vec<(CauseKind, String)> {
        let mut findings = findings(effects);
        let compared = |effect: &mut Effect| effect.without = Some(Estimate { value: without, error: 0.02 });
        findings.effects.iter_mut().filter(|effect| effect.kind == EffectKind::Strength).for_each(compared);
        let play = (EffectKind::Backlash, Some(Estimate { value: 0.0, error: 0.001 }));
        findings
            .effects
            .iter_mut()
            .filter(|effect| effect.kind == play.0)
            .for_each(|effect| effect.without = play.1);
        causes(&findings).into_iter().map(|cause| (cause.kind, cause.unit)).collect()
    };
    assert_eq!(kinds(&[strength], -0.1), [(CauseKind::Backlash, "-".to_owned())]);
    assert_eq!(kinds(&[strength], -0.4), [], "simulated robots respond as little");
    let heights = (EffectKind::Backlash, "calf", 0.03, 0.002, 0.1);
    assert_eq!(kinds(&[strength, heights], -0.1), [(CauseKind::Backlash, "rad".to_owned())], "once");
    assert_eq!(causes(&findings(&[strength])), [], "it was not compared");
    let load = (EffectKind::LoadFriction, "hip", 0.09, 0.003, 0.7);
    assert_eq!(kinds(&[strength, load], -0.1), [(CauseKind::LoadFriction, "-".to_owned())], "gears rub");
}

#[test]
fn what_looks_like_play_hides_it() {
    let play = (EffectKind::Backlash, "thigh", 0.035, 0.002, 0.03);
    let kinds = |other: (EffectKind, &str, f64, f64, f64)| -> Vec<CauseKind> {
        let mut findings = findings(&[play, other]);
        findings.effects[0].without = Some(Estimate { value: 0.005, error: 0.001 });
        causes(&findings).iter().map(|cause| cause.kind).collect()
    };
    let twist = (EffectKind::Elasticity, "calf", 0.005, 0.0001, 0.9);
    assert_eq!(kinds(twist), [CauseKind::Elasticity], "a robot on soft joints leans");
    let load = |group| (EffectKind::LoadFriction, group, 0.09, 0.003, 0.7);
    assert_eq!(kinds(load("thigh")), [CauseKind::LoadFriction]);
    assert_eq!(kinds(load("calf")), [CauseKind::Backlash, CauseKind::LoadFriction]);
}

#[test]
fn the_tilt_depends_on_whether_joints_twist() {
    let tilt = |pitch| Standing { tilt: Some([0.0, pitch].map(|value| Estimate { value, error: 0.0005 })) };
    let mut findings = findings(&[(EffectKind::Elasticity, "calf", 0.005, 0.0001, 0.9)]);
    (findings.standing, findings.beside_twist) = (tilt(0.012), Some(tilt(0.001)));
    let kinds =
        |findings: &SwingFindings| causes(findings).iter().map(|cause| cause.kind).collect::<Vec<_>>();
    assert_eq!(kinds(&findings), [CauseKind::Elasticity]);
    // Simulated robots that do not twist show the same.
    findings.effects[0].without = Some(Estimate { value: 0.005, error: 0.0001 });
    assert_eq!(kinds(&findings), [CauseKind::Tilt]);
}

#[test]
fn what_is_fitted_or_known_is_not_missing() {
    let model = crate::robot::go2().unwrap();
    let base = Candidate::nominal(&model);
    let of_effects = causes(&findings(&[
        (EffectKind::LoadFriction, "calf", 0.09, 0.003, 0.7),
        (EffectKind::UnevenGround, "", 0.009, 0.0003, 1.0),
    ]));
    let text = missing(&of_effects, &Theta::default(), &base, &[]).unwrap_or_default();
    assert!(text.contains("grows by 0.090") && text.contains("9 mm apart"), "{text}");
    assert_eq!(missing(&[], &Theta::default(), &base, &[]), None);
    // A simulator whose unit is tilted does not lack the tilt.
    let standing = Standing { tilt: Some([Estimate { value: 0.03, error: 0.001 }; 2]) };
    let tilted = causes(&SwingFindings { standing, ..SwingFindings::default() });
    let theta = |kinds: &[RobotNumber]| {
        let robot = kinds.iter().map(|kind| RobotRule::new(*kind)).collect();
        Rules { robot, ..Rules::default() }.theta(&[], &[], &[]).unwrap_or_default()
    };
    let doubt = missing(&tilted, &theta(&[RobotNumber::BaseMass]), &base, &[]).unwrap_or_default();
    assert!(
        doubt.contains("tilted by 1.7° of roll") && doubt.contains("fit it: imu_roll, imu_pitch"),
        "{doubt}"
    );
    assert_eq!(missing(&tilted, &theta(&[RobotNumber::ImuRoll, RobotNumber::ImuPitch]), &base, &[]), None);
    let mut known = base.clone();
    known.sensors.imu_tilt = [0.03, 0.03];
    assert_eq!(missing(&tilted, &Theta::default(), &known, &[]), None);
    let velocity_lag = Some(Estimate { value: 0.004, error: 0.0001 });
    let sensors = Sensors { velocity_lag, ..Sensors::default() };
    let late = causes(&SwingFindings { sensors, ..SwingFindings::default() });
    let doubt = missing(&late, &theta(&[RobotNumber::ImuRoll]), &base, &[]).unwrap_or_default();
    assert!(doubt.contains("by 4.0 ms") && doubt.contains("fit it: velocity_lag"), "{doubt}");
    assert_eq!(missing(&late, &theta(&[RobotNumber::VelocityLag]), &base, &[]), None);
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
    assert!(covered(&odd, &theta("FL_calf_joint"), &base, &joints));
    assert!(!covered(&odd, &theta("waist_joint"), &base, &joints), "a group of one joint is another joint's");
}

#[test]
fn a_gear_parameter_covers_its_own_joint_group_alone() {
    let model = crate::robot::go2().unwrap();
    let joints = crate::robot::joint_names(&model);
    let base = Candidate::nominal(&model);
    let load = (EffectKind::LoadFriction, "calf", 0.09, 0.003, 0.7);
    let twist = (EffectKind::Elasticity, "calf", 0.005, 0.0001, 0.9);
    for (effect, kind) in [(load, JointParameter::LoadFriction), (twist, JointParameter::Compliance)] {
        let causes = causes(&findings(&[effect]));
        assert_eq!(causes.len(), 1);
        for (group, is_covered) in [("calf", true), ("thigh", false)] {
            let rule = ParameterRule {
                per: Sharing::All,
                joints: vec![format!("*_{group}_joint")],
                ..ParameterRule::new(kind)
            };
            let theta = Rules { parameter: vec![rule], ..Rules::default() }.theta(&[], &joints, &[]).unwrap();
            assert_eq!(covered(&causes[0], &theta, &base, &joints), is_covered, "{kind:?} of {group}");
        }
        let mut known = base.clone();
        let numbers = match kind {
            JointParameter::LoadFriction => &mut known.robot.load_friction,
            _ => &mut known.robot.compliance,
        };
        numbers[1] = 0.1;
        assert!(!covered(&causes[0], &Theta::default(), &known, &joints), "a thigh has it");
    }
}

#[test]
fn a_known_spring_or_strength_covers_its_own_joint_alone() {
    let model = crate::robot::go2().unwrap();
    let joints = crate::robot::joint_names(&model);
    let mut base = Candidate::nominal(&model);
    (base.robot.stiffness[0], base.robot.torque_scale[0]) = (20.0, 0.7);
    for kind in [CauseKind::OddSpring, CauseKind::OddStrength] {
        let of = |joint: usize| Cause {
            kind,
            of: joints[joint].clone(),
            size: Estimate { value: 20.0, error: 1.0 },
            unit: String::new(),
            weight: 1.0,
            text: "odd".to_owned(),
        };
        assert!(covered(&of(0), &Theta::default(), &base, &joints), "{kind:?}");
        assert!(!covered(&of(1), &Theta::default(), &base, &joints), "{kind:?}");
    }
}

#[test]
fn play_that_swings_show_and_the_fit_does_not_find_is_marked() {
    let joints = ["FL", "FR"].map(|leg| format!("{leg}_thigh_joint")).to_vec();
    let none = Estimate { value: 0.0, error: 0.1 };
    let swings = report("thigh", joints.clone(), [none; 3], [none; 2]);
    let with = |kind, size| {
        let mut findings = findings(&[(kind, "thigh", size, 0.002, 0.6)]);
        findings.effects[0].without = Some(Estimate { value: 0.0, error: 0.002 });
        SwingFindings { swings: Some(swings.clone()), ..findings }
    };
    let rule = ParameterRule { joints: joints.clone(), ..ParameterRule::new(JointParameter::Play) };
    let rules = Rules { parameter: vec![rule], ..Rules::default() };
    let groups = [("thigh".to_owned(), joints.clone())];
    let theta = rules.theta(&groups, &joints, &[]).unwrap();
    let marked = |kind, size, play: f64| false_play(&with(kind, size), &theta, &vec![play; theta.len()]);
    let text = marked(EffectKind::Strength, -0.4, 0.003);
    assert_eq!(text.len(), 1, "{text:?}");
    assert!(text[0].contains("play of thigh joints, but the fit finds 0.003 rad"), "{text:?}");
    assert!(marked(EffectKind::Strength, -0.4, 0.021).is_empty(), "the fit finds it too");
    assert!(marked(EffectKind::Backlash, 0.03, 0.003).is_empty(), "it comes from the heights of feet");
    assert!(false_play(&with(EffectKind::Strength, -0.4), &Theta::default(), &[]).is_empty());
}
