//! Robot files as description packages have them: xacro, meshes that only ROS finds, inertias of links without mass.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_model::{Model, ModelError, ReadOptions, read, read_mjcf_str, read_urdf_str};

fn urdf(text: &str) -> Result<Model, ModelError> {
    read_urdf_str(text, &ReadOptions::default())
}

const XACRO: &str = r#"<?xml version="1.0"?>
<robot name="quad" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:include filename="$(find quad_description)/urdf/leg.xacro"/>
<link name="base"><inertial><mass value="${mass}"/></inertial></link>
</robot>"#;

#[test]
fn xacro_is_named_whatever_the_files_name_is_with_the_command_that_expands_it() {
    let folder = tempfile::tempdir().unwrap();
    for (name, command) in [
        ("robot.urdf.xacro", "robot.urdf.xacro > "),
        ("robot.xacro", "robot.xacro > "),
        ("renamed.urdf", "renamed.urdf > "),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, XACRO).unwrap();
        let error = read(&path, &ReadOptions::default()).unwrap_err().to_string();
        assert!(
            error.contains("this is xacro")
                && error.contains(&format!("`xacro {}", path.parent().unwrap().display())),
            "{error}"
        );
        assert!(error.contains(command), "{error}");
        // What is made does not replace what it is made of.
        let made = error.rsplit("> ").next().unwrap().split('`').next().unwrap();
        assert!(made.ends_with(".urdf") && made != path.display().to_string(), "{error}");
        assert!(error.contains(":3:1:"), "{error}");
    }
    // Values to be filled in are enough where the namespace is declared; it alone is left over in made files.
    let filled = XACRO.replace("<xacro:include filename=\"$(find quad_description)/urdf/leg.xacro\"/>\n", "");
    assert!(urdf(&filled).unwrap_err().to_string().contains("this is xacro"));
    let inertia = r#"<mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>"#;
    urdf(&filled.replace("<mass value=\"${mass}\"/>", inertia)).unwrap();
}

/// A trunk on one leg whose foot has the collision `shape`.
fn with_foot(shape: &str) -> String {
    let inertial =
        r#"<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"#;
    let picture =
        r#"<visual><geometry><mesh filename="package://quad_description/meshes/x.dae"/></geometry></visual>"#;
    format!(
        r#"<robot name="quad"><link name="base">{inertial}{picture}</link><link name="shank">{inertial}<collision><origin
        xyz="0 0 -0.2"/><geometry>{shape}</geometry></collision></link><joint name="knee" type="continuous"><parent
        link="base"/><child link="shank"/><axis xyz="0 1 0"/></joint></robot>"#
    )
}

#[test]
fn feet_that_are_meshes_alone_are_named_with_what_to_write() {
    let mesh = r#"<mesh filename="package://quad_description/meshes/foot.stl" scale="0.001 0.001 0.001"/>"#;
    let model = urdf(&with_foot(mesh)).unwrap();
    let said = model.feet_of_meshes().unwrap();
    for words in ["\"shank\"", "are meshes", "<sphere radius=\"0.02\"/>"] {
        assert!(said.contains(words), "`{words}` is not in `{said}`");
    }
    assert!(model.warnings().iter().any(|warning| warning.contains("are meshes")), "{:?}", model.warnings());
    // A picture from a package is no matter.
    let ball = urdf(&with_foot(r#"<sphere radius="0.02"/>"#)).unwrap();
    assert_eq!((ball.feet_of_meshes(), ball.pairs.len()), (None, 1));
}

/// The moments of a link almost without mass.
fn light(moments: [&str; 3]) -> Result<Model, ModelError> {
    let [x, y, z] = moments;
    urdf(&format!(
        r#"<robot name="r"><link name="trunk"><inertial><mass value="9"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0"
        iyz="0"/></inertial></link><link name="tip"><inertial><mass value="1e-6"/><inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0"
        ixz="0" iyz="0"/></inertial></link><joint name="hip" type="continuous"><parent link="trunk"/><child
        link="tip"/></joint></robot>"#
    ))
}

#[test]
fn negative_moments_of_the_size_of_rounding_are_zero() {
    for moments in [["1e-10", "1e-10", "-1e-22"], ["1e-10", "-1e-22", "1e-10"]] {
        let model = light(moments).unwrap();
        let tip = &model.bodies[model.body("tip").unwrap()];
        let [a, b, c] = tip.inertia;
        assert!(c >= 0.0 && a <= b + c + 1e-30, "{moments:?}: {:?}", tip.inertia);
    }
    for moments in [["1e-10", "1e-10", "-1e-12"], ["3", "1", "1"], ["1", "1", "-1e-9"]] {
        let error = light(moments).unwrap_err().to_string();
        assert!(error.contains("principal moment") || error.contains("A + B >= C"), "{moments:?}: {error}");
    }
    let mjcf = |moments: &str| {
        let body =
            format!("<body><joint/><inertial pos=\"0 0 0\" mass=\"1\" diaginertia=\"{moments}\"/></body>");
        let text = format!("<mujoco><worldbody>{body}</worldbody></mujoco>");
        read_mjcf_str(&text, &ReadOptions::default())
    };
    assert_eq!(mjcf("1 1 -1e-22").unwrap().bodies[0].inertia, [1.0, 1.0, 0.0]);
    assert!(mjcf("1 1 -1e-3").unwrap_err().to_string().contains("negative"));
}
