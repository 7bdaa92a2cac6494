//! `gaitfit loop` on robots that are programs: missing, failing, and ended with the loop.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::loops::{SIMULATED, args, begun};
use common::{errors, json, program, run};
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

#[test]
fn a_robot_that_may_be_missing_is_asked_once() {
    let recorded = tempfile::tempdir().unwrap();
    let logs = recorded.path().join("l/round-1/logs");
    let more = ["--set", "references=false"];
    let output = run(&args(recorded.path(), SIMULATED, &more));
    assert!(output.status.success(), "{}", errors(&output));

    let folder = tempfile::tempdir().unwrap();
    let there = folder.path().join("there");
    let target = format!(
        "logs = [{:?}]\n[target]\nkind = \"command\"\n\
         probe = [\"sh\", \"-c\", \"test -e {} || {{ echo no robot here >&2; exit 1; }}\"]\n\
         collect = [\"sh\", \"-c\", \"cp {}/*.csv {{folder}}\"]\nevaluate = [\"cat\", {:?}]\n",
        logs.display().to_string(),
        there.display(),
        logs.display(),
        recorded.path().join("l/evaluations/policy-0-target.json").display().to_string(),
    );
    let loop_of = |more: &[&str]| run(&args(folder.path(), &target, more));

    // Not there: one line says so, whatever there is to measure is measured in the fitted simulator.
    let output = loop_of(&["--set", "rounds=2"]);
    assert!(output.status.success(), "{}", errors(&output));
    assert_eq!(errors(&output).matches("no robot here").count(), 1, "{}", errors(&output));
    let result = json(&output);
    let places = |result: &serde_json::Value| -> Vec<String> {
        let rows = result["evaluations"].as_array().unwrap();
        rows.iter().map(|row| row["on"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(places(&result), ["adapted, round 1", "adapted, round 1"]);
    assert_eq!(result["rounds"].as_array().unwrap().len(), 1);
    assert!(result["next"].as_str().unwrap().contains("was absent"), "{}", result["next"]);
    let page = fs::read_to_string(folder.path().join("l/report.html")).unwrap();
    assert!(page.contains("no robot here"));

    // It came: the loop that began without it ends without it, a new one measures on it.
    fs::write(&there, "").unwrap();
    fs::remove_file(folder.path().join("l/result.json")).unwrap();
    let output = loop_of(&["--resume", "--set", "rounds=2"]);
    assert!(output.status.success(), "{}", errors(&output));
    assert_eq!(places(&json(&output)), ["adapted, round 1", "adapted, round 1"]);
    let output = loop_of(&[]);
    assert!(output.status.success(), "{}", errors(&output));
    assert_eq!(places(&json(&output)), ["target", "target", "adapted", "adapted"]);

    // It went: what was begun with it waits for it.
    fs::remove_file(&there).unwrap();
    fs::remove_file(folder.path().join("l-2/result.json")).unwrap();
    let output = loop_of(&["--resume"]);
    assert_eq!(output.status.code(), Some(4), "{}", errors(&output));
    assert!(errors(&output).contains("no robot here"), "{}", errors(&output));
}

/// A target whose measurement is what is given.
fn evaluating(trajectories: usize, error: f64, falls: &str) -> String {
    let evaluation = format!(
        r#"{{"trajectories": {trajectories}, "linear_velocity_error": {{"mean": {error}, "ci95": null}},
            "angular_velocity_error": {{"mean": 0.1, "ci95": 0.01}}, "fall_rate": {{"mean": {falls}, "ci95": 0.0}}}}"#
    );
    format!("collect = [\"true\", \"{{folder}}\"]\nevaluate = [\"echo\", '''{evaluation}''']")
}

#[test]
fn a_program_that_fails_is_named_with_what_it_said() {
    for (target, words) in [
        (
            r#"collect = ["sh", "-c", "echo the robot is off >&2; exit 7", "{folder}"]"#,
            ["exit status: 7", "robot is off"],
        ),
        (r#"collect = ["no-such-robot", "{folder}"]"#, ["no-such-robot", "cannot be started"]),
        // Found at once, though what comes first is there.
        (
            "collect = [\"no-such-robot\", \"{folder}\"]\nevaluate = [\"echo\", \"hello\"]",
            ["no-such-robot", "cannot be started"],
        ),
        (r#"collect = ["true", "{folder}"]"#, ["target.collect", "no .csv"]),
        (r#"collect = ["sh", "-c", "mkfifo {folder}/log.csv"]"#, ["`log.csv`", "a pipe"]),
        (
            r#"collect = ["sh", "-c", "ln -s nowhere {folder}/log.csv"]"#,
            ["`log.csv`", "a symbolic link to nowhere"],
        ),
        (
            "timeout_seconds = 0.5\ncollect = [\"sh\", \"-c\", \"sleep 600; true {folder}\"]",
            ["more than 0.5 s", "`target.timeout_seconds`"],
        ),
        (r#"collect = ["true", "{foldr}"]"#, ["{foldr}", "{folder}"]),
        (r#"collect = ["true"]"#, ["target.collect", "{folder}"]),
        (
            "collect = [\"true\", \"{folder}\"]\nevaluate = [\"echo\", \"hello\"]",
            ["target.evaluate", "hello"],
        ),
        (&evaluating(5, 0.1, "7.0"), ["target.evaluate", "`fall_rate` is 7"]),
        (&evaluating(5, -1.0, "0.0"), ["target.evaluate", "`linear_velocity_error` is -1"]),
        (&evaluating(0, 0.1, "0.0"), ["target.evaluate", "`trajectories` is 0"]),
        (
            &evaluating(5, 0.1, "0.0")
                .replace("\"trajectories\"", "\"errors\": [[0.1, 0.2, 0]], \"trajectories\""),
            ["target.evaluate", "`errors` has 1 entries for 5"],
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let output = run(&args(folder.path(), &format!("[target]\nkind = \"command\"\n{target}\n"), &[]));
        let missing = target.contains("no-such-robot");
        assert!(
            matches!((output.status.code(), missing), (Some(1 | 2), false) | (Some(4), true)),
            "{target}: {}",
            output.status
        );
        assert!(words.iter().all(|word| errors(&output).contains(word)), "{target}: {}", errors(&output));
    }
}

/// Waits until a file is there and whole; gives what it holds.
fn awaited(file: &Path) -> String {
    // Half a minute in all.
    for _ in 0..600 {
        match fs::read_to_string(file) {
            Ok(text) if text.ends_with('\n') => return text,
            _ => std::thread::sleep(Duration::from_millis(50)),
        }
    }
    panic!("{} never came", file.display());
}

/// Sends a signal to a process; `0` only asks whether it is there.
fn signal(signal: &str, process: &str) -> bool {
    let mut kill = std::process::Command::new("kill");
    kill.args([&format!("-{signal}"), process]).stderr(Stdio::null()).status().unwrap().success()
}

/// A loop whose robot does `then`, writes the number of its process into `pid`, and walks for ever.
fn robot(folder: &Path, then: &str) -> std::process::Child {
    let place = folder.display();
    let script = format!(
        "echo {{folder}} >> {place}/folders; {then}; echo $$ > {place}/pid; while :; do sleep 0.1; done"
    );
    let target = format!("[target]\nkind = \"command\"\ncollect = [\"sh\", \"-c\", {script:?}]\n");
    let mut program = program();
    program.args(args(folder, &target, begun(folder))).stdout(Stdio::null()).stderr(Stdio::null());
    program.spawn().unwrap()
}

#[test]
fn a_robots_program_ends_with_the_loop_however_that_ends() {
    let folder = tempfile::tempdir().unwrap();
    let pid = folder.path().join("pid");
    // It may end as it likes when it is asked to.
    let lain = folder.path().join("lain");
    let lie = format!("trap 'touch {}; exit' TERM", lain.display());
    let mut killed = robot(folder.path(), &lie);
    let first = awaited(&pid);
    // The program may write its number before the loop has told it to the program's guard. On a busy machine that took long enough
    // for the guard to see the loop die without knowing whom to end.
    std::thread::sleep(Duration::from_secs(1));
    killed.kill().unwrap();
    killed.wait().unwrap();
    // Signal 0 only asks whether the process is there, here for 15 s at most.
    let gone = (0..300).any(|_| {
        std::thread::sleep(Duration::from_millis(50));
        !signal("0", first.trim())
    });
    assert!(gone, "the program outlives a loop that was killed");

    // Asked to end, the loop asks the program.
    fs::remove_file(&pid).unwrap();
    fs::remove_file(&lain).ok();
    let mut asked = robot(folder.path(), &lie);
    awaited(&pid);
    assert!(signal("TERM", &asked.id().to_string()));
    assert_eq!(asked.wait().unwrap().code(), Some(130));
    assert!(lain.exists(), "the program was not asked to end");
    let folders = fs::read_to_string(folder.path().join("folders")).unwrap();
    let folders: Vec<&str> = folders.lines().collect();
    assert!(folders.len() == 2 && folders[0] != folders[1], "attempts share a folder: {folders:?}");
}

/// A Go2 in the project's engine, walked on the clock; the training leaves the policy as it is.
const ON_THE_CLOCK: &str = r#"
[target]
kind = "simulated-go2"
trajectories = 3
seconds = 5.0
pause = 0.5
patience = 1000
yes = true
"#;
const WALKS: [&str; 4] =
    ["--set", "policy=assets/go2-walk.safetensors", "--set", "finetune.ppo.critic_warmup=5"];

#[test]
fn a_robot_walks_for_a_loop_once_for_each_log_and_the_new_policy_walks_too() {
    let folder = tempfile::tempdir().unwrap();
    let run_folder = folder.path().join("l");
    let session = |number: u32| run_folder.join(format!("round-1/sessions/{number}"));
    let mut child = program()
        .args(args(folder.path(), ON_THE_CLOCK, &WALKS))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // It is stopped within its first walk, which is long enough to count.
    let first = session(1).join("trajectory_00.csv");
    let begun = std::time::Instant::now();
    while fs::read_to_string(&first).unwrap_or_default().lines().count() < 65 {
        assert!(child.try_wait().unwrap().is_none() && begun.elapsed() < Duration::from_secs(120));
        std::thread::sleep(Duration::from_millis(5));
    }
    let kill = std::process::Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", errors(&output));
    assert!(errors(&output).contains("1 of 3 walks are in"), "{}", errors(&output));
    let whole = fs::read_to_string(session(1).join("run/whole.csv")).unwrap();
    assert!(whole.lines().last().unwrap().contains(",damping,"), "the robot was left standing");

    let more = [&WALKS[..], &["--resume"]].concat();
    let output = run(&args(folder.path(), ON_THE_CLOCK, &more));
    assert!(output.status.success(), "{}", errors(&output));
    assert!(errors(&output).contains("1 of 3 walks are made already"), "{}", errors(&output));
    let logs = |round: u32| gaitfit_log::csv_files(&run_folder.join(format!("round-{round}/logs"))).unwrap();
    assert_eq!((logs(1).len(), logs(2).len()), (3, 3));
    assert_eq!(gaitfit_log::csv_files(&session(2)).unwrap().len(), 2, "what was made was made again");
    // The new policy walked under the same commands.
    let command = |log: &Path| {
        let log = gaitfit_log::read_csv(log, &gaitfit_log::ReadOptions::default()).unwrap();
        log.command.unwrap()[..3].to_vec()
    };
    for (first, last) in logs(1).iter().zip(&logs(2)) {
        assert_eq!(command(first), command(last));
    }
    let result = json(&output);
    let walked = result["walked"].as_array().unwrap();
    assert_eq!((walked[0]["policy"].as_str(), walked[1]["policy"].as_str()), (Some("π₀"), Some("π₁")));
    assert_eq!((walked[0]["walks"].as_u64(), walked[0]["stopped"].as_u64()), (Some(3), Some(1)));
    assert!(walked[1]["yaw_rate_error"]["mean"].as_f64().unwrap() < 0.5, "{walked:?}");
    assert!(result["next"].as_str().unwrap().contains("was not measured"), "{result}");
    let places: Vec<_> = result["evaluations"].as_array().unwrap().iter().map(|one| &one["on"]).collect();
    assert!(places.iter().all(|on| *on == "adapted"), "{places:?}");
}

#[test]
fn a_robot_without_a_person_or_with_a_wrong_link_is_refused_before_anything_is_made() {
    let real = ON_THE_CLOCK.replace("simulated-go2", "robot");
    for (target, words) in [
        (ON_THE_CLOCK.replace("yes = true", ""), ["a person types a word", "no terminal"]),
        (real.clone(), ["`target.interface`", "eth0"]),
        (real.replace("yes", "interface = \"lo\"\nyes"), ["`target.yes`", "simulators only"]),
        (format!("{ON_THE_CLOCK}domain = 1\n"), ["`target.domain`", "kind = \"robot\""]),
        (format!("{ON_THE_CLOCK}collect = [\"x\"]\n"), ["`target.collect`", "command"]),
        (ON_THE_CLOCK.replace("pause = 0.5", "pause = 0.1"), ["`target.pause`", "0.5 to 60"]),
        (ON_THE_CLOCK.replace("trajectories = 3", "trajectories = 3000"), ["longer than an hour", "fewer"]),
        (format!("{}yes = true\n", common::loops::COMMAND), ["`yes`", "kind = \"robot\""]),
        (format!("{ON_THE_CLOCK}robot = \"unitree-b2\"\n"), ["`target.robot`", "kind = \"robot\""]),
        (
            format!("{real}interface = \"lo\"\nrobot = \"unitree-b3\"\ndomain = 1\n"),
            ["target.robot", "unitree-b2"],
        ),
        (
            // The name by which earlier builds knew it.
            format!(
                "{}interface = \"no-such-0\"\ndomain = 1\n",
                real.replace("\"robot\"", "\"unitree-go2\"")
            ),
            ["[target]", if cfg!(feature = "dds") { "no-such-0" } else { "without DDS" }],
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let mut command = program();
        let output = command.args(args(folder.path(), &target, &[])).stdin(Stdio::null()).output().unwrap();
        let code = if errors(&output).contains("without DDS") { 4 } else { 2 };
        assert_eq!(output.status.code(), Some(code), "{target}: {}", errors(&output));
        assert!(words.iter().all(|word| errors(&output).contains(word)), "{target}: {}", errors(&output));
        assert!(!folder.path().join("l").exists(), "{target}");
    }
}
