//! `gaitfit inspect` on robots and logs.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, json, root, run};

#[test]
fn a_robot_shows_masses_joints_limits_and_contacts() {
    let robot = json(&run(&["inspect", "assets/go2.xml", "--json"]));
    assert!((robot["total_mass"].as_f64().unwrap() - 15.206).abs() < 1e-3);
    let joints = robot["joints"].as_array().unwrap();
    assert_eq!(joints.len(), 12);
    let calf = joints.iter().find(|joint| joint["name"].as_str().unwrap().starts_with("FL_calf")).unwrap();
    assert_eq!((calf["effort"].as_f64(), calf["velocity_limit"].as_f64()), (Some(45.43), Some(15.7)));
    let text = String::from_utf8(run(&["inspect", "assets/go2.xml"]).stdout).unwrap();
    for word in ["15.2064 kg", "FL_calf", "45.43", "[-2.7227, -0.8378]", "condim"] {
        assert!(text.contains(word), "`{word}` is not in:\n{text}");
    }
}

#[test]
fn a_healthy_log_is_summarised_and_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("log.svg");
    let output = run(&[
        "inspect",
        "examples/go2-demo/fit.csv",
        "--robot",
        "assets/go2.xml",
        "--plot",
        picture.to_str().unwrap(),
    ]);
    assert_eq!(output.status.code(), Some(0), "{}", errors(&output));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("12 joints, 1800 samples") && text.contains("nothing suspicious"), "{text}");
    let svg = std::fs::read_to_string(picture).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains("FL_hip") && svg.contains("<path"));
    // A picture never replaces a log.
    let log = folder.path().join("log.csv");
    std::fs::copy(root().join("examples/go2-demo/fit.csv"), &log).unwrap();
    let before = std::fs::read(&log).unwrap();
    let output = run(&["inspect", log.to_str().unwrap(), "--plot", log.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
    assert!(errors(&output).contains("--plot writes a file whose name ends in .svg"), "{}", errors(&output));
    assert!(std::fs::read(&log).unwrap() == before);
    let page = folder.path().join("log.html");
    let output = run(&["inspect", log.to_str().unwrap(), "--plot", page.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(0), "{}", errors(&output));
    let html = std::fs::read_to_string(page).unwrap();
    assert!(html.starts_with("<!DOCTYPE html>") && html.matches("<figure>").count() == 12);
}

#[test]
fn walks_show_joints_and_sensors_without_a_simulation() {
    let folder = tempfile::tempdir().unwrap();
    for file in ["trajectory_00.csv", "trajectory_01.csv", "trajectory_02.csv", "log.toml"] {
        std::fs::copy(root().join("examples/go2-ground/logs").join(file), folder.path().join(file)).unwrap();
    }
    let logs = folder.path().to_str().unwrap();
    let output = run(&["inspect", logs, "--robot", "assets/go2.xml"]);
    let text = String::from_utf8(output.stdout).unwrap();
    for word in ["joint velocities later than positions", "legs in the air", "delay of targets", "[prior]"] {
        assert!(text.contains(word), "`{word}` is not in:\n{text}");
    }
    let report = json(&run(&["inspect", logs, "--robot", "assets/go2.xml", "--json"]));
    let groups = report["without_simulation"]["swings"]["groups"].as_array().unwrap();
    let armature = groups[0]["armature"]["value"].as_f64().unwrap();
    assert!(groups.len() == 3 && (armature - 0.02).abs() < 0.003, "{groups:?}");
    let alone = json(&run(&["inspect", logs, "--json"]));
    assert!(alone.get("without_simulation").is_none(), "a robot is needed for it");

    // The robot of these walks has a spring on one calf (examples/go2-ground/robot.toml); a log that must not be used explains
    // nothing.
    let output = run(&["explain", logs, "--robot", "assets/go2.xml"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("1. RR_calf_joint has a spring of") && !text.contains("\n2. "), "{text}");
    assert!(text.contains("From 3 logs (12 s).") && !text.contains("left out"), "{text}");
    let log = folder.path().join("trajectory_00.csv");
    let degrees = |line: &str| {
        let cell = |(column, cell): (usize, &str)| match cell.parse::<f64>() {
            Ok(angle) if (1..=12).contains(&column) => (100.0 * angle).to_string(),
            _ => cell.to_owned(),
        };
        line.split(',').enumerate().map(cell).collect::<Vec<_>>().join(",") + "\n"
    };
    let changed: String = std::fs::read_to_string(&log).unwrap().lines().map(degrees).collect();
    std::fs::write(&log, changed).unwrap();
    let output = run(&["explain", log.to_str().unwrap(), "--robot", "assets/go2.xml"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(errors(&output).contains("suspect-unit"), "{}", errors(&output));
    // Without an inertial unit it prints what to record.
    let output = run(&["explain", "examples/go2-demo/fit.csv", "--robot", "assets/go2.xml"]);
    assert_eq!(output.status.code(), Some(1));
    for word in ["base_quat_w", "wx, wy, wz", "gaitfit import"] {
        assert!(errors(&output).contains(word), "{}", errors(&output));
    }
}

#[test]
fn effects_are_compared_with_simulated_robots_if_the_policy_is_given() {
    let folder = tempfile::tempdir().unwrap();
    for name in
        ["log.toml", "trajectory_00.csv", "trajectory_01.csv", "trajectory_02.csv", "trajectory_03.csv"]
    {
        std::fs::copy(root().join("examples/go2-ground/logs").join(name), folder.path().join(name)).unwrap();
    }
    let explain = |logs: &str| {
        run(&[
            "explain",
            logs,
            "--robot",
            "assets/go2.xml",
            "--policy",
            "assets/go2-walk.safetensors",
            "--json",
        ])
    };
    let explanation = json(&explain(folder.path().to_str().unwrap()));
    assert_eq!(explanation["causes"][0]["kind"], "odd_spring", "{}", explanation["causes"]);
    let effects = explanation["without_simulation"]["effects"].as_array().unwrap();
    let compared: Vec<&str> = effects
        .iter()
        .filter(|effect| effect["without"]["error"].as_f64().is_some_and(|error| error > 0.0))
        .filter_map(|effect| effect["kind"].as_str())
        .collect();
    assert!(compared.contains(&"load_friction") && compared.contains(&"elasticity"), "{effects:?}");
    // One short walk is no fit's log.
    let log = folder.path().join("trajectory_00.csv");
    let output = explain(log.to_str().unwrap());
    assert_eq!(output.status.code(), Some(1));
    assert!(errors(&output).contains("trajectory_00.csv: the logs hold"), "{}", errors(&output));
}

#[test]
fn the_next_command_has_what_this_one_was_given() {
    let log = "examples/go2-ground/logs/trajectory_00.csv";
    let output =
        run(&["inspect", log, "--robot", "assets/go2.xml", "--policy", "assets/go2-walk.safetensors"]);
    assert_eq!(output.status.code(), Some(0), "{}", errors(&output));
    let said = String::from_utf8(output.stdout.clone()).unwrap() + &errors(&output);
    let next = "gaitfit new --robot assets/go2.xml --policy assets/go2-walk.safetensors --logs ";
    assert!(said.contains(next), "{said}");
}

#[test]
#[ignore = "needs recordings of real robots and reference numbers in ../shared"]
fn shared_a_robot_that_lies_or_is_stuck_is_told_from_one_that_trots() {
    let folder = root().join("../shared/data/go2_ground");
    let inspect = |name: &str| run(&["inspect".as_ref(), folder.join(name).as_os_str(), "--json".as_ref()]);
    let kinds = |output: &std::process::Output| {
        let report = json(output);
        let findings = report["findings"].as_array().unwrap().clone();
        let errors = findings.into_iter().filter(|finding| finding["severity"] == "error");
        errors.map(|finding| finding["kind"].as_str().unwrap().to_owned()).collect::<Vec<_>>()
    };
    let (trot, stuck) = (inspect("trot.csv"), inspect("stuck.csv"));
    assert_eq!(trot.status.code(), Some(0), "{}", errors(&trot));
    assert_eq!(kinds(&trot), Vec::<String>::new());
    assert_eq!(stuck.status.code(), Some(3));
    assert!(kinds(&stuck).iter().any(|kind| kind == "stuck" || kind == "lying"), "{:?}", kinds(&stuck));
}

#[test]
fn a_folder_of_logs_shows_what_they_share() {
    let walks = tempfile::tempdir().unwrap();
    let names: Vec<String> = (0..6).map(|number| format!("trajectory_0{number}.csv")).collect();
    for file in names.iter().map(String::as_str).chain(["log.toml"]) {
        std::fs::copy(root().join("examples/go2-ground/logs").join(file), walks.path().join(file)).unwrap();
    }
    let output = run(&["inspect", walks.path().to_str().unwrap(), "--robot", "assets/go2.xml"]);
    assert_eq!(output.status.code(), Some(0), "{}", errors(&output));
    let text = String::from_utf8(output.stdout).unwrap();
    for part in ["6 logs", "robot: go2", "rate: 50 Hz (6 logs)", "trajectory_05.csv", "nothing suspicious"] {
        assert!(text.contains(part), "`{part}` is not in:\n{text}");
    }
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("cut.csv"), "time,q_a,dq_a\n0,1\n").unwrap();
    let rows: String = (0..50).map(|i| format!("{},0.{i},1\n", i * 5_000_000)).collect();
    let log = folder.path().join("\u{1b}[2Jrun.csv");
    std::fs::write(&log, format!("# robot = \"\\u001B[31mred\"\ntime,q_\u{9b}a,dq_\u{9b}a\n{rows}")).unwrap();
    for path in [folder.path(), &log] {
        let output = run(&["inspect".as_ref(), path.as_os_str()]);
        let text = String::from_utf8(output.stdout.clone()).unwrap() + &errors(&output);
        assert!(!text.chars().any(|c| c.is_control() && c != '\n'), "{text:?}");
        assert!(text.contains("nanoseconds") && text.contains("red"), "{text}");
    }
    let output = run(&["inspect".as_ref(), folder.path().as_os_str(), "--json".as_ref()]);
    assert_eq!(output.status.code(), Some(3));
    let report = json(&output);
    assert!(report["logs"][1]["unreadable"].as_str().unwrap().contains("cut short"), "{report}");
    assert_eq!(report["logs"][0]["log"]["samples"], 50);
}
