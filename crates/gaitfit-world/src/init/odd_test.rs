//! Robots whose files are laid out oddly: a root of little mass, a base frame at the floor, feet of meshes, a keyframe that
//! lies.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::{InitError, look};
use gaitfit_learn::task::Task;
use gaitfit_model::{Model, ReadOptions, read_mjcf_str, read_urdf_str};
use gaitfit_physics::Preset;
use gaitfit_sim::Candidate;

fn inertial(mass: f64, inertia: f64) -> String {
    format!(
        "<inertial><mass value=\"{mass}\"/><inertia ixx=\"{inertia}\" ixy=\"0\" ixz=\"0\" iyy=\"{inertia}\" iyz=\"0\" \
         izz=\"{inertia}\"/></inertial>"
    )
}

fn joint(name: &str, kind: &str, parent: &str, child: &str, at: [f64; 3]) -> String {
    let [x, y, z] = at;
    format!(
        "<joint name=\"{name}\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"{child}\"/><origin xyz=\"{x} {y} \
         {z}\"/><axis xyz=\"0 1 0\"/><limit lower=\"-2.5\" upper=\"2.5\" effort=\"20\" velocity=\"20\"/></joint>"
    )
}

/// A robot of four legs whose root link has `mass`, beside a trunk of 30 kg, and its frame `below` the hips; `foot` is what
/// its feet collide with.
fn robot(mass: f64, below: f64, foot: &str) -> Model {
    let mut text = format!("<robot name=\"quad\"><link name=\"root\">{}</link>", inertial(mass, 0.01 * mass));
    text += &format!("<link name=\"trunk\">{}</link>", inertial(30.0, 0.5));
    text += &joint("weld", "fixed", "root", "trunk", [0.0, 0.0, below]);
    for (leg, x, y) in [("FL", 0.2, 0.1), ("FR", 0.2, -0.1), ("RL", -0.2, 0.1), ("RR", -0.2, -0.1)] {
        let (thigh, shank) = (format!("{leg}_thigh"), format!("{leg}_shank"));
        text += &format!("<link name=\"{thigh}\">{}</link>", inertial(1.0, 0.004));
        text += &format!(
            "<link name=\"{shank}\">{}<collision><origin xyz=\"0 0 -0.2\"/><geometry>{foot}</geometry></collision></link>",
            inertial(0.3, 0.001)
        );
        text += &joint(&format!("{leg}_hip"), "revolute", "trunk", &thigh, [x, y, 0.0]);
        text += &joint(&format!("{leg}_knee"), "revolute", &thigh, &shank, [0.0, 0.0, -0.2]);
    }
    read_urdf_str(&(text + "</robot>"), &ReadOptions::default()).unwrap()
}

const BALL: &str = "<sphere radius=\"0.02\"/>";

/// Robots as a training makes them of the settings.
fn varied(model: &Model, settings: &gaitfit_learn::task::TaskSettings) -> Result<usize, String> {
    let task = Task::new(model, settings, Preset::Fast).map_err(|error| error.to_string())?;
    let robots = task.robots(&[Candidate::nominal(model)], 1, 0, 300);
    robots.map(|robots| robots.len()).map_err(|error| error.to_string())
}

#[test]
fn no_more_mass_is_taken_from_the_base_than_it_has() {
    for mass in [1e-3, 1.0, 30.0] {
        let model = robot(mass, 0.0, BALL);
        let mut settings = look(&model).unwrap().settings;
        let [low, high] = settings.randomisation.base_mass;
        assert!(low >= -0.51 * mass && low <= 0.0 && high > 5.0, "{mass}: {low} to {high}");
        assert_eq!(varied(&model, &settings), Ok(300), "{mass}");
        // As it was written before.
        settings.randomisation.base_mass = [-2.3, 7.0];
        assert_eq!(varied(&model, &settings).is_err(), mass < 2.0, "{mass}");
    }
}

/// The robot on wheels: joints without limits behind the shanks.
fn rover(wheel_joint: &str) -> Model {
    let mut text = format!("<robot name=\"rover\"><link name=\"trunk\">{}</link>", inertial(20.0, 0.3));
    for (leg, x, y) in [("FL", 0.2, 0.1), ("FR", 0.2, -0.1), ("RL", -0.2, 0.1), ("RR", -0.2, -0.1)] {
        let [thigh, shank, wheel] = ["thigh", "shank", "wheel"].map(|part| format!("{leg}_{part}"));
        text += &format!("<link name=\"{thigh}\">{}</link>", inertial(1.0, 0.004));
        text += &format!("<link name=\"{shank}\">{}</link>", inertial(0.3, 0.001));
        text += &format!(
            "<link name=\"{wheel}\">{}<collision><origin rpy=\"1.5707963 0 0\"/><geometry><cylinder radius=\"0.08\" \
             length=\"0.04\"/></geometry></collision></link>",
            inertial(0.6, 0.01)
        );
        text += &joint(&format!("{leg}_hip"), "revolute", "trunk", &thigh, [x, y, 0.0]);
        text += &joint(&format!("{leg}_knee"), "revolute", &thigh, &shank, [0.0, 0.0, -0.2]);
        text += &joint(&format!("{leg}_roll"), wheel_joint, &shank, &wheel, [0.0, 0.0, -0.2]);
    }
    read_urdf_str(&(text + "</robot>"), &ReadOptions::default()).unwrap()
}

#[test]
fn wheels_get_velocities_and_roll() {
    let model = rover("continuous");
    let known = look(&model).unwrap();
    let settings = &known.settings;
    assert_eq!(settings.policy.velocity_joints, ["FL_roll", "FR_roll", "RL_roll", "RR_roll"]);
    assert!(settings.policy.joints.is_empty(), "the policy moves all joints: {:?}", settings.policy.joints);
    assert_eq!([settings.rewards["foot_slip"], settings.rewards["gait"]], [0.0; 2]);
    assert_eq!((settings.command.y, settings.command.x[1] > 0.5), ([0.0; 2], true));
    let task = Task::new(&model, settings, Preset::Fast).unwrap();
    let interface = &task.walker.interface;
    let wheel = interface.joints.iter().position(|joint| joint == "RR_roll").unwrap();
    assert_eq!((interface.kp[wheel], interface.default_pose[wheel]), (0.0, 0.0));
    // A unit of action is the largest command; from a standstill it takes half of the motor's 20 N·m.
    let scale = interface.action_scale[wheel];
    assert!((0.08 * scale / settings.command.x[1] - 1.0).abs() < 0.05, "{scale}");
    assert!((scale * interface.kd[wheel] / 10.0 - 1.0).abs() < 0.1, "{}", interface.kd[wheel]);
    assert_eq!(varied(&model, settings), Ok(300));
    assert!(known.text.contains("wheels: their targets are velocities"), "{}", known.text);

    // With limits it is a round foot.
    let feet = look(&rover("revolute")).unwrap().settings;
    assert!(feet.policy.velocity_joints.is_empty() && feet.rewards["foot_slip"] < 0.0);
}

/// Legs whose joints all turn about y, as Solo8's, cannot step aside; with hips that turn about x they can.
#[test]
fn legs_in_a_plane_get_no_commands_to_the_side() {
    let model = robot(1.0, 0.0, BALL);
    let known = look(&model).unwrap();
    assert_eq!((known.settings.command.y, known.settings.command.x[1] > 0.5), ([0.0; 2], true));
    assert!(known.text.contains("no joint moves a foot sideways"), "{}", known.text);
    let mut turned = model;
    turned.joints[0].axis = [1.0, 0.0, 0.0];
    assert!(look(&turned).unwrap().settings.command.y[1] > 0.1);
}

#[test]
fn a_base_frame_at_the_floor_is_no_missing_foot() {
    let usual = look(&robot(1.0, 0.0, BALL)).unwrap().settings;
    for below in [0.42, 0.40, 0.45] {
        let model = robot(1.0, below, BALL);
        let settings = look(&model).unwrap().settings;
        assert_eq!((&settings.feet, &settings.gait), (&usual.feet, &usual.gait), "{below}");
        // The base's origin is as much lower as the file has it.
        assert!((settings.height - (usual.height - below)).abs() < 0.01, "{below}: {}", settings.height);
        // A robot that stands has not fallen, and one that lies has.
        assert!(settings.fall.height < settings.height - 0.1, "{below}: {:?}", settings.fall);
        assert!(settings.fall.height > -below, "{below}: {:?}", settings.fall);
        assert_eq!(varied(&model, &settings), Ok(300), "{below}");
    }
}

#[test]
fn a_keyframe_with_folded_legs_is_no_standing_pose() {
    let height = |thigh: f64, knee: f64| {
        let mut model = robot(1.0, 0.0, BALL);
        let mut qpos = vec![0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0];
        (0..4).for_each(|_| qpos.extend([thigh, knee]));
        let (qvel, ctrl) = (vec![0.0; model.nv()], Vec::new());
        model.keyframes.push(gaitfit_model::Keyframe { name: "home".into(), qpos, qvel, ctrl });
        let known = look(&model).unwrap();
        (known.settings.height, known.text.contains("keyframe `home`"))
    };
    let (stands, by_keyframe) = height(0.8, -1.6);
    assert!(by_keyframe && stands > 0.25, "{stands}");
    // As in Unitree's own B2: feet a fifth of the legs' length below the hips.
    let (stood_up, by_keyframe) = height(1.15, -2.45);
    assert!(!by_keyframe && stood_up > 0.25, "{stood_up}");
}

/// A robot of so many equal legs around its base; each bends about an axis across its direction. `first`: how far
/// thigh and knee of the first leg turn, rad.
fn radial(legs: usize, first: f64) -> Model {
    let leg = |leg: usize| {
        let turn = std::f64::consts::TAU * leg as f64 / legs as f64;
        let (sine, cosine) = turn.sin_cos();
        let range = if leg == 0 { first } else { 2.4 };
        format!(
            "<body pos=\"{} {} 0\" euler=\"0 0 {turn}\"><joint name=\"hip{leg}\" axis=\"0 0 1\" range=\"-.7 .7\"/><geom size=\".02\" \
             contype=\"0\" conaffinity=\"0\"/><body pos=\".05 0 0\"><joint name=\"thigh{leg}\" axis=\"0 1 0\" range=\"-{range} {range}\"/>\
             <geom type=\"capsule\" fromto=\"0 0 0 0 0 -.15\" size=\".02\" contype=\"0\" conaffinity=\"0\"/><body pos=\"0 0 -.15\">\
             <joint name=\"knee{leg}\" axis=\"0 1 0\" range=\"-{range} {range}\"/><geom type=\"capsule\" fromto=\"0 0 0 0 0 -.12\" size=\".015\" \
             contype=\"0\" conaffinity=\"0\"/><geom name=\"foot{leg}\" pos=\"0 0 -.15\" size=\".02\"/></body></body></body>",
            0.2 * cosine,
            0.2 * sine
        )
    };
    let motors: String = (0..legs)
        .flat_map(|leg| {
            ["hip", "thigh", "knee"]
                .map(|part| format!("<motor joint=\"{part}{leg}\" ctrlrange=\"-15 15\"/>"))
        })
        .collect();
    let text = format!(
        "<mujoco><compiler angle=\"radian\"/><worldbody><body pos=\"0 0 .32\"><freejoint/><geom type=\"box\" size=\".1 .1 .03\" \
         mass=\"4\"/>{}</body></worldbody><actuator>{motors}</actuator></mujoco>",
        (0..legs).map(leg).collect::<String>()
    );
    read_mjcf_str(&text, &ReadOptions { add_floor: true, ..ReadOptions::default() }).unwrap()
}

#[test]
fn legs_around_the_base_all_bend_and_stand() {
    for legs in [3, 5, 6, 8] {
        let model = radial(legs, 2.4);
        let known = look(&model).unwrap();
        let pose = &known.settings.policy.default_pose;
        for leg in 0..legs {
            let [thigh, knee] = ["thigh", "knee"].map(|part| pose[&format!("{part}{leg}")]);
            // With two equal parts the hip is 0.8 of their length above the foot: 2 acos(0.8).
            assert!(
                (thigh.abs() - 0.6435).abs() < 2e-3 && (knee + 2.0 * thigh).abs() < 4e-3,
                "{legs}: {pose:?}"
            );
        }
        assert_eq!(known.settings.feet.len(), legs);
        assert!(known.text.contains("base level"), "{}", known.text);
    }
    // A leg that cannot bend as far as the others.
    let known = look(&radial(6, 0.2)).unwrap();
    assert!(!known.text.contains("base level") && known.text.contains("does not stand level: foot1, foot2"));
}

#[test]
fn feet_of_meshes_are_said_with_what_to_write() {
    let error = look(&robot(1.0, 0.0, "<mesh filename=\"package://quad/foot.stl\"/>")).unwrap_err();
    assert!(matches!(&error, InitError::NoContact { .. }), "{error}");
    let said = error.to_string();
    for words in ["\"FL_shank\"", "are meshes", "<sphere"] {
        assert!(said.contains(words), "`{words}` is not in `{said}`");
    }
}
