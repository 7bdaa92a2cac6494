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
    let text = &TWO
        .replace("</actuator>", "<motor name=\"two\" joint=\"two\"/></actuator>")
        .replace("ctrl=\"3\"", "ctrl=\"3 3\"");
    let model = read_mjcf_str(text, &ReadOptions::default()).unwrap();
    let delay = |joint: &str, value: f64| {
        format!(
            "[[parameter]]\nname = \"{joint}\"\nkind = \"delay\"\njoints = [\"{joint}\"]\nvalue = {value:?}\n"
        )
    };
    let file =
        ThetaFile::parse(&format!("format = 2\n{}{}", delay("one", 0.002), delay("two", 0.01))).unwrap();
    let candidate = file.candidate(&model).unwrap();
    let exported = files_of(&file, &model, text, false, &candidate, None, STEP).unwrap();
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

/// The export of a file `name` with the text `text`.
fn export(name: &str, text: &str, theta: &str, gains: bool) -> Result<Exported, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path(name), text).unwrap();
    std::fs::write(path("theta.toml"), format!("format = 2\n{theta}")).unwrap();
    let settings = ExportSettings {
        theta: path("theta.toml"),
        robot: Some(path(name)),
        lenient: false,
        kp: gains.then_some(PerJoint::All(30.0)),
        kd: gains.then_some(PerJoint::All(1.0)),
        policy: None,
        step: None,
    };
    export_theta(&settings).map_err(|error| error.to_string())
}

fn parameter(kind: &str, joints: &str, value: f64) -> String {
    format!("[[parameter]]\nname = \"p\"\nkind = \"{kind}\"\njoints = {joints}\nvalue = {value:?}\n")
}

#[test]
fn default_classes_do_not_change_the_controllers() {
    let classes = "<default><motor gear=\"2\" forcerange=\"-3 3\"/><position inheritrange=\"0.5\"/>\
                   <default class=\"c\"><general ctrlrange=\"-1 1\"/></default></default><worldbody>";
    let text = TWO.replacen("<worldbody>", classes, 1);
    let model = read_mjcf_str(&text, &ReadOptions::default()).unwrap();
    let file = ThetaFile::parse("format = 2\n").unwrap();
    let candidate = file.candidate(&model).unwrap();
    let exported = files_of(&file, &model, &text, false, &candidate, Some(&gains(&model)), STEP).unwrap();
    let robot = content(&exported, "robot.xml");
    assert!(!robot.contains("inheritrange") && !robot.contains("ctrlrange"), "{robot}");
    assert_eq!(robot.matches("gear=\"1\"").count(), 2, "an included file may have such classes too");
    let again = read_mjcf_str(robot, &ReadOptions::default()).unwrap();
    let said: Vec<_> = again.actuators.iter().map(|one| (one.gear, one.forcerange, one.gain)).collect();
    assert_eq!(said, [(1.0, Some([-14.0, 14.0]), 30.0), (1.0, None, 30.0)]);
    // Without gains they are the file's.
    let plain = files_of(&file, &model, &text, false, &candidate, None, STEP).unwrap();
    assert!(content(&plain, "robot.xml").contains(classes));
}

#[test]
fn joints_without_a_motor_get_no_controller_from_gains_of_all_joints() {
    let limp = |exported: &Exported, joint: &str| {
        let isaac = content(exported, "isaac_lab.py");
        assert!(isaac.contains(&format!("joints without a motor: `{joint}`")), "{isaac}");
        assert!(!isaac.contains(&format!("\"{joint}\"")), "{isaac}");
        assert!(!content(exported, "mjlab_robot.py").contains(&format!("\"{joint}\",")));
        let noted = format!("joints without a motor in the robot's file get no controller: `{joint}`");
        assert!(exported.notes.contains(&noted), "{:?}", exported.notes);
    };
    let read = |exported: &Exported| {
        read_mjcf_str(content(exported, "robot.xml"), &ReadOptions::default()).unwrap().actuators.len()
    };
    let exported = export("robot.xml", TWO, "", true).unwrap();
    limp(&exported, "two");
    assert_eq!(read(&exported), 1);
    // A file without any actuator says nothing of motors.
    let bare = format!("{}</mujoco>", &TWO[..TWO.find("<actuator>").unwrap()]);
    let exported = export("robot.xml", &bare, "", true).unwrap();
    assert_eq!(read(&exported), 2);
    assert!(!exported.notes.iter().any(|note| note.contains("without a motor")), "{:?}", exported.notes);
    // In a URDF all have motors but those that follow others.
    let inertial =
        "<inertial><mass value='2'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>";
    let joint = |name: &str, more: &str| {
        format!(
            "<link name=\"link_{name}\">{inertial}</link><joint name=\"{name}\" type=\"revolute\"><parent \
             link=\"base\"/><child link=\"link_{name}\"/><axis xyz=\"0 1 0\"/><limit lower=\"-1\" upper=\"1\" \
             effort=\"5\" velocity=\"5\"/>{more}</joint>"
        )
    };
    let text = format!(
        "<robot name=\"two\"><link name=\"base\">{inertial}</link>{}{}</robot>",
        joint("knuckle", ""),
        joint("tip", "<mimic joint=\"knuckle\"/>")
    );
    let exported = export("robot.urdf", &text, "", true).unwrap();
    limp(&exported, "tip");
    assert!(content(&exported, "mjlab_robot.py").contains("servo((\"knuckle\", ), kp=30.0, kd=1.0"));
}

#[test]
fn names_are_regular_expressions_of_one_joint() {
    for (names, text) in [
        (r#""one", "two""#, TWO.to_owned()),
        (
            r#""left\\.j-1", "r\\(1\\)""#,
            TWO.replace("\"one\"", "\"left.j-1\"").replace("\"two\"", "\"r(1)\""),
        ),
    ] {
        let model = read_mjcf_str(&text, &ReadOptions::default()).unwrap();
        let file = ThetaFile::parse("format = 2\n").unwrap();
        let candidate = file.candidate(&model).unwrap();
        let gains = Gains { kp: vec![30.0; 2], kd: vec![1.0, 2.0] };
        let exported = files_of(&file, &model, &text, false, &candidate, Some(&gains), STEP).unwrap();
        let isaac = content(&exported, "isaac_lab.py");
        assert!(isaac.contains(&format!("joint_names_expr=[{names}]")), "{isaac}");
        let [first, second] = [0, 1].map(|at| names.split(", ").nth(at).unwrap());
        assert!(isaac.contains(&format!("damping={{{first}: 1.0, {second}: 2.0}}")), "{isaac}");
        assert!(isaac.contains(&format!("effort_limit={{{first}: 7.0, ")), "{isaac}");
        assert!(
            content(&exported, "mjlab_robot.py").contains(&format!("servo(({second}, ), kp=30.0, kd=2.0"))
        );
    }
}

#[test]
fn joints_without_a_name_may_stay_as_they_are() {
    let text = TWO.replace("<joint name=\"two\"/>", "<joint/>");
    for gains in [false, true] {
        let theta = parameter("frictionloss", "[\"one\"]", 0.2);
        let exported = export("robot.xml", &text, &theta, gains).unwrap();
        assert!(content(&exported, "robot.xml").contains("<joint/>"));
        let document: serde_json::Value = serde_json::from_str(content(&exported, "theta.json")).unwrap();
        assert_eq!(document["joints"].as_object().unwrap().keys().collect::<Vec<_>>(), ["one"]);
        assert!(!content(&exported, "isaac_lab.py").contains("joint1"));
    }
    for kind in ["frictionloss", "stiction"] {
        let error = export("robot.xml", &text, &parameter(kind, "[\"*\"]", 0.2), false).unwrap_err();
        assert!(error.contains("`joint1`: it has no name there"), "{error}");
    }
    let bare = format!("{}</mujoco>", &text[..text.find("<actuator>").unwrap()]);
    assert!(export("robot.xml", &bare, "", true).unwrap_err().contains("`joint1`"), "its gains change it");
    export("robot.xml", &bare, "", false).unwrap();
}

#[test]
fn a_base_without_mass_is_refused() {
    let error = export("robot.xml", TWO, &parameter("base_mass", "[]", -2.0), false).unwrap_err();
    assert!(error.contains("`p` is -2 kg") && error.contains("more than -2 kg"), "{error}");
    export("robot.xml", TWO, &parameter("base_mass", "[]", -1.5), false).unwrap();
}
