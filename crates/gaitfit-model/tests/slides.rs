//! Slides: what files say of them, and what they do to bodies.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use std::path::Path;

use gaitfit_model::kinematics::{Frame, body_frames, rest_frames};
use gaitfit_model::{JointAxis, JointKind, Model, ReadOptions, Root, read, read_mjcf_str, read_urdf_str};

fn telescope() -> Model {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../gaitfit-physics/tests/fixtures/telescope.xml");
    read(Path::new(file), &ReadOptions::default()).unwrap()
}

fn mjcf(text: &str) -> Model {
    read_mjcf_str(text, &ReadOptions::default()).unwrap()
}

/// Positions of slides are metres in a file in degrees, and their springs and motors are as for hinges.
#[test]
fn a_file_in_degrees_has_slides_in_metres() {
    let model = telescope();
    let joint = |name: &str| &model.joints[model.joint(name).unwrap()];
    assert_eq!(joint("FL_slide").kind, JointKind::Slide);
    assert_eq!(joint("FL_slide").range, Some([-0.06, 0.1]));
    assert_eq!(joint("RR_slide").reference, 0.02);
    assert_eq!((joint("lift").stiffness, joint("lift").springref), (400.0, 0.05));
    assert_eq!(model.effort(model.joint("FL_slide").unwrap()), Some(250.0));
    assert_eq!(model.effort(model.joint("lift").unwrap()), Some(60.0), "gear 20 · 3");
    // Hinges of the same file are in degrees.
    let quarter = std::f64::consts::FRAC_PI_4;
    assert_eq!((joint("FL_hip").kind, joint("FL_hip").range), (JointKind::Hinge, Some([-quarter, quarter])));
}

/// `springdamper` states a time constant T, s, and a damping ratio ζ. A slide that moves the mass m, kg, then has the stiffness
/// m / (T² ζ²) and the damping 2 m / T.
#[test]
fn a_spring_of_a_slide_is_computed_from_the_mass_that_it_moves() {
    let model = mjcf(
        r#"<mujoco><worldbody><body><joint type="slide" springdamper="0.1 0.5"/>
        <inertial pos="0.3 0 0" mass="2" diaginertia="1 1 1"/></body></worldbody></mujoco>"#,
    );
    let joint = &model.joints[0];
    assert!(
        (joint.stiffness - 2.0 / 0.0025).abs() < 1e-9 && (joint.damping - 40.0).abs() < 1e-12,
        "{joint:?}"
    );
}

const LEG: &str = r#"<robot name="hopper">
    <link name="base"><inertial><mass value="4"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
    <link name="tube"><inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
    <link name="shank"><inertial><origin xyz="0 0 -0.1"/><mass value="0.5"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
      <collision name="foot"><origin xyz="0 0 -0.2"/><geometry><sphere radius="0.02"/></geometry></collision></link>
    <joint name="hip" type="revolute"><parent link="base"/><child link="tube"/><origin xyz="0 0.1 0"/><axis xyz="0 1 0"/>
      <limit lower="-1" upper="1" effort="20" velocity="9"/></joint>
    <joint name="knee" type="prismatic"><parent link="tube"/><child link="shank"/><origin xyz="0 0 -0.1" rpy="0 0 0.4"/><axis xyz="0 0 -2"/>
      <limit lower="-0.05" upper="0.1" effort="200" velocity="2"/><dynamics damping="3" friction="1.5"/></joint></robot>"#;

#[test]
fn a_prismatic_joint_of_urdf_is_a_slide_of_mjcf() {
    let urdf = read_urdf_str(LEG, &ReadOptions::default()).unwrap();
    let mjcf = mjcf(
        r#"<mujoco model="hopper"><compiler angle="radian" eulerseq="XYZ"/><worldbody><geom name="ground" type="plane" size="0 0 1"/>
        <body name="base"><freejoint/><inertial pos="0 0 0" mass="4" diaginertia="0.1 0.1 0.1"/>
        <body name="tube" pos="0 0.1 0"><joint name="hip" axis="0 1 0" range="-1 1"/>
        <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
        <body name="shank" pos="0 0 -0.1" euler="0 0 0.4"><joint name="knee" type="slide" axis="0 0 -1" range="-0.05 0.1" damping="3"
          frictionloss="1.5"/><inertial pos="0 0 -0.1" mass="0.5" diaginertia="0.01 0.01 0.01"/>
        <geom name="foot" pos="0 0 -0.2" size="0.02"/></body></body></body></worldbody>
        <actuator><motor name="hip" joint="hip" ctrlrange="-20 20"/><motor name="knee" joint="knee" ctrlrange="-200 200"/></actuator>
        <custom><tuple name="velocity_limit"><element objtype="joint" objname="hip" prm="9"/>
        <element objtype="joint" objname="knee" prm="2"/></tuple></custom></mujoco>"#,
    );
    assert_eq!(urdf.joints, mjcf.joints);
    assert_eq!(urdf.actuators, mjcf.actuators);
    for (a, b) in urdf.bodies.iter().zip(&mjcf.bodies) {
        assert_eq!((&a.name, a.parent, a.pos, a.mass, a.ipos), (&b.name, b.parent, b.pos, b.mass, b.ipos));
        assert!(a.quat.iter().zip(b.quat).all(|(x, y)| (x - y).abs() < 1e-15), "{:?}, {:?}", a.quat, b.quat);
    }
    // Without limits it moves as far as it likes, and that is said.
    let free = LEG.replace(r#"lower="-0.05" upper="0.1" "#, "");
    let free = read_urdf_str(&free, &ReadOptions::default()).unwrap();
    assert_eq!(free.joints[1].range, None);
    assert!(free.changed.iter().any(|change| change.what.contains("prismatic")), "{:?}", free.changed);
    // Dropped by nobody, also leniently.
    let lenient = read_urdf_str(LEG, &ReadOptions { lenient: true, ..ReadOptions::default() }).unwrap();
    assert_eq!(lenient.joints, urdf.joints);
}

#[test]
fn a_robot_with_slides_is_written_as_it_was_read() {
    let model = telescope();
    let again = mjcf(&model.to_mjcf(&[], None).unwrap());
    for (read, own) in again.joints.iter().zip(&model.joints) {
        // A skew axis is made unit once more.
        assert!(read.axis.iter().zip(own.axis).all(|(a, b)| (a - b).abs() < 1e-15), "{read:?}");
        assert_eq!(gaitfit_model::Joint { axis: own.axis, ..read.clone() }, *own);
    }
    assert_eq!(again.joints.len(), model.joints.len());
    assert_eq!(
        (again.bodies, again.actuators, again.keyframes),
        (model.bodies, model.actuators, model.keyframes)
    );
}

/// Only a mending reading takes six joints of one degree of freedom for a free one.
#[test]
fn a_base_on_slides_is_read_as_the_file_has_it() {
    let slides =
        r#"<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>"#;
    let text = format!(
        r#"<mujoco><worldbody><body name="torso" pos="0 0 1.2">{slides}<geom size=".1"/>
        <body><joint name="hip" axis="0 1 0"/><geom size=".1"/></body></body></worldbody></mujoco>"#
    );
    let model = mjcf(&text);
    assert_eq!((model.root, model.joints.len()), (Root::Fixed, 4));
    let frames = body_frames(&model, &rest_frames(&model)[0], &[0.5, -0.2, 0.3, 0.0]);
    assert!((frames[0].position[0] - 0.5).abs() < 1e-15 && (frames[0].position[2] - 1.0).abs() < 1e-15);
}

/// A slide moves along its axis as the joints before it have turned it, whatever its `pos`.
#[test]
fn a_slide_moves_along_its_turned_axis() {
    let model = mjcf(
        r#"<mujoco><compiler angle="radian"/><worldbody><body><freejoint/><geom size=".1"/>
        <body pos="0.1 0 0"><joint axis="0 1 0"/><joint type="slide" axis="0 0 -1" ref="0.2" pos="3 2 1"/><geom size=".1"/></body>
        </body></worldbody></mujoco>"#,
    );
    let quarter = std::f64::consts::FRAC_PI_2;
    let frames = body_frames(&model, &Frame::WORLD, &[quarter, 0.5]);
    // −z has been turned to −x.
    let [x, y, z] = frames[1].position;
    assert!((x - (0.1 - 0.3)).abs() < 1e-15 && y.abs() < 1e-15 && z.abs() < 1e-15, "{:?}", frames[1]);
    let JointAxis { kind, axis, .. } = model.joints[1].axis_at(&frames[1]);
    assert_eq!(kind, JointKind::Slide);
    let along = model.joints[1].axis_at(&frames[1]);
    assert_eq!((along.lever([5.0, 6.0, 7.0]), along.turn()), (axis, [0.0; 3]));
    assert!((along.share_of([-2.0, 3.0, 4.0], [9.0; 3]) - 2.0).abs() < 1e-15);
}

#[test]
fn units_follow_the_kind() {
    let units = ["rad", "rad/s", "N·m", "N·m/rad", "N·m·s/rad", "kg·m²", "rad/(N·m)", "s", "-", "m"];
    let slides = units.map(|unit| JointKind::Slide.unit(unit));
    assert_eq!(slides, ["m", "m/s", "N", "N/m", "N·s/m", "kg", "m/N", "s", "-", "m"]);
    assert_eq!(units.map(|unit| JointKind::Hinge.unit(unit)), units);
    assert!((JointKind::Slide.like("N·m", 2.0) - 20.0).abs() < 1e-12);
    assert_eq!((JointKind::Hinge.like("N·m", 2.0), JointKind::Slide.like("s", 2.0)), (2.0, 2.0));
    assert_eq!(telescope().units("N·m"), "N·m (slides: N)");
    assert_eq!(gaitfit_model::builtin::go2().unwrap().units("N·m"), "N·m");
}
