//! Robots of the link and topics of `gaitfit record`: what is refused before anything is opened.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, program};

const WALK: &str = "assets/go2-walk.safetensors";

#[test]
fn a_robots_file_and_a_built_in_robot_are_taken_and_wrong_ones_refused() {
    let folder = tempfile::tempdir().unwrap();
    let script = folder.path().join("commands.csv").display().to_string();
    std::fs::write(&script, "t,vx,vy,wz\n0,0.5,0,0\n1,0,0,0\n").unwrap();
    let out = folder.path().join("out").display().to_string();
    let go2 = include_str!("../../gaitfit-robot/robots/go2.toml");
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    let softer = file("softer.toml", &go2.replace("kp = 100,", "kp = 10,").replace("kp = 50,", "kp = 10,"));
    let double = file("double.toml", &go2.replace("\"FL_hip\"", "\"FR_hip\""));
    for (robot, words) in [
        (softer.as_str(), "the guard lets 0 to 10 through"),
        (double.as_str(), "each joint once"),
        ("missing.toml", "missing.toml"),
        ("unitree-g1", "`go2`, and this is a Unitree G1"),
        ("unitree-b2", "this is a Unitree B2"),
        ("unitree-go3", "unitree-go2w"),
    ] {
        let base = ["run", WALK, "--commands", &script, "--out", &out, "--domain", "1", "--yes"];
        let output = program().args(base).args(["--robot", robot, "--interface", "lo"]).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{robot}: {}", errors(&output));
        assert!(errors(&output).contains(words), "{robot}: {}", errors(&output));
    }
}

#[test]
fn topics_that_cannot_be_recorded_are_refused_before_anything_is_opened() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (folder.path().join("topics.toml"), folder.path().join("log.csv"));
    for (text, words) in [
        ("robot = \"mine\"", "[topics]"),
        ("[topics]\n\"/imu\" = \"Imu\"", "package/msg/Name"),
        ("[topics]\n\"/scan\" = \"sensor_msgs/msg/LaserScan\"", "known are sensor_msgs/msg/JointState"),
        ("[topics]\n\"/a b\" = \"sensor_msgs/msg/Imu\"", "no name of a topic"),
        ("[topic]\n", "line 1"),
    ] {
        std::fs::write(&path, text).unwrap();
        let words_of =
            ["record", &path.display().to_string(), "--interface", "lo", "--out"].map(str::to_owned);
        let output = program().args(words_of).arg(&out).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{text}: {}", errors(&output));
        assert!(
            errors(&output).contains(words) && errors(&output).contains("topics.toml"),
            "{}",
            errors(&output)
        );
    }
    std::fs::write(&path, "[topics]\n\"/imu\" = \"sensor_msgs/msg/Imu\"").unwrap();
    let output =
        program().arg("record").arg(&path).args(["--interface", "no-such-0", "--out"]).arg(&out).output();
    let output = output.unwrap();
    assert_eq!(output.status.code(), Some(if cfg!(feature = "dds") { 2 } else { 4 }), "{}", errors(&output));
    assert!(errors(&output).contains("no-such-0") && !out.exists(), "{}", errors(&output));
    assert!(!out.with_extension("mcap").exists());
}
