//! What is exported is the fitted robot: read back here, and moved by official MuJoCo.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod held;
mod mujoco;
mod networks;
mod robots;

use super::*;
use gaitfit_model::{ReadOptions, Root, read_mjcf_str, read_urdf_str};
use gaitfit_physics::{JointParameter, Preset, Robot};
use std::path::{Path, PathBuf};

const HUMANOID: &str = include_str!("../../gaitfit-model/tests/robots/humanoid.xml");
const ARM: &str = include_str!("../../gaitfit-model/tests/robots/arm.xml");
const GO2_URDF: &str = include_str!("../../../assets/go2.urdf");

/// Kinds that a robot file has no words for.
const BY_CODE: [&str; 7] =
    ["stiction", "stribeck_velocity", "load_friction", "play", "compliance", "no_load_speed", "stall_torque"];

/// Physics step of the simulators that take the files, s.
const STEP: f64 = 0.005;

/// A theta.toml with one of each kind, some on all joints and some on the second alone.
fn theta_of(model: &Model, delay: f64) -> ThetaFile {
    let all: Vec<&str> = model.joints.iter().map(|joint| joint.name.as_str()).collect();
    let second = &all[1..2];
    let mut text = format!("format = 2\nrobot = {:?}\n", model.name);
    for (kind, joints, value) in [
        ("armature", &all[..], 0.035),
        ("damping", &all, 0.4),
        ("frictionloss", &all, 0.25),
        ("stiffness", second, 6.0),
        ("spring_torque", second, 1.5),
        ("encoder_bias", second, 0.03),
        ("torque_scale", second, 0.8),
        ("torque_offset", second, 0.5),
        ("kp_scale", &all, 1.1),
        ("kd_scale", &all, 0.9),
        ("delay", &all, delay),
        ("stiction", &all, 0.3),
        ("stribeck_velocity", second, 0.5),
        ("load_friction", second, 0.05),
        ("play", second, 0.02),
        ("compliance", second, 0.003),
        ("no_load_speed", &all, 4.0),
        ("stall_torque", &all, 6.0),
        ("link_mass", second, 1.3),
        ("link_com_y", &all, 0.01),
        ("link_com_z", second, -0.02),
    ] {
        // What only code says goes with the delay.
        if delay == 0.0 && BY_CODE.contains(&kind) {
            continue;
        }
        // So do links where the file's inertias are from its shapes.
        if delay == 0.0 && model.name != "go2" && kind.starts_with("link_") {
            continue;
        }
        text.push_str(&format!(
            "[[parameter]]\nname = \"{kind}\"\nkind = \"{kind}\"\njoints = {joints:?}\nvalue = {value:?}\n\
             interval = [{:?}, {:?}]\nidentified = true\n",
            value - 0.01,
            value + 0.01
        ));
    }
    for (kind, value) in [
        ("base_mass", 0.7),
        ("base_com_x", 0.02),
        ("payload_mass", 1.5),
        ("payload_z", 0.1),
        ("floor_friction", 0.8),
        ("ground_softness", 0.5),
        ("ground_impedance", 0.4),
        ("imu_roll", 0.02),
        ("imu_pitch", -0.03),
        ("gyro_bias_z", 0.01),
        ("velocity_lag", 0.004),
        ("imu_delay", 0.006),
    ] {
        text.push_str(&format!("[[parameter]]\nname = \"{kind}\"\nkind = \"{kind}\"\nvalue = {value:?}\n"));
    }
    ThetaFile::parse(&text).unwrap()
}

fn gains(model: &Model) -> Gains {
    let joints = model.joints.len();
    Gains { kp: vec![30.0; joints], kd: vec![1.0; joints] }
}

fn content<'a>(exported: &'a Exported, name: &str) -> &'a str {
    exported
        .files
        .iter()
        .find(|(file, _)| file == name)
        .map(|(_, bytes)| std::str::from_utf8(bytes).unwrap())
        .unwrap()
}

#[test]
fn an_exported_mjcf_is_the_fitted_robot() {
    for text in [builtin::GO2, HUMANOID, ARM] {
        let model = read_mjcf_str(text, &ReadOptions::default()).unwrap();
        let file = theta_of(&model, 0.0);
        let candidate = file.candidate(&model).unwrap();
        let gains = gains(&model);
        let exported = files_of(&file, &model, text, false, &candidate, Some(&gains), STEP).unwrap();
        let again = read_mjcf_str(content(&exported, "robot.xml"), &ReadOptions::default()).unwrap();
        let (own, want) = (Robot::nominal(&again), &candidate.robot);
        assert_eq!(own.armature, want.armature, "{}", model.name);
        assert_eq!((&own.damping, &own.frictionloss), (&want.damping, &want.frictionloss));
        let (old, new) = (&model.joints[1], &again.joints[1]);
        assert!((new.stiffness - (old.stiffness + 6.0)).abs() < 1e-12);
        let torque = old.stiffness * old.springref + 1.5;
        assert!((new.stiffness * new.springref - torque).abs() < 1e-12, "{}", model.name);
        assert_eq!(again.joints[2].stiffness, model.joints[2].stiffness);
        assert_eq!(again.actuators.len(), model.joints.len());
        let pd = again.actuators.iter().find(|actuator| actuator.joint == 1).unwrap();
        let kp = 30.0 * 1.1 * 0.8;
        assert!((pd.gain - kp).abs() < 1e-12 && (pd.bias[0] - (0.5 - kp * 0.03)).abs() < 1e-12);
        assert!((pd.bias[1] + kp).abs() < 1e-12 && (pd.bias[2] + 1.0 * 0.9 * 0.8).abs() < 1e-12);

        let said: Vec<&str> =
            exported.rows.iter().filter(|row| row.in_robot_file).map(|row| row.name.as_str()).collect();
        assert!(
            said.contains(&"torque_scale") && !said.contains(&"delay") && !said.contains(&"floor_friction")
        );
        // The humanoid's total mass is set, and the arm's inertias are from its shapes.
        let plain = model.name == "go2";
        assert_eq!(said.contains(&"base_mass"), plain);
        if plain {
            assert!((again.bodies[0].mass - model.bodies[0].mass - 0.7).abs() < 1e-12);
            assert!((again.bodies[0].ipos[0] - model.bodies[0].ipos[0] - 0.02).abs() < 1e-12);
            let load = again.bodies.iter().find(|body| body.name == "gaitfit_payload").unwrap();
            assert_eq!((load.mass, load.pos), (1.5, [0.0, 0.0, 0.1]));
        }
        assert_eq!(said.contains(&"link_mass"), plain);
        if plain {
            let changes = want.body_changes(&model);
            assert!(changes.iter().filter(|change| change.changed()).count() >= 12);
            let own = again.bodies.iter().filter(|body| body.name != "gaitfit_payload");
            for ((before, after), change) in model.bodies.iter().zip(own).zip(changes).skip(1) {
                assert!((after.mass - change.factor * before.mass).abs() < 1e-12, "{}", before.name);
                for k in 0..3 {
                    assert!((after.inertia[k] - change.factor * before.inertia[k]).abs() < 1e-12);
                    assert!((after.ipos[k] - before.ipos[k] - change.shift[k]).abs() < 1e-12);
                }
            }
        }
        // All else of the file is as it was: comments, floors, keyframes.
        assert_eq!((again.geoms.len(), again.planes.len()), (model.geoms.len(), model.planes.len()));
        let document: serde_json::Value = serde_json::from_str(content(&exported, "theta.json")).unwrap();
        assert_eq!(document["parameters"][0]["interval"], serde_json::json!([0.035 - 0.01, 0.035 + 0.01]));
        assert_eq!(document["parameters"][0]["identified"], true);
        assert_eq!(document["joints"][&model.joints[1].name]["torque_offset"], 0.5);
        assert_eq!(document["sensors"]["imu_tilt"], serde_json::json!([0.02, -0.03]));
        assert_eq!(document["sensors"]["gyro_bias"], serde_json::json!([0.0, 0.0, 0.01]));
        assert_eq!(document["sensors"]["velocity_lag"], 0.004);
        assert_eq!(document["numbers"]["imu_delay"], 0.006);
        assert!(content(&exported, "isaac_lab.py").contains("velocity_lag"));
        assert!(content(&exported, "isaac_lab.py").contains("imu_roll") && !said.contains(&"imu_roll"));
    }
}

#[test]
fn friction_at_rest_and_falling_torque_are_said_by_code() {
    let model = read_mjcf_str(builtin::GO2, &ReadOptions::default()).unwrap();
    let file = theta_of(&model, 0.004);
    let candidate = file.candidate(&model).unwrap();
    let exported =
        files_of(&file, &model, builtin::GO2, false, &candidate, Some(&gains(&model)), STEP).unwrap();
    assert!(
        BY_CODE.iter().all(|kind| exported.rows.iter().any(|row| row.name == *kind && !row.in_robot_file))
    );
    let document: serde_json::Value = serde_json::from_str(content(&exported, "theta.json")).unwrap();
    let [first, second] = [0, 1].map(|j: usize| &document["joints"][&model.joints[j].name]);
    assert_eq!((&first["stiction"], &second["stribeck_velocity"]), (&0.3.into(), &0.5.into()));
    assert_eq!(second["load_friction"], 0.05);
    assert_eq!((&second["no_load_speed"], &second["stall_torque"]), (&4.0.into(), &6.0.into()));
    let isaac = content(&exported, "isaac_lab.py");
    assert!(isaac.contains("friction=0.55,") && isaac.contains("dynamic_friction=0.25,"), "{isaac}");
    assert!(isaac.contains("velocity_limit") && isaac.contains("stribeck_velocity"), "{isaac}");
    assert!(isaac.contains("randomize_rigid_body_com"), "{isaac}");
    // A motor's torque falls from some limit.
    let bare = GO2_URDF.replace(" effort=", " was_effort=");
    let model = read_urdf_str(&bare, &ReadOptions { lenient: true, ..ReadOptions::default() }).unwrap();
    let falling =
        "format = 2\n[[parameter]]\nname = \"n\"\nkind = \"no_load_speed\"\njoints = [\"*\"]\nvalue = 20.0\n";
    let motor = |more: &str| {
        let file = ThetaFile::parse(&format!(
            "{falling}{}",
            more.replace("\"n\"", "\"stall\"").replace("no_load_speed", "stall_torque")
        ))
        .unwrap();
        files_of(&file, &model, &bare, true, &file.candidate(&model).unwrap(), None, STEP).map(|_| ())
    };
    let error = motor("").unwrap_err().to_string();
    assert!(error.contains(&model.joints[0].name) && error.contains("stall_torque"), "{error}");
    motor(&falling["format = 2\n".len()..]).unwrap();
    // A file that switches dry friction off has it where there is only stiction.
    let off = builtin::GO2.replacen("<option", "<option><flag frictionloss=\"disable\"/></option><option", 1);
    assert!(off != builtin::GO2);
    let model = read_mjcf_str(&off, &ReadOptions::default()).unwrap();
    let text =
        "format = 2\n[[parameter]]\nname = \"s\"\nkind = \"stiction\"\njoints = [\"*\"]\nvalue = 0.3\n";
    let file = ThetaFile::parse(text).unwrap();
    let candidate = file.candidate(&model).unwrap();
    let sticky = files_of(&file, &model, &off, false, &candidate, None, STEP).unwrap();
    assert!(content(&sticky, "robot.xml").contains("frictionloss=\"enable\""));
    // A robot whose torque does not fall says so by a null.
    let plain = theta_of(&model, 0.0);
    let candidate = plain.candidate(&model).unwrap();
    let exported = files_of(&plain, &model, builtin::GO2, false, &candidate, None, STEP).unwrap();
    let document: serde_json::Value = serde_json::from_str(content(&exported, "theta.json")).unwrap();
    assert!(document["joints"][&model.joints[0].name]["no_load_speed"].is_null());
    assert!(!content(&exported, "isaac_lab.py").contains("velocity_limit"));
}

#[test]
fn an_exported_urdf_has_friction_and_damping() {
    let model = read_urdf_str(GO2_URDF, &ReadOptions::default()).unwrap();
    let file = theta_of(&model, 0.0);
    let candidate = file.candidate(&model).unwrap();
    let exported = files_of(&file, &model, GO2_URDF, true, &candidate, None, STEP).unwrap();
    let again = read_urdf_str(content(&exported, "robot.urdf"), &ReadOptions::default()).unwrap();
    let own = Robot::nominal(&again);
    assert_eq!((&own.damping, &own.frictionloss), (&candidate.robot.damping, &candidate.robot.frictionloss));
    let links = own.params(&again).unwrap().links;
    let mut bare = candidate.robot.clone();
    (bare.payload_mass, bare.armature) = (0.0, own.armature.clone());
    for (link, wanted) in links.iter().zip(bare.params(&model).unwrap().links).skip(1) {
        assert!((link.mass - wanted.mass).abs() < 1e-12);
        assert!(link.com.iter().zip(wanted.com).all(|(a, b)| (a - b).abs() < 1e-12));
        assert!(link.inertia.iter().zip(wanted.inertia).all(|(a, b)| (a - b).abs() < 1e-12));
    }
    let armature = exported.rows.iter().find(|row| row.name == "armature").unwrap();
    assert!(!armature.in_robot_file);
    assert!(exported.notes.iter().any(|note| note.contains("--kp")));
}

/// What tools write that MuJoCo and URDF readers take too: white space in closing tags, elements without content, no origin.
#[test]
fn an_exported_urdf_is_whole_whatever_its_layout() {
    let link = |name: &str, inertial: &str| format!("<link name=\"{name}\">{inertial}</link>");
    let heavy = |more: &str| {
        format!(
            "<inertial><mass value=\"2\"/><inertia ixx=\"0.1\" iyy=\"0.1\" izz=\"0.1\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/>{more}\
             </inertial  >"
        )
    };
    let text = format!(
        "<robot name=\"two\">{}{}{}<joint name=\"swing\" type=\"revolute\"><parent link=\"base\"/><child link=\"arm\"/>\
         <axis xyz=\"0 1 0\"/><limit lower=\"-1\" upper=\"1\" effort=\"5\" velocity=\"5\"/></joint\n><joint name=\"weld\" \
         type=\"fixed\"><parent link=\"base\"/><child link=\"trunk\"/></joint></robot>",
        link("base", ""),
        link("trunk", &heavy("<origin xyz=\"0 0 0.1\"/>")),
        link("arm", &heavy(""))
    );
    let model = read_urdf_str(&text, &ReadOptions::default()).unwrap();
    let mut said = "format = 2\n".to_owned();
    for (kind, joints, value) in [
        ("damping", "[\"swing\"]", 0.3),
        ("link_com_x", "[\"swing\"]", 0.02),
        ("link_mass", "[\"swing\"]", 1.5),
        ("base_mass", "[]", 0.7),
    ] {
        said.push_str(&format!(
            "[[parameter]]\nname = \"{kind}\"\nkind = \"{kind}\"\njoints = {joints}\nvalue = {value:?}\n"
        ));
    }
    let file = ThetaFile::parse(&said).unwrap();
    let candidate = file.candidate(&model).unwrap();
    let exported = files_of(&file, &model, &text, true, &candidate, None, STEP).unwrap();
    let again = read_urdf_str(content(&exported, "robot.urdf"), &ReadOptions::default()).unwrap();
    assert_eq!(again.joints[0].damping, 0.3);
    let arm = again.bodies.iter().find(|body| body.name == "arm").unwrap();
    assert_eq!((arm.mass, arm.ipos), (3.0, [0.02, 0.0, 0.0]));
    // The base link has no mass that the file could change, and the table says so.
    let row = |name: &str| exported.rows.iter().find(|row| row.name == name).unwrap().in_robot_file;
    assert!(row("link_mass") && !row("base_mass"));
    assert!(content(&exported, "theta.json").contains("\"mass\": 0.7"));

    let edited = |text: &str, tag: &str| {
        let document = xml::parse(text).unwrap();
        let node = document.descendants().find(|node| node.has_tag_name(tag)).unwrap();
        let mut edits = xml::Edits::default();
        edits.append(text, node, "<b/>".to_owned());
        edits.apply(text)
    };
    assert_eq!(edited("<r><a/></r>", "a"), "<r><a><b/></a></r>");
    assert_eq!(edited("<r><a x='1' /></r>", "a"), "<r><a x='1' ><b/></a></r>");
    assert_eq!(edited("<r><a>1</a ></r>", "a"), "<r><a>1<b/></a ></r>");
    assert_eq!(edited("<r><a><c/></a></r>", "a"), "<r><a><c/><b/></a></r>");
}

#[test]
fn robots_of_several_files_are_refused_with_a_remedy() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../gaitfit-model/tests/robots/biped.xml");
    let model = robot::as_written(&path, false).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    let candidate = theta_of(&model, 0.0).candidate(&model).unwrap();
    let error = files_of(&theta_of(&model, 0.0), &model, &text, false, &candidate, None, STEP)
        .unwrap_err()
        .to_string();
    assert!(error.contains("included file") && error.contains("to_xml()"), "{error}");
}

/// The files for the Go2, written into a folder.
fn written(file: &ThetaFile) -> (Exported, tempfile::TempDir) {
    let model = read_mjcf_str(builtin::GO2, &ReadOptions::default()).unwrap();
    let candidate = file.candidate(&model).unwrap();
    let exported =
        files_of(file, &model, builtin::GO2, false, &candidate, Some(&gains(&model)), STEP).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in &exported.files {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    (exported, folder)
}

/// The Python of the repository's environment, run on a folder.
fn python(interpreter: PathBuf, script: &str, folder: &Path) -> String {
    let mut command = std::process::Command::new(interpreter);
    let output = match script.ends_with(".py") {
        true => command.arg(script).arg(folder).output().unwrap(),
        false => command.args(["-c", script]).arg(folder).output().unwrap(),
    };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
#[ignore = "needs the Python packages of tools/setup_venv.sh; GAITFIT_MJLAB_PYTHON names an interpreter with mjlab"]
fn python_configurations_are_loaded_where_their_simulators_are() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let interpreter = std::env::var_os("GAITFIT_MJLAB_PYTHON").map(PathBuf::from);
    let interpreter = interpreter.unwrap_or_else(|| root.join(".venv/bin/python"));
    let model = read_mjcf_str(builtin::GO2, &ReadOptions::default()).unwrap();
    let (_, folder) = written(&theta_of(&model, 0.0105));
    let script = root.join("tools/check_configurations.py").display().to_string();
    let said = python(interpreter, &script, folder.path());
    assert!(said.contains("mjlab_robot.py: ") && said.contains("isaac_lab.py: "), "{said}");
    eprintln!("{said}");
}

#[test]
fn a_delay_between_two_steps_is_never_rounded_in_silence() {
    let model = robot::go2().unwrap();
    let notes = |delay: f64, step: f64| {
        let file = theta_of(&model, delay);
        let candidate = file.candidate(&model).unwrap();
        let export =
            files_of(&file, &model, builtin::GO2, false, &candidate, Some(&gains(&model)), step).unwrap();
        let code = ["isaac_lab.py", "mjlab_robot.py"].map(|wanted| {
            let (_, bytes) = export.files.iter().find(|(name, _)| name == wanted).unwrap();
            String::from_utf8(bytes.clone()).unwrap().contains("DELAY ROUNDED")
        });
        (export.notes.into_iter().find(|note| note.contains("DELAY ROUNDED")), code)
    };
    let (note, code) = notes(0.008, 0.005);
    let note = note.unwrap();
    assert!(note.contains("10.00 ms") && note.contains("8.00 ms") && note.contains("--step 0.004"), "{note}");
    assert_eq!(code, [true; 2]);
    for (delay, step) in [(0.008, 0.004), (0.01, 0.005), (0.0, 0.005)] {
        assert_eq!(notes(delay, step), (None, [false; 2]), "{delay} {step}");
    }
}

#[test]
fn gains_are_those_of_the_fit_beside_the_parameters_unless_others_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let theta = folder.path().join("theta.toml");
    let model = robot::go2().unwrap();
    std::fs::write(&theta, theta_of(&model, 0.0).to_toml().unwrap()).unwrap();
    let mut settings = ExportSettings {
        theta: theta.clone(),
        robot: None,
        lenient: false,
        kp: None,
        kd: None,
        policy: None,
        step: None,
    };
    let noted = |settings: &ExportSettings, text: &str| {
        export_theta(settings).unwrap().notes.iter().any(|note| note.contains(text))
    };
    assert!(noted(&settings, "without gains"), "no fit lies beside the parameters");
    let walk = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/go2-walk.safetensors");
    let config = |text: &str| std::fs::write(folder.path().join("config.toml"), text).unwrap();
    let walks =
        format!("base = \"free\"\npolicy = {:?}\nlogs = [\"gone.csv\"]\n", walk.display().to_string());
    config(&walks);
    assert!(noted(&settings, "come from the policy"));
    config("logs = [\"gone.csv\"]\n[gains]\nkp = 30.0\nkd = 0.7\n");
    assert!(noted(&settings, "come from [gains]"));
    let robot = content(&export_theta(&settings).unwrap(), "robot.xml").to_owned();
    assert!(robot.contains("30"), "{robot}");
    let header = "# kp = 22.0\n# kd = 0.6\ntime,q_FL_hip,dq_FL_hip,qdes_FL_hip\n";
    std::fs::write(folder.path().join("gone.csv"), format!("{header}0,0,0,0\n0.02,0.1,0,0\n0.04,0,0,0\n"))
        .unwrap();
    assert!(noted(&settings, "come from the log"), "a log's gains are those that acted");
    config(&walks);
    assert!(noted(&settings, "come from the policy"), "a fit of walks simulates the policy's");
    (settings.kp, settings.kd) = (Some(PerJoint::All(1.0)), Some(PerJoint::All(0.1)));
    assert!(!noted(&settings, "gains come from"));
}

#[test]
fn robots_whose_included_files_decide_their_numbers_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("theta.toml", "format = 2\n");
    write(
        "robot.xml",
        "<mujoco><include file=\"a.xml\"/><worldbody><body><freejoint/><geom size=\".1\"/><body><joint name=\"j\"/>\
         <geom size=\".1\"/></body></body></worldbody></mujoco>",
    );
    write("a.xml", "<mujocoinclude><include file=\"b.xml\"/></mujocoinclude>");
    let settings = |gain: Option<f64>| ExportSettings {
        theta: folder.path().join("theta.toml"),
        robot: Some(folder.path().join("robot.xml")),
        lenient: true,
        kp: gain.map(PerJoint::All),
        kd: gain.map(PerJoint::All),
        policy: None,
        step: None,
    };
    let exported = |text: &str, gain: Option<f64>| {
        write("b.xml", &format!("<mujocoinclude>{text}</mujocoinclude>"));
        export_theta(&settings(gain)).map(|_| ()).map_err(|error| error.to_string())
    };
    let refused = |text: &str, gain: Option<f64>| {
        let error = exported(text, gain).unwrap_err();
        assert!(error.contains("b.xml: it has <") && error.contains("to_xml()"), "{error}");
    };
    let motor = "<actuator><motor name=\"m\" joint=\"j\"/></actuator>";
    exported("<compiler autolimits=\"true\" meshdir=\"meshes\"/>", Some(1.0)).unwrap();
    exported(motor, None).unwrap();
    refused(motor, Some(1.0));
    refused("<compiler angle=\"radian\"/>", None);
    refused("<option><flag damper=\"disable\"/></option>", None);
}
