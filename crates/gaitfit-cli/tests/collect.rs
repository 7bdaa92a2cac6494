//! `gaitfit collect`: its logs are read back as what the policy saw and did.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, json, run};
use gaitfit_log::{ReadOptions, Trajectory, read_csv};
use gaitfit_model::rotation::rotate;
use gaitfit_policy::network::Scratch;
use std::path::Path;

/// Its joints are in another order than the robot's.
const FOREIGN: &str = "crates/gaitfit-policy-files/tests/fixtures/policies/foreign.toml";

/// Logs of three trajectories of 0.4 s.
fn collect(folder: &Path, more: &[&str]) -> Vec<Trajectory> {
    let out = folder.join("logs/of a policy").display().to_string();
    let mut args =
        vec!["collect", FOREIGN, "--out", &out, "--trajectories", "3", "--seconds", "0.4", "--json"];
    args.extend(more);
    let output = run(&args);
    assert!(output.status.success(), "{}", errors(&output));
    let document = json(&output);
    assert_eq!((&document["trajectories"], &document["falls"]), (&3.into(), &0.into()));
    let files = document["files"].as_array().unwrap();
    assert!(files[2].as_str().unwrap().ends_with("trajectory_02.csv"), "{files:?}");
    let read = |file: &serde_json::Value| {
        read_csv(Path::new(file.as_str().unwrap()), &ReadOptions::default()).unwrap()
    };
    files.iter().map(read).collect()
}

#[test]
fn logs_read_back_are_what_the_policy_saw_and_did() {
    let folder = tempfile::tempdir().unwrap();
    let policy = gaitfit_policy_files::read(&common::root().join(FOREIGN)).unwrap();
    let interface = &policy.interface;
    let scales = interface.scales(&interface.observation);
    let logs = collect(folder.path(), &["--privileged", "--torque-noise", "1"]);
    assert!(logs[0].position != logs[1].position);
    for log in &logs {
        assert_eq!((&log.joints, log.robot.as_deref()), (&interface.joints, Some("go2")));
        assert_eq!((log.rate_hz, log.time.len()), (50.0, 20));
        let gains = log.gains.as_ref().unwrap();
        assert_eq!((&gains.kp, &gains.kd), (&interface.kp, &interface.kd));
        let (targets, actions) = (log.target.as_ref().unwrap(), log.action.as_ref().unwrap());
        let (commands, base) = (log.command.as_ref().unwrap(), log.base.as_ref().unwrap());
        assert!(commands.iter().any(|&command| command != 0.0));
        let (quaternions, turning) =
            (base.quaternion.as_ref().unwrap(), base.angular_velocity.as_ref().unwrap());
        for row in 0..20 {
            let joints = 12 * row..12 * (row + 1);
            for (k, (target, action)) in
                targets[joints.clone()].iter().zip(&actions[joints.clone()]).enumerate()
            {
                let wanted = interface.default_pose[k] + interface.action_scale[k] * action;
                assert!((target - wanted).abs() < 1e-5, "row {row}, joint {k}: {target}, not {wanted}");
            }
            let [w, x, y, z]: [f64; 4] = quaternions[4 * row..4 * row + 4].try_into().unwrap();
            let mut observation = turning[3 * row..3 * row + 3].to_vec();
            // The conjugate turns gravity from the world into the base.
            observation.extend(rotate([w, -x, -y, -z], [0.0, 0.0, -1.0]));
            observation.extend(&commands[3 * row..3 * row + 3]);
            observation.extend((0..12).map(|k| log.position[12 * row + k] - interface.default_pose[k]));
            observation.extend(&log.velocity[joints.clone()]);
            // Before its first action the policy sees zeros.
            match row {
                0 => observation.extend([0.0; 12]),
                _ => observation.extend(&actions[12 * (row - 1)..12 * row]),
            }
            let observation: Vec<f32> =
                observation.iter().zip(&scales).map(|(&value, scale)| value as f32 * scale).collect();
            let mut again = [f32::NAN; 12];
            policy.act(1, &observation, &mut again, &mut Scratch::default());
            for (again, action) in again.iter().zip(&actions[joints]) {
                assert!((f64::from(*again) - action).abs() < 1e-4, "row {row}: {again}, in the log {action}");
            }
        }
    }
}

#[test]
fn shifts_seeds_and_threads() {
    let folders: Vec<_> = (0..4).map(|_| tempfile::tempdir().unwrap()).collect();
    let plain = collect(folders[0].path(), &["--threads", "1"]);
    let base = plain[0].base.as_ref().unwrap();
    assert!(base.quaternion.is_some() && base.angular_velocity.is_some(), "an inertial unit measures them");
    assert!(base.position.is_none() && base.linear_velocity.is_none(), "a robot does not measure them");
    let signals =
        |logs: &[Trajectory]| -> Vec<Vec<f64>> { logs.iter().map(|log| log.position.clone()).collect() };
    assert!(signals(&plain) == signals(&collect(folders[1].path(), &["--threads", "2"])));
    assert!(signals(&plain) != signals(&collect(folders[2].path(), &["--seed", "1"])));
    let shifted = collect(folders[3].path(), &["--log-shift", "0.1", "0.1"]);
    for (shifted, plain) in shifted.iter().zip(&plain) {
        assert_eq!(shifted.time[0], 0.0);
        // A shift of 0.1 s leaves out five rows at 50 Hz.
        assert_eq!(shifted.position[..12 * 15], plain.position[12 * 5..]);
    }
}

#[test]
fn what_cannot_be_collected_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("logs").display().to_string();
    let cases = [
        (vec!["--log-shift", "0.2", "0.1"], 2, "the shorter first"),
        (vec!["--seconds", "0"], 2, "at least one"),
        (vec!["--trajectories", "0"], 2, "--trajectories"),
        (vec!["--torque-noise", "-1"], 2, "torque-noise"),
        (vec!["--spring", "RR_calf_joint"], 2, "JOINT=STIFFNESS"),
        (vec!["--spring", "tail=75"], 2, "no joint `tail`"),
        (vec!["--task", "none.toml"], 2, "none.toml"),
        (vec!["--theta", "none.toml"], 1, "cannot read none.toml"),
        (vec!["--robot", "none.xml"], 1, "none.xml"),
        (vec!["--out", "README.md"], 2, "README.md: is a file; name the folder that the logs go into"),
    ];
    for (more, code, message) in cases {
        let args = if more[0] == "--out" {
            vec!["collect", FOREIGN]
        } else {
            vec!["collect", FOREIGN, "--out", &out]
        };
        let args: Vec<&str> = args.into_iter().chain(more).collect();
        let output = run(&args);
        let error = errors(&output);
        assert_eq!(output.status.code(), Some(code), "{args:?}: {error}");
        assert!(error.contains(message), "`{message}` is not in `{error}`");
    }
    assert!(!Path::new(&out).exists(), "a refused call leaves a folder");
}

#[test]
fn logs_of_two_runs_are_not_mixed() {
    let folder = tempfile::tempdir().unwrap();
    collect(folder.path(), &[]);
    let out = folder.path().join("logs/of a policy").display().to_string();
    let output = run(&["collect", FOREIGN, "--out", &out, "--trajectories", "1", "--seconds", "0.1"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(errors(&output).contains("another folder"), "{}", errors(&output));
    // A refused call adds no file to a folder that has logs.
    let used = folder.path().join("used");
    std::fs::create_dir(&used).unwrap();
    std::fs::write(used.join("walk.csv"), "time\n").unwrap();
    let output = run(&["collect", FOREIGN, "--out", used.to_str().unwrap(), "--trajectories", "1"]);
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
    assert_eq!(std::fs::read_dir(&used).unwrap().count(), 1);
}

/// Arguments of a short chirp of the Go2 into `out`.
fn chirp<'a>(out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let short = ["--seconds", "3", "--ease", "0.5", "--rate", "100", "--threads", "1"];
    [&["excite", "assets/go2.xml", "--out", out], &short[..], more].concat()
}

#[test]
fn a_chirp_is_written_for_programs_and_fits() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("chirp").display().to_string();
    let output = run(&chirp(&out, &["--joints", "F*", "--turns", "limbs"]));
    assert!(output.status.success(), "{}", errors(&output));
    let text = String::from_utf8(output.stdout).unwrap();
    for words in ["7.0 s for go2", "FR_calf_joint", "armature_calf", "on 32 simulated robots", "play.py"] {
        assert!(text.contains(words), "`{words}` is not in {text}");
    }
    assert!(!text.contains("RR_calf_joint "), "{text}");
    let targets = std::fs::read_to_string(folder.path().join("chirp/chirp.csv")).unwrap();
    assert_eq!(targets.lines().filter(|line| !line.starts_with('#')).count(), 701);
    // What the robot of the file would measure, fitted as its log would be.
    let expected = read_csv(&folder.path().join("chirp/expected.csv"), &ReadOptions::default()).unwrap();
    assert_eq!((expected.len(), expected.gains.as_ref().unwrap().kp[0]), (700, 25.0));
    std::fs::rename(folder.path().join("chirp/expected.csv"), folder.path().join("chirp/log.csv")).unwrap();
    let report = json(&run(&["sensitivity", &format!("{out}/fit.toml"), "--json", "--threads", "1"]));
    assert_eq!(report["parameters"].as_array().unwrap().len(), 10, "{report}");

    // A joint whose name no log can have: before anything is simulated or made.
    let robot = std::fs::read_to_string(common::root().join("assets/go2.xml")).unwrap();
    let odd = folder.path().join("odd.xml").display().to_string();
    std::fs::write(&odd, robot.replace("FL_hip_joint", "FL,hip_joint")).unwrap();
    let none = folder.path().join("none");
    let refused = run(&["excite", &odd, "--out", &none.display().to_string()]);
    assert_eq!(refused.status.code(), Some(1));
    let said = errors(&refused);
    assert!(said.contains("odd.xml: joint `FL,hip_joint`") && said.contains("letters"), "{said}");
    assert!(!none.exists());

    let refused = run(&chirp(&out, &["--pose", "FL_hip"]));
    assert_eq!(refused.status.code(), Some(2));
    assert!(errors(&refused).contains("JOINT=RAD"), "{}", errors(&refused));
    let refused = run(&chirp(&out, &["--kp", "high", "--kd", "1"]));
    assert!(errors(&refused).contains("*_hip"), "{}", errors(&refused));
    let refused = run(&chirp(&out, &["--torque-limit", "0.5"]));
    assert_eq!(refused.status.code(), Some(2));
    assert!(errors(&refused).contains("at rest uses"), "{}", errors(&refused));
}

#[test]
#[ignore = "needs the Python packages of tools/setup_venv.sh"]
fn python_the_script_plays_the_chirp_and_stops_at_limits() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("chirp").display().to_string();
    let written = run(&chirp(&out, &["--amplitude", "0.6", "--frequency", "0.2", "8"]));
    assert!(written.status.success(), "{}", errors(&written));
    let play = |more: &[&str]| {
        std::process::Command::new(common::root().join(".venv/bin/python"))
            .arg(folder.path().join("chirp/play.py"))
            .args(more)
            .current_dir(common::root())
            .output()
            .unwrap()
    };
    let said = |output: &std::process::Output| {
        String::from_utf8_lossy(&[output.stdout.clone(), output.stderr.clone()].concat()).into_owned()
    };
    let dry = play(&["--dry-run"]);
    assert!(dry.status.success() && said(&dry).contains("12 of 12 joints move"), "{}", said(&dry));
    let bare = play(&[]);
    assert!(!bare.status.success() && said(&bare).contains("fill in the class Robot"), "{}", said(&bare));
    // The limits hold in MuJoCo too, on robots at the ends of the bounds.
    for (friction, armature) in [("0", "0.01"), ("0.5", "0.1"), ("0.1", "0.03")] {
        let robot =
            ["--mujoco", "assets/go2.xml", "--frictionloss", friction, "--armature", armature, "--force"];
        let played = play(&robot);
        assert!(played.status.success() && said(&played).contains("of a joint's limit"), "{}", said(&played));
    }
    let again = play(&["--mujoco", "assets/go2.xml"]);
    assert!(!again.status.success() && said(&again).contains("is there already"), "{}", said(&again));
    let log = read_csv(&folder.path().join("chirp/log.csv"), &ReadOptions::default()).unwrap();
    assert_eq!((log.len(), log.joints.len()), (400, 12));
    let fitted = format!("{out}/fit.toml");
    let runs = format!("runs={}", folder.path().display());
    let sets =
        ["--set", &runs, "--set", "optimizer.method=least-squares", "--set", "optimizer.seeds=1", "--json"];
    let report = json(&run(&[&["adapt", &fitted, "--name", "chirp"], &sets[..]].concat()));
    let parameter = |name: &str| {
        let parameters = report["parameters"].as_array().unwrap();
        parameters.iter().find(|one| one["name"] == name).unwrap()["value"].as_f64().unwrap()
    };
    for kind in ["hip", "thigh", "calf"] {
        assert!((parameter(&format!("frictionloss_{kind}")) - 0.1).abs() < 0.02, "{report}");
        assert!((parameter(&format!("armature_{kind}")) - 0.03).abs() < 0.002, "{report}");
    }
    // A robot that does not do as the simulated ones did is stopped.
    let player = std::fs::read_to_string(folder.path().join("chirp/play.py")).unwrap();
    let low = player.replace("\"speed\": [\n    30.1", "\"speed\": [\n    0.1");
    assert!(low != player, "{}", &player[..2000]);
    std::fs::write(folder.path().join("chirp/play.py"), low).unwrap();
    let stopped = play(&["--mujoco", "assets/go2.xml", "--force"]);
    assert_eq!(stopped.status.code(), Some(1));
    assert!(said(&stopped).contains("its limit is 0.1"), "{}", said(&stopped));
}

#[test]
fn commands_are_chosen_and_played() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let policy = "assets/go2-walk.safetensors";
    std::fs::write(
        at("fit.toml"),
        "costs = [\"matchr1\"]\n[simulation]\ntimestep = 0.01\npreset = \"fast\"\n",
    )
    .unwrap();
    let choose = |out: &str, more: &[&str]| {
        let (config, out) = (at("fit.toml"), at(out));
        let words =
            ["excite", &config, "--policy", policy, "--out", &out, "--trajectories", "2", "--pool", "12"];
        run(&[&words[..], &["--seconds", "1.6", "--json"], more].concat())
    };
    let output = choose("commands.csv", &["--threads", "1"]);
    assert!(output.status.success(), "{}", errors(&output));
    let plan = json(&output);
    assert!(plan["ratio"].as_f64().unwrap() < 1.0, "{plan}");
    // Friction and armature of three groups and the delay; two rounds of three variants.
    assert_eq!((plan["parameters"].as_array().unwrap().len(), &plan["pool"]), (7, &18.into()));
    assert!(plan["parameters"][0]["chosen"].as_f64().unwrap() > 0.0);
    assert!(plan["recorded_seconds"].is_null() && plan["parameters"][0]["recorded"].is_null(), "{plan}");
    let text = std::fs::read_to_string(at("commands.csv")).unwrap();
    // The same whatever the threads; others for friction alone and from another seed.
    assert!(choose("again.csv", &["--threads", "2"]).status.success());
    assert_eq!(std::fs::read_to_string(at("again.csv")).unwrap(), text);
    assert!(choose("other.csv", &["--seed", "3", "--parameters", "frictionloss_*"]).status.success());
    assert!(std::fs::read_to_string(at("other.csv")).unwrap() != text);

    let (commands, out) = (at("commands.csv"), at("logs"));
    let play = |out: &str, more: &[&str]| {
        let words = ["collect", policy, "--out", out, "--commands", &commands, "--seconds", "1.2", "--json"];
        run(&[&words[..], &["--log-shift", "0.2", "--privileged"], more].concat())
    };
    let output = play(&out, &[]);
    assert!(output.status.success(), "{}", errors(&output));
    assert_eq!(json(&output)["trajectories"], 2);
    let rows: Vec<Vec<f64>> = text
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|word| word.parse().unwrap()).collect())
        .collect();
    for number in 0..2 {
        let log = folder.path().join(format!("logs/trajectory_{number:02}.csv"));
        let log = read_csv(&log, &ReadOptions::default()).unwrap();
        assert_eq!((log.len(), log.time[0]), (60, 0.0));
        let sent = log.command.as_ref().unwrap();
        for sample in 0..60 {
            let time = 0.2 + 0.02 * sample as f64 + 1e-6;
            let mut mine = rows.iter().filter(|row| row[0] == number as f64 && row[1] <= time);
            assert_eq!(
                sent[3 * sample..3 * sample + 3],
                mine.next_back().unwrap()[2..],
                "{number}, {sample}"
            );
        }
        let base = log.base.as_ref().unwrap();
        assert!(base.position.as_ref().unwrap()[2] > 0.2 && base.quaternion.is_some());
    }

    // Logs that there are count: they tell something alone, and all parameters better with more commands.
    let more = choose("more.csv", &["--set", &format!("logs = [\"{out}\"]")]);
    assert!(more.status.success(), "{}", errors(&more));
    let more = json(&more);
    assert!((more["recorded_seconds"].as_f64().unwrap() - 2.36).abs() < 0.1, "{more}");
    for (alone, both) in
        plan["parameters"].as_array().unwrap().iter().zip(more["parameters"].as_array().unwrap())
    {
        let of = |of: &serde_json::Value, key: &str| of[key].as_f64().unwrap();
        let (recorded, chosen) = (of(both, "recorded"), of(both, "chosen"));
        assert!(chosen < 0.9 * recorded && chosen < of(alone, "chosen"), "{both} {alone}");
        // Only what they leave unidentified counts: half of the bounds of 0.5 is wider than four deviations.
        assert_eq!(
            both["counts"],
            more["notes"].to_string().contains("every parameter") || recorded >= 0.0625
        );
    }
    let wide = json(&choose("wide.csv", &["--reach", "2"]));
    assert!(wide["fell"].as_u64().unwrap() < 12, "{wide}");
    let text = std::fs::read_to_string(at("wide.csv")).unwrap();
    let greatest = |text: &str| {
        let values = text
            .lines()
            .skip(1)
            .flat_map(|line| line.split(',').skip(2).map(|word| word.parse::<f64>().unwrap()));
        values.fold(0.0f64, |most, value| most.max(value.abs()))
    };
    assert!(greatest(&text) > 1.0 && greatest(&text) <= 2.0, "{text}");

    let refused = |output: std::process::Output, code: i32, words: &str| {
        assert_eq!(output.status.code(), Some(code), "{}", errors(&output));
        assert!(errors(&output).contains(words), "`{words}` is not in {}", errors(&output));
    };
    refused(choose("no.csv", &["--set", "logs = [\"nowhere\"]"]), 2, "nowhere");
    refused(choose("no.csv", &["--reach", "0.5"]), 2, "--reach");
    refused(choose("no.csv", &["--parameters", "tail"]), 2, "--parameters");
    refused(choose("no.csv", &["--torque-noise", "NaN"]), 2, "--torque-noise");
    refused(choose("no.csv", &["--amplitude", "0.1"]), 2, "--policy");
    let (config, none) = (at("fit.toml"), at("no.csv"));
    let long = ["--policy", policy, "--pool", "10000", "--seconds", "600"];
    refused(run(&[&["excite", &config, "--out", &none], &long[..]].concat()), 2, "--pool");
    let other =
        "format = 2\n[[parameter]]\nname = \"other\"\nkind = \"damping\"\njoints = [\"*\"]\nvalue = 0.1\n";
    std::fs::write(at("theta.toml"), other).unwrap();
    refused(choose("no.csv", &["--theta", &at("theta.toml")]), 2, "none of the fit's parameters");
    std::fs::write(at("theta.toml"), other.replace("other", "frictionloss_hip").replace("0.1", "77.0"))
        .unwrap();
    refused(choose("no.csv", &["--theta", &at("theta.toml")]), 2, "the search's bounds");
    // Without a no-load speed no torque falls with speed.
    let stall = "{kind = \"stall_torque\", per = \"all\"}";
    refused(choose("no.csv", &["--set", &format!("parameter = [{stall}]")]), 1, "identifies stall_torque");
    let part =
        json(&choose("part.csv", &["--set", &format!("parameter = [{stall}, {{kind = \"armature\"}}]")]));
    assert!(part["ratio"].as_f64().unwrap() < 1.5 && part["parameters"][0]["chosen"].is_null(), "{part}");
    assert!(part["notes"][0].as_str().unwrap().contains("`stall_torque` is not in the mean"), "{part}");
    refused(choose("no.txt", &[]), 2, ".csv");
    // Whole walks are not compared sample by sample, so short predictions stand in for them.
    let whole = json(&choose("whole.csv", &["--set", "costs=[\"wass\"]"]));
    assert!(whole["notes"].to_string().contains("matchr1"), "{whole}");
    refused(play(&at("none"), &["--randomised"]), 2, "--randomised");
    std::fs::write(at("commands.csv"), "trajectory,time\n").unwrap();
    refused(play(&at("none"), &[]), 1, "its header is");
    assert!(!folder.path().join("none").exists() && !folder.path().join("no.csv").exists());
}
