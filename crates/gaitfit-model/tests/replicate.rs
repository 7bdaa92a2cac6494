//! Copies of `<replicate>` and springs of `springdamper`: what MuJoCo 4.0 makes of the same texts.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_model::{Model, ModelError, ReadOptions, Root, read_mjcf_str};

fn legs(count: &str, more: &str) -> Result<Model, ModelError> {
    let text = format!(
        "<mujoco><worldbody><body name=\"base\"><freejoint/><geom size=\".1\"/><replicate count=\"{count}\" offset=\"0.1 0 0.02\" euler=\"0 0 30\" \
         {more}<body name=\"leg\" pos=\"0.3 0 0\"><joint name=\"hip\" axis=\"0 1 0\"/><geom name=\"g\" size=\".02\"/></body></replicate></body>\
         <geom name=\"floor\" type=\"plane\" size=\"0 0 1\"/></worldbody><contact><pair geom1=\"floor\" geom2=\"g\"/></contact><actuator><position \
         name=\"m\" joint=\"hip\" kp=\"3\"/><motor joint=\"hip\"/></actuator></mujoco>"
    );
    read_mjcf_str(&text, &ReadOptions::default())
}

#[test]
fn copies_stand_where_mujoco_puts_them() {
    let model = legs("3", "sep=\"_\">").unwrap();
    let names: Vec<&str> = model.bodies.iter().map(|body| body.name.as_str()).collect();
    assert_eq!(names, ["base", "leg_0", "leg_1", "leg_2"]);
    // body_pos and body_quat of MuJoCo 4.0.0.
    let wanted = [
        ([0.3, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]),
        ([0.359_807_62, 0.15, 0.02], [0.965_925_83, 0.0, 0.0, 0.258_819_05]),
        ([0.336_602_54, 0.309_807_62, 0.04], [0.866_025_4, 0.0, 0.0, 0.5]),
    ];
    for (body, (pos, quat)) in model.bodies[1..].iter().zip(wanted) {
        assert!(body.pos.iter().zip(pos).all(|(a, b)| (a - b).abs() < 1e-8), "{body:?}");
        assert!(body.quat.iter().zip(quat).all(|(a, b)| (a - b).abs() < 1e-8), "{body:?}");
    }
    // One copy after the other: its servo, then its motor.
    let actuators: Vec<(&str, usize)> =
        model.actuators.iter().map(|actuator| (actuator.name.as_str(), actuator.joint)).collect();
    assert_eq!(
        actuators,
        [("m_0", 0), ("actuator1", 0), ("m_1", 1), ("actuator3", 1), ("m_2", 2), ("actuator5", 2)]
    );
    assert_eq!(model.pairs.len(), 4);

    let last = |count: &str| legs(count, ">").unwrap().bodies.last().unwrap().name.clone();
    assert_eq!((last("9"), last("10"), last("12")), ("leg8".into(), "leg09".into(), "leg11".into()));
}

#[test]
fn copies_of_copies_have_both_numbers_and_their_count_is_bounded() {
    let inner = "><replicate count=\"2\" sep=\"-\" offset=\"0 0 .1\"><body name=\"toe\"><geom size=\".1\"/></body></replicate>";
    let model = legs("2", inner).unwrap();
    let names: Vec<&str> = model.bodies.iter().map(|body| body.name.as_str()).collect();
    assert_eq!(names, ["base", "toe-00", "toe-10", "leg0", "toe-01", "toe-11", "leg1"]);
    let bomb = "<replicate count=\"1000\">".repeat(6) + "<geom size=\".1\"/>" + &"</replicate>".repeat(6);
    let text = format!("<mujoco><worldbody>{bomb}</worldbody></mujoco>");
    assert!(matches!(read_mjcf_str(&text, &ReadOptions::default()), Err(ModelError::TooLarge { .. })));
    for count in ["0", "-1", "x"] {
        assert!(legs(count, ">").is_err(), "{count}");
    }
}

/// A class may have a body's name, and a number may be a joint's name.
#[test]
fn only_references_to_copies_get_their_number() {
    let text = "<mujoco><default><default class=\"leg\"><motor gear=\"3\"/></default></default><worldbody><body name=\"base\"><freejoint/>\
        <geom size=\".1\"/><replicate count=\"2\"><body name=\"leg\"><joint name=\"1\"/><geom size=\".02\"/></body></replicate></body></worldbody>\
        <actuator><motor class=\"leg\" joint=\"1\"/><position joint=\"1\" kp=\"1\"/></actuator></mujoco>";
    let model = read_mjcf_str(text, &ReadOptions::default()).unwrap();
    let actuators: Vec<_> = model.actuators.iter().map(|one| (one.joint, one.gear, one.gain)).collect();
    assert_eq!(actuators, [(0, 3.0, 1.0), (0, 1.0, 1.0), (1, 3.0, 1.0), (1, 1.0, 1.0)]);
}

#[test]
fn springs_of_a_time_constant_are_mujocos() {
    let text = |flag: &str| {
        format!(
            "<mujoco><option><flag {flag}/></option><worldbody><body name=\"base\"><freejoint/><geom size=\".1\"/><body pos=\"0 0 -.2\"><joint name=\"hip\" \
             axis=\"0 1 0\" springdamper=\"0.1 0.7\" armature=\"0.01\" stiffness=\"3\"/><geom size=\".05\" pos=\"0 0 -.1\"/></body></body></worldbody></mujoco>"
        )
    };
    let joint = |flag: &str| {
        let model = read_mjcf_str(&text(flag), &ReadOptions::default()).unwrap();
        (model.joints[0].stiffness, model.joints[0].damping)
    };
    // jnt_stiffness and dof_damping of MuJoCo 4.0.0.
    let (stiffness, damping) = joint("");
    assert!(
        (stiffness - 2.373_680_28).abs() < 1e-8 && (damping - 0.232_620_67).abs() < 1e-8,
        "{stiffness} {damping}"
    );
    assert_eq!(joint("spring=\"disable\"").0, 0.0);
    assert_eq!(joint("damper=\"disable\"").1, 0.0);
}

/// A base with an armature like a ship's hardly moves: the joint's spring is that of a clamped robot.
#[test]
fn springs_of_a_time_constant_see_the_armature_of_the_base() {
    let joint = |base: &str, options: &ReadOptions| {
        let text = format!(
            "<mujoco><worldbody><body name=\"base\">{base}<geom size=\".1\"/><body pos=\"0 0 -.2\"><joint name=\"hip\" axis=\"0 1 0\" \
             springdamper=\"0.1 0.7\"/><geom size=\".05\" pos=\"0 0 -.1\"/></body></body></worldbody></mujoco>"
        );
        let model = read_mjcf_str(&text, options).unwrap();
        (model.joints[0].stiffness, model.joints[0].damping)
    };
    let floating = ReadOptions::default();
    let heavy = joint("<joint type=\"free\" armature=\"1e7\"/>", &floating);
    let clamped = joint("<freejoint/>", &ReadOptions { root: Some(Root::Fixed), ..floating.clone() });
    let light = joint("<freejoint/>", &floating);
    for (found, wanted) in [(heavy.0, clamped.0), (heavy.1, clamped.1)] {
        assert!((found / wanted - 1.0).abs() < 1e-5, "{heavy:?} {clamped:?}");
    }
    assert!(light.0 < 0.9 * heavy.0, "{light:?} {heavy:?}");
}
