//! A policy that follows a reference motion along the commands: described, looked at, evaluated, collected from, fitted with.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, json, root, run};
use gaitfit_log::{ReadOptions, Trajectory, read_csv, write_csv};
use gaitfit_policy::network::{Activation, Network, Shape};
use gaitfit_policy::{Interface, Policy, Quantity, Reference, Term};
use gaitfit_policy_files::weights;
use std::path::Path;

/// Friction of every joint of the robot that the fit does not know, N·m.
const FRICTION: f64 = 0.4;

/// Ten seconds in which a Go2 bends its knees and sways, at twice the policy's rate; its base faces 40° to the left.
fn motion(interface: &Interface) -> Trajectory {
    let rate = 2.0 / interface.control_dt;
    let time: Vec<f64> = (0..=(10.0 * rate) as usize).map(|k| k as f64 / rate).collect();
    let (mut position, mut velocity) = (Vec::new(), Vec::new());
    for t in &time {
        for (joint, home) in interface.joints.iter().zip(&interface.default_pose) {
            let [far, turns] = match joint {
                name if name.contains("hip") => [0.08, 0.5],
                name if name.contains("thigh") => [0.2, 0.8],
                _ => [-0.4, 0.8],
            };
            let angle = std::f64::consts::TAU * turns;
            position.push(home + far * (angle * t).sin());
            velocity.push(far * angle * (angle * t).cos());
        }
    }
    let (sin, cos) = 20_f64.to_radians().sin_cos();
    let base = gaitfit_log::BaseState {
        quaternion: Some([cos, 0.0, 0.0, sin].repeat(time.len())),
        ..Default::default()
    };
    let log = Trajectory::of_joints(interface.joints.clone(), rate, time, position, velocity);
    Trajectory { base: Some(base), ..log }
}

/// A linear policy that goes where the motion is, and to which every number that it observes matters.
fn policy(folder: &Path) -> Policy {
    let walk = gaitfit_policy_files::read(&root().join("assets/go2-walk.safetensors")).unwrap();
    let walking = walk.interface.clone();
    let motion = motion(&walking);
    write_csv(&folder.join("dance.csv"), &motion).unwrap();
    let terms = [
        Term::new(Quantity::ReferenceJointPosition),
        Term { ahead: 1, ..Term::new(Quantity::ReferenceJointVelocity) },
        Term::new(Quantity::ReferenceOrientation),
        Term::new(Quantity::ReferencePhase),
        Term::new(Quantity::JointPosition),
        Term::new(Quantity::JointVelocity),
    ];
    let interface = Interface {
        reference: Some(Reference::from_log(&motion, &walking.joints, Vec::new()).unwrap()),
        observation: terms.to_vec(),
        critic_observation: Vec::new(),
        gait_frequency: None,
        ..walking
    };
    let joints = interface.joints.len();
    let inputs = interface.observation_width();
    let shape = Shape { inputs, hidden: Vec::new(), outputs: joints, activation: Activation::Elu };
    let mut parameters = vec![0.0; shape.parameters()];
    for joint in 0..joints {
        let (home, scale) = (interface.default_pose[joint] as f32, interface.action_scale[joint] as f32);
        let mut weight = |input: usize, value: f32| parameters[input * joints + joint] = value;
        weight(joint, 1.2 / scale);
        weight(joints + joint, 0.02 / scale);
        // The sine of the heading's difference.
        weight(2 * joints + 2, 0.1);
        weight(2 * joints + 6, 0.05);
        weight(2 * joints + 7 + joint, -0.2 / scale);
        weight(3 * joints + 7 + joint, -0.01 / scale);
        weight(inputs, -1.2 * home / scale);
    }
    let actor = Network::new(shape, &parameters).unwrap();
    let none = gaitfit_policy::Provenance::default();
    Policy {
        interface,
        actor,
        front: None,
        critic: None,
        critic_memory: None,
        normaliser: None,
        critic_normaliser: None,
        provenance: none,
        ..walk
    }
}

#[test]
fn a_policy_with_a_motion_is_evaluated_collected_from_and_fitted_with() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let policy = policy(folder.path());
    std::fs::write(at("policy.safetensors"), weights::write(&policy).unwrap()).unwrap();
    let read = gaitfit_policy_files::read(Path::new(&at("policy.safetensors"))).unwrap();
    assert_eq!((&read.interface, &read.actor), (&policy.interface, &policy.actor));
    // A description takes the motion from a log, whose numbers are in double precision.
    std::fs::write(at("p.toml"), "file = \"policy.safetensors\"\nreference = \"dance.csv\"\n").unwrap();
    let described = gaitfit_policy_files::read(Path::new(&at("p.toml"))).unwrap();
    assert_eq!(described.interface, policy.interface);

    let evaluated = run(&[
        "evaluate",
        &at("p.toml"),
        "--device",
        "cpu",
        "--trajectories",
        "20",
        "--seconds",
        "4",
        "--json",
    ]);
    assert_eq!(evaluated.status.code(), Some(0), "{}", errors(&evaluated));
    let evaluated = json(&evaluated);
    let error = evaluated["motion_error"]["mean"].as_f64().unwrap();
    assert!(error > 0.005 && error < 0.15, "{error}");
    assert_eq!(evaluated["fall_rate"]["mean"], 0.0);
    // This policy lags its motion so far that a robot that rests is not much further off, and that is said.
    let rests = evaluated["motion_error_at_rest"].as_f64().unwrap();
    assert!(rests > error && rests < 2.0 * error, "{error} {rests}");
    let verdict = evaluated["verdict"].as_str().unwrap();
    assert!(verdict.contains("% of the distance of a robot that stays in its first pose"), "{verdict}");
    // A motion is run to its end without further words.
    let whole = run(&[
        "evaluate",
        &at("p.toml"),
        "--trajectories",
        "3",
        "--drift",
        "8",
        "--report",
        &at("page.html"),
    ]);
    let text = String::from_utf8_lossy(&whole.stdout).into_owned();
    assert!(text.contains("3 trajectories of 10 s along a motion of 10 s"), "{text}{}", errors(&whole));
    assert!(errors(&whole).contains("--drift has no effect"), "{}", errors(&whole));
    let page = std::fs::read_to_string(at("page.html")).unwrap();
    assert!(page.contains("distance from the motion"), "no distance on the page");

    let theta = format!(
        "format = 2\nrobot = \"go2\"\ncost_name = \"truth\"\ncost = 0.0\n[[parameter]]\nname = \"frictionloss\"\n\
         kind = \"frictionloss\"\njoints = {:?}\nvalue = {FRICTION}\nunit = \"N·m\"\n",
        policy.interface.joints
    );
    std::fs::write(at("truth.toml"), theta).unwrap();
    let collect = ["collect", &at("p.toml"), "--theta", &at("truth.toml"), "--out", &at("logs")];
    let more =
        ["--trajectories", "4", "--seconds", "5", "--log-shift", "0.3", "1.5", "--seed", "3", "--json"];
    let collected = run(&[&collect[..], &more].concat());
    assert_eq!(collected.status.code(), Some(0), "{}", errors(&collected));
    let file = json(&collected)["files"][0].as_str().unwrap().to_owned();
    let log = read_csv(Path::new(&file), &ReadOptions::default()).unwrap();
    let motion = log.motion.as_ref().unwrap();
    assert!(motion[0] >= 0.3 - 1e-9 && (motion[2] - motion[0] - 0.02).abs() < 1e-9, "{:?}", &motion[..4]);

    let config = |logs: &str| {
        format!(
            "name = \"dance\"\nbase = \"free\"\npolicy = \"{}\"\nlogs = [\"{logs}\"]\ncosts = [\"wass\"]\nruns = \"{}\"\n\
             [[parameter]]\nkind = \"frictionloss\"\nper = \"all\"\n[optimizer]\ngenerations = 30\npopulation = 12\nseeds = 1\n\
             replicates = 0\n[simulation]\npreset = \"fast\"\n",
            at("p.toml"),
            folder.path().display()
        )
    };
    std::fs::write(at("fit.toml"), config(&at("logs"))).unwrap();
    let fit = |more: &[&str]| {
        run(&[&["adapt", at("fit.toml").as_str(), "--json", "--device", "cpu"], more].concat())
    };
    let output = fit(&[]);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{}", errors(&output));
    let report = json(&output);
    let value = report["parameters"][0]["value"].as_f64().unwrap();
    assert!((value - FRICTION).abs() < 0.1 * FRICTION, "{value}");
    // Its actions are the policy's at every sample: place in the motion, heading and encoders are as they were.
    let warnings = report["warnings"].to_string();
    assert!(!warnings.contains("do not cover"), "it observes no command: {warnings}");
    assert!(!warnings.contains("action") && !warnings.contains("motion_time"), "{warnings}");

    // Without the columns a log must begin with the motion; this one does not, and its actions show it.
    let log = Trajectory { motion: None, ..log };
    std::fs::create_dir(at("bare")).unwrap();
    write_csv(&folder.path().join("bare/log.csv"), &log).unwrap();
    let bare = at("bare/log.csv");
    for (log, agrees) in [(file.as_str(), true), (bare.as_str(), false)] {
        let output = run(&["inspect", log, "--policy", &at("p.toml"), "--robot", "assets/go2.xml"]);
        let shown = format!("{}{}", String::from_utf8_lossy(&output.stdout), errors(&output));
        assert_eq!(!shown.contains("actions do not follow from"), agrees, "{shown}");
        assert_eq!(!shown.contains("taken to begin with the motion"), agrees, "{shown}");
    }

    // One that does begin with the motion is right without them.
    let out = at("begins");
    let begins = [&collect[..5], &[&out[..], "--trajectories", "3", "--seconds", "4", "--json"]].concat();
    let begun = run(&begins);
    assert_eq!(begun.status.code(), Some(0), "{}", errors(&begun));
    let files = json(&begun)["files"].clone();
    let read = |number: usize| {
        read_csv(Path::new(files[number].as_str().unwrap()), &ReadOptions::default()).unwrap()
    };
    // No command distinguishes the logs, so their starts do.
    assert!(read(0).position != read(1).position && read(1).position != read(2).position);
    assert!(read(0).command.unwrap().iter().all(|part| *part == 0.0));
    let log = Trajectory { motion: None, ..read(0) };
    write_csv(&folder.path().join("bare/begins.csv"), &log).unwrap();
    let output =
        run(&["inspect", &at("bare/begins.csv"), "--policy", &at("p.toml"), "--robot", "assets/go2.xml"]);
    let shown = format!("{}{}", String::from_utf8_lossy(&output.stdout), errors(&output));
    assert_eq!(output.status.code(), Some(0), "{shown}");
    assert!(
        shown.contains("taken to begin with the motion") && shown.contains("next: gaitfit new"),
        "{shown}"
    );

    for (args, word) in [
        (
            vec!["run", &at("p.toml"), "--robot", "simulated", "--random", "2", "--yes", "--out", &at("ran")],
            "follows a motion, which gaitfit does not run on a robot yet",
        ),
        (
            vec![
                "collect",
                &at("p.toml"),
                "--robot",
                "simulated",
                "--seconds",
                "2",
                "--yes",
                "--out",
                &at("ran"),
            ],
            "follows a motion, which gaitfit does not run on a robot yet",
        ),
        (
            vec!["excite", &at("fit.toml"), "--policy", &at("p.toml"), "--out", &at("commands.csv")],
            "the policy observes no command",
        ),
        (
            vec!["finetune", &at("p.toml"), "--name", "f", "--device", "cpu"],
            "a reference motion that it follows",
        ),
        (vec!["export", &at("p.toml"), "--cpp", &at("cpp")], "the policy follows a reference motion"),
    ] {
        let output = run(&args);
        assert!(!output.status.success() && errors(&output).contains(word), "{}", errors(&output));
    }
    std::fs::write(at("q.toml"), "file = \"policy.safetensors\"\nreference = \"missing.csv\"\n").unwrap();
    let output = run(&["export", &at("q.toml")]);
    assert!(errors(&output).contains("missing.csv"), "{}", errors(&output));
}
