//! Armature, damping and friction loss of a free joint.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_model::{FreeJoint, Model, ModelError, ReadOptions, Root, read_mjcf_str};

/// A floating ball; `defaults` are those of joints, `joint` is how it floats.
fn ball(defaults: &str, joint: &str, flags: &str, options: &ReadOptions) -> Result<Model, ModelError> {
    let text = format!(
        "<mujoco><option><flag {flags}/></option><default><joint {defaults}/></default><worldbody><geom type=\"plane\" \
         size=\"1 1 1\"/><body>{joint}<geom size=\"0.1\" mass=\"2\"/></body></worldbody></mujoco>"
    );
    read_mjcf_str(&text, options)
}

const DRAG: &str = "armature=\"0.01\" damping=\"0.1\" frictionloss=\"0.2\"";

#[test]
fn a_free_joint_takes_the_defaults_of_joints_and_a_freejoint_does_not() {
    let free = "<joint type=\"free\"/>";
    let read = |joint: &str, flags: &str| ball(DRAG, joint, flags, &ReadOptions::default()).unwrap();
    let found = read(free, "").free_joint.unwrap();
    assert_eq!((found.armature, found.damping, found.frictionloss), (0.01, 0.1, 0.2));
    assert_eq!((found.solref_friction, found.solimp_friction), ([0.02, 1.0], [0.9, 0.95, 0.001, 0.5, 2.0]));
    assert_eq!(read("<freejoint/>", "").free_joint, None);
    assert_eq!(
        read("<joint type=\"free\" armature=\"0\" damping=\"0\" frictionloss=\"0\"/>", "").free_joint,
        None
    );
    // What flags switch off of joints is off here too.
    let off = read(free, "frictionloss=\"disable\" damper=\"disable\"").free_joint.unwrap();
    assert_eq!(off, FreeJoint { damping: 0.0, frictionloss: 0.0, ..found });
    // A clamped base has none.
    let clamped = ReadOptions { root: Some(Root::Fixed), ..ReadOptions::default() };
    assert_eq!(ball(DRAG, free, "", &clamped).unwrap().free_joint, None);
}

#[test]
fn a_spring_on_a_free_joint_is_refused() {
    let joint = "<joint type=\"free\" stiffness=\"3\"/>";
    let error = ball("", joint, "", &ReadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("stiffness of the free joint") && error.contains("<freejoint/>"), "{error}");
}
