//! θ from rules, its values on robots, and its files.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::*;
use gaitfit_model::JointKind;
use std::collections::BTreeMap;

/// A robot of `joints` joints on which nothing is set.
fn tests_candidate(joints: usize) -> Candidate {
    let body = |joint| {
        format!(
            "<body><inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/><joint name='{joint}' axis='0 0 1'/>"
        )
    };
    let bodies: String = (0..joints).map(body).chain((0..joints).map(|_| "</body>".to_owned())).collect();
    let text = format!("<mujoco><worldbody>{bodies}</worldbody></mujoco>");
    Candidate::nominal(&gaitfit_model::read_mjcf_str(&text, &Default::default()).unwrap())
}

fn joints() -> Vec<String> {
    ["FL", "FR"].iter().flat_map(|leg| ["hip", "thigh", "calf"].map(|part| format!("{leg}_{part}"))).collect()
}

fn groups() -> Vec<(String, Vec<String>)> {
    ["hip", "thigh", "calf"].map(|name| (name.to_owned(), vec![format!("*_{name}")])).to_vec()
}

fn rule(kind: JointParameter, per: Sharing, patterns: &[&str]) -> ParameterRule {
    ParameterRule {
        per,
        joints: patterns.iter().map(|&pattern| pattern.to_owned()).collect(),
        ..ParameterRule::new(kind)
    }
}

#[test]
fn fric_arm_has_six_numbers_with_the_papers_bounds() {
    let theta = Theta::from_rules(&ParameterRule::fric_arm(), &groups(), &joints()).unwrap();
    let names: Vec<_> = theta.entries().iter().map(|entry| entry.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "frictionloss_hip",
            "frictionloss_thigh",
            "frictionloss_calf",
            "armature_hip",
            "armature_thigh",
            "armature_calf"
        ]
    );
    let hip = &theta.entries()[0];
    assert_eq!((hip.lower, hip.upper, hip.start, hip.deviation), (0.0, 0.5, 0.0, 0.1));
    assert_eq!(hip.joints, ["FL_hip", "FR_hip"]);
    assert_eq!(theta.entries()[3].deviation, 0.05);
}

#[test]
fn one_value_for_all_one_for_each_and_one_for_a_pattern() {
    let rules = [
        rule(JointParameter::Delay, Sharing::All, &["*"]),
        rule(JointParameter::EncoderBias, Sharing::Joint, &["*_calf"]),
        rule(JointParameter::Damping, Sharing::All, &["*_hip"]),
    ];
    let theta = Theta::from_rules(&rules, &groups(), &joints()).unwrap();
    let names: Vec<_> = theta.entries().iter().map(|entry| entry.name.as_str()).collect();
    assert_eq!(names, ["delay", "encoder_bias_FL_calf", "encoder_bias_FR_calf", "damping_hip"]);
    assert_eq!(theta.largest(JointParameter::Delay), Some(0.1));

    let mut candidate = tests_candidate(6);
    theta.apply(&[0.01, 0.02, 0.03, 0.04], &joints(), &mut candidate);
    assert_eq!(candidate.robot.encoder_bias, [0.0, 0.0, 0.02, 0.0, 0.0, 0.03]);
    assert_eq!(candidate.robot.delay, [0.01; 6]);
    assert_eq!(candidate.robot.damping, [0.04, 0.0, 0.0, 0.04, 0.0, 0.0]);
}

#[test]
fn patterns_and_names_leave_out_a_final_joint() {
    let joints = ["FL_hip_joint".to_owned(), "FL_calf_joint".to_owned()];
    let rules = [rule(JointParameter::Delay, Sharing::Joint, &["*_hip"])];
    let theta = Theta::from_rules(&rules, &groups(), &joints).unwrap();
    assert_eq!(theta.entries()[0].name, "delay_FL_hip");
    assert_eq!(theta.entries()[0].joints, ["FL_hip_joint"]);
}

#[test]
fn a_bound_below_its_start_is_refused_by_name() {
    let mut low = rule(JointParameter::Armature, Sharing::Group, &["*"]);
    low.upper = Some(0.1);
    low.start = Some(0.2);
    let error = Theta::from_rules(&[low], &groups(), &joints()).unwrap_err();
    assert!(error.to_string().contains("armature_hip"), "{error}");
    let mut negative = rule(JointParameter::Armature, Sharing::Group, &["*"]);
    negative.lower = Some(-0.1);
    let error = Theta::from_rules(&[negative], &groups(), &joints()).unwrap_err();
    assert!(matches!(error, ThetaError::Meaningless { .. }), "{error}");
    // What is found there no theta.toml could say.
    let mut wide = rule(JointParameter::NoLoadSpeed, Sharing::All, &["*"]);
    wide.upper = Some(1e300);
    let error = Theta::from_rules(&[wide], &groups(), &joints()).unwrap_err();
    assert!(matches!(error, ThetaError::Wide { .. }) && error.to_string().contains("1e300"), "{error}");
}

#[test]
fn overlapping_unmatched_and_ungrouped_joints_are_refused() {
    let twice = [
        rule(JointParameter::Delay, Sharing::All, &["*"]),
        ParameterRule { name: Some("late".into()), ..rule(JointParameter::Delay, Sharing::All, &["*_hip"]) },
    ];
    let error = Theta::from_rules(&twice, &groups(), &joints()).unwrap_err();
    assert!(matches!(error, ThetaError::Overlap { .. }), "{error}");
    let error =
        Theta::from_rules(&[rule(JointParameter::Delay, Sharing::All, &["*_wheel"])], &groups(), &joints())
            .unwrap_err();
    assert!(matches!(error, ThetaError::Joints { .. }), "{error}");
    let error =
        Theta::from_rules(&[rule(JointParameter::Delay, Sharing::Group, &["*"])], &groups()[..2], &joints())
            .unwrap_err();
    assert!(error.to_string().contains("FL_calf"), "{error}");
}

#[test]
fn everything_combines_and_clashes_are_named() {
    let rest = [0.1, 0.8, -1.5, -0.1, 0.8, -1.5];
    let spring = NetworkRule { joints: vec!["FR_calf".into()], ..NetworkRule::new(NetworkName::ResidAct) };
    let delta = NetworkRule { joints: vec!["*_calf".into()], ..NetworkRule::new(NetworkName::ActionDelta) };
    let mut rules = Rules {
        parameter: ParameterRule::fric_arm(),
        network: vec![spring, delta],
        robot: vec![RobotRule::new(RobotNumber::TorqueNoise), RobotRule::new(RobotNumber::BaseComY)],
    };
    let theta = rules.theta(&groups(), &joints(), &rest).unwrap();
    assert_eq!(theta.len(), 6 + 3 * 97 + 2);
    assert_eq!(theta.entries()[6].name, "resid_act_FR_calf_0");
    assert_eq!(theta.entries()[6 + 97 + 96].name, "action_delta_FL_calf_96");
    let values: Vec<f64> = (0..theta.len()).map(|index| 0.001 * index as f64).collect();
    let mut candidate = tests_candidate(6);
    theta.apply(&values, &joints(), &mut candidate);
    assert_eq!(candidate.robot.armature[5], 0.005);
    assert_eq!((candidate.networks[0].joints.as_slice(), candidate.networks[0].rest[0]), (&[5][..], -1.5));
    assert_eq!(candidate.networks[0].weights, values[6..6 + 97]);
    assert_eq!(candidate.networks[1].joints, [2, 5]);
    assert_eq!(candidate.networks[1].weights, values[6 + 97..6 + 3 * 97]);
    assert_eq!((candidate.torque_noise, candidate.robot.base_com[1]), (values[297], values[298]));

    rules.robot.push(RobotRule::new(RobotNumber::TorqueNoise));
    let error = rules.theta(&groups(), &joints(), &rest).unwrap_err();
    assert_eq!(error, ThetaError::SameName("torque_noise".into()));
    rules.robot.pop();
    rules.network.push(NetworkRule::new(NetworkName::ResidAct));
    let error = rules.theta(&groups(), &joints(), &rest).unwrap_err();
    assert!(error.to_string().contains("resid_act"), "{error}");
    let error = rules.theta(&groups(), &joints(), &rest[..3]).unwrap_err();
    assert!(matches!(error, ThetaError::Rest { count: 3, joints: 6, .. }), "{error}");
    rules.network[2].output_scale = 0.0;
    let error = rules.theta(&groups(), &joints(), &rest).unwrap_err();
    assert!(error.to_string().contains("output_scale"), "{error}");
}

#[test]
fn networks_start_at_no_output_and_only_the_last_layer_is_regularised() {
    let rest = [0.0; 6];
    let rule = NetworkRule {
        start: NetworkStart::Random,
        regularisation: 2.0,
        ..NetworkRule::new(NetworkName::ResidAct)
    };
    let theta = Theta::new(vec![rule.modification(&[], &joints(), &rest).unwrap()]).unwrap();
    let (one, two) = (theta.start(1), theta.start(2));
    assert_eq!(one, theta.start(1));
    assert_ne!(one, two);
    for (index, network) in one.chunks_exact(97).enumerate() {
        let (hidden, last) = network.split_at(92);
        assert!(hidden.iter().all(|weight| weight.abs() <= 1.0 && *weight != 0.0), "{index}");
        assert_eq!(last, [0.0; 5]);
    }
    assert_ne!(one[..97], one[97..194], "joints differ");
    assert_eq!(theta.regularisation(&one), 0.0);
    let mut values = one;
    values[92..97].copy_from_slice(&[0.1, 0.2, 0.0, -0.2, 0.4]);
    assert!((theta.regularisation(&values) - 2.0 * 0.25 / 6.0).abs() < 1e-15);
    let zero = NetworkRule::new(NetworkName::ResidAct).modification(&[], &joints(), &rest).unwrap();
    assert_eq!(Theta::new(vec![zero]).unwrap().start(1), vec![0.0; 582]);
}

#[test]
fn of_features_only_the_last_layer_is_searched_and_whole_networks_are_simulated_and_saved() {
    let rule = NetworkRule {
        start: NetworkStart::Features,
        per: Sharing::Group,
        regularisation: 2.0,
        ..NetworkRule::new(NetworkName::ResidAct)
    };
    let theta = Theta::new(vec![rule.modification(&groups(), &joints(), &[0.0; 6]).unwrap()]).unwrap();
    let names: Vec<&str> = theta.entries().iter().map(|entry| entry.name.as_str()).collect();
    assert_eq!(names.len(), 3 * 5);
    assert_eq!(names[..2], ["resid_act_hip_friction", "resid_act_hip_damping"]);
    assert_eq!(theta.start(7), [0.0; 15]);
    let mut values = vec![0.0; 15];
    values[5..10].copy_from_slice(&[0.1, 0.2, 0.0, -0.2, 0.4]);
    assert!((theta.regularisation(&values) - 2.0 * 0.25 / 3.0).abs() < 1e-15);

    let mut candidate = tests_candidate(6);
    theta.apply(&values, &joints(), &mut candidate);
    let networks = &candidate.networks[0];
    let thigh = networks.joints.iter().position(|&joint| joints()[joint] == "FL_thigh").unwrap();
    let weights = networks.weights.chunks_exact(97).nth(thigh).unwrap();
    assert_eq!(weights[92..96], values[5..9]);
    assert!(weights[..92].iter().any(|weight| *weight != 0.0));
    let estimates: Vec<Found> = values.iter().map(|&value| Found { value, spread: None }).collect();
    let saved = ThetaFile::new(&theta, &estimates, "legs", "wass", 0.1);
    let of_thigh = saved.network.iter().find(|network| network.joint == "FL_thigh").unwrap();
    assert_eq!(of_thigh.weights, weights);
}

#[test]
fn a_network_that_a_group_shares_acts_on_each_of_its_joints() {
    let rest = [0.1, 0.8, -1.5, -0.1, 0.8, -1.4];
    let rule = NetworkRule {
        per: Sharing::Group,
        joints: vec!["*_hip".into(), "*_calf".into()],
        regularisation: 1.0,
        ..NetworkRule::new(NetworkName::ActionDelta)
    };
    let theta = Theta::new(vec![rule.modification(&groups(), &joints(), &rest).unwrap()]).unwrap();
    assert_eq!(theta.len(), 2 * 97);
    assert_eq!(theta.entries()[97].name, "action_delta_calf_0");
    assert_eq!(theta.entries()[97].joints, ["FL_calf", "FR_calf"]);
    let values: Vec<f64> = (0..theta.len()).map(|index| 0.001 * index as f64).collect();
    let mut candidate = tests_candidate(6);
    theta.apply(&values, &joints(), &mut candidate);
    let networks = &candidate.networks[0];
    assert_eq!(
        (networks.joints.as_slice(), networks.rest.as_slice()),
        (&[0, 3, 2, 5][..], &[0.1, -0.1, -1.5, -1.4][..])
    );
    for (network, weights) in networks.weights.chunks_exact(97).enumerate() {
        assert_eq!(weights, &values[97 * (network / 2)..][..97]);
    }
    let last: f64 = [92..97, 189..194].into_iter().flatten().map(|at: usize| values[at] * values[at]).sum();
    assert!((theta.regularisation(&values) - last / 2.0).abs() < 1e-15);
    // One for all joints is called after them, so that two such rules go together.
    let all = |joint: &str| {
        let rule = NetworkRule { per: Sharing::All, joints: vec![joint.into()], ..rule.clone() };
        rule.modification(&groups(), &joints(), &rest).unwrap()
    };
    let theta = Theta::new(vec![all("*_hip"), all("*_calf")]).unwrap();
    assert_eq!(theta.len(), 2 * 97);
    assert_eq!(theta.entries()[97].name, "action_delta_calf_0");
    let error = rule.modification(&groups()[..2], &joints(), &rest).unwrap_err();
    assert!(matches!(error, ThetaError::Group { .. }), "{error}");
}

#[test]
fn springs_are_sums_of_what_parameters_and_networks_do() {
    let per_joint = |kind| ParameterRule {
        per: Sharing::Joint,
        joints: vec!["*_calf".into()],
        ..ParameterRule::new(kind)
    };
    let network = NetworkRule {
        joints: vec!["FR_calf".into()],
        start: NetworkStart::Features,
        output_scale: 100.0,
        ..NetworkRule::new(NetworkName::ResidAct)
    };
    let rules = Rules {
        parameter: [JointParameter::Stiffness, JointParameter::SpringTorque].map(per_joint).to_vec(),
        network: vec![network],
        robot: Vec::new(),
    };
    let theta = rules.theta(&groups(), &joints(), &[0.1, 0.8, -1.5, -0.1, 0.8, -1.4]).unwrap();
    // Stiffnesses, torques at 0, then friction, damping, inertia, stiffness and offset of the network.
    let springs = theta.springs(&[40.0, 10.0, -60.0, 1.0, 0.3, 0.3, 0.3, 0.2, 0.5]);
    assert_eq!(
        springs[0],
        LinearSpring { joint: "FL_calf".into(), kind: JointKind::Hinge, stiffness: 40.0, torque: -60.0 }
    );
    assert_eq!(springs[0].rest(), -1.5);
    // 100 · 0.2 N·m/rad about −1.4 rad, and 0.02 · 100 · 0.5 N·m.
    assert_eq!((springs[1].joint.as_str(), springs[1].stiffness), ("FR_calf", 30.0));
    assert!((springs[1].torque - (1.0 - 28.0 + 1.0)).abs() < 1e-12, "{springs:?}");
    assert_eq!(springs.len(), 2);
}

#[test]
fn a_value_on_a_bound_is_seen() {
    let theta = Theta::from_rules(&ParameterRule::fric_arm(), &groups(), &joints()).unwrap();
    assert!(theta.entries()[0].at_bound(0.0) && theta.entries()[0].at_bound(0.4999));
    assert!(!theta.entries()[0].at_bound(0.01));
}

#[test]
fn priors_move_with_the_strength_of_the_motors() {
    let strength = ParameterRule { per: Sharing::All, ..ParameterRule::new(JointParameter::TorqueScale) };
    let rules = [ParameterRule::new(JointParameter::Damping), strength];
    let theta = Theta::from_rules(&rules, &groups(), &joints()).unwrap();
    let place = |name: &str| theta.entries().iter().position(|entry| entry.name == name).unwrap();
    let (damping, scale) = (place("damping_calf"), place("torque_scale"));
    assert_eq!((theta.strength(damping), theta.strength(scale)), (Some(scale), Some(scale)));
    let seen = Prior { by_strength: 0.4, ..Prior::new(0.4, 0.02) };
    let priors = |strength: Option<Prior>| {
        let weak = strength.map(|prior| ("torque_scale".to_owned(), prior));
        [("damping_calf".to_owned(), seen)].into_iter().chain(weak).collect::<BTreeMap<_, _>>()
    };
    let known = theta.with_priors(&priors(Some(Prior::new(0.8, 0.05))), 1.0).unwrap();
    // The search begins with the strength and what belongs to it.
    let mut values = known.start(7);
    assert!((values[scale] - 0.8).abs() < 1e-12 && (values[damping] - 0.32).abs() < 1e-12, "{values:?}");
    assert!(known.prior_cost(&values).abs() < 1e-12);
    // With motors as they should be the estimate is 0.4, and the strength is four errors away.
    (values[scale], values[damping]) = (1.0, 0.4);
    assert!((known.prior_cost(&values) - 16.0).abs() < 1e-9);
    let shifted = seen.with_strength(0.8, 0.1);
    assert!((shifted.value - 0.32).abs() < 1e-12 && (shifted.deviation - 0.02f64.hypot(0.04)).abs() < 1e-12);
}

#[test]
fn priors_move_with_friction_under_load() {
    let rules = [JointParameter::FrictionLoss, JointParameter::LoadFriction].map(ParameterRule::new);
    let theta = Theta::from_rules(&rules, &groups(), &joints()).unwrap();
    let place = |name: &str| theta.entries().iter().position(|entry| entry.name == name).unwrap();
    let (friction, load) = (place("frictionloss_calf"), place("load_friction_calf"));
    assert_eq!(theta.load(friction), Some(load));
    // Legs in the air show 0.4 N·m in all, at a mean torque of 2 N·m.
    let seen = Prior { by_load: 2.0, ..Prior::new(0.4, 0.02) };
    let known = theta.with_priors(&BTreeMap::from([("frictionloss_calf".to_owned(), seen)]), 1.0).unwrap();
    let mut values = known.start(7);
    (values[friction], values[load]) = (0.2, 0.1);
    assert!(known.prior_cost(&values) < 1e-12, "0.2 and 0.1 of 2 N·m");
    values[load] = 0.0;
    assert!((known.prior_cost(&values) - 100.0).abs() < 1e-9, "ten standard errors too little");
    let shifted = seen.with_load(0.1, 0.02);
    assert!((shifted.value - 0.2).abs() < 1e-12 && (shifted.deviation - 0.02f64.hypot(0.04)).abs() < 1e-12);
}

#[test]
fn a_prior_moves_the_start_and_charges_by_standard_errors() {
    let theta = || Theta::from_rules(&ParameterRule::fric_arm(), &groups(), &joints()).unwrap();
    let prior =
        |name: &str, value, deviation| BTreeMap::from([(name.to_owned(), Prior::new(value, deviation))]);
    let known = theta().with_priors(&prior("frictionloss_calf", 0.4, 0.02), 0.5).unwrap();
    let at = known.entries().iter().position(|entry| entry.name == "frictionloss_calf").unwrap();
    assert_eq!((known.start(7)[at], known.entries()[at].deviation), (0.4, 0.02));
    let mut values = known.start(7);
    assert_eq!(known.prior_cost(&values), 0.0);
    values[at] = 0.34;
    assert!((known.prior_cost(&values) - 0.5 * 9.0).abs() < 1e-9, "three standard errors");
    let others = (0..known.len()).filter(|other| *other != at);
    assert!(others.into_iter().all(|other| known.start(7)[other] == theta().start(7)[other]));
    let beyond = theta().with_priors(&prior("frictionloss_calf", 0.8, 0.1), 1.0).unwrap();
    assert_eq!(beyond.start(7)[at], 0.5, "the upper bound");
    assert!((beyond.prior_cost(&beyond.start(7)) - 9.0).abs() < 1e-9, "it pulls towards 0.8 still");
    for (name, deviation) in
        [("frictionloss_knee", 0.1), ("frictionloss_calf", 0.0), ("frictionloss_calf", f64::NAN)]
    {
        let error = theta().with_priors(&prior(name, 0.1, deviation), 1.0).unwrap_err();
        assert!(matches!(error, ThetaError::Prior { .. }) && error.to_string().contains(name), "{error}");
    }
}

/// A robot with a hinge and a slide a leg.
fn telescopic() -> gaitfit_model::Model {
    let leg = |leg: &str| {
        format!(
            "<body><inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/><joint name='{leg}_hip'/>\
             <body><inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/><joint name='{leg}_knee' type='slide'/></body></body>"
        )
    };
    let base = "<inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/><freejoint/>";
    let text = format!("<mujoco><worldbody><body>{base}{}{}</body></worldbody></mujoco>", leg("L"), leg("R"));
    gaitfit_model::read_mjcf_str(&text, &Default::default()).unwrap()
}

/// A rule over hinges and slides becomes two, whose entries have their own units and defaults; numbers have one unit.
#[test]
fn rules_over_hinges_and_slides_are_two() {
    let model = telescopic();
    let joints: Vec<String> = model.joints.iter().map(|joint| joint.name.clone()).collect();
    let groups =
        [("hip".to_owned(), vec!["*_hip".to_owned()]), ("knee".to_owned(), vec!["*_knee".to_owned()])];
    let split = |parameter: Vec<ParameterRule>| Rules { parameter, ..Rules::default() }.by_kind(&model);
    let rules = split([JointParameter::FrictionLoss, JointParameter::Delay].map(ParameterRule::new).to_vec());
    let mut rules = rules.unwrap();
    assert_eq!(rules.parameter.len(), 3, "the delay's unit is one");
    rules.resolve();
    let theta = rules.theta(&groups, &joints, &[]).unwrap();
    let of_name = |name: &str| theta.entries().iter().find(|entry| entry.name == name).unwrap();
    let (hip, knee) = (of_name("frictionloss_hip"), of_name("frictionloss_knee"));
    assert_eq!((hip.unit.as_str(), hip.upper), ("N·m", 0.5));
    assert_eq!((knee.unit.as_str(), knee.upper, knee.joints.len()), ("N", 5.0, 2));
    assert_eq!(of_name("delay_hip").unit, "s");
    let saved = ThetaFile::new(&theta, &[Found { value: 0.1, spread: None }; 4], "telescopic", "", 0.0);
    let units: Vec<&str> = saved.parameter.iter().map(|parameter| parameter.unit.as_str()).collect();
    assert_eq!(units, ["N·m", "N", "s", "s"]);

    let stated = ParameterRule { upper: Some(2.0), ..ParameterRule::new(JointParameter::Damping) };
    let error = split(vec![stated.clone()]).unwrap_err();
    assert!(error.to_string().contains("hinge `L_hip` and slide `L_knee`, whose units differ"), "{error}");
    let shared = ParameterRule { per: Sharing::All, ..ParameterRule::new(JointParameter::Armature) };
    assert!(matches!(split(vec![shared]).unwrap_err(), ThetaError::Kinds { .. }));
    let play = split(vec![ParameterRule::new(JointParameter::Play)]).unwrap_err();
    assert!(play.to_string().contains("gears"), "{play}");
    let knees = split(vec![ParameterRule { joints: vec!["*_knee".to_owned()], ..stated.clone() }]).unwrap();
    assert_eq!((knees.parameter[0].upper, knees.parameter[0].joint_kind), (Some(2.0), JointKind::Slide));
    let like = stated.by_kind(&model, true).unwrap();
    assert_eq!((like[0].upper, like[1].upper.map(f64::round)), (Some(2.0), Some(200.0)));
}

#[test]
fn networks_of_slides_are_refused() {
    let rule: NetworkRule = toml::from_str("kind = 'resid_act'").unwrap();
    let rules = Rules { network: vec![rule], ..Rules::default() };
    let error = rules.clone().by_kind(&telescopic()).unwrap_err();
    assert!(error.to_string().contains("joint `L_knee` slides"), "{error}");
}
