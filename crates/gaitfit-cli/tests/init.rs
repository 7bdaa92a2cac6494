//! `gaitfit init`: what it finds of a robot, and that what it writes trains.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, json, program, root, run};
use std::path::{Path, PathBuf};
use toml::Table;

/// Writes a configuration for `robot` into `folder`; it and what was printed.
fn init(robot: &Path, folder: &Path, more: &[&str]) -> (Table, serde_json::Value) {
    let out = folder.join("robot.toml");
    let mut args = vec!["init", robot.to_str().unwrap(), "--json", "--force", "--out", out.to_str().unwrap()];
    args.extend(more);
    let output = run(&args);
    assert!(output.status.success(), "{}: {}", robot.display(), errors(&output));
    (toml::from_str(&std::fs::read_to_string(out).unwrap()).unwrap(), json(&output))
}

fn number(table: &Table, path: &str) -> f64 {
    let value = path.split('.').fold(None, |at: Option<&toml::Value>, key| match at {
        None => table.get(key),
        Some(inner) => inner.get(key),
    });
    value.and_then(toml::Value::as_float).unwrap_or_else(|| panic!("no number {path}: {table}"))
}

fn close(value: f64, wanted: f64, share: f64) {
    assert!((value - wanted).abs() <= share * wanted.abs(), "{value}, not {wanted}");
}

/// Trains a little, and returns the folder of the run.
fn train(configuration: &Path, runs: &Path, more: &[&str]) -> serde_json::Value {
    let runs = format!("runs={}", runs.display());
    let mut args = vec!["train", configuration.to_str().unwrap(), "--json", "--name", "t"];
    args.extend(["--set", &runs]);
    more.iter().for_each(|set| args.extend(["--set", set]));
    let output = run(&args);
    assert!(output.status.success(), "{}: {}", configuration.display(), errors(&output));
    json(&output)
}

const TINY: [&str; 4] =
    ["train.iterations=1", "train.environments=16", "ppo.actor_hidden=[8]", "ppo.critic_hidden=[8]"];

#[test]
fn of_the_go2_it_finds_about_the_built_in_task() {
    let folder = tempfile::tempdir().unwrap();
    let (settings, printed) = init(&root().join("assets/go2.xml"), folder.path(), &[]);
    // Its file lets own parts touch: that is a choice, and off.
    let text = std::fs::read_to_string(folder.path().join("robot.toml")).unwrap();
    assert!(text.contains("\n# self_contact = \"file\""), "{text}");
    let built_in: Table = {
        let output = run(&["config", "train"]);
        toml::from_str(std::str::from_utf8(&output.stdout).unwrap()).unwrap()
    };
    for key in ["feet", "gait"] {
        assert_eq!(settings["task"][key], built_in["task"][key], "{key}");
    }
    for (path, share) in [
        ("task.height", 0.1),
        ("task.swing_height", 0.15),
        ("task.swing_seconds", 0.1),
        ("task.tracking_width", 0.1),
        ("task.fall.height", 0.15),
        ("task.push.velocity", 0.1),
        ("task.rewards.torque", 0.2),
        ("task.rewards.vertical_velocity", 0.1),
        ("task.rewards.action_rate", 0.05),
    ] {
        close(number(&settings, path), number(&built_in, path), share);
    }
    let table = |name: &str| settings["task"]["policy"][name].as_table().unwrap().clone();
    close(number(&table("kp"), "*"), 25.0, 0.1);
    close(number(&table("kd"), "*"), 0.5, 0.1);
    assert_eq!((table("action_scale").len(), number(&table("action_scale"), "*")), (1, 0.25));
    let pose = table("default_pose");
    assert_eq!((pose.len(), number(&pose, "FL_hip_joint"), number(&pose, "RR_calf_joint")), (12, 0.1, -1.5));
    assert_eq!(settings["task"]["fall"]["contacts"].to_string(), r#"["trunk", "head", "chin"]"#);
    assert!(settings["task"]["policy"].get("joints").is_none(), "all joints are the legs'");
    let guesses = printed["guesses"].as_array().unwrap();
    assert!(guesses.iter().any(|guess| guess["found"].as_str().unwrap().contains("trot")), "{printed}");
    train(&folder.path().join("robot.toml"), folder.path(), &TINY);
}

/// Elliptic cones take the solver more steps: trainings leave them, unless they are asked for.
#[test]
fn a_robot_with_elliptic_cones_trains_with_pyramids() {
    let folder = tempfile::tempdir().unwrap();
    let text = std::fs::read_to_string(root().join("assets/go2.xml")).unwrap();
    let file = folder.path().join("elliptic.xml");
    std::fs::write(
        &file,
        text.replace("cone=\"pyramidal\" impratio=\"1\"", "cone=\"elliptic\" impratio=\"100\""),
    )
    .unwrap();
    let (settings, printed) = init(&file, folder.path(), &[]);
    assert_eq!(settings["cone"].as_str(), Some("pyramidal"));
    assert!(printed["guesses"].to_string().contains("pyramidal"), "{printed}");
    let configuration = folder.path().join("robot.toml");
    let reward = |more: &[&str]| {
        let sets: Vec<&str> = TINY.iter().chain(more).copied().collect();
        train(&configuration, folder.path(), &sets)["seeds"][0]["reward"].as_f64().unwrap()
    };
    assert_ne!(reward(&[]), reward(&["cone=elliptic"]), "the setting reaches the physics");
    let (plain, _) = init(&root().join("assets/go2.xml"), folder.path(), &[]);
    assert!(plain.get("cone").is_none());
}

/// Names of joints are keys of the file, whatever is in them.
#[test]
fn names_with_quotes_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let text = std::fs::read_to_string(root().join("assets/go2.xml")).unwrap();
    let file = folder.path().join("quotes.xml");
    std::fs::write(
        &file,
        text.replace("FL_hip_joint", "FL&quot;hip'\\joint").replace("model=\"go2\"", "model=\"q\""),
    )
    .unwrap();
    let (settings, _) = init(&file, folder.path(), &[]);
    let pose = settings["task"]["policy"]["default_pose"].as_table().unwrap();
    assert!(pose.contains_key("FL\"hip'\\joint"), "{pose:?}");
    train(&folder.path().join("robot.toml"), folder.path(), &TINY);
}

/// A robot whose only likeness to the Go2 is its shape: other names, no keyframe, no armature; box feet.
fn stranger(folder: &Path) -> PathBuf {
    let text = std::fs::read_to_string(root().join("assets/go2.xml")).unwrap();
    let keys = text.find("<keyframe>").unwrap()..text.find("</keyframe>").unwrap() + "</keyframe>".len();
    let text = text.replace(&text[keys], "");
    let text = text.replace("model=\"go2\"", "model=\"stranger\"").replace("_hip_joint", "_abductor");
    let text = text.replace("_thigh_joint", "_upper").replace("_calf_joint", "_lower");
    let text = text.replace(
        r#"type="sphere" size="0.022" pos="-0.002 0 -0.213""#,
        r#"type="box" size="0.03 0.02 0.02" pos="-0.002 0 -0.213""#,
    );
    assert!(text.contains("type=\"box\" size=\"0.03") && text.contains("FL_upper"), "{text}");
    let path = folder.join("stranger.xml");
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn a_stranger_without_a_keyframe_gets_a_stance_and_trains() {
    let folder = tempfile::tempdir().unwrap();
    let robot = stranger(folder.path());
    let (settings, _) = init(&robot, folder.path(), &[]);
    let pose = settings["task"]["policy"]["default_pose"].as_table().unwrap();
    for leg in ["FL", "FR", "RL", "RR"] {
        let (upper, lower) = (number(pose, &format!("{leg}_upper")), number(pose, &format!("{leg}_lower")));
        assert!((0.3..1.2).contains(&upper) && (-2.4..-0.8).contains(&lower), "{leg}: {upper}, {lower}");
    }
    close(number(&settings, "task.height"), 0.36, 0.15);
    assert_eq!(settings["task"]["gait"].to_string(), r#"[["FL_foot", "RR_foot"], ["FR_foot", "RL_foot"]]"#);
    let report = train(&folder.path().join("robot.toml"), folder.path(), &TINY);
    assert!(report["seeds"][0]["iterations"] == 1, "{report}");

    // Without a task of its own it is not taken for a Go2.
    let runs = format!("runs={}", folder.path().display());
    let output = run(&["train", "--robot", robot.to_str().unwrap(), "--set", &runs]);
    assert_eq!(output.status.code(), Some(2));
    for words in ["the robot is `stranger`", "task.policy.default_pose", "gaitfit init "] {
        assert!(errors(&output).contains(words), "{}", errors(&output));
    }
    // Its policy is evaluated at its own task, not at the Go2's.
    let policy = folder.path().join("t/seed-1/policy.safetensors");
    let evaluate = |more: &[&str]| {
        let mut args = vec!["evaluate", policy.to_str().unwrap(), "--robot", robot.to_str().unwrap()];
        args.extend(["--trajectories", "2", "--seconds", "0.2", "--drift", "0"]);
        args.extend(more);
        run(&args)
    };
    let output = evaluate(&[]);
    assert!(output.status.success(), "{}", errors(&output));
    let output = evaluate(&["--task", "velocity"]);
    assert!(errors(&output).contains("the built-in tasks are the Go2's"), "{}", errors(&output));
    let output = evaluate(&["--task", folder.path().join("robot.toml").to_str().unwrap()]);
    assert!(output.status.success(), "{}", errors(&output));
}

#[test]
fn what_cannot_walk_is_said_and_nothing_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, body: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, format!("<mujoco model=\"m\"><worldbody>{body}</worldbody></mujoco>")).unwrap();
        path
    };
    // A box on straight legs with a hip and a knee each.
    let legs = |count: usize, foot: &str, mass: f64| {
        let leg = |k: usize| {
            let (x, y) =
                (0.3 - 0.6 * (k / 2) as f64 / count as f64, if k.is_multiple_of(2) { 0.2 } else { -0.2 });
            format!(
                "<body name=\"h{k}\" pos=\"{x} {y} 0\"><joint name=\"h{k}\" axis=\"0 1 0\"/>\
                 <geom type=\"capsule\" fromto=\"0 0 0 0 0 -.3\" size=\".03\" contype=\"0\" conaffinity=\"0\"/>\
                 <body name=\"l{k}\" pos=\"0 0 -.3\"><joint name=\"l{k}\" axis=\"0 1 0\"/>\
                 <geom name=\"f{k}\" type=\"sphere\" pos=\"0 0 -.3\" size=\".03\" {foot}/></body></body>"
            )
        };
        let legs: String = (0..count).map(leg).collect();
        format!(
            "<geom type=\"plane\" size=\"1 1 1\"/><body pos=\"0 0 1\"><freejoint/>\
             <geom type=\"box\" size=\".3 .2 .1\" mass=\"{mass}\"/>{legs}</body>"
        )
    };
    let free = "<body><freejoint/><geom size=\".1\"/></body>";
    for (path, words) in [
        (
            write(
                "clamped.xml",
                "<geom type=\"plane\" size=\"1 1 1\"/><body><joint/><geom size=\".1\"/></body>",
            ),
            "fixed to the world",
        ),
        (
            write("ball.xml", &format!("<geom type=\"plane\" size=\"1 1 1\"/>{free}")),
            "no legs are found in m",
        ),
        (
            write("ghost.xml", &legs(4, "contype=\"0\" conaffinity=\"0\"", 1.0)),
            "its last links (l0, l1, l2, l3) have no geom",
        ),
        (write("spider.xml", &legs(9, "", 1.0)), "m has 9 legs, and a task may have 8 feet"),
        (write("heavy.xml", &legs(4, "", 1e5)), "task.policy.kp is"),
    ] {
        let output = program().arg("init").arg(&path).current_dir(folder.path()).output().unwrap();
        assert_eq!(output.status.code(), Some(1));
        assert!(errors(&output).contains(words), "{}", errors(&output));
    }
    let robot = root().join("assets/go2.xml");
    let init = || program().arg("init").arg(&robot).current_dir(folder.path()).output().unwrap();
    let output = init();
    assert!(output.status.success(), "{}", errors(&output));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("gaitfit train go2.toml") && text.contains("trot"), "{text}");
    assert!(folder.path().join("go2.toml").exists());
    let output = init();
    assert_eq!(output.status.code(), Some(2));
    assert!(errors(&output).contains("go2.toml exists already"), "{}", errors(&output));
}

/// A robot on four legs with an arm whose finger follows another, and a trunk with a mesh that is missing.
fn coupled(folder: &Path) -> PathBuf {
    let leg = |name: &str, x: f64, y: f64| {
        format!(
            "<body name=\"{name}_thigh\" pos=\"{x} {y} 0\"><joint name=\"{name}_hip\" axis=\"0 1 0\" range=\"-100 100\"/><geom type=\"capsule\" \
             fromto=\"0 0 0 0 0 -.2\" size=\".02\"/><body name=\"{name}_shank\" pos=\"0 0 -.2\"><joint name=\"{name}_knee\" axis=\"0 1 0\" \
             range=\"-140 10\"/><geom type=\"capsule\" fromto=\"0 0 0 0 0 -.2\" size=\".02\"/></body></body>"
        )
    };
    let legs: String = [("FL", 0.2, 0.1), ("FR", 0.2, -0.1), ("RL", -0.2, 0.1), ("RR", -0.2, -0.1)]
        .map(|(name, x, y)| leg(name, x, y))
        .concat();
    let finger = |name: &str, y: f64| {
        format!("<body pos=\"0 {y} .1\"><joint name=\"{name}\" range=\"-30 30\"/><geom size=\".02\"/></body>")
    };
    let path = folder.join("robot.xml");
    let text = format!(
        "<mujoco model=\"coupled\"><asset><mesh name=\"shell\" file=\"shell.stl\"/></asset><worldbody><body name=\"trunk\" pos=\"0 0 .4\"><freejoint/>\
         <geom type=\"box\" size=\".2 .1 .05\"/><geom type=\"mesh\" mesh=\"shell\" mass=\"0\"/>{legs}{}{}</body></worldbody><equality><joint \
         joint1=\"right\" joint2=\"left\"/></equality></mujoco>",
        finger("left", 0.05),
        finger("right", -0.05)
    );
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn a_file_that_does_not_read_is_mended_into_a_file_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let robot = coupled(folder.path());
    let before = std::fs::read(&robot).unwrap();
    let (settings, printed) = init(&robot, folder.path(), &[]);
    // Beside the robot's own file, which has the name that it would get.
    let mended = folder.path().join("robot-mended.xml");
    assert_eq!((std::fs::read(&robot).unwrap(), printed["robot_file"].as_str()), (before, mended.to_str()));
    assert!(
        settings["robot"].as_str().unwrap().ends_with("robot-mended.xml")
            && settings.get("lenient").is_none()
    );
    let said = printed["guesses"].to_string();
    for words in ["right follows left: x", "(mesh): this shape does not collide"] {
        assert!(said.contains(words), "{words}: {said}");
    }
    let page = std::fs::read_to_string(printed["page"].as_str().unwrap()).unwrap();
    assert!(page.contains("coupled") && page.contains("<script"), "a page that plays");
    train(&folder.path().join("robot.toml"), folder.path(), &TINY);

    // Nothing is overwritten without a word.
    let out = folder.path().join("robot.toml");
    std::fs::remove_file(&out).unwrap();
    let output = run(&["init", robot.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2));
    assert!(errors(&output).contains("robot-mended.xml exists already"), "{}", errors(&output));
}

#[test]
fn a_guess_that_does_not_walk_is_followed_by_the_next() {
    let folder = tempfile::tempdir().unwrap();
    let robot = coupled(folder.path());
    let (out, runs) = (folder.path().join("walk.toml"), format!("runs={}", folder.path().display()));
    let mut args = vec![
        "init",
        robot.to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
        "--no-picture",
        "--json",
        "--train",
    ];
    args.extend(["--minutes", "0", "--device", "cpu", "--set", &runs]);
    TINY.iter().for_each(|set| args.extend(["--set", set]));
    let output = run(&args);
    // One iteration teaches nobody to walk.
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    let trainings = json(&output)["trainings"].as_array().unwrap().clone();
    let gains: Vec<&str> = trainings.iter().map(|training| training["gains"].as_str().unwrap()).collect();
    assert!(gains.len() == 3 && gains[0] != gains[1] && gains[1] != gains[2], "{gains:?}");
    assert!(errors(&output).contains("no guess learned to walk"), "{}", errors(&output));
    // The configuration is the first guess again.
    let text = std::fs::read_to_string(&out).unwrap();
    assert!(text.contains("kp = 0.56 m g l"), "{text}");
    assert!(!folder.path().join("walk-stance.html").exists());
}

/// Trains a robot that does not learn to walk, for `minutes`: its folder, the output, and the trainings.
fn further(minutes: &str) -> (tempfile::TempDir, std::process::Output, Vec<serde_json::Value>) {
    let folder = tempfile::tempdir().unwrap();
    let robot = coupled(folder.path());
    let (out, runs) = (folder.path().join("walk.toml"), format!("runs={}", folder.path().display()));
    let mut args = vec!["init", robot.to_str().unwrap(), "--out", out.to_str().unwrap(), "--no-picture"];
    args.extend(["--json", "--train", "--minutes", minutes, "--device", "cpu", "--set", &runs]);
    TINY.iter().for_each(|set| args.extend(["--set", set]));
    let output = run(&args);
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    let trainings = json(&output)["trainings"].as_array().unwrap().clone();
    (folder, output, trainings)
}

/// It is trained until the time is over.
#[test]
fn the_best_guess_is_trained_further() {
    // A busy machine may need more time for the first three trainings.
    let (folder, output, trainings) =
        ["0.3", "2", "8"].into_iter().map(further).find(|guess| guess.2.len() > 3).unwrap();
    let out = folder.path().join("walk.toml");
    let guess = |training: &serde_json::Value| training["guess"].as_u64().unwrap();
    let guesses: Vec<u64> = trainings.iter().map(guess).collect();
    assert_eq!(guesses[..3], [1, 2, 3], "{}", errors(&output));
    // One iteration teaches nobody to walk, so no policy is evaluated. The highest reward of a guess's last training decides.
    let reward = |training: &serde_json::Value| training["reward"].as_f64().unwrap();
    let best = |trainings: &[serde_json::Value]| {
        let last = |of: u64| trainings.iter().rev().find(|one| guess(one) == of).unwrap().clone();
        [1, 2, 3].map(last).into_iter().max_by(|a, b| reward(a).total_cmp(&reward(b))).unwrap()
    };
    for number in 3..trainings.len() {
        let (before, further) = (best(&trainings[..number]), &trainings[number]);
        assert_eq!(guess(further), guess(&before), "{guesses:?}");
        assert_eq!(further["iterations"].as_u64(), Some(before["iterations"].as_u64().unwrap() + 1));
    }
    let (best, errors) = (best(&trainings), errors(&output));
    let count = best["iterations"].as_u64().unwrap();
    assert!(errors.contains("the nearest to walking, is trained further, to 2 iterations"), "{errors}");
    // All its trainings are in one run, which the command in the message continues.
    let name = format!("walk-guess-{}", guess(&best));
    assert!(errors.contains(&format!("--name {name} --resume")), "{errors}");
    let of_best = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name());
    let of_best = of_best.filter(|file| file.to_string_lossy().contains(&name)).count();
    assert_eq!(of_best, 1);
    let text: Table = toml::from_str(&std::fs::read_to_string(&out).unwrap()).unwrap();
    assert_eq!(text["train"]["iterations"].as_integer(), i64::try_from(count).ok());
}

/// While commands grow, a training cannot compare its policy with a robot that stands still. So the evaluation decides.
#[test]
fn a_policy_that_stands_still_does_not_walk() {
    let folder = tempfile::tempdir().unwrap();
    let (robot, out) = (root().join("assets/go2.xml"), folder.path().join("stands.toml"));
    let runs = format!("runs={}", folder.path().display());
    let mut args =
        vec!["init", robot.to_str().unwrap(), "--out", out.to_str().unwrap(), "--no-picture", "--json"];
    args.extend(["--train", "--minutes", "0", "--device", "cpu", "--set", &runs]);
    args.extend([
        "--set",
        "task.command.curriculum={x=[-0.1,0.1],y=[-0.1,0.1],yaw=[-0.1,0.1],iterations=10}",
    ]);
    TINY.iter().for_each(|set| args.extend(["--set", set]));
    let output = run(&args);
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    let first = &json(&output)["trainings"][0];
    let said = first["result"].as_str().unwrap();
    assert!(said.contains("policy.safetensors: Its velocity error is"), "{said}");
}

fn shared(name: &str) -> PathBuf {
    root().join("../shared/data/robots").join(name)
}

/// Robots of other projects: feet, legs, whether the policy moves only some joints.
const ROBOTS: [(&str, usize, usize); 9] = [
    ("playground_go1/scene_mjx_feetonly_flat_terrain.xml", 4, 12),
    ("playground_spot/scene_mjx_feetonly_flat_terrain.xml", 4, 12),
    ("menagerie_unitree_a1/scene.xml", 4, 12),
    ("menagerie_anybotics_anymal_c/scene.xml", 4, 12),
    ("urdf/a1.urdf", 4, 12),
    ("urdf/anymal_c.urdf", 4, 12),
    ("playground_h1/scene_mjx_feetonly.xml", 2, 10),
    ("playground_g1/scene_mjx_feetonly_flat_terrain.xml", 2, 12),
    ("playground_t1/scene_mjx_feetonly_flat_terrain.xml", 2, 13),
];

#[test]
#[ignore = "needs ../shared"]
fn shared_robots_of_other_projects_get_a_task_that_trains() {
    for (name, feet, joints) in ROBOTS {
        let folder = tempfile::tempdir().unwrap();
        let (settings, printed) = init(&shared(name), folder.path(), &["--lenient"]);
        let task = &settings["task"];
        assert_eq!(task["feet"].as_array().unwrap().len(), feet, "{name}: {printed}");
        let groups = task["gait"].as_array().unwrap();
        assert!(
            groups.len() == 2 && groups.iter().all(|g| g.as_array().unwrap().len() == feet / 2),
            "{name}"
        );
        let pose = task["policy"]["default_pose"].as_table().unwrap();
        let moved = task["policy"].get("joints").map_or(pose.len(), |list| list.as_array().unwrap().len());
        assert_eq!(moved, joints, "{name}: {printed}");
        let report = train(&folder.path().join("robot.toml"), folder.path(), &TINY);
        // Robots that stand as they start do not fall in the half second of a rollout with small actions.
        assert!(report["seeds"][0]["iterations"] == 1, "{name}: {report}");
    }
}
