//! Joints that follow others: how both formats are read, what is refused and left out, and that a written file has them.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_model::{Coupling, Model, ModelError, ReadOptions, read_mjcf_str, read_urdf_str};

fn strict(text: &str) -> Result<Model, ModelError> {
    read_mjcf_str(text, &ReadOptions::default())
}

fn mending(text: &str) -> Model {
    read_mjcf_str(text, &ReadOptions { mend: true, ..ReadOptions::default() }).unwrap()
}

fn lenient(text: &str) -> Model {
    read_mjcf_str(text, &ReadOptions { lenient: true, ..ReadOptions::default() }).unwrap()
}

/// A floating body that carries a chain of four hinges, a to d, and beside it a hinge e. `more`: further sections.
fn robot(more: &str) -> String {
    let body = |name: &str, inner: &str| {
        format!("<body pos=\"0 0 .2\"><joint name=\"{name}\"/><geom size=\".1\"/>{inner}</body>")
    };
    let chain = body("a", &body("b", &body("c", &body("d", ""))));
    format!(
        "<mujoco><worldbody><body><freejoint/><geom size=\".1\"/>{chain}{}</body></worldbody>{more}</mujoco>",
        body("e", "")
    )
}

fn equality(couplings: &str) -> String {
    robot(&format!("<equality>{couplings}</equality>"))
}

#[test]
fn couplings_are_read_with_their_defaults() {
    let text = robot(
        r#"<default><equality solref="0.03 0.9"/><default class="stiff"><equality solimp="0.5 0.98 0.01"/></default>
        <default class="off"><equality active="false"/></default></default>
        <equality><joint joint1="b" joint2="a" polycoef="0.1 2"/><joint joint1="c" class="stiff" polycoef="0.3"/>
        <joint joint1="d" joint2="c" class="off"/><joint joint1="e" joint2="d" active="false"/></equality>"#,
    );
    let model = strict(&text).unwrap();
    let soft = [0.9, 0.95, 0.001, 0.5, 2.0];
    let expected = [
        Coupling {
            follower: 1,
            leader: Some(0),
            polynomial: [0.1, 2.0, 0.0, 0.0, 0.0],
            solref: [0.03, 0.9],
            solimp: soft,
        },
        Coupling {
            follower: 2,
            leader: None,
            polynomial: [0.3, 1.0, 0.0, 0.0, 0.0],
            solref: [0.03, 0.9],
            solimp: [0.5, 0.98, 0.01, 0.5, 2.0],
        },
    ];
    assert_eq!(model.couplings, expected);
    assert_eq!(model.couplings_in_words(), ["b follows a: 0.1 + 2 x", "c is held at 0.3"]);
    let signs =
        equality(r#"<joint joint1="b" joint2="a" polycoef="-1 -1 0 2.5"/><joint joint1="c" joint2="b"/>"#);
    assert_eq!(
        strict(&signs).unwrap().couplings_in_words(),
        ["b follows a: -1 - x + 2.5 x^3", "c follows b: x"]
    );
    let mut positions = vec![0.5, 9.0, 9.0, 0.7, 0.8];
    model.couple(&mut positions);
    assert_eq!(positions, [0.5, 1.1, 0.3, 0.7, 0.8]);
    let mut velocities = vec![3.0, 9.0, 9.0, 0.7, 0.8];
    model.couple_velocities(&positions, &mut velocities);
    assert_eq!(velocities, [3.0, 6.0, 0.0, 0.7, 0.8]);
    // A file that is written has them.
    let again = strict(&model.to_mjcf(&[], None).unwrap()).unwrap();
    assert_eq!(again.couplings, model.couplings);
    for flag in ["equality", "constraint"] {
        let off = text.replace(
            "<equality><joint",
            &format!("<option><flag {flag}=\"disable\"/></option><equality><joint"),
        );
        assert!(strict(&off).unwrap().couplings.is_empty(), "{flag}");
    }
}

#[test]
fn joints_may_follow_joints_of_other_limbs() {
    let text = equality(
        r#"<joint joint1="d" joint2="b" polycoef="0 2"/><joint joint1="e" joint2="a"/><joint joint1="b" joint2="e" polycoef="1"/>"#,
    );
    let model = strict(&text).unwrap();
    let pairs: Vec<_> = model.couplings.iter().map(|coupling| (coupling.follower, coupling.leader)).collect();
    assert_eq!(pairs, [(3, Some(1)), (4, Some(0)), (1, Some(4))]);
    assert_eq!(
        [mending(&text).couplings, lenient(&text).couplings],
        [model.couplings.clone(), model.couplings.clone()]
    );
    // d follows b, which follows e, which follows a.
    let mut positions = vec![0.5, 9.0, 0.7, 9.0, 9.0];
    model.couple(&mut positions);
    assert_eq!(positions, [0.5, 1.5, 0.7, 3.0, 0.5]);
}

#[test]
fn joints_do_not_follow_each_other_in_a_ring() {
    let text = equality(
        r#"<joint joint1="b" joint2="a"/><joint joint1="c" joint2="b"/><joint joint1="a" joint2="c"/>"#,
    );
    let error = strict(&text).unwrap_err().to_string();
    assert!(error.contains("joint \"a\" follows \"c\", which follows it"), "{error}");
    assert_eq!((lenient(&text).couplings.len(), mending(&text).couplings.len()), (2, 2));
}

#[test]
fn only_what_is_left_out_of_an_equality_is_listed() {
    let text =
        equality(r#"<joint joint1="b" joint2="a"/><connect body1="body1" body2="body2" anchor="0 0 0"/>"#);
    assert!(strict(&text).unwrap_err().to_string().contains("<connect> of <equality>"));
    let left = lenient(&text);
    assert_eq!(left.couplings.len(), 1);
    let listed: Vec<&str> =
        left.dropped.iter().filter(|part| !part.harmless).map(|part| part.what.as_str()).collect();
    assert!(listed.len() == 1 && listed[0].contains("<connect>"), "{listed:?}");
}

#[test]
fn couplings_of_nothing_are_errors() {
    for (couplings, words) in [
        (r#"<joint joint1="b" joint2="x"/>"#, "no hinge or slide is called \"x\""),
        (r#"<joint joint2="b"/>"#, "without joint1"),
        (r#"<joint joint1="b" joint2="b"/>"#, "follows itself"),
        (r#"<joint joint1="b" joint2="a" polycoef="0 1e300"/>"#, "at most 1000"),
        (r#"<joint joint1="b" joint2="a" polycoef="0 3000"/>"#, "a coefficient of 3000"),
        (r#"<joint joint1="b" joint2="a" polycoef="0 nan"/>"#, "polycoef"),
        (r#"<joint joint1="b" joint2="a" class="x"/>"#, "default class"),
        (r#"<joint joint1="b" joint2="a" colour="red"/>"#, "colour"),
    ] {
        let error = strict(&equality(couplings)).unwrap_err().to_string();
        assert!(error.contains(words), "{couplings}: {error}");
    }
    let left = lenient(&equality(r#"<joint joint1="b" joint2="x"/>"#));
    assert_eq!((left.joints.len(), left.couplings.len()), (5, 0));
}

#[test]
fn a_mimic_is_a_coupling_without_a_motor() {
    let link = |name: &str| {
        format!(
            "<link name=\"{name}\"><inertial><mass value=\"1\"/><inertia ixx=\".01\" ixy=\"0\" ixz=\"0\" iyy=\".01\" iyz=\"0\" \
             izz=\".01\"/></inertial></link>"
        )
    };
    let joint = |name: &str, parent: &str, child: &str, more: &str| {
        format!(
            "<joint name=\"{name}\" type=\"revolute\"><parent link=\"{parent}\"/><child link=\"{child}\"/><axis xyz=\"0 1 0\"/>\
             <limit lower=\"-1\" upper=\"2\" effort=\"9\" velocity=\"8\"/>{more}</joint>"
        )
    };
    let links: String = ["base", "finger", "tip", "toe"].map(link).concat();
    let robot = |mimic: &str| {
        format!(
            "<robot name=\"r\">{links}{}{}{}</robot>",
            joint("tip_joint", "finger", "tip", mimic),
            joint("finger_joint", "base", "finger", ""),
            joint("toe_joint", "base", "toe", "")
        )
    };
    let text = robot("<mimic joint=\"finger_joint\" multiplier=\"1.3\" offset=\"-0.2\"/>");
    let model = read_urdf_str(&text, &ReadOptions::default()).unwrap();
    let names: Vec<&str> = model.joints.iter().map(|joint| joint.name.as_str()).collect();
    assert_eq!(names, ["finger_joint", "tip_joint", "toe_joint"]);
    assert_eq!(model.couplings_in_words(), ["tip_joint follows finger_joint: -0.2 + 1.3 x"]);
    let driven: Vec<usize> = model.actuators.iter().map(|actuator| actuator.joint).collect();
    assert_eq!(driven, [0, 2]);
    assert!(
        model.only_follows(1)
            && !model.follows(0)
            && model.warnings().iter().all(|said| !said.contains("effort"))
    );
    for (mimic, words) in [
        ("<mimic multiplier=\"1\"/>", "`joint`"),
        ("<mimic joint=\"x\"/>", "is called \"x\""),
        ("<mimic joint=\"finger_joint\"/><mimic joint=\"toe_joint\"/>", "two <mimic>"),
    ] {
        let error = read_urdf_str(&robot(mimic), &ReadOptions::default()).unwrap_err().to_string();
        assert!(error.contains(words), "{mimic}: {error}");
    }
}
