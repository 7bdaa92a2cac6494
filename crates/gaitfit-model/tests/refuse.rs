//! What is not honoured is refused with its place, or dropped and listed on request.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use std::path::Path;

use gaitfit_model::{
    Model, ModelError, ReadOptions, SelfContact, SelfContactError, Shape, read, read_mjcf_str,
};

/// A leg on a floating base over a floor; `{...}` marks where tests insert.
const LEG: &str = r#"<mujoco model="leg">
  <compiler angle="radian"/>{top}
  <worldbody>{world}
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="base" pos="0 0 1"{body}>
      <freejoint/>{base}
      <geom name="trunk" size="0.1"/>
      <body name="leg">
        <joint name="knee" range="-1 1"{joint}/>
        <geom name="shin" type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3"{geom}/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="m" joint="knee" ctrlrange="-5 5"{motor}/>{actuator}</actuator>{end}
</mujoco>"#;

fn with(slot: &str, text: &str) -> String {
    let marks = ["top", "world", "body", "base", "joint", "geom", "motor", "actuator", "end"];
    assert!(marks.contains(&slot));
    marks.iter().fold(LEG.to_string(), |all, mark| {
        all.replace(&format!("{{{mark}}}"), if *mark == slot { text } else { "" })
    })
}

fn strict(text: &str) -> Result<Model, ModelError> {
    read_mjcf_str(text, &ReadOptions::default())
}

fn lenient(text: &str) -> Result<Model, ModelError> {
    read_mjcf_str(text, &ReadOptions { lenient: true, ..Default::default() })
}

#[test]
fn what_is_not_simulated_is_refused_and_leniently_dropped() {
    for (slot, text, what) in [
        ("top", "<option integrator=\"RK4\"/>", "RK4"),
        ("top", "<option integrator=\"implicit\"/>", "implicit"),
        ("top", "<option density=\"1.2\"/>", "density"),
        ("top", "<option wind=\"1 0 0\"/>", "wind"),
        ("top", "<option noslip_iterations=\"3\"/>", "noslip"),
        ("top", "<option><flag actuation=\"disable\"/></option>", "actuation"),
        ("top", "<option><flag override=\"enable\"/></option>", "override"),
        ("top", "<option colour=\"red\"/>", "colour"),
        ("top", "<default><muscle/></default>", "muscle"),
        ("world", "<geom type=\"cylinder\" size=\"1 1\"/>", "cylinder"),
        ("world", "<geom type=\"mesh\" mesh=\"m\"/>", "mesh"),
        (
            "world",
            "<body><freejoint/><geom size=\"1\" contype=\"0\" conaffinity=\"0\"/></body>",
            "second moving body",
        ),
        ("body", " gravcomp=\"1\"", "gravcomp"),
        ("body", " mocap=\"true\"", "mocap"),
        ("base", "<geom type=\"mesh\" mesh=\"m\" mass=\"0\"/>", "mesh"),
        ("base", "<geom type=\"ellipsoid\" size=\"1 1 1\"/>", "ellipsoid"),
        ("base", "<geom type=\"mesh\" mesh=\"m\" contype=\"0\" conaffinity=\"0\"/>", "mass of"),
        ("world", "<body name=\"free\"><freejoint align=\"true\"/><geom size=\"1\"/></body>", "align"),
        ("base", "<banana/>", "banana"),
        ("base", "<body><joint type=\"ball\"/><geom size=\"1\"/></body>", "ball"),
        ("joint", " stiffness=\"1 2\"", "stiffness"),
        ("joint", " colour=\"red\"", "colour"),
        ("geom", " adhesion=\"2\"", "adhesion"),
        ("geom", " shellinertia=\"true\"", "shellinertia"),
        ("motor", " delay=\"0.1\"", "delay"),
        ("motor", " armature=\"0.1\"", "armature"),
        ("actuator", "<muscle joint=\"knee\"/>", "muscle"),
        ("actuator", "<general joint=\"knee\" dyntype=\"filter\"/>", "dyntype"),
        ("actuator", "<general joint=\"knee\" gaintype=\"affine\"/>", "gaintype"),
        ("actuator", "<position joint=\"knee\" timeconst=\"0.1\"/>", "timeconst"),
        ("actuator", "<motor tendon=\"t\"/>", "tendon"),
        ("end", "<equality><connect body1=\"leg\" anchor=\"0 0 0\"/></equality>", "equality"),
        ("end", "<tendon><fixed name=\"t\"/></tendon>", "tendon"),
        ("end", "<extension><plugin/></extension>", "extension"),
        ("end", "<contact><glue/></contact>", "glue"),
        ("end", "<secret/>", "secret"),
    ] {
        let text = with(slot, text);
        let error = strict(&text).unwrap_err();
        assert!(matches!(error, ModelError::Unsupported { .. }), "{text}: {error}");
        assert!(error.to_string().contains(what), "{what}: {error}");
        let place = error.place().unwrap().clone();
        let model = lenient(&text).unwrap_or_else(|e| panic!("{what}: {e}"));
        assert!(
            model.dropped.iter().any(|d| (d.line, d.column) == (place.line, place.column)
                && format!("{} {}", d.what, d.why).contains(what)),
            "{what} is not listed: {:?}",
            model.dropped
        );
        assert_eq!(model.joints[0].name, "knee", "the rest of the robot is there");
    }
}

#[test]
fn what_makes_no_robot_is_refused_even_leniently() {
    for (slot, text, what) in [
        ("top", "<compiler angle=\"grad\"/>", "grad"),
        ("top", "<compiler coordinate=\"global\"/>", "global"),
        ("top", "<compiler eulerseq=\"xyw\"/>", "eulerseq"),
        ("top", "<option timestep=\"0\"/>", "timestep"),
        ("top", "<option timestep=\"nan\"/>", "nan"),
        ("top", "<option timestep=\"1e999\"/>", "1e999"),
        ("top", "<option gravity=\"0 0\"/>", "exactly 3"),
        ("top", "<default class=\"robot\"/>", "top-level"),
        ("top", "<default><default/></default>", "empty or repeated"),
        ("top", "<include file=\"other.xml\"/>", "include"),
        ("world", "<joint/>", "in the world"),
        ("world", "<geom type=\"plane\" name=\"floor\"/>", "used twice"),
        ("body", " childclass=\"nobody\"", "nobody"),
        ("body", " quat=\"1 0 0 0\" euler=\"0 0 1\"", "twice"),
        ("base", "<freejoint/>", "beside another joint"),
        ("base", "<joint/>", "degrees of freedom"),
        ("base", "<inertial pos=\"0 0 0\"/>", "mass"),
        ("base", "<inertial mass=\"1\"/>", "pos"),
        ("base", "<inertial pos=\"0 0 0\" mass=\"-1\"/>", "mass"),
        ("base", "<inertial pos=\"0 0 0\" mass=\"1\" diaginertia=\"1 1 3\"/>", "A + B >= C"),
        ("base", "<inertial pos=\"0 0 0\" mass=\"1\" diaginertia=\"1 1 -1\"/>", "negative"),
        ("base", "<inertial pos=\"0 0 0\" mass=\"1\" fullinertia=\"1 1 1 2 0 0\"/>", "principal moment"),
        (
            "base",
            "<inertial pos=\"0 0 0\" mass=\"1\" fullinertia=\"1 1 1 0 0 0\" diaginertia=\"1 1 1\"/>",
            "keep one",
        ),
        ("base", "<body><joint/></body>", "no mass"),
        ("base", "<body><freejoint/></body>", "child of the world"),
        ("base", "<geom type=\"plane\"/>", "moving body"),
        ("base", "<geom size=\"0\"/>", "above zero"),
        ("base", "<geom type=\"box\" size=\"1 1\"/>", "above zero"),
        ("base", "<geom size=\"1\" mass=\"-1\"/>", "negative"),
        ("base", "<geom size=\"1e200\"/>", "mass"),
        ("joint", " axis=\"0 0 0\"", "axis"),
        ("joint", " axis=\"0 0 inf\"", "inf"),
        ("joint", " damping=\"-1\"", "damping"),
        ("joint", " limited=\"maybe\"", "maybe"),
        ("joint", " actuatorfrcrange=\"5 1\"", "[5, 1]"),
        ("geom", " condim=\"2\"", "condim"),
        ("geom", " solref=\"-1e300 -1\"", "`solref` of"),
        ("joint", " solreffriction=\"-1 -1e300\"", "-1e300"),
        ("geom", " pos=\"0 0 1\"", "fromto"),
        ("geom", " friction=\"1 1 1 1\"", "1 to 3"),
        ("motor", " ctrllimited=\"perhaps\"", "perhaps"),
        ("actuator", "<motor/>", "drives nothing"),
        ("actuator", "<motor joint=\"knee\" name=\"m\"/>", "used twice"),
        ("actuator", "<position joint=\"knee\" kp=\"-1\"/>", "kp"),
        ("actuator", "<position joint=\"knee\" kv=\"1\" dampratio=\"1\"/>", "dampratio"),
        ("end", "<contact><exclude body1=\"leg\" body2=\"arm\"/></contact>", "arm"),
        ("end", "<contact><pair geom1=\"shin\" geom2=\"sky\"/></contact>", "sky"),
    ] {
        let text = with(slot, text);
        for error in [strict(&text).unwrap_err(), lenient(&text).unwrap_err()] {
            assert!(matches!(error, ModelError::Invalid { .. }), "{text}: {error:?}");
            assert!(error.to_string().contains(what), "{what}: {error}");
        }
    }
    let key = with("end", "<keyframe><key qpos=\"1 2\"/></keyframe>");
    assert!(strict(&key).unwrap_err().to_string().contains("give 8"));
    assert!(lenient(&key).unwrap().keyframes.is_empty());
    let stray = with("actuator", "<motor joint=\"elbow\"/>");
    assert!(strict(&stray).unwrap_err().to_string().contains("elbow"));
    assert_eq!(lenient(&stray).unwrap().actuators.len(), 1);
}

#[test]
fn messages_name_line_column_and_remedy() {
    let error = strict(&with("joint", " colour=\"red\"")).unwrap_err();
    let place = error.place().unwrap();
    assert_eq!((place.file.as_str(), place.line, place.column), ("<text>", 9, 41));
    assert_eq!(
        error.to_string(),
        "<text>:9:41: `colour` of <joint> \"knee\": this attribute is not known here; \
         correct or remove it, or read leniently to drop it"
    );
    let error = strict("<mujoco>\n  <worldbody>\n</mujoco>").unwrap_err();
    assert!(matches!(error, ModelError::Syntax { .. }));
    assert_eq!(error.place().unwrap().line, 3);
    let error = read(Path::new("no/such/robot.xml"), &ReadOptions::default()).unwrap_err();
    assert!(error.to_string().starts_with("no/such/robot.xml: ") && error.place().is_none());
    assert!(strict("<sdf/>").unwrap_err().to_string().contains("<sdf>"));
}

#[test]
fn flags_switch_physics_off() {
    let model = strict(&with(
        "top",
        "<option><flag contact=\"disable\" gravity=\"disable\" limit=\"disable\" clampctrl=\"disable\"/></option>",
    ))
    .unwrap();
    assert!(model.pairs.is_empty());
    assert_eq!(model.options.gravity, [0.0; 3]);
    assert_eq!((model.joints[0].range, model.actuators[0].ctrlrange), (None, None));
    let model = strict(&with(
        "top",
        "<option><flag spring=\"disable\" damper=\"disable\" constraint=\"disable\"/></option>
         <default><joint stiffness=\"3\" damping=\"2\" frictionloss=\"1\"/></default>",
    ))
    .unwrap();
    let knee = &model.joints[0];
    assert_eq!((knee.stiffness, knee.damping, knee.frictionloss, knee.range), (0.0, 0.0, 0.0, None));
    assert!(model.pairs.is_empty());
}

#[test]
fn a_default_class_meant_for_hinges_must_not_reach_the_free_joint() {
    let text = with("top", "<default><joint stiffness=\"1\"/></default>");
    assert!(strict(&text).is_ok(), "<freejoint/> takes no defaults");
    let error = strict(&text.replace("<freejoint/>", "<joint type=\"free\"/>")).unwrap_err();
    assert!(error.to_string().contains("<freejoint/>"), "{error}");
}

#[test]
fn of_two_robots_the_one_with_more_joints_stays() {
    let other = r#"<body name="ball"><freejoint/><geom name="ball" size="0.1"/></body>"#;
    let text = with("world", other).replace("</mujoco>", "<keyframe><key/></keyframe></mujoco>");
    assert!(strict(&text).unwrap_err().to_string().contains("second moving body beside \"base\""));
    let model = lenient(&text).unwrap();
    assert_eq!((model.bodies[0].name.as_str(), model.bodies.len()), ("base", 2));
    assert!(model.geoms.iter().all(|g| g.name != "ball") && model.pairs.len() == 2);
    for what in ["body \"ball\"", "geom \"ball\"", "1 keyframes"] {
        assert!(model.dropped.iter().any(|d| d.what.contains(what)), "{what}");
    }
}

#[test]
fn self_collision_is_counted_once() {
    // trunk and shin are neighbours: MuJoCo does not test them; the second shin meets both its cousins.
    let text = with("base", "<body name=\"b\"><joint/><geom name=\"x\" size=\"0.1\"/></body>");
    let model = strict(&text).unwrap();
    let listed: Vec<&str> = model.dropped.iter().map(|d| d.what.as_str()).collect();
    assert_eq!(listed, ["self-collision (1 geom pairs)"]);
    let excluded =
        text.replace("</mujoco>", "<contact><exclude body1=\"b\" body2=\"leg\"/></contact></mujoco>");
    assert!(strict(&excluded).unwrap().dropped.is_empty());
    let neighbours =
        text.replace("<compiler angle=\"radian\"/>", "<option><flag filterparent=\"disable\"/></option>");
    assert!(strict(&neighbours).unwrap().dropped[0].what.contains("(3 geom pairs)"));
}

/// Two limbs beside the leg: an arm with a ball and a stick, and a tail with a box.
fn limbs() -> Model {
    let arm = r#"<body name="arm"><joint/><geom name="hand" size="0.05" condim="4" friction="2"/>
        <geom name="elbow" size="0.05" contype="0" conaffinity="0"/></body>
      <body name="tail"><joint/><geom name="end" type="box" size="0.1 0.1 0.1"/></body>"#;
    let end = r#"<contact><pair geom1="elbow" geom2="shin" condim="1" margin="0.02"/>
        <exclude body1="tail" body2="arm"/></contact></mujoco>"#;
    strict(&with("base", arm).replace("</mujoco>", end)).unwrap()
}

fn names(model: &Model) -> Vec<[&str; 2]> {
    model.self_pairs.iter().map(|pair| [pair.geoms[0].name.as_str(), pair.geoms[1].name.as_str()]).collect()
}

fn pairs(chosen: &[[&str; 2]]) -> SelfContact {
    SelfContact::Pairs(chosen.iter().map(|pair| pair.map(str::to_owned)).collect())
}

#[test]
fn own_parts_touch_as_the_file_or_a_setting_says() {
    let model = limbs();
    assert!(model.self_pairs.is_empty());
    let (of_file, left_out) = model.touching_itself(&SelfContact::File).unwrap();
    // The trunk carries all limbs; the explicit pair goes past the bits of an elbow that is only seen.
    assert_eq!(names(&of_file), [["hand", "shin"], ["elbow", "shin"]]);
    let [mixed, explicit] = &of_file.self_pairs[..] else { panic!() };
    assert_eq!((mixed.condim, mixed.friction[0], mixed.margin), (4, 2.0, 0.0));
    assert_eq!((explicit.condim, explicit.friction[0], explicit.margin), (1, 1.0, 0.02));
    let [said] = &left_out[..] else { panic!("{left_out:?}") };
    assert!(said.contains("1 pairs are left out (end (box) with shin (capsule))"), "{said}");
    assert!(of_file.warnings().iter().any(|warning| warning.contains("end (box) with shin (capsule)")));
    assert_eq!((model.self_contact_of_file(), model.self_pairs_of_file().len()), ((3, 2), 3));
    // If the pair is named, the ball inside stands for the cube.
    let (boxed, left_out) = model.touching_itself(&pairs(&[["end", "shin"]])).unwrap();
    assert_eq!(boxed.self_pairs[0].geoms[0].shape, Shape::Sphere { radius: 0.1 });
    assert!(left_out[0].contains("of 1 pairs (end (box) with shin (capsule))"), "{left_out:?}");

    let (of_limbs, _) = model.touching_itself(&SelfContact::Limbs).unwrap();
    assert_eq!(names(&of_limbs), [["hand", "shin"]]);
    let (named, left_out) = model.touching_itself(&pairs(&[["arm", "s*"], ["elbow", "leg"]])).unwrap();
    assert_eq!((names(&named), left_out.len()), (vec![["hand", "shin"], ["elbow", "shin"]], 0));
    assert!(of_file.touching_itself(&SelfContact::Off).unwrap().0.self_pairs.is_empty());
}

#[test]
fn own_parts_that_cannot_touch_are_named() {
    let model = limbs();
    let wrong = |chosen: &[[&str; 2]]| model.touching_itself(&pairs(chosen)).unwrap_err();
    let unknown = wrong(&[["hands", "shin"]]).to_string();
    assert!(unknown.contains("`hands`") && unknown.contains("nearest names are hand"), "{unknown}");
    assert!(matches!(wrong(&[["[a", "shin"]]), SelfContactError::Syntax { .. }));
    // One carries the other; excluded; the same part.
    for pair in [["trunk", "shin"], ["hand", "end"], ["hand", "elbow"]] {
        let error = wrong(&[pair]);
        assert!(matches!(&error, SelfContactError::Nothing { .. }), "{error}");
    }
    for (text, meant) in [("\"limbs\"", SelfContact::Limbs), ("[[\"a*\", \"b\"]]", pairs(&[["a*", "b"]]))] {
        let read: SelfContact = serde_json::from_str(text).unwrap();
        assert_eq!(read, meant);
        assert_eq!(serde_json::to_string(&read).unwrap().replace(',', ", "), text);
    }
    for text in ["\"feet\"", "3", "[\"a\", \"b\"]"] {
        let error = serde_json::from_str::<SelfContact>(text).unwrap_err().to_string();
        assert!(error.contains("\"file\", \"limbs\""), "{error}");
    }
}

#[test]
fn joints_are_found_by_the_names_of_logs() {
    let model =
        strict(&with("base", "<body><joint name=\"hip_joint\"/><geom size=\"0.1\"/></body>")).unwrap();
    assert_eq!(model.find_joint("hip"), Some(0));
    assert_eq!(model.find_joint("hip_joint"), Some(0));
    assert_eq!(model.find_joint("knee_joint"), Some(1));
    assert_eq!(model.find_joint("knee"), Some(1));
    assert_eq!(model.find_joint("ankle"), None);
}

#[test]
fn the_summary_adds_up() {
    let model = strict(&with("geom", " mass=\"0.5\" friction=\"0.7\" priority=\"1\"")).unwrap();
    let summary = model.summary();
    let trunk = 1000.0 * 4.0 / 3.0 * std::f64::consts::PI * 0.001;
    assert!((summary.total_mass - trunk - 0.5).abs() < 1e-12);
    assert_eq!((summary.nq, summary.nv, summary.nu, summary.pairs), (8, 7, 1, 2));
    assert_eq!(summary.joints[0].effort, Some(5.0));
    assert_eq!((summary.geoms[1].shape, summary.geoms[1].friction), ("capsule", Some(0.7)));
    assert_eq!(summary.actuators[0].kind, "motor");
    assert_eq!(summary.bodies[1].parent.as_deref(), Some("base"));
    let json = serde_json::to_value(&summary).unwrap();
    assert_eq!(json["root"], "floating");
    assert_eq!(json["joints"][0]["range"], serde_json::json!([-1.0, 1.0]));
}

/// What a lenient reading takes instead is said, not only what it leaves out.
#[test]
fn other_integrators_become_euler_and_it_is_said() {
    for integrator in ["implicit", "RK4"] {
        let text = with(
            "top",
            &format!("<option integrator=\"implicitfast\"/><option integrator=\"{integrator}\"/>"),
        );
        let model = lenient(&text).unwrap();
        assert_eq!(model.options.integrator, gaitfit_model::Integrator::Euler);
        let listed = model.dropped.iter().find(|d| d.what.contains(integrator)).unwrap();
        assert!(listed.why.contains("takes Euler"), "{}", listed.why);
    }
}
