//! Robots with telescopic legs.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::look;
use gaitfit_model::{Model, ReadOptions, read};
use std::path::Path;

fn telescope() -> Model {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../gaitfit-physics/tests/fixtures/telescope.xml");
    read(Path::new(file), &ReadOptions::default()).unwrap()
}

/// Legs stand with their slides, whose numbers are in m and N; the mast is held.
#[test]
fn telescopic_legs_get_a_task_in_metres() {
    let model = telescope();
    let look = look(&model).unwrap();
    let policy = &look.settings.policy;
    assert_eq!(look.settings.feet, ["FL_foot", "FR_foot", "RL_foot", "RR_foot"]);
    let joints: Vec<&str> = policy.joints.iter().map(String::as_str).collect();
    let legs = ["FL", "FR", "RL", "RR"].map(|leg| [format!("{leg}_hip"), format!("{leg}_slide")]).concat();
    assert_eq!(joints, legs);
    let text = look.configuration("telescope.xml", false);
    for words in
        ["rad (slides: m) per unit action", "N·m/rad (slides: N/m)", "rad (slides: m): keyframe `home`"]
    {
        assert!(text.contains(words), "{words}: {text}");
    }
    assert_eq!(look.settings.start.joint_position, 0.01);
    assert!(text.contains("\"FL_slide\" = 0.03") && text.contains("\"RR_slide\" = 0.05"), "{text}");
}

/// Without a keyframe a slide is half out; gains by size carry the robot.
#[test]
fn legs_without_a_keyframe_stand_on_slides_that_are_half_out() {
    let mut model = telescope();
    model.keyframes.clear();
    model.actuators.clear();
    let look = look(&model).unwrap();
    let slide = model.joint("FL_slide").unwrap();
    assert!((look.angles[slide] - 0.02).abs() < 1e-12, "{:?}", look.angles);
    let text = look.configuration("telescope.xml", false);
    assert!(text.contains("slides: 10 m g / l ="), "{text}");
    // The page of the gait lifts the feet by the slides.
    let stance = look.stance(&model);
    let frames = &stance.robots[0].frames;
    let moved = frames.iter().map(|frame| frame.joints[slide]).fold(0.0, |least: f64, q| least.min(q - 0.02));
    assert!(moved < -0.01, "{moved}");
    assert!(stance.robots[0].bodies.iter().flat_map(|body| &body.joint).any(|joint| joint.slides));
}
