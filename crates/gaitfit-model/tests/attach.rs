//! Bodies of other files (`<attach>`): what MuJoCo 4.0.0 makes of the same files.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_model::{Form, Model, ModelError, ObstacleShape, ReadOptions, read};

const ARM: &str = r#"<mujoco model="arm">
  <compiler angle="radian"/><option timestep="0.005" gravity="0 0 -3"/>
  <default>
    <joint damping="0.7" armature="0.02"/><geom contype="0" conaffinity="1"/>
    <default class="big"><joint damping="2"/><geom density="500"/></default>
  </default>
  <worldbody>
    <body name="base" pos="0.1 0.2 0.3" quat="0.9 0.1 0.2 0.3">
      <joint name="yaw" axis="0 0 1"/><geom name="g" size="0.05"/><site name="tip" pos="0 0 0.1"/>
      <body name="link" pos="0 0 0.1" childclass="big">
        <joint name="elbow" axis="0 1 0" range="-1 1"/><geom size="0.03 0.1" type="capsule"/>
      </body>
    </body>
    <body name="other"><joint name="lost"/><geom size="0.1"/></body>
  </worldbody>
  <contact><exclude body1="base" body2="link"/></contact>
  <actuator>
    <motor name="m" joint="elbow" gear="3"/><position joint="yaw" kp="20" class="big"/><motor name="x" joint="lost"/>
  </actuator>
  <keyframe><key name="up" qpos="0.3 0.4 0"/></keyframe>
</mujoco>"#;

/// A trunk that attaches an arm; `attach`: twice, in the file of the test that MuJoCo read.
fn robot(attach: &str, compiler: &str) -> String {
    format!(
        r#"<mujoco model="robot">
  <compiler angle="{compiler}"/><default><joint damping="0.1"/><geom density="2000" contype="0" conaffinity="1"/></default>
  <asset><model name="arm" file="parts/arm.xml"/></asset>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" contype="1" conaffinity="0"/>
    <body name="trunk" pos="0 0 1">
      <freejoint/><geom name="trunk" type="box" size="0.2 0.1 0.05"/>
      {attach}
      <body name="tail"><joint name="t" axis="0 1 0"/><geom size="0.02"/></body>
    </body>
  </worldbody>
  <actuator><motor name="tm" joint="t"/></actuator>
</mujoco>"#
    )
}

const BOTH: &str = r#"<frame pos="0.1 0 0" euler="0 0 0.5"><attach model="arm" body="base" prefix="L_"/></frame>
      <attach model="arm" body="base" prefix="R_"/>"#;

fn read_files(robot: &str, arm: &str) -> Result<Model, ModelError> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("parts")).unwrap();
    std::fs::write(folder.path().join("parts/arm.xml"), arm).unwrap();
    std::fs::write(folder.path().join("robot.xml"), robot).unwrap();
    read(&folder.path().join("robot.xml"), &ReadOptions::default())
}

fn error(robot: &str, arm: &str) -> String {
    read_files(robot, arm).unwrap_err().to_string()
}

#[test]
fn two_arms_are_attached_as_mujoco_attaches_them() {
    let model = read_files(&robot(BOTH, "radian"), ARM).unwrap();
    // MuJoCo 4.0.0: body_pos, body_quat, body_mass.
    let wanted = [
        ("trunk", [0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0], 16.0),
        (
            "L_base",
            [0.091_873_15, 0.223_459_07, 0.3],
            [0.818_525_52, 0.048_642_1, 0.224_199_74, 0.526_672_95],
            std::f64::consts::FRAC_PI_6,
        ),
        ("L_link", [0.0, 0.0, 0.1], [1.0, 0.0, 0.0, 0.0], 0.339_292_01),
        (
            "R_base",
            [0.1, 0.2, 0.3],
            [0.923_380_52, 0.102_597_84, 0.205_195_67, 0.307_793_51],
            std::f64::consts::FRAC_PI_6,
        ),
        ("R_link", [0.0, 0.0, 0.1], [1.0, 0.0, 0.0, 0.0], 0.339_292_01),
        ("tail", [0.0; 3], [1.0, 0.0, 0.0, 0.0], 0.067_020_64),
    ];
    assert_eq!(model.bodies.len(), wanted.len());
    for (body, (name, pos, quat, mass)) in model.bodies.iter().zip(wanted) {
        assert_eq!(body.name, name);
        assert!(body.pos.iter().zip(pos).all(|(a, b)| (a - b).abs() < 1e-7), "{body:?}");
        assert!(body.quat.iter().zip(quat).all(|(a, b)| (a - b).abs() < 1e-7), "{body:?}");
        assert!((body.mass - mass).abs() < 1e-7, "{body:?}");
    }
    // Names, damping and armature: classes of the arm inherit nothing from those of the robot.
    let joints: Vec<_> =
        model.joints.iter().map(|joint| (joint.name.as_str(), joint.damping, joint.armature)).collect();
    let [yaw, elbow] = [(0.7, 0.02), (2.0, 0.02)];
    assert_eq!(
        joints,
        [
            ("L_yaw", yaw.0, yaw.1),
            ("L_elbow", elbow.0, elbow.1),
            ("R_yaw", yaw.0, yaw.1),
            ("R_elbow", elbow.0, elbow.1),
            ("t", 0.1, 0.0)
        ]
    );
    assert_eq!(model.joints[1].range, Some([-1.0, 1.0]));
    let actuators: Vec<_> =
        model.actuators.iter().map(|one| (one.name.as_str(), one.joint, one.gain, one.gear)).collect();
    assert_eq!(
        actuators,
        [
            ("tm", 4, 1.0, 1.0),
            ("L_m", 1, 1.0, 3.0),
            ("actuator2", 0, 20.0, 1.0),
            ("R_m", 3, 1.0, 3.0),
            ("actuator4", 2, 20.0, 1.0)
        ]
    );
    // The robot's options count, and so do its keyframes alone.
    assert_eq!((model.options.timestep, model.options.gravity[2]), (0.002, -9.81));
    assert!(model.keyframes.is_empty());
    assert!(
        model.dropped.iter().any(|one| one.what.contains("<keyframe> of an attached file")),
        "{:?}",
        model.dropped
    );
    assert_eq!(model.sites.len(), 2);
}

#[test]
fn a_whole_world_is_attached_without_a_body() {
    let model = read_files(&robot(r#"<attach model="arm" prefix="a-"/>"#, "radian"), ARM).unwrap();
    let names: Vec<&str> = model.joints.iter().map(|joint| joint.name.as_str()).collect();
    assert_eq!(names, ["a-yaw", "a-elbow", "a-lost", "t"]);
    assert_eq!(model.actuators.len(), 4);
}

/// MuJoCo 4.0.0: `eq_solref` is that of the attached file's main class, and the name has the prefix once.
#[test]
fn couplings_have_the_defaults_of_the_attached_file() {
    let soft = |text: &str, solref: &str| {
        text.replacen("<default>", &format!("<default><equality solref=\"{solref}\"/>"), 1)
    };
    let robot = soft(&robot(r#"<attach model="arm" body="base" prefix="L_"/>"#, "radian"), "0.9 1");
    let coupling = r#"<equality><joint name="e" joint1="elbow" joint2="yaw"/></equality></mujoco>"#;
    let arm = soft(&ARM.replace("</mujoco>", coupling), "0.5 2");
    let couplings = read_files(&robot, &arm).unwrap().couplings;
    assert_eq!((couplings.len(), couplings[0].solref), (1, [0.5, 2.0]));
    let found = error(&robot, &arm.replace("name=\"e\"", "name=\"e\" gear=\"2\""));
    assert!(found.contains("`gear` of <joint> \"L_e\""), "{found}");
}

#[test]
fn what_cannot_be_attached_is_named() {
    let one = |attributes: &str| robot(&format!("<attach {attributes}/>"), "radian");
    for (robot, arm, wanted) in [
        (one(r#"model="leg" body="base""#), ARM, "model \"leg\", which <asset> does not have"),
        (one(r#"model="arm" body="hand""#), ARM, "the model \"arm\" has no body \"hand\""),
        (robot(BOTH, "degree"), ARM, "has another `angle` of <compiler>"),
        (
            robot(&BOTH.replace("R_", "L_"), "radian"),
            ARM,
            "default classes of two attached files are called \"L_main\"",
        ),
        (one(r#"model="arm" body="base" prefix="L_""#), "<mujoco>", "arm.xml"),
        (one(r#"model="arm""#).replace("parts/arm.xml", "none.xml"), ARM, "cannot read"),
        (
            one("").replace("</asset>", "<model name=\"arm\" file=\"parts/arm.xml\"/></asset>"),
            ARM,
            "two models of <asset> are called \"arm\"; the other is at ",
        ),
    ] {
        let found = error(&robot, arm);
        assert!(found.contains(wanted), "`{wanted}` is not in `{found}`");
    }
    // A file that names itself, and one that is attached again and again.
    let own = ARM.replace("<worldbody>", "<asset><model name=\"me\" file=\"arm.xml\"/></asset><worldbody>");
    let found = error(&robot(BOTH, "radian"), &own);
    assert!(found.contains("more than 64 files named by <model>, or one that names itself"), "{found}");
    let frames = |inner: &str| "<frame>".repeat(60) + inner + &"</frame>".repeat(60);
    let deep = robot(&frames(r#"<attach model="arm" body="base"/>"#), "radian");
    let found = error(&deep, &ARM.replace("<site ", &(frames("") + "<site ")));
    assert!(found.contains("more than 100 elements inside each other"), "{found}");
    let many = (0..20_000).map(|number| format!("<attach model=\"arm\" prefix=\"p{number}\"/>"));
    let found = error(&robot(&many.collect::<String>(), "radian"), ARM);
    assert!(found.contains("elements with those of <attach>"), "{found}");
}

/// Files and defaults of an attached file's assets are its own.
#[test]
fn assets_lie_where_the_attached_file_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::create_dir_all(path("parts/maps")).unwrap();
    // Rows, columns, then heights from 0 to 8.
    let counts = [3_i32, 3].into_iter().flat_map(i32::to_le_bytes);
    let heights = (0..9_u8).flat_map(|height| f32::from(height).to_le_bytes());
    std::fs::write(path("parts/maps/hills.bin"), counts.chain(heights).collect::<Vec<u8>>()).unwrap();
    let ball = r#"<mujoco model="ball"><compiler meshdir="maps"/><default><mesh scale="2 2 2"/></default>
        <asset><hfield file="hills.bin" size="1 1 0.4 0.1"/><mesh file="ball.stl"/></asset>
        <worldbody><geom type="hfield" hfield="hills"/><body name="ball"><freejoint/><geom size="0.1"/>
        <geom type="mesh" mesh="ball" mass="0" contype="0" conaffinity="0"/></body></worldbody></mujoco>"#;
    std::fs::write(path("parts/ball.xml"), ball).unwrap();
    let robot = r#"<mujoco><compiler meshdir="meshes"/><asset><model name="ball" file="parts/ball.xml"/></asset>
        <worldbody><attach model="ball" prefix="a_"/></worldbody></mujoco>"#;
    std::fs::write(path("robot.xml"), robot).unwrap();
    let model = read(&path("robot.xml"), &ReadOptions { mend: true, ..ReadOptions::default() }).unwrap();
    let ObstacleShape::Field(field) = &model.obstacles[0].shape else { panic!("{:?}", model.obstacles) };
    assert_eq!((field.rows, field.columns, field.heights[8]), (3, 3, 0.4));
    let Form::Mesh(mesh) = &model.outlines[0].form else { panic!("{:?}", model.outlines) };
    assert_eq!((&mesh.file, mesh.scale), (&path("parts/maps/ball.stl"), [2.0; 3]));
    assert!(model.changed.is_empty(), "{:?}", model.changed);
}
