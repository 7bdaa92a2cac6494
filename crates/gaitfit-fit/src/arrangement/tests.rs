//! Policies whose joints, signs or scales are wrong, and logs of the right ones.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::*;
use crate::robot;
use crate::walk::fixtures::{logs, policy, scene};
use crate::world::{World, WorldSettings};
use gaitfit_log::Trajectory;
use gaitfit_policy::Policy;
use std::path::Path;

/// The policy with the joints of another order of legs, named in the Go2's.
fn misnamed(policy: &Policy, names: &[&str]) -> Policy {
    let mut policy = policy.clone();
    policy.interface.joints = names.iter().map(|name| (*name).to_owned()).collect();
    policy
}

const LEG_BY_LEG: [&str; 12] = [
    "FL_hip", "FL_thigh", "FL_calf", "FR_hip", "FR_thigh", "FR_calf", "RL_hip", "RL_thigh", "RL_calf",
    "RR_hip", "RR_thigh", "RR_calf",
];

/// The logs as the wrong policy's reader would have them: columns by its names.
fn read_by(policy: &Policy, logs: &[Trajectory]) -> Vec<Trajectory> {
    let named = |name: &String, log: &Trajectory| {
        log.joints.iter().find(|joint| joint.starts_with(name.as_str())).unwrap().clone()
    };
    let names =
        |log: &Trajectory| policy.interface.joints.iter().map(|name| named(name, log)).collect::<Vec<_>>();
    logs.iter().map(|log| log.select_joints(&names(log)).unwrap()).collect()
}

fn diagnosed(policy: &Policy, logs: &[Trajectory]) -> Option<Diagnosis> {
    of_logs(policy, &robot::go2().unwrap(), &logs.iter().collect::<Vec<_>>())
}

#[test]
fn orders_of_four_legs_are_named() {
    let model = robot::go2().unwrap();
    let interface = policy(&scene(), 3).interface;
    let limbs = Limbs::new(&model, &interface.resolve(&model).unwrap());
    let orders = limbs.orders();
    assert_eq!(
        orders.len(),
        48,
        "24 sequences of legs, leg by leg and type by type, and the alphabet, without the policy's own"
    );
    for name in [
        "FR FL RR RL, leg by leg (Unitree's motors)",
        "FL FR RL RR, type by type (Isaac Lab's, breadth first)",
    ] {
        assert!(orders.iter().any(|(other, _)| other == name), "{name} is not in {orders:?}");
    }
    for (name, order) in &orders {
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..12).collect::<Vec<_>>(), "{name} has every joint once");
    }
}

#[test]
fn a_humanoids_joints_are_listed_level_by_level_whatever_they_hang_on() {
    let text = r#"<mujoco model="upper"><worldbody><body name="base" pos="0 0 1"><freejoint/>
        <geom type="sphere" size="0.1"/>
        <body><joint name="left_hip"/><geom type="sphere" size="0.1"/>
            <body><joint name="left_knee"/><geom type="sphere" size="0.1"/></body></body>
        <body><joint name="right_hip"/><geom type="sphere" size="0.1"/>
            <body><joint name="right_knee"/><geom type="sphere" size="0.1"/></body></body>
        <body><joint name="waist"/><geom type="sphere" size="0.1"/>
            <body><joint name="left_shoulder"/><geom type="sphere" size="0.1"/>
                <body><joint name="left_elbow"/><geom type="sphere" size="0.1"/></body></body>
            <body><joint name="right_shoulder"/><geom type="sphere" size="0.1"/>
                <body><joint name="right_elbow"/><geom type="sphere" size="0.1"/></body></body></body>
        </body></worldbody></mujoco>"#;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("upper.xml");
    std::fs::write(&path, text).unwrap();
    let model = gaitfit_model::read(&path, &Default::default()).unwrap();
    let joints: Vec<usize> = (0..model.joints.len()).collect();
    let orders = Limbs::new(&model, &joints).orders();
    let (_, order) = orders.iter().find(|(name, _)| name == "breadth first (Isaac Lab's)").unwrap();
    let names: Vec<&str> = order.iter().map(|&joint| model.joints[joint].name.as_str()).collect();
    assert_eq!(
        names,
        [
            "left_hip",
            "right_hip",
            "waist",
            "left_knee",
            "right_knee",
            "left_shoulder",
            "right_shoulder",
            "left_elbow",
            "right_elbow"
        ]
    );
}

#[test]
fn a_permuted_policy_is_put_right_by_its_logs() {
    let scene = scene();
    let right = policy(&scene, 3);
    let recorded = logs(&scene, &right, true);
    assert_eq!(diagnosed(&right, &recorded), None, "nothing to put right");
    let joints: Vec<&str> =
        right.interface.joints.iter().map(|name| gaitfit_model::patterns::plain(name)).collect();
    assert_eq!(joints, LEG_BY_LEG);
    // The file names the joints in the order of Unitree's motors.
    let wrong = misnamed(&right, &[3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8].map(|joint| LEG_BY_LEG[joint]));
    let diagnosis = diagnosed(&wrong, &read_by(&wrong, &recorded)).unwrap();
    assert!(diagnosis.measure[1] < 0.01 && diagnosis.measure[0] > 0.3, "{diagnosis:?}");
    let listed: Vec<String> = joints.iter().map(|name| format!("{name:?}")).collect();
    assert!(
        diagnosis.settings[0].starts_with(&format!("`joints = [{}]`", listed.join(", "))),
        "{diagnosis:?}"
    );
}

#[test]
fn scales_and_signs_are_named() {
    let scene = scene();
    let right = policy(&scene, 3);
    let recorded = logs(&scene, &right, true);
    // The network was trained with velocities of 0.05, and its description does not say so.
    let mut unscaled = right.clone();
    let term = unscaled
        .interface
        .observation
        .iter_mut()
        .find(|term| term.quantity == Quantity::JointVelocity)
        .unwrap();
    let was = term.scale.clone();
    assert!(was == [0.05] || was.is_empty(), "{was:?}");
    term.scale = if was.is_empty() { vec![0.05] } else { Vec::new() };
    let diagnosis = diagnosed(&unscaled, &recorded).unwrap();
    assert!(diagnosis.text().contains("joint_velocity") && diagnosis.measure[1] < 0.01, "{diagnosis:?}");
    // Logged actions of the hips with the other sign.
    let hips: Vec<bool> = right.interface.joints.iter().map(|name| name.contains("hip")).collect();
    let mut turned = recorded.clone();
    for log in &mut turned {
        log.target = None;
        for (place, action) in log.action.as_mut().unwrap().iter_mut().enumerate() {
            if hips[place % 12] {
                *action = -*action;
            }
        }
    }
    let diagnosis = diagnosed(&right, &turned).unwrap();
    assert!(
        diagnosis.changes[0].contains("FL_hip") && diagnosis.changes[0].contains("reversed"),
        "{diagnosis:?}"
    );
    assert!(diagnosis.measure[1] < 0.05, "{diagnosis:?}");
    // Actions that were logged in another unit.
    let mut scaled = recorded.clone();
    for log in &mut scaled {
        log.target = None;
        log.action.as_mut().unwrap().iter_mut().for_each(|action| *action *= 0.25);
    }
    let diagnosis = diagnosed(&right, &scaled).unwrap();
    assert!(diagnosis.settings[0].contains("divided by 0.25"), "{diagnosis:?}");
    // Another policy is not explained by any arrangement.
    assert_eq!(diagnosed(&policy(&scene, 4), &recorded), None);
}

#[test]
fn terms_in_another_order_and_gravity_that_points_up_are_named() {
    let scene = scene();
    let right = policy(&scene, 3);
    let recorded = logs(&scene, &right, true);
    let place = |quantity: Quantity| {
        right.interface.observation.iter().position(|term| term.quantity == quantity).unwrap()
    };
    let (gravity, command) = (place(Quantity::ProjectedGravity), place(Quantity::Command));
    let mut swapped = right.clone();
    swapped.interface.observation.swap(gravity, command);
    let diagnosis = diagnosed(&swapped, &recorded).unwrap();
    let names: Vec<&str> = right.interface.observation.iter().map(|term| term.quantity.name()).collect();
    assert_eq!(
        diagnosis.settings,
        [format!("`observation` in the order {}", names.join(", "))],
        "{diagnosis:?}"
    );
    assert!(diagnosis.measure[0] > 0.2 && diagnosis.measure[1] < 0.01, "{diagnosis:?}");
    let mut upwards = right.clone();
    upwards.interface.observation[gravity].scale = vec![-1.0];
    let diagnosis = diagnosed(&upwards, &recorded).unwrap();
    assert_eq!(diagnosis.settings, ["`scale = [1]` of projected_gravity in `observation`"], "{diagnosis:?}");
    // The network saw its last action as the change of the target.
    let mut scaled = right.clone();
    let last = place(Quantity::LastAction);
    scaled.interface.observation[last].scale = vec![right.interface.action_scale[0] as f32];
    let diagnosis = diagnosed(&scaled, &recorded).unwrap();
    assert_eq!(diagnosis.settings, ["`scale = [1]` of last_action in `observation`"], "{diagnosis:?}");
}

#[test]
fn a_policy_that_falls_for_its_joint_order_is_put_right() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut policy = gaitfit_policy_files::read(&folder.join("assets/go2-walk.safetensors")).unwrap();
    // As a policy that was trained elsewhere.
    policy.provenance.iteration = 0;
    let joints = policy.interface.joints.clone();
    policy.interface.joints = match joints[1].contains("thigh") {
        true => [0, 3, 6, 9, 1, 4, 7, 10, 2, 5, 8, 11].map(|joint| joints[joint].clone()).to_vec(),
        false => [0, 4, 8, 1, 5, 9, 2, 6, 10, 3, 7, 11].map(|joint| joints[joint].clone()).to_vec(),
    };
    let settings = WorldSettings {
        policy: "walk.toml".into(),
        robot: None,
        lenient: false,
        task: None,
        theta: None,
        spring: Vec::new(),
        torque_noise: 0.0,
        randomised: false,
        preset: crate::settings::Preset::Fast,
        seed: 1,
        threads: None,
    };
    let world = World::new(&settings, policy).unwrap();
    let diagnosis = of_walk(&world, 1, 2, &crate::watch::Watch::silent()).unwrap();
    let listed: Vec<String> = joints.iter().map(|name| format!("{name:?}")).collect();
    assert!(diagnosis.settings[0].contains(&listed.join(", ")), "{diagnosis:?}");
    assert!(diagnosis.measure[0] > 0.7 && diagnosis.measure[1] < WALKS_WELL, "{diagnosis:?}");
}

/// Measure of a policy that hardly falls and follows its commands.
const WALKS_WELL: f64 = 0.4;
