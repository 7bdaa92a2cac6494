//! URDF against MJCF, and what URDF cannot be.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use std::path::{Path, PathBuf};

use gaitfit_model::{Model, ModelError, ReadOptions, Root, Shape, read, read_urdf_str};

fn asset(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets").join(name)
}

fn urdf(text: &str) -> Result<Model, ModelError> {
    read_urdf_str(text, &ReadOptions::default())
}

fn near(a: &[f64], b: &[f64], tolerance: f64) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(x, y)| (x - y).abs() <= tolerance)
}

/// Rotates a vector by a wxyz quaternion.
fn turn(q: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let [w, x, y, z] = q;
    let t = [2.0 * (y * v[2] - z * v[1]), 2.0 * (z * v[0] - x * v[2]), 2.0 * (x * v[1] - y * v[0])];
    [
        v[0] + w * t[0] + y * t[2] - z * t[1],
        v[1] + w * t[1] + z * t[0] - x * t[2],
        v[2] + w * t[2] + x * t[1] - y * t[0],
    ]
}

#[test]
fn go2_in_urdf_is_go2_in_mjcf() {
    let a = read(&asset("go2.urdf"), &ReadOptions::default()).unwrap();
    let b = read(&asset("go2.xml"), &ReadOptions::default()).unwrap();
    assert_eq!((a.root, a.nq(), a.nv(), a.nu()), (b.root, b.nq(), b.nv(), b.nu()));
    for (x, y) in a.bodies.iter().zip(&b.bodies) {
        assert_eq!((&x.name, x.parent, x.quat, x.mass), (&y.name, y.parent, y.quat, y.mass));
        assert!(y.parent.is_none() || x.pos == y.pos, "the root's height is not a matter of URDF");
        assert!(near(&x.ipos, &y.ipos, 0.0) && near(&x.inertia, &y.inertia, 1e-15), "{}", x.name);
        for axis in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
            // Principal axes are the same lines.
            let (p, q) = (turn(x.iquat, axis), turn(y.iquat, axis));
            let dot: f64 = p.iter().zip(q).map(|(a, b)| a * b).sum();
            assert!((dot.abs() - 1.0).abs() < 1e-9, "{}", x.name);
        }
    }
    assert_eq!(a.joints, b.joints);
    assert_eq!(a.actuators, b.actuators);
    assert_eq!(a.geoms.len(), b.geoms.len());
    for (x, y) in a.geoms.iter().zip(&b.geoms) {
        assert_eq!((&x.name, x.body, x.pos), (&y.name, y.body, y.pos));
        assert!(near(&turn(x.quat, [0.1, 0.2, 0.3]), &turn(y.quat, [0.1, 0.2, 0.3]), 1e-12), "{}", x.name);
        assert_eq!(x.shape, y.shape, "{}", x.name);
    }
    assert_eq!(a.planes.len(), 1);
    let order = |m: &Model| m.pairs.iter().map(|p| (p.geom, p.ground)).collect::<Vec<_>>();
    assert_eq!(order(&a), order(&b));
    // URDF has no contact parameters: MuJoCo's defaults.
    assert!(a.pairs.iter().all(|p| p.condim == 3 && p.friction == [1.0, 1.0, 0.005, 0.0001, 0.0001]));
}

const SMALL: &str = r#"<robot name="r">
  <material name="grey"/>
  <link name="base"><inertial><origin xyz="0 0 0.1" rpy="0 0 1.5707963267948966"/><mass value="2"/>
    <inertia ixx="0.3" iyy="0.2" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="base.stl"/></geometry></visual>
    <collision><geometry><mesh filename="base.stl"/></geometry></collision></link>
  <link name="shoe"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 -0.1" rpy="0.1 0.2 0.3"/><geometry><cylinder radius="0.1" length="0.4"/></geometry></collision></link>
  <link name="sensor"/>
  <joint name="weld" type="fixed"><parent link="shoe"/><child link="sensor"/><origin xyz="0 0 1"/></joint>
  <joint name="turn" type="continuous"><parent link="base"/><child link="shoe"/><origin xyz="1 2 3" rpy="0.3 0.2 0.1"/>
    <axis xyz="0 3 4"/><dynamics damping="0.5" friction="0.25"/><limit effort="9" velocity="4"/></joint>
  <transmission name="t"/>
</robot>"#;

#[test]
fn links_joints_and_shapes_are_read() {
    let model = urdf(SMALL).unwrap();
    assert_eq!(model.root, Root::Floating);
    let names: Vec<&str> = model.bodies.iter().map(|b| b.name.as_str()).collect();
    assert_eq!(names, ["base", "shoe", "sensor"]);
    // The tensor is turned by the inertial's origin: x and y change places.
    let base = &model.bodies[0];
    let x = turn(base.iquat, [1.0, 0.0, 0.0]);
    assert!(near(&base.inertia, &[0.3, 0.2, 0.1], 1e-15) && near(&x.map(f64::abs), &[0.0, 1.0, 0.0], 1e-12));
    let joint = &model.joints[0];
    assert!(near(&joint.axis, &[0.0, 0.6, 0.8], 1e-15));
    assert_eq!((joint.damping, joint.frictionloss, joint.range), (0.5, 0.25, None));
    assert_eq!(joint.velocity_limit, Some(4.0));
    assert_eq!(model.actuators[0].ctrlrange, Some([-9.0, 9.0]));
    assert_eq!(model.actuators[0].name, "turn");
    // Fixed-axis roll 0.3, pitch 0.2, yaw 0.1: Rz Ry Rx applied to y by hand.
    let (r, p, y): (f64, f64, f64) = (0.3, 0.2, 0.1);
    let rolled = [0.0, r.cos(), r.sin()];
    let pitched = [p.sin() * rolled[2], rolled[1], p.cos() * rolled[2]];
    let yawed = [
        y.cos() * pitched[0] - y.sin() * pitched[1],
        y.sin() * pitched[0] + y.cos() * pitched[1],
        pitched[2],
    ];
    assert!(near(&turn(model.bodies[1].quat, [0.0, 1.0, 0.0]), &yawed, 1e-15));
    assert_eq!(model.geoms[0].shape, Shape::Cylinder { radius: 0.1, half_length: 0.2 });
    assert_eq!(model.pairs.len(), 1);
    assert!(model.dropped.iter().any(|d| d.what.contains("mesh") && d.line == 6));
    assert!(model.dropped.iter().any(|d| d.what.contains("transmission")));
}

#[test]
fn joints_that_differ_by_their_ending_have_motors_of_their_own() {
    let second = SMALL.replace(
        "<transmission name=\"t\"/>",
        r#"<joint name="turn_joint" type="continuous"><parent link="shoe"/><child link="toe"/></joint>
        <joint name="knee_joint" type="continuous"><parent link="toe"/><child link="tip"/></joint>"#,
    );
    let link = |name: &str| {
        format!(
            "<link name=\"{name}\"><inertial><mass value=\"1\"/><inertia ixx=\"0.1\" iyy=\"0.1\" izz=\"0.1\" ixy=\"0\" \
             ixz=\"0\" iyz=\"0\"/></inertial></link></robot>"
        )
    };
    let text = second.replace("</robot>", &link("toe")).replace("</robot>", &link("tip"));
    let model = urdf(&text).unwrap();
    let mut names: Vec<&str> = model.actuators.iter().map(|actuator| actuator.name.as_str()).collect();
    names.sort_unstable();
    assert_eq!(names, ["knee", "turn", "turn_joint"]);
}

#[test]
fn a_clamped_robot_hangs_in_the_air_and_a_world_link_is_the_world() {
    let fixed = ReadOptions { root: Some(Root::Fixed), ..Default::default() };
    let model = read_urdf_str(SMALL, &fixed).unwrap();
    assert_eq!((model.root, model.planes.len(), model.nq()), (Root::Fixed, 0, 1));
    let arm = SMALL.replace(
        "<transmission name=\"t\"/>",
        r#"<link name="world"/><joint name="bolt" type="fixed"><parent link="world"/><child link="base"/>
           <origin xyz="0 0 2"/></joint>"#,
    );
    let model = urdf(&arm).unwrap();
    assert_eq!((model.root, model.planes.len()), (Root::Fixed, 1));
    assert_eq!((model.bodies[0].name.as_str(), model.bodies[0].pos), ("base", [0.0, 0.0, 2.0]));
}

#[test]
fn what_urdf_says_but_the_engine_lacks_is_refused() {
    for (from, to, want) in [
        ("continuous", "spherical", "spherical"),
        (
            "limit effort=\"9\"",
            "limit lower=\"2\" upper=\"1\" effort=\"9\"",
            "is prismatic, but has no limits with",
        ),
        ("continuous", "floating", "floating"),
        ("continuous", "planar", "planar"),
        ("limit effort=\"9\"", "limit lower=\"1\" upper=\"1\" effort=\"9\"", "lower < upper"),
        ("<axis xyz=\"0 3 4\"/>", "<axis xyz=\"0 0 0\"/>", "axis is zero"),
        ("<child link=\"sensor\"/>", "<child link=\"base\"/>", "hangs on itself"),
        ("<child link=\"sensor\"/>", "<child link=\"shoe\"/>", "child of two joints"),
        ("<child link=\"sensor\"/>", "<child link=\"nobody\"/>", "does not exist"),
        ("<child link=\"sensor\"/>", "", "without a parent or child"),
        ("<link name=\"sensor\"/>", "<link/>", "without `name`"),
        ("<link name=\"sensor\"/>", "<link name=\"sensor\"/><link name=\"lost\"/>", "have no parent"),
        ("<link name=\"sensor\"/>", "<link name=\"sensor\"/><link name=\"base\"/>", "used twice"),
        ("<mass value=\"2\"/>", "<mass value=\"-2\"/>", "negative"),
        ("<mass value=\"2\"/>", "<mass value=\"nan\"/>", "nan"),
        ("<mass value=\"2\"/>", "", "without mass"),
        ("ixx=\"0.3\"", "ixx=\"-0.3\"", "principal moment"),
        ("ixx=\"0.3\"", "ixx=\"3\"", "A + B >= C"),
        ("<cylinder radius=\"0.1\" length=\"0.4\"/>", "<cylinder radius=\"0.1\"/>", "length"),
        ("<cylinder radius=\"0.1\" length=\"0.4\"/>", "<torus radius=\"0.1\"/>", "torus"),
    ] {
        let small = match want {
            "lower < upper" => SMALL.replace("continuous", "revolute"),
            _ if want.contains("prismatic") => SMALL.replace("continuous", "prismatic"),
            _ => SMALL.to_string(),
        };
        assert!(small.contains(from), "{from}");
        let error = urdf(&small.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(error.contains(want), "{to}: {error}");
        assert!(error.starts_with("<text>:"), "{error}");
    }
    let lenient = ReadOptions { lenient: true, ..Default::default() };
    // Leniently a joint of another type is a weld; nothing moves then but the base.
    let welded = read_urdf_str(&SMALL.replace("continuous", "planar"), &lenient).unwrap();
    assert_eq!((welded.nv(), welded.bodies.len()), (6, 3));
    assert!(welded.dropped.iter().any(|d| d.what.contains("planar")));
}

/// A robot of 100 kg with a camera of `mass` kg on its trunk, whose inertia is `inertia`.
fn with_camera(mass: f64, inertia: &str, joint: &str) -> Result<Model, ModelError> {
    let even = |mass: f64| {
        format!(
            r#"<inertial><mass value="{mass}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"#
        )
    };
    urdf(&format!(
        r#"<robot name="r"><link name="trunk">{}</link><link name="leg">{}</link>
          <link name="camera"><inertial><mass value="{mass}"/><inertia {inertia} ixy="0" ixz="0" iyz="0"/></inertial></link>
          <joint name="hip" type="continuous"><parent link="trunk"/><child link="leg"/><limit effort="9" velocity="4"/></joint>
          <joint name="mount" type="{joint}"><parent link="trunk"/><child link="camera"/></joint></robot>"#,
        even(90.0),
        even(10.0 - mass)
    ))
}

#[test]
fn the_impossible_inertia_of_a_light_fixed_link_becomes_its_mean() {
    for (inertia, mean) in [
        (r#"ixx="0.003" iyy="0.001" izz="0.001""#, 0.005 / 3.0),
        (r#"ixx="0.003" iyy="-0.001" izz="0.003""#, 0.002),
        (r#"ixx="-1e-19" iyy="1e-19" izz="0.003""#, 0.001),
    ] {
        let model = with_camera(0.9, inertia, "fixed").unwrap();
        let camera = &model.bodies[model.body("camera").unwrap()];
        assert!(near(&camera.inertia, &[mean; 3], 1e-15), "{:?}", camera.inertia);
        assert_eq!(model.changed.len(), 1);
        let said = format!("{} {}", model.changed[0].what, model.changed[0].how);
        assert!(
            said.contains("\"camera\"") && said.contains("0.9 %") && model.changed[0].line == 2,
            "{said}"
        );
        // A hundredth of the robot is not light, and a link that turns needs a true inertia.
        for refused in [with_camera(1.0, inertia, "fixed"), with_camera(0.9, inertia, "continuous")] {
            let error = refused.unwrap_err().to_string();
            assert!(error.contains("A + B >= C") || error.contains("principal moment of -"), "{error}");
        }
    }
    let sound = with_camera(0.9, r#"ixx="0.002" iyy="0.001" izz="0.001""#, "fixed").unwrap();
    assert!(sound.changed.is_empty());
}

#[test]
fn annotations_of_other_programs_are_listed_and_unknown_words_refused() {
    for (from, to, listed) in [
        ("type=\"fixed\"", "type=\"fixed\" dont_collapse=\"true\"", "`dont_collapse`"),
        (
            "effort=\"9\"",
            "effort=\"9\" command_effort=\"8\" current=\"1\" gear_velocity=\"3\"",
            "`command_effort`",
        ),
        (
            "<link name=\"sensor\"/>",
            "<link name=\"sensor\"><contact><lateral_friction value=\"1\"/></contact></link>",
            "<contact>",
        ),
        (
            "<link name=\"sensor\"/>",
            "<link name=\"sensor\"><surface/><material/><gazebo/></link>",
            "<surface>",
        ),
        ("<axis xyz=\"0 3 4\"/>", "<axis xyz=\"0 3 4\"/><gazebo/>", "<gazebo>"),
        (
            "<geometry><cylinder",
            "<contact_coefficients mu=\"1\"/><geometry><cylinder",
            "<contact_coefficients>",
        ),
        ("<transmission", "<gazebo reference=\"base\"><mu1>1</mu1></gazebo><transmission", "<gazebo>"),
    ] {
        assert!(SMALL.contains(from), "{from}");
        let model = urdf(&SMALL.replacen(from, to, 1)).unwrap();
        let found = model.dropped.iter().find(|d| d.what.contains(listed));
        assert!(found.is_some_and(|d| d.harmless && d.line > 0), "{listed}: {:?}", model.dropped);
        let plain = urdf(SMALL).unwrap();
        assert_eq!(
            (&model.bodies, &model.joints, &model.geoms),
            (&plain.bodies, &plain.joints, &plain.geoms)
        );
    }
    for (from, to) in [
        ("type=\"fixed\"", "type=\"fixed\" stiffness=\"3\""),
        ("effort=\"9\"", "effort=\"9\" lower_velocity=\"8\""),
        ("<link name=\"sensor\"/>", "<link name=\"sensor\"><rotor/></link>"),
        ("<axis xyz=\"0 3 4\"/>", "<axis xyz=\"0 3 4\"/><rotor_inertia value=\"1\"/>"),
        ("<transmission", "<loop_joint/><transmission"),
    ] {
        let error = urdf(&SMALL.replacen(from, to, 1)).unwrap_err();
        assert!(matches!(error, ModelError::Unsupported { .. }), "{to}: {error}");
    }
}

#[test]
fn a_massless_root_fixed_to_its_only_child_is_folded() {
    let two = r#"<link name="foot_print"/><link name="frame"/>
      <joint name="a" type="fixed"><parent link="foot_print"/><child link="frame"/><origin xyz="0 0 1" rpy="0 0 1.5707963267948966"/></joint>
      <joint name="b" type="fixed"><parent link="frame"/><child link="base"/><origin xyz="1 0 0"/></joint><transmission"#;
    let text = SMALL.replace("<transmission", two);
    let model = urdf(&text).unwrap();
    let plain = urdf(SMALL).unwrap();
    assert_eq!(model.bodies[0].name, "base");
    assert!(near(&model.bodies[0].pos, &[0.0, 1.0, 1.0], 1e-15), "{:?}", model.bodies[0].pos);
    assert_eq!((model.nq(), &model.bodies[1..]), (plain.nq(), &plain.bodies[1..]));
    let said: Vec<&str> = model.changed.iter().map(|c| c.what.as_str()).collect();
    assert_eq!(said, ["root link \"foot_print\"", "root link \"frame\""]);
    // With a second child, or a shape, the link stays.
    let other = r#"<link name="frame"/><link name="lamp"/>
      <joint name="a" type="fixed"><parent link="frame"/><child link="base"/></joint>
      <joint name="b" type="fixed"><parent link="frame"/><child link="lamp"/></joint><transmission"#;
    let model = urdf(&SMALL.replace("<transmission", other)).unwrap();
    assert_eq!((model.bodies[0].name.as_str(), model.changed.len()), ("frame", 0));
}

#[test]
fn a_revolute_joint_whose_file_gives_no_limits_turns_and_it_is_said() {
    let model = urdf(&SMALL.replace("continuous", "revolute")).unwrap();
    assert_eq!(model.joints[0].range, None);
    assert!(model.changed[0].what.contains("(1, such as \"turn\")"), "{:?}", model.changed);
    assert!(urdf(SMALL).unwrap().changed.is_empty());
    let half = SMALL.replace("continuous", "revolute").replace("limit effort", "limit upper=\"0\" effort");
    assert!(urdf(&half).unwrap_err().to_string().contains("lower < upper"));
}

#[test]
fn a_robot_without_a_root_or_of_impossible_size_is_named() {
    let link = |name: &str| {
        format!(
            "<link name=\"{name}\"><inertial><mass value=\"1\"/><inertia ixx=\"0.1\" iyy=\"0.1\" izz=\"0.1\" ixy=\"0\" ixz=\"0\" \
             iyz=\"0\"/></inertial></link>"
        )
    };
    let joint = |name: &str, parent: &str, child: &str, xyz: &str| {
        format!(
            "<joint name=\"{name}\" type=\"revolute\"><parent link=\"{parent}\"/><child link=\"{child}\"/>\
             <origin xyz=\"{xyz}\"/><axis xyz=\"0 1 0\"/><limit lower=\"-1\" upper=\"1\" effort=\"1\" velocity=\"1\"/></joint>"
        )
    };
    let robot = |parts: &[String]| format!("<robot name=\"r\">\n{}\n</robot>", parts.join("\n"));
    let refused = |text: &str| urdf(text).unwrap_err().to_string();
    let empty = refused(&robot(&[]));
    assert!(empty.contains("the robot has no <link>"), "{empty}");
    let ring = refused(&robot(&[
        link("a"),
        link("b"),
        joint("j", "a", "b", "0 0 0"),
        joint("k", "b", "a", "0 0 0"),
    ]));
    assert!(ring.contains("the joints form a ring, which goes through link \"a\""), "{ring}");
    let far = refused(&robot(&[link("a"), link("b"), joint("j", "a", "b", "1e300 0 0")]));
    assert!(far.contains("body \"b\" has a position of 1e300 m"), "{far}");
    let heavy = robot(&[
        link("a"),
        link("b").replace("value=\"1\"", "value=\"1e300\""),
        joint("j", "a", "b", "0 0 0"),
    ]);
    assert!(refused(&heavy).contains("body \"b\" has a mass of 1e300 kg"), "{}", refused(&heavy));
}
