//! Two legs: soles lie flat in a stance, knees keep away from their stops, ankles are damped as other joints are.

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
