//! What is changed in robot files.

use super::*;

/// Two hinges of which the first has a motor; the root's end has white space.
const TWO: &str = r#"<mujoco><compiler angle="radian" autolimits="true"/><worldbody><body name="base"><freejoint/>
    <inertial pos="0 0 0" mass="2" diaginertia="0.1 0.1 0.1"/>
    <body name="a" pos="0.1 0 0"><joint name="one"/><inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/></body>
    <body name="b" pos="-0.1 0 0"><joint name="two"/><inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/></body>
    </body></worldbody>
    <actuator><motor name="one" joint="one" forcerange="-7 7"/></actuator>
    <keyframe><key name="sit" qpos="0 0 1 1 0 0 0 0.25 0.5" ctrl="3"/></keyframe>
    </mujoco >"#;

#[test]
fn controllers_of_an_exported_mjcf_belong_to_all_joints_and_its_keyframes() {
    let model = read_mjcf_str(TWO, &ReadOptions::default()).unwrap();
    let file = ThetaFile::parse("format = 2\n").unwrap();
    let candidate = file.candidate(&model).unwrap();
    let gains = Gains { kp: vec![30.0, 0.0], kd: vec![1.0, 2.0] };
    let exported = |text: &str| {
        let exported = files_of(&file, &model, text, false, &candidate, Some(&gains), STEP).unwrap();
        (read_mjcf_str(content(&exported, "robot.xml"), &ReadOptions::default()).unwrap(), exported)
    };
    let (again, files) = exported(TWO);
    let gained: Vec<_> = again.actuators.iter().map(|one| (one.joint, one.gain, one.bias[2])).collect();
    assert_eq!(gained, [(0, 30.0, -1.0), (1, 0.0, -2.0)], "a joint that is only damped has a controller too");
    assert_eq!(again.keyframes[0].ctrl, [0.25, 0.5], "controls are angles now");
    // Isaac Lab gives joints without a limit none at all if others have one.
    let isaac = content(&files, "isaac_lab.py");
    assert!(isaac.contains("effort_limit={\"one\": 7.0, \"two\": 1000000000.0}"), "{isaac}");
    // Without actuators and keyframes the block of controllers stands at the end.
    let bare = &TWO[..TWO.find("<actuator>").unwrap()];
    for end in ["</mujoco>", "</mujoco >", "<!-- </mujoco> --></mujoco\n>"] {
        let (again, _) = exported(&format!("{bare}{end}"));
        assert_eq!(again.actuators.len(), 2, "{end}");
    }
}

#[test]
fn a_torque_without_stiffness_is_not_said_to_be_in_the_file() {
    let model = read_mjcf_str(TWO, &ReadOptions::default()).unwrap();
    let torque = "[[parameter]]\nname = \"t\"\nkind = \"spring_torque\"\njoints = [\"two\"]\nvalue = 1.5\n";
    let stiffness = torque.replace("spring_torque", "stiffness").replace("\"t\"", "\"s\"");
    for (text, within) in [(torque.to_owned(), false), (format!("{torque}{stiffness}"), true)] {
        let file = ThetaFile::parse(&format!("format = 2\n{text}")).unwrap();
        let candidate = file.candidate(&model).unwrap();
        let exported = files_of(&file, &model, TWO, false, &candidate, None, STEP).unwrap();
        assert_eq!(exported.rows[0].in_robot_file, within);
        let noted = exported.notes.iter().any(|note| note.contains("spring_torque of `two`"));
        assert_eq!(noted, !within, "{:?}", exported.notes);
    }
}

#[test]
fn only_joints_and_links_of_the_robot_are_changed_in_a_urdf() {
    let inertial =
        "<inertial><mass value='2'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>";
    let text = format!(
        "<robot name=\"two\"><transmission name=\"t\"><joint name=\"swing\"/><link name=\"arm\"/></transmission>\
         <link name=\"base\">{inertial}</link><link name=\"arm\">{inertial}</link><joint name=\"swing\" \
         type=\"continuous\"><parent link=\"base\"/><child link=\"arm\"/><axis xyz=\"0 1 0\"/></joint></robot>"
    );
    let lenient = ReadOptions { lenient: true, ..ReadOptions::default() };
    let model = read_urdf_str(&text, &lenient).unwrap();
    let file = ThetaFile::parse(
        "format = 2\n[[parameter]]\nname = \"d\"\nkind = \"damping\"\njoints = [\"swing\"]\nvalue = 0.3\n\
         [[parameter]]\nname = \"m\"\nkind = \"link_mass\"\njoints = [\"swing\"]\nvalue = 1.5\n",
    )
    .unwrap();
    let candidate = file.candidate(&model).unwrap();
    let exported = files_of(&file, &model, &text, true, &candidate, None, STEP).unwrap();
    let robot = content(&exported, "robot.urdf");
    let again = read_urdf_str(robot, &lenient).unwrap();
    assert_eq!((again.joints[0].damping, again.bodies[1].mass), (0.3, 3.0));
    assert!(robot.contains("<joint name=\"swing\"/>"), "{robot}");
}
