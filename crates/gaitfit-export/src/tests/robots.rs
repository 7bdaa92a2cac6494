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

#[test]
fn mjlab_reads_the_robot_file_that_is_written() {
    for (text, is_urdf, name) in [(builtin::GO2, false, "robot.xml"), (GO2_URDF, true, "robot.urdf")] {
        let read = if is_urdf { read_urdf_str } else { read_mjcf_str };
        let model = read(text, &ReadOptions::default()).unwrap();
        let file = theta_of(&model, 0.0);
        let candidate = file.candidate(&model).unwrap();
        let exported = files_of(&file, &model, text, is_urdf, &candidate, None, STEP).unwrap();
        let code = content(&exported, "mjlab_robot.py");
        assert!(code.contains(&format!("with_name(\"{name}\")")), "{code}");
        // A URDF has no place for them.
        assert_eq!(code.contains("armature = armature"), is_urdf, "{code}");
        assert_eq!(code.contains("base.add_freejoint()"), is_urdf, "{code}");
        assert_eq!(code.contains("0.035"), is_urdf, "{code}");
        assert!(exported.files.iter().any(|(file, _)| file == name));
    }
}

#[test]
fn no_step_is_named_where_joints_have_different_delays() {
    let model = read_mjcf_str(TWO, &ReadOptions::default()).unwrap();
    let delay = |joint: &str, value: f64| {
        format!(
            "[[parameter]]\nname = \"{joint}\"\nkind = \"delay\"\njoints = [\"{joint}\"]\nvalue = {value:?}\n"
        )
    };
    let file =
        ThetaFile::parse(&format!("format = 2\n{}{}", delay("one", 0.002), delay("two", 0.01))).unwrap();
    let candidate = file.candidate(&model).unwrap();
    let exported = files_of(&file, &model, TWO, false, &candidate, None, STEP).unwrap();
    let note = exported.notes.iter().find(|note| note.contains("DELAY ROUNDED")).unwrap();
    assert!(note.contains("2.00 to 10.00 ms") && !note.contains("for example"), "{note}");
}

#[test]
fn flags_that_are_switched_on_leave_tendons_off() {
    let flags = "<option><flag frictionloss=\"disable\" spring=\"disable\"/></option>";
    let tendon = "<tendon><fixed name=\"t\" stiffness=\"3\" damping=\"2\" frictionloss=\"1\"><joint joint=\"one\" \
                  coef=\"1\"/></fixed></tendon>";
    let text = TWO.replacen("<worldbody>", &format!("{flags}{tendon}<worldbody>"), 1);
    let model = read_mjcf_str(&text, &ReadOptions { lenient: true, ..ReadOptions::default() }).unwrap();
    let exported = |kind: &str| {
        let parameter =
            format!("[[parameter]]\nname = \"p\"\nkind = \"{kind}\"\njoints = [\"one\"]\nvalue = 0.5\n");
        let file = ThetaFile::parse(&format!("format = 2\n{parameter}")).unwrap();
        let candidate = file.candidate(&model).unwrap();
        let exported = files_of(&file, &model, &text, false, &candidate, None, STEP).unwrap();
        content(&exported, "robot.xml").to_owned()
    };
    let tendon = |numbers: &str| format!("<fixed name=\"t\" {numbers}>");
    let friction = exported("frictionloss");
    assert!(friction.contains("<flag frictionloss=\"enable\" spring=\"disable\"/>"), "{friction}");
    assert!(friction.contains(&tendon("stiffness=\"3\" damping=\"2\" frictionloss=\"0\"")), "{friction}");
    let spring = exported("stiffness");
    assert!(spring.contains(&tendon("stiffness=\"0\" damping=\"2\" frictionloss=\"1\"")), "{spring}");
    // What nothing switches on stays as it is.
    let load = exported("link_mass");
    assert!(load.contains(flags) && load.contains("stiffness=\"3\""), "{load}");
}

#[test]
fn the_last_of_several_compilers_counts() {
    let file = ThetaFile::parse(
        "format = 2\n[[parameter]]\nname = \"s\"\nkind = \"stiffness\"\njoints = [\"one\"]\nvalue = 2.0\n\
         [[parameter]]\nname = \"t\"\nkind = \"spring_torque\"\njoints = [\"one\"]\nvalue = 1.0\n\
         [[parameter]]\nname = \"m\"\nkind = \"base_mass\"\nvalue = 0.5\n",
    )
    .unwrap();
    let unset = "<compiler inertiafromgeom=\"true\" settotalmass=\"9\"/><compiler inertiafromgeom=\"false\" \
                 settotalmass=\"-1\"/>";
    for more in
        ["<compiler angle=\"degree\"/>", "<compiler angle=\"degree\"/><compiler angle=\"radian\"/>", unset]
    {
        let text = TWO.replacen("<worldbody>", &format!("{more}<worldbody>"), 1);
        let model = read_mjcf_str(&text, &ReadOptions::default()).unwrap();
        let candidate = file.candidate(&model).unwrap();
        let exported = files_of(&file, &model, &text, false, &candidate, None, STEP).unwrap();
        let again = read_mjcf_str(content(&exported, "robot.xml"), &ReadOptions::default()).unwrap();
        let spring = &again.joints[0];
        assert!((spring.stiffness * spring.springref - 1.0).abs() < 1e-12, "{more}: {}", spring.springref);
        assert!((again.bodies[0].mass - 2.5).abs() < 1e-12, "{more}");
    }
}
