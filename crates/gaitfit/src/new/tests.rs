//! Configurations of the examples' logs, and of logs that lack something.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::{NewSettings, write};
use crate::ErrorKind;
use crate::settings::{AdaptConfig, LoopConfig, load};
use gaitfit_log::PerJoint;
use std::path::{Path, PathBuf};

fn root(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)
}

fn air(folder: &Path) -> NewSettings {
    NewSettings {
        robot: Some(root("assets/go2.xml")),
        logs: vec![root("examples/go2-demo/fit.csv"), root("examples/go2-demo/validate.csv")],
        out: Some(folder.join("new.toml")),
        ..NewSettings::default()
    }
}

/// Some of the example's walks: all of them take a minute in a test.
fn walks() -> Vec<PathBuf> {
    (0..8).map(|number| root(&format!("examples/go2-ground/logs/trajectory_0{number}.csv"))).collect()
}

/// The error of settings that lack something, which is wrong usage.
fn refused(settings: &NewSettings) -> String {
    let error = write(settings).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Settings, "{error}");
    if let Some(out) = &settings.out {
        assert!(!out.exists(), "nothing is written");
    }
    error.to_string()
}

#[test]
fn legs_in_the_air_give_a_fit_with_a_log_kept_out() {
    let folder = tempfile::tempdir().unwrap();
    let settings = air(folder.path());
    let written = write(&settings).unwrap();
    assert_eq!(written.problem, None);
    assert_eq!(written.next, format!("gaitfit fit {}", written.file));
    let config: AdaptConfig = load(settings.out.as_deref(), &[]).unwrap();
    assert_eq!((config.logs.len(), config.validate.len()), (1, 1));
    let kinds: Vec<&str> = config.parameter.iter().map(|rule| rule.kind.name()).collect();
    assert_eq!(kinds, ["frictionloss", "armature", "damping", "delay"]);
    assert_eq!(config.parameter[0].upper, Some(2.0), "5 % of the calves' 45.43 N·m");
    assert_eq!(config.simulation.timestep, crate::air::choices::STEP_S);
    let line = |what: &str| written.assumed.iter().find(|one| one.what == what).unwrap().value.clone();
    assert_eq!(line("gains"), "stated by the logs");
    assert!(line("logs").starts_with("2 logs, 17.0 s in all at 200 Hz"), "{}", line("logs"));
}

#[test]
fn gains_of_the_robot_file_are_numbers_and_a_kd_of_0_is_doubted() {
    let folder = tempfile::tempdir().unwrap();
    let text = std::fs::read_to_string(root("assets/go2.xml")).unwrap();
    let (start, end) = (text.find("<actuator>").unwrap(), text.find("</actuator>").unwrap());
    let model = crate::robot::go2().unwrap();
    let servos: Vec<String> = model
        .joints
        .iter()
        .map(|joint| format!("<position joint=\"{}\" kp=\"20\" forcerange=\"-40 40\"/>", joint.name))
        .collect();
    let robot = folder.path().join("servos.xml");
    std::fs::write(&robot, format!("{}<actuator>{}{}", &text[..start], servos.concat(), &text[end..]))
        .unwrap();
    let log = std::fs::read_to_string(root("examples/go2-demo/fit.csv")).unwrap();
    let bare = folder.path().join("bare.csv");
    let lines: Vec<&str> = log.lines().filter(|line| !line.starts_with('#')).collect();
    std::fs::write(&bare, lines.join("\n")).unwrap();
    let written = write(&NewSettings { robot: Some(robot), logs: vec![bare], ..air(folder.path()) }).unwrap();
    let gains = written.assumed.iter().find(|one| one.what == "gains").unwrap();
    assert!(gains.value.starts_with("kp 20 N·m/rad, kd 0 N·m·s/rad: "), "{}", gains.value);
    assert!(written.warnings.iter().any(|warning| warning.starts_with("kd is 0")), "{:?}", written.warnings);
    assert!(!std::fs::read_to_string(&written.file).unwrap().contains("-0.0"));
}

#[test]
fn the_built_in_robot_has_a_name() {
    let folder = tempfile::tempdir().unwrap();
    let settings = NewSettings { robot: Some("unitree-go2".into()), ..air(folder.path()) };
    let walked = NewSettings { logs: walks()[..1].to_vec(), ..settings.clone() };
    assert!(refused(&walked).contains("the logs have commands"));
    assert!(!folder.path().join("go2.xml").exists());
    let written = write(&settings).unwrap();
    assert_eq!(written.problem, None);
    let config: AdaptConfig = load(settings.out.as_deref(), &[]).unwrap();
    assert!(config.robot.ends_with("go2.xml"), "{}", config.robot);
    // Another robot of that name stays.
    std::fs::write(folder.path().join("go2.xml"), "<mujoco/>").unwrap();
    assert!(write(&settings).unwrap_err().to_string().contains("is not the built-in Go2"));
}

#[test]
fn a_policy_gives_a_loop_and_is_checked_against_the_logs() {
    let folder = tempfile::tempdir().unwrap();
    let settings = NewSettings {
        policy: Some(root("assets/go2-walk.safetensors")),
        logs: walks(),
        out: Some(folder.path().join("new.toml")),
        ..NewSettings::default()
    };
    let written = write(&settings).unwrap();
    assert_eq!(written.problem, None);
    assert!(written.next.starts_with("gaitfit loop "), "{}", written.next);
    let config: LoopConfig = load(settings.out.as_deref(), &[]).unwrap();
    assert_eq!(config.adapt.simulation.robot_timestep, Some(0.001));
    let policy = written.assumed.iter().find(|one| one.what == "policy").unwrap();
    assert!(policy.value.contains("it walked in these logs"), "{}", policy.value);

    // The file is kept for another policy's logs too, with what is wrong.
    let other = NewSettings { policy: Some(root("assets/go2-biped.safetensors")), ..settings };
    let written = write(&other).unwrap();
    assert!(written.problem.is_some(), "{written:?}");
    assert!(other.out.unwrap().exists());
}

#[test]
fn a_policy_that_is_not_trained_here_gives_a_fit() {
    let folder = tempfile::tempdir().unwrap();
    let mut policy = gaitfit_policy_files::read(&root("assets/go2-walk.safetensors")).unwrap();
    let width = policy.actor.shape.hidden[0];
    let (weight, bias) = (vec![1.0; width], vec![0.0; width]);
    let norm = gaitfit_policy::network::LayerNorm { weight, bias, epsilon: 1e-5 };
    policy.actor.norms = vec![Some(norm)];
    let path = folder.path().join("policy.safetensors");
    std::fs::write(&path, gaitfit_policy_files::weights::write(&policy).unwrap()).unwrap();
    let out = Some(folder.path().join("new.toml"));
    let settings = NewSettings { policy: Some(path), logs: walks(), out, ..NewSettings::default() };
    let written = write(&settings).unwrap();
    assert!(written.next.starts_with("gaitfit fit "), "{}", written.next);
    let text = std::fs::read_to_string(settings.out.unwrap()).unwrap();
    assert!(text.contains("under a policy that is not trained here") && !text.contains("finetune"), "{text}");
}

#[test]
fn the_robot_of_the_policys_training_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let mut policy = gaitfit_policy_files::read(&root("assets/go2-walk.safetensors")).unwrap();
    let robot = root("assets/go2.xml").canonicalize().unwrap();
    policy.provenance.robot_file = Some(crate::robot_file::record(&robot, false).unwrap());
    let seed = folder.path().join("walk/seed-1");
    std::fs::create_dir_all(&seed).unwrap();
    std::fs::write(seed.join("policy.safetensors"), gaitfit_policy_files::weights::write(&policy).unwrap())
        .unwrap();
    let settings = NewSettings {
        policy: Some(seed),
        logs: walks(),
        out: Some(folder.path().join("new.toml")),
        ..NewSettings::default()
    };
    let written = write(&settings).unwrap();
    assert_eq!(written.problem, None);
    let config: LoopConfig = load(settings.out.as_deref(), &[]).unwrap();
    assert_eq!(Path::new(&config.robot), robot);
    let delay = written.assumed.iter().find(|one| one.what == "delay").unwrap();
    assert!(delay.value.contains("ms from targets to swinging legs"), "{}", delay.value);
}

#[test]
fn what_is_missing_is_asked_for_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let all = refused(&NewSettings::default());
    for option in ["--robot FILE", "--logs PATH", "--policy POLICY", "--out FILE.toml"] {
        assert!(all.contains(option), "{option}: {all}");
    }
    let walks = NewSettings { logs: vec![root("examples/go2-ground/logs")], ..air(folder.path()) };
    assert!(refused(&walks).contains("also give --policy"));

    // Logs that do not state their gains, and a robot file without position actuators.
    let text = std::fs::read_to_string(root("examples/go2-demo/fit.csv")).unwrap();
    let lines: Vec<&str> = text.lines().filter(|line| !line.starts_with('#')).collect();
    let bare = folder.path().join("bare.csv");
    std::fs::write(&bare, lines.join("\n")).unwrap();
    let settings = NewSettings { logs: vec![bare.clone()], ..air(folder.path()) };
    let asked = refused(&settings);
    assert!(asked.contains("--kp N and --kd N"), "{asked}");
    assert!(
        refused(&NewSettings { kp: Some(PerJoint::All(20.0)), ..settings.clone() }).contains("--kp and --kd")
    );
    let given = NewSettings { kp: Some(PerJoint::All(20.0)), kd: Some(PerJoint::All(1.0)), ..settings };
    assert_eq!(write(&given).unwrap().problem, None);
    std::fs::remove_file(given.out.as_ref().unwrap()).unwrap();

    // The file that describes a log.
    let beside = NewSettings { out: Some(bare.with_extension("toml")), ..given.clone() };
    assert!(refused(&beside).contains("give the configuration another name"));

    // Joints that the robot does not have.
    std::fs::write(&bare, lines.join("\n").replace("FL_hip", "arm")).unwrap();
    let asked = refused(&given);
    assert!(asked.contains("no joints arm") && asked.contains("--mapping"), "{asked}");
}
