//! Floors that files leave to a scene, what is said of a robot that was read, and lists that a person can read.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_model::{Model, ModelError, ReadOptions, Root, read_mjcf_str};

const HOPPER: &str = r#"<mujoco><default><geom friction="0.7 0.01 0.001" condim="4"/></default><worldbody>{world}
  <body name="base" pos="0 0 1"><freejoint/><geom name="trunk" size="0.1" contype="0" conaffinity="0"/>
    <body name="leg"><joint name="knee" axis="0 1 0"/><geom name="foot" size="0.05" pos="0 0 -0.4"{foot}/></body></body>
  </worldbody><actuator><motor name="m" joint="knee"{motor}/></actuator>{end}</mujoco>"#;

fn hopper(slots: &[(&str, &str)]) -> String {
    ["world", "foot", "motor", "end"].iter().fold(HOPPER.to_string(), |text, mark| {
        let put = slots.iter().find(|(slot, _)| slot == mark).map_or("", |(_, put)| put);
        text.replace(&format!("{{{mark}}}"), put)
    })
}

fn with_floor(text: &str) -> Result<Model, ModelError> {
    read_mjcf_str(text, &ReadOptions { add_floor: true, ..Default::default() })
}

#[test]
fn a_floating_robot_without_a_floor_gets_one_and_it_is_said() {
    let model = with_floor(&hopper(&[])).unwrap();
    assert_eq!((model.planes.len(), model.pairs.len()), (1, 1));
    assert_eq!((model.planes[0].name.as_str(), model.planes[0].pos), ("floor", [0.0; 3]));
    // The floor is of the file's default class, as in a scene that includes it.
    let same = hopper(&[("world", r#"<geom name="floor" type="plane" size="0 0 1"/>"#)]);
    let scene = with_floor(&same).unwrap();
    assert_eq!((&model.pairs, &model.planes), (&scene.pairs, &scene.planes));
    assert_eq!((model.pairs[0].condim, model.pairs[0].friction[0]), (4, 0.7));
    assert_eq!((model.changed.len(), scene.changed.len()), (1, 0));
    assert!(
        model.changed[0].what.contains("floor") && model.changed[0].how.contains("friction 0.7 0.01 0.001")
    );
    // MuJoCo adds none, nor does a robot that hangs need one.
    assert!(read_mjcf_str(&hopper(&[]), &ReadOptions::default()).unwrap().planes.is_empty());
    let clamped = ReadOptions { add_floor: true, root: Some(Root::Fixed), ..Default::default() };
    assert!(read_mjcf_str(&hopper(&[]), &clamped).unwrap().planes.is_empty());
    let arm = hopper(&[]).replace("<freejoint/>", "");
    assert!(with_floor(&arm).unwrap().planes.is_empty());
    let freed = ReadOptions { add_floor: true, root: Some(Root::Floating), ..Default::default() };
    assert_eq!(read_mjcf_str(&arm, &freed).unwrap().planes.len(), 1);
}

#[test]
fn a_floating_robot_in_the_air_touches_nothing_of_the_world_and_an_arm_keeps_its_table() {
    let world =
        r#"<geom name="floor" type="plane" size="0 0 1"/><geom name="step" type="box" size="1 1 0.1"/>"#;
    let text = hopper(&[("world", world)]);
    let hanging = ReadOptions { root: Some(Root::Fixed), in_the_air: true, ..Default::default() };
    let model = read_mjcf_str(&text, &hanging).unwrap();
    assert_eq!((model.planes.len(), model.obstacles.len(), model.pairs.len()), (0, 0, 0));
    assert_eq!(model.geoms.len(), 1, "only the world is gone");
    let clamped = ReadOptions { in_the_air: false, ..hanging.clone() };
    assert_eq!(read_mjcf_str(&text, &clamped).unwrap().pairs.len(), 2);
    assert_eq!(read_mjcf_str(&text, &ReadOptions { root: None, ..hanging.clone() }).unwrap().pairs.len(), 2);
    let arm = read_mjcf_str(&text.replace("<freejoint/>", ""), &hanging).unwrap();
    assert_eq!((arm.planes.len(), arm.obstacles.len(), arm.pairs.len()), (1, 1, 2));
}

#[test]
fn pairs_that_name_the_floor_of_a_scene_find_it() {
    let pair = |floor: &str| {
        format!(r#"<contact><pair geom1="foot" geom2="{floor}" condim="3" friction="0.6 0.6"/></contact>"#)
    };
    let unseen = ("foot", r#" contype="0" conaffinity="0""#);
    let text = hopper(&[("end", &pair("ground")), unseen]);
    let model = with_floor(&text).unwrap();
    assert_eq!((model.planes[0].name.as_str(), model.pairs.len()), ("ground", 1));
    assert_eq!((model.pairs[0].condim, model.pairs[0].friction[0]), (3, 0.6));
    assert!(model.changed[0].how.contains("pairs call it"), "{}", model.changed[0].how);
    // As MuJoCo does without it.
    let error = read_mjcf_str(&text, &ReadOptions::default()).unwrap_err();
    assert!(error.to_string().contains("\"ground\", which does not exist"), "{error}");
    // Two names are no floor.
    let two = hopper(&[("end", &(pair("ground") + &pair("sky")))]);
    assert!(with_floor(&two).unwrap_err().to_string().contains("\"ground\", which does not exist"));
    // A name that a geom of the robot has stays the robot's.
    let taken = with_floor(&hopper(&[]).replace("trunk", "floor")).unwrap();
    assert_eq!(taken.planes[0].name, "floor_");
}

#[test]
fn a_default_class_that_only_draws_makes_a_floor_that_is_touched() {
    let text = hopper(&[("foot", " contype=\"1\"")])
        .replace("condim=\"4\"/>", "condim=\"4\" contype=\"0\" conaffinity=\"0\"/>");
    assert_eq!(with_floor(&text).unwrap().pairs.len(), 1);
}

#[test]
fn unbounded_torques_and_missing_ground_are_warned_of() {
    let said = |text: &str| with_floor(text).unwrap().warnings();
    assert!(said(&hopper(&[("motor", " ctrlrange=\"-5 5\"")])).is_empty());
    assert!(said(&hopper(&[("motor", " forcerange=\"-5 5\"")])).is_empty());
    let warnings = said(&hopper(&[]));
    assert_eq!(warnings.len(), 1);
    assert!(warnings[0].contains("no actuator") && warnings[0].contains("`forcerange`"), "{}", warnings[0]);
    let second = r#"<body name="arm"><joint name="elbow"/><geom size="0.1" contype="0" conaffinity="0"/></body></body>
        </worldbody><actuator><motor name="e" joint="elbow" ctrlrange="-1 1"/></actuator>"#;
    let warnings = said(&hopper(&[]).replacen("</body>\n  </worldbody>", second, 1));
    assert!(warnings[0].starts_with("1 of 2 driven joints have no effort limit (knee)"), "{}", warnings[0]);
    let seen = ("foot", " contype=\"0\" conaffinity=\"0\"");
    let warnings = said(&hopper(&[seen, ("motor", " ctrlrange=\"-5 5\"")]));
    assert!(warnings.len() == 1 && warnings[0].contains("no geom of it collides"), "{warnings:?}");
    for (range, bound) in [("-10 30", 10.0), ("0 5", 5.0), ("-30 0", 30.0)] {
        let text = hopper(&[("motor", &format!(" ctrlrange=\"{range}\""))]);
        let warnings = said(&text);
        let words = ["joint knee", "to both sides alike"];
        assert!(warnings.len() == 1 && words.iter().all(|word| warnings[0].contains(word)), "{warnings:?}");
        assert_eq!(
            with_floor(&text).unwrap().effort(0),
            Some(bound),
            "{range}: what is shown is what is simulated"
        );
    }
    let plain = hopper(&[]);
    let driven = plain.find("<actuator>").unwrap()..plain.find("</actuator>").unwrap() + "</actuator>".len();
    let warnings = said(&plain.replace(&plain[driven], ""));
    assert!(warnings[0].starts_with("no joint of the robot has an effort limit"), "{warnings:?}");
    let written = read_mjcf_str(&hopper(&[]), &ReadOptions::default()).unwrap();
    assert!(written.warnings()[1].contains("the file has no floor"), "{:?}", written.warnings());
}

#[test]
fn what_is_left_out_is_counted_by_kind() {
    let shells: String = (0..36)
        .map(|i| {
            format!(
                "\n<geom name=\"s{i}\" type=\"mesh\" mesh=\"m\" mass=\"0\" contype=\"0\" conaffinity=\"0\"/>"
            )
        })
        .collect();
    let solid = r#"<geom name="solid" type="mesh" mesh="m" mass="0"/><geom name="more" type="mesh" mesh="m" mass="0"/>"#;
    let text = hopper(&[]).replace("<freejoint/>", &format!("<freejoint/>{shells}{solid}"));
    let error = with_floor(&text).unwrap_err().to_string();
    assert!(error.contains("2 geoms of the robot are such, 1 others touch the ground"), "{error}");
    let lenient = ReadOptions { lenient: true, add_floor: true, ..Default::default() };
    let model = read_mjcf_str(&text, &lenient).unwrap();
    let groups = model.left_out();
    let meshes = groups.iter().find(|group| group.what == "36 visual meshes").unwrap();
    assert_eq!((meshes.count, meshes.line, meshes.last_line, meshes.harmless), (36, 3, 38, true));
    let solids = groups.iter().find(|group| group.what == "2 colliding meshes, such as \"solid\"").unwrap();
    assert!(!solids.harmless);
    assert!(groups.iter().any(|group| group.what == "geom \"trunk\" (sphere, visual)"), "{groups:?}");
    assert!(model.warnings()[0].contains("read without 2 colliding meshes"), "{:?}", model.warnings());
}
