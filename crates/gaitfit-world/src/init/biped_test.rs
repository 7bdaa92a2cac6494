//! Two legs: soles lie flat in a stance, knees keep away from their stops, ankles are damped as other joints are.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::look;
use gaitfit_model::kinematics::{Frame, body_frames};
use gaitfit_model::rotation::rotate;
use gaitfit_model::{Model, ReadOptions, read_mjcf_str};

/// A robot whose file draws it with joints outside their ranges, as Cassie's does: the knees bend by 0.6 to 2.4 rad, the
/// ankles by −2 to −0.3 rad. A foot is a rod along x.
fn robot() -> Model {
    let leg = |side: &str, y: f64| {
        format!(
            "<body name=\"{side}_thigh\" pos=\"0 {y} 0\"><joint name=\"{side}_roll\" axis=\"1 0 0\" range=\"-0.5 0.5\"/>\
             <joint name=\"{side}_hip\" axis=\"0 1 0\" range=\"-1.5 1.5\"/><geom type=\"capsule\" fromto=\"0 0 -.05 0 0 -.35\" \
             size=\".03\"/><body pos=\"0 0 -.4\"><joint name=\"{side}_knee\" axis=\"0 1 0\" range=\"0.6 2.4\"/><geom type=\"capsule\" \
             fromto=\"0 0 -.05 0 0 -.35\" size=\".02\"/><body name=\"{side}_foot\" pos=\"0 0 -.4\"><joint name=\"{side}_ankle\" \
             axis=\"0 1 0\" range=\"-2 -0.3\"/><geom name=\"{side}_sole\" type=\"capsule\" fromto=\"-.08 0 -.03 .12 0 -.03\" size=\".015\" \
             mass=\"0.1\"/></body></body></body>"
        )
    };
    let motors: String = ["left", "right"]
        .iter()
        .flat_map(|side| ["roll", "hip", "knee", "ankle"].map(|joint| format!("{side}_{joint}")))
        .map(|joint| format!("<motor joint=\"{joint}\" ctrlrange=\"-80 80\"/>"))
        .collect();
    let text = format!(
        "<mujoco><compiler angle=\"radian\"/><worldbody><body name=\"trunk\" pos=\"0 0 .9\"><freejoint/><geom type=\"box\" \
         size=\".1 .15 .2\" pos=\"0 0 .2\" mass=\"20\"/>{}{}</body></worldbody><actuator>{motors}</actuator></mujoco>",
        leg("left", 0.1),
        leg("right", -0.1)
    );
    read_mjcf_str(&text, &ReadOptions { add_floor: true, ..ReadOptions::default() }).unwrap()
}

#[test]
fn soles_lie_flat_and_knees_keep_room_where_the_drawn_pose_is_out_of_range() {
    let model = robot();
    let look = look(&model).unwrap();
    let mut angles = vec![0.0; model.joints.len()];
    for (name, angle) in &look.settings.policy.default_pose {
        angles[model.joint(name).unwrap()] = *angle;
    }
    let frames = body_frames(&model, &Frame::WORLD, &angles);
    for side in ["left", "right"] {
        let foot = model.body(&format!("{side}_foot")).unwrap();
        let along = rotate(frames[foot].quaternion, [1.0, 0.0, 0.0]);
        assert!(along[2].abs() < 0.06, "{side}: a sole leans by {}", along[2]);
        let knee = model.joint(&format!("{side}_knee")).unwrap();
        assert!(angles[knee] >= 0.6 + 0.2 * 1.8 - 1e-9, "{angles:?}");
    }
}

#[test]
fn light_feet_do_not_take_the_damping_from_ankles() {
    let model = robot();
    let look = look(&model).unwrap();
    let all: Vec<usize> = (0..model.joints.len()).collect();
    let policy = &look.settings.policy;
    let of = |name: &str, values: &[f64]| values[model.joint(name).unwrap()];
    let kp = policy.kp.of_joints(&model, &all, "kp").unwrap();
    let kd = policy.kd.of_joints(&model, &all, "kd").unwrap();
    assert_eq!(of("left_ankle", &kp), of("left_hip", &kp));
    // The foot alone has 5e-4 kg·m²; robots of the training have a rotor.
    let damping = of("left_ankle", &kd) / of("left_ankle", &kp);
    assert!((damping - 0.02).abs() < 2e-3, "{kd:?}");
    let [smallest, largest] = look.settings.randomisation.armature;
    assert!(smallest > 0.0 && (largest / smallest - 10.0).abs() < 1.0, "{smallest} {largest}");
    // The nominal robot of evaluations has the smallest.
    assert_eq!(look.settings.nominal().randomisation.armature, [smallest; 2]);
}

/// A robot on four legs of a thigh, a shank and an upright last link of 0.1 m. `equality`: couplings of its joints.
fn quadruped(equality: &str) -> Model {
    let leg = |name: &str, x: f64, y: f64| {
        format!(
            "<body pos=\"{x} {y} 0\"><joint name=\"{name}_hip\" axis=\"0 1 0\" range=\"-2 2\"/><geom type=\"capsule\" fromto=\"0 0 -.03 0 \
             0 -.2\" size=\".02\"/><body pos=\"0 0 -.2\"><joint name=\"{name}_knee\" axis=\"0 1 0\" range=\"-2.6 2.6\"/><geom \
             type=\"capsule\" fromto=\"0 0 -.03 0 0 -.2\" size=\".02\"/><body name=\"{name}_end\" pos=\"0 0 -.2\"><joint \
             name=\"{name}_ankle\" axis=\"0 1 0\" range=\"-2 2\"/><geom type=\"capsule\" fromto=\"0 0 0 0 0 -.1\" size=\".015\"/>\
             </body></body></body>"
        )
    };
    let legs = [("FL", 0.2, 0.1), ("FR", 0.2, -0.1), ("RL", -0.2, 0.1), ("RR", -0.2, -0.1)];
    let bodies: String = legs.map(|(name, x, y)| leg(name, x, y)).concat();
    let couplings: String = legs.map(|(name, ..)| equality.replace("LEG", name)).concat();
    let motors: String = legs
        .map(|(name, ..)| format!("<motor joint=\"{name}_hip\"/><motor joint=\"{name}_knee\"/>"))
        .concat();
    let text = format!(
        "<mujoco><compiler angle=\"radian\"/><worldbody><body pos=\"0 0 .5\"><freejoint/><geom type=\"box\" size=\".2 .1 .05\" \
         mass=\"10\"/>{bodies}</body></worldbody><equality>{couplings}</equality><actuator>{motors}</actuator></mujoco>"
    );
    read_mjcf_str(&text, &ReadOptions { add_floor: true, ..ReadOptions::default() }).unwrap()
}

/// Angles of all joints in the pose of a task, as a training begins with them.
fn pose(model: &Model) -> Vec<f64> {
    let task =
        gaitfit_learn::task::Task::new(model, &look(model).unwrap().settings, gaitfit_physics::Preset::Fast);
    task.unwrap().walker.interface.model_pose(model).unwrap()
}

#[test]
fn an_upright_last_link_is_no_sole() {
    let model = quadruped("");
    let frames = body_frames(&model, &Frame::WORLD, &pose(&model));
    for name in ["FL_end", "RR_end"] {
        let up = rotate(frames[model.body(name).unwrap()].quaternion, [0.0, 0.0, 1.0]);
        assert!(up[2] > 0.8, "{name} leans: {up:?}");
    }
}

#[test]
fn a_coupled_ankle_stands_where_its_knee_puts_it() {
    let model = quadruped("<joint joint1=\"LEG_ankle\" joint2=\"LEG_knee\" polycoef=\"0 -0.5\"/>");
    let look = look(&model).unwrap();
    assert!(!look.settings.policy.default_pose.contains_key("FL_ankle"));
    assert!(look.guesses.iter().any(|guess| guess.what == "coupled"), "{:?}", look.guesses);
    let angles = pose(&model);
    let at = |name: &str| angles[model.joint(name).unwrap()];
    assert!(at("FL_knee").abs() > 0.3 && (at("FL_ankle") + 0.5 * at("FL_knee")).abs() < 1e-9, "{angles:?}");
    // The height is that of the pose with its ankles.
    let frames = body_frames(&model, &Frame::WORLD, &angles);
    let foot = frames[model.body("FL_end").unwrap()].point([0.0, 0.0, -0.1]);
    let height = frames[0].position[2] - foot[2] + 0.015;
    assert!((look.settings.height - height).abs() < 0.01, "{} {height}", look.settings.height);
}
