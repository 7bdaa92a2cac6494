//! `gaitfit run`: a policy on a simulated robot, on the clock.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, json, program, run};
use gaitfit_log::{ReadOptions, Trajectory, read_csv};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const WALK: &str = "assets/go2-walk.safetensors";

fn commands(folder: &Path, rows: &str) -> String {
    let path = folder.join("commands.csv");
    std::fs::write(&path, format!("t,vx,vy,wz\n{rows}")).unwrap();
    path.display().to_string()
}

/// Arguments for the engine's robot; a busy machine is no reason to stop.
fn simulated<'a>(commands: &'a str, out: &'a str) -> Vec<&'a str> {
    let robot = ["--robot", "simulated", "--yes", "--patience", "1000"];
    [&["run", WALK, "--commands", commands, "--out", out, "--json"][..], &robot].concat()
}

fn log(folder: &Path) -> Trajectory {
    read_csv(&folder.join("walk.csv"), &ReadOptions::default()).unwrap()
}

/// Waits until the walk has been recorded for so many rows.
fn wait_for_rows(folder: &Path, rows: usize, child: &mut Child) {
    let begin = Instant::now();
    loop {
        let text = std::fs::read_to_string(folder.join("walk.csv")).unwrap_or_default();
        // A few lines before the rows are comments and the header.
        if text.lines().count() > rows + 5 {
            return;
        }
        assert!(child.try_wait().unwrap().is_none(), "it ended early");
        assert!(begin.elapsed() < Duration::from_secs(60), "it does not walk");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn what_may_not_run_is_refused_before_anything_moves() {
    let folder = tempfile::tempdir().unwrap();
    let script = commands(folder.path(), "0,0.5,0,0\n1,0,0,0\n");
    let out = folder.path().join("out").display().to_string();
    let base = ["run", WALK, "--commands", &script, "--out", &out];
    for (more, word) in [
        (&["--robot", "unitree-go2", "--interface", "lo", "--yes"][..], "--yes: for simulators only"),
        (&["--robot", "unitree-go2", "--interface", "lo"], "standard input is no terminal"),
        (
            &[
                "--robot",
                "unitree-go2",
                "--interface",
                "lo",
                "--domain",
                "0",
                "--patience",
                "100",
                "--dry-run",
            ],
            "--patience",
        ),
        (&["--robot", "unitree-go2", "--domain", "1", "--yes"], "--interface"),
        (&["--robot", "simulated", "--yes", "--random", "5"], "--random"),
        (&["--robot", "spot", "--yes"], "spot"),
        (&["--robot", "simulated", "--yes", "--stand", "0.1"], "--stand takes 0.5 to 120 s"),
        (&["--robot", "simulated", "--yes", "--stand", "nan"], "--stand takes 0.5 to 120 s"),
    ] {
        let output = program().args(base).args(more).stdin(Stdio::null()).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{more:?}: {}", errors(&output));
        assert!(errors(&output).contains(word), "{more:?}: {}", errors(&output));
    }
    let wrong = ["--robot", "unitree-go2", "--interface", "no-such-0", "--domain", "1", "--yes"];
    let output = program().args(base).args(wrong).output().unwrap();
    assert_eq!(output.status.code(), Some(if cfg!(feature = "dds") { 2 } else { 4 }), "{}", errors(&output));
    assert!(errors(&output).contains("no-such-0"), "{}", errors(&output));
    let out = folder.path().join("held").display().to_string();
    std::fs::create_dir_all(&out).unwrap();
    std::fs::write(folder.path().join("held/walk.csv"), "time\n").unwrap();
    let output = run(&simulated(&script, &out));
    assert_eq!(output.status.code(), Some(2));
    assert!(errors(&output).contains("holds a run already"), "{}", errors(&output));
    assert!(!folder.path().join("held/.lock").exists());
    let biped = folder.path().join("other.csv").display().to_string();
    std::fs::write(&biped, "t,vx,vy\n0,0,0\n").unwrap();
    let output = run(&simulated(&biped, &folder.path().join("none").display().to_string()));
    assert_eq!(output.status.code(), Some(1));
    assert!(errors(&output).contains("no column `wz`"), "{}", errors(&output));
}

#[test]
fn a_simulated_robot_stands_up_walks_and_lies_down_on_the_clock() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a run");
    let script = commands(folder.path(), "0,0.5,0,0\n2,0,0,0\n2.4,0,0,0\n");
    let out_text = out.display().to_string();
    let output = run(&[simulated(&script, &out_text).as_slice(), &["--stand", "1"]].concat());
    assert!(output.status.success(), "{}", errors(&output));
    let phases = errors(&output);
    for phase in ["stand up", "stand", "walk", "stop", "lie down", "damping"] {
        assert!(phases.lines().any(|line| line == phase), "{phase}: {phases}");
    }
    let summary = json(&output);
    assert!(summary["reason"].is_null() && summary["armed"] == true);
    let saved: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("summary.json")).unwrap()).unwrap();
    assert_eq!(saved, summary);
    assert!(
        summary["commands"].as_u64().unwrap() > 1000
            && summary["send_late_us"]["turns"].as_u64().unwrap() > 1000
    );
    let log = log(&out);
    // On a busy machine turns of the policy's loop are left out.
    assert!(log.len() > 20 && log.len() <= 121, "{}", log.len());
    // The last second, in which it comes to rest, is not in the log.
    let more = summary["outputs"].as_u64().unwrap() as usize - log.len();
    assert!((1..=51).contains(&more), "{more}");
    assert!(log.command.unwrap().iter().take(3).any(|part| *part == 0.5));
    let whole = std::fs::read_to_string(out.join("whole.csv")).unwrap();
    let mut rows = whole.lines().filter(|line| !line.starts_with('#')).map(|line| line.split(','));
    let phase = rows.next().unwrap().position(|column| column == "phase").unwrap();
    let standing: Vec<f64> = rows
        .filter(|row| row.clone().nth(phase) == Some("stand"))
        .map(|mut row| row.next().unwrap().parse().unwrap())
        .collect();
    let stood = standing.last().unwrap() - standing[0];
    assert!((0.9..1.5).contains(&stood), "--stand 1: {stood} s");
}

#[cfg(unix)]
#[test]
fn signals_damp_the_robot_and_a_kill_leaves_a_complete_log() {
    let stopped = Some(130);
    let signals = [
        ("-INT", stopped),
        ("-QUIT", stopped),
        ("-TSTP", stopped),
        ("-USR1", stopped),
        ("-USR2", stopped),
        ("-ALRM", stopped),
        ("-KILL", None),
    ];
    std::thread::scope(|scope| {
        let runs = signals.map(|(signal, code)| scope.spawn(move || ends_by(signal, code)));
        runs.into_iter().for_each(|run| run.join().unwrap());
    });
}

/// A robot that walks is sent a signal.
#[cfg(unix)]
fn ends_by(signal: &str, code: Option<i32>) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let random = ["run", WALK, "--random", "60", "--seed", "3", "--robot", "simulated", "--yes"];
    let mut command = program();
    command.args(random).args(["--patience", "1000", "--out"]).arg(&out);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    wait_for_rows(&out, 30, &mut child);
    let kill = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), code, "{}", errors(&output));
    if code.is_some() {
        assert!(errors(&output).contains("damped: the program was asked to end"), "{}", errors(&output));
        let name = format!("(SIG{})", &signal[1..]);
        // ctrlc does not tell which signal came, so only the others have names.
        assert_eq!(errors(&output).contains(&name), signal != "-INT", "{}", errors(&output));
        let whole = std::fs::read_to_string(out.join("whole.csv")).unwrap();
        assert!(whole.lines().last().unwrap().contains(",damping,"));
    }
    let log = log(&out);
    assert!(log.len() >= 30 && log.command.as_ref().unwrap()[0] != 0.0);
    // Whatever ended it, viewers and other programs get the whole of it as MCAP.
    let mcap = folder.path().join("walk.mcap").display().to_string();
    let written = run(&["export-log", &out.join("walk.csv").display().to_string(), "--out", &mcap, "--json"]);
    assert!(written.status.success(), "{}", errors(&written));
    assert_eq!(json(&written)["samples"].as_u64(), Some(log.len() as u64));
    let back = folder.path().join("back.csv").display().to_string();
    let read = run(&["import", &mcap, "--out", &back]);
    assert!(read.status.success(), "{}", errors(&read));
    let back = read_csv(Path::new(&back), &ReadOptions::default()).unwrap();
    assert_eq!((back.len(), &back.position), (log.len(), &log.position));
    // So is the MCAP that was written while it walked, but for a row that was being written.
    let live = out.join("walk.mcap");
    let bytes = std::fs::read(&live).unwrap();
    assert_eq!(bytes.ends_with(b"\x89MCAP0\r\n"), code.is_some(), "the end that a kill leaves out");
    let seen = folder.path().join("live.csv").display().to_string();
    let read = run(&["import", &live.display().to_string(), "--out", &seen]);
    assert!(read.status.success(), "{}", errors(&read));
    let seen = read_csv(Path::new(&seen), &ReadOptions::default()).unwrap();
    let least = if code.is_some() { log.len() } else { log.len() - 1 };
    assert!((least..=log.len()).contains(&seen.len()), "{} of {}", seen.len(), log.len());
    let (rows, values) = (seen.len(), 12 * seen.len());
    assert_eq!(seen.position, log.position[..values]);
    assert_eq!(seen.target.unwrap(), log.target.unwrap()[..values]);
    assert_eq!(seen.action.unwrap(), log.action.unwrap()[..values]);
    assert_eq!(seen.command.unwrap(), log.command.unwrap()[..3 * rows]);
    let (seen, log) = (seen.base.unwrap(), log.base.unwrap());
    let rates = seen.angular_velocity.unwrap();
    assert_eq!(rates, log.angular_velocity.unwrap()[..rates.len()]);
    for topic in [&b"/robot_state"[..], b"temperature", b"battery_charge"] {
        assert!(bytes.windows(topic.len()).any(|window| window == topic), "{topic:?}");
    }
}

/// Presses keys at a terminal; what they do, and what of the terminal is left.
#[cfg(unix)]
#[test]
fn keys_of_a_terminal_steer_and_leave_it_as_it_was() {
    use nix::sys::termios::{InputFlags, LocalFlags, tcgetattr};
    use std::io::{Read, Write};
    for (last, code, words) in [
        (&b"q"[..], Some(0), ["it comes to rest and lies down", "lie down"]),
        (b"\x1b", Some(1), ["damped", "damping"]),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let terminal = nix::pty::openpty(None, None).unwrap();
        let flags = || tcgetattr(&terminal.slave).map(|mode| (mode.local_flags, mode.input_flags)).unwrap();
        let before: (LocalFlags, InputFlags) = flags();
        let mut command = program();
        command.args([
            "run",
            WALK,
            "--keyboard",
            "--robot",
            "simulated",
            "--yes",
            "--patience",
            "1000",
            "--out",
        ]);
        command
            .arg(&out)
            .stdin(terminal.slave.try_clone().unwrap())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let mut keys = std::fs::File::from(terminal.master.try_clone().unwrap());
        // A terminal that nobody reads fills up.
        let mut echo = std::fs::File::from(terminal.master.try_clone().unwrap());
        std::thread::spawn(move || while echo.read(&mut [0; 256]).is_ok_and(|count| count > 0) {});
        wait_for_rows(&out, 10, &mut child);
        assert!(!flags().0.contains(LocalFlags::ICANON), "keys are read one by one");
        // Three steps ahead, and one of a turn to the left.
        keys.write_all(b"wwwa").unwrap();
        let begin = Instant::now();
        let walks = || std::fs::read_to_string(out.join("walk.csv")).unwrap().lines().count();
        let until = walks() + 20;
        while walks() < until {
            assert!(begin.elapsed() < Duration::from_secs(60), "it does not walk");
            std::thread::sleep(Duration::from_millis(20));
        }
        keys.write_all(last).unwrap();
        let output = child.wait_with_output().unwrap();
        let said = errors(&output);
        assert_eq!(output.status.code(), code, "{said}");
        assert!(said.contains("vx +") && words.iter().all(|word| said.contains(word)), "{said}");
        let command = log(&out).command.unwrap();
        let last = &command[command.len() - 3..];
        assert!(command[0] == 0.0 && last[0] > 0.2 && last[2] > 0.0, "{last:?}");
        assert_eq!(flags(), before, "the terminal is as it was");
    }
}

#[test]
fn options_that_would_do_nothing_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out").display().to_string();
    let script = commands(folder.path(), "0,0.5,0,0\n1,0,0,0\n");
    let bad = folder.path().join("bad.csv").display().to_string();
    std::fs::write(&bad, "trajectory,time,vx_cmd,vy_cmd,wz_cmd\n0,0,x,0,0\n").unwrap();
    let walk = ["run", WALK, "--commands", &script];
    let random = ["run", WALK, "--random", "2"];
    for (first, more, word) in [
        (&walk[..], &["--drift-speeds", "1,1,1"][..], "--drift-speeds"),
        (&walk, &["--trajectories", "3"], "--trajectories"),
        (&walk, &["--seed", "1"], "--seed"),
        (&walk, &["--seconds", "3"], "--seconds: "),
        (&walk, &["--pause", "3"], "--pause: "),
        (&walk, &["--domain", "1"], "--domain: "),
        (&walk, &["--interface", "lo"], "--interface, "),
        (&random, &["--pause", "3"], "--pause: "),
        (&random, &["--beyond-training"], "--beyond-training"),
        (&["collect", WALK], &["--threads", "1"], "--threads is for simulators"),
        (&["collect", WALK], &["--preset", "accurate"], "--preset is for simulators"),
        (&["collect", WALK, "--commands", &script], &["--seed", "1"], "--seed is for random commands"),
    ] {
        let output = run(&[first, more, &["--robot", "simulated", "--yes", "--out", &out]].concat());
        assert_eq!(output.status.code(), Some(2), "{first:?} {more:?}: {}", errors(&output));
        assert!(errors(&output).contains(word), "{first:?} {more:?}: {}", errors(&output));
    }
    // What is wrong is a file, as for all commands.
    for (first, words) in [
        (&["run", WALK, "--commands", &bad][..], ["bad.csv: line 2", "numbers"]),
        (&["run", WALK, "--commands", "none.csv"], ["none.csv", "No such file"]),
        (&["run", "assets/go2.xml", "--random", "2"], ["go2.xml: no policy", ".safetensors"]),
        (&["collect", WALK, "--commands", &script], ["no column `trajectory`", "`gaitfit run --commands`"]),
    ] {
        let output = run(&[first, &["--robot", "simulated", "--yes", "--out", &out]].concat());
        assert_eq!(output.status.code(), Some(1), "{first:?}: {}", errors(&output));
        assert!(words.iter().all(|word| errors(&output).contains(word)), "{first:?}: {}", errors(&output));
    }
    let output = run(&["collect", WALK, "--patience", "100", "--out", &out]);
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
    assert!(errors(&output).contains("--patience, "), "{}", errors(&output));
    assert!(!Path::new(&out).exists());
}

#[test]
fn collect_on_a_robot_writes_a_log_a_trajectory_as_in_a_simulator() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("logs");
    let shown = out.display().to_string();
    let asked = ["collect", WALK, "--robot", "simulated", "--trajectories", "3", "--seconds", "1"];
    let link = ["--pause", "0.5", "--yes", "--patience", "1000", "--seed", "5", "--out", &shown];
    let refused = run(&[&asked[..], &link, &["--theta", "theta.toml"]].concat());
    assert_eq!(refused.status.code(), Some(2));
    assert!(errors(&refused).contains("--theta is for simulators"), "{}", errors(&refused));
    let output = run(&[&asked[..], &link].concat());
    assert!(output.status.success(), "{}", errors(&output));
    let mut first = Vec::new();
    for number in 0..3 {
        let log = read_csv(&out.join(format!("trajectory_0{number}.csv")), &ReadOptions::default()).unwrap();
        // On a busy machine turns of the policy's loop are left out.
        assert!(
            (20..=51).contains(&log.len()) && log.time[0] < 0.1,
            "{number}: {} {}",
            log.len(),
            log.time[0]
        );
        first.push(log.command.unwrap()[..3].to_vec());
    }
    assert!(first[0] != first[1] && first[1] != first[2], "{first:?}");
    assert_eq!(gaitfit_log::csv_files(&out).unwrap().len(), 3);
    let summary: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("run/summary.json")).unwrap()).unwrap();
    assert!(summary["reason"].is_null() && summary["outputs"].as_u64().unwrap() > 100);
    // Each log has an MCAP file beside it, which says less.
    let config = folder.path().join("fit.toml");
    let written = run(&["new", "--policy", WALK, "--logs", &shown, "--out", &config.display().to_string()]);
    assert!(errors(&written).contains("a fit needs at least 10 s"), "{}", errors(&written));
    let config = std::fs::read_to_string(config).unwrap();
    assert!(config.contains(&format!("    \"{shown}\",\n]")), "{config}");
    assert!(!folder.path().join("fit.logs").exists());
    // Fits read the folder.
    let inspected = run(&["inspect", &shown]);
    assert!(inspected.status.success(), "{}", errors(&inspected));
    let again = run(&[&asked[..], &link].concat());
    assert!(errors(&again).contains("holds a run already"), "{}", errors(&again));
    let simulator = run(&["collect", WALK, "--interface", "lo", "--out", &shown]);
    assert_eq!(simulator.status.code(), Some(2));
    assert!(errors(&simulator).contains("name it, --robot"), "{}", errors(&simulator));
}

#[cfg(unix)]
#[test]
fn signals_without_a_meaning_do_not_end_a_run_and_a_file_beyond_its_limit_damps() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let random = ["--random", "60", "--robot", "simulated", "--yes", "--patience", "1000", "--out"];
    let mut child = program()
        .args(["run", WALK])
        .args(random)
        .arg(&out)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    wait_for_rows(&out, 10, &mut child);
    for signal in ["-XFSZ", "-TTOU", "-TTIN"] {
        assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
    }
    let rows = std::fs::read_to_string(out.join("walk.csv")).unwrap().lines().count();
    wait_for_rows(&out, rows + 20, &mut child);
    // The folder goes away under the run: the reason and the table are told all the same.
    std::fs::remove_dir_all(&out).unwrap();
    std::fs::write(&out, "a file").unwrap();
    assert!(Command::new("kill").args(["-USR1", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", errors(&output));
    let said = errors(&output);
    assert!(
        said.contains("summary.json") && said.contains("damped: the program was asked to end (SIGUSR1)"),
        "{said}"
    );
    assert!(String::from_utf8_lossy(&output.stdout).contains("states received"), "no table");
}

/// The second walk is refused, and the first one's log is whole.
#[test]
fn a_folder_that_another_walk_writes_into_is_refused_before_anything_moves() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let shown = out.display().to_string();
    let script = commands(folder.path(), "0,0.5,0,0\n3,0,0,0\n");
    let mut first = program();
    first.args(simulated(&script, &shown)).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut first = first.spawn().unwrap();
    wait_for_rows(&out, 1, &mut first);
    let collect = ["collect", WALK, "--trajectories", "1", "--seconds", "1", "--out", &shown];
    for output in [run(&simulated(&script, &shown)), run(&collect)] {
        assert_eq!(output.status.code(), Some(1), "{}", errors(&output));
        assert!(errors(&output).contains("another process is writing logs"), "{}", errors(&output));
    }
    let output = first.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", errors(&output));
    // Three seconds at 50 Hz; a busy machine leaves some turns out.
    assert!((140..=160).contains(&log(&out).len()), "{} rows", log(&out).len());
}

#[cfg(unix)]
#[test]
fn files_without_an_end_are_no_scripts() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    // A tebibyte that takes no room on the disk.
    std::fs::File::create(path("sparse.csv")).unwrap().set_len(1 << 40).unwrap();
    assert!(Command::new("mkfifo").arg(path("pipe.csv")).status().unwrap().success());
    let out = path("out").display().to_string();
    for (script, words) in [
        ("/dev/zero".to_owned(), "not a regular file"),
        (path("sparse.csv").display().to_string(), "larger than 16 MiB"),
        (path("pipe.csv").display().to_string(), "not a regular file"),
        (path("none.csv").display().to_string(), "No such file"),
    ] {
        let begin = Instant::now();
        for output in
            [run(&simulated(&script, &out)), run(&["collect", WALK, "--commands", &script, "--out", &out])]
        {
            assert!(!output.status.success() && begin.elapsed() < Duration::from_secs(30), "{script}");
            let error = errors(&output);
            assert!(error.contains(&script) && error.len() < 600, "{error}");
            assert!(error.contains(words) || error.contains("larger than 64 MiB"), "{error}");
        }
    }
}

/// A simulated robot that is interrupted while it is listened to, for a second.
#[cfg(unix)]
#[test]
fn a_run_that_never_moves_says_so_leaves_no_log_and_may_be_repeated() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let script = commands(folder.path(), "0,0.5,0,0\n1,0,0,0\n");
    let mut command = program();
    command.args(simulated(&script, &out.display().to_string()));
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let begin = Instant::now();
    while !out.exists() && begin.elapsed() < Duration::from_secs(30) {
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", errors(&output));
    assert!(errors(&output).contains("interrupted; nothing was sent"), "{}", errors(&output));
    let left = std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name());
    assert!(left.into_iter().all(|name| name == ".lock"), "logs of nothing");
    assert!(output.stdout.is_empty(), "a table of zeros");
    let shown = out.display().to_string();
    let dry = [&simulated(&script, &shown)[..], &["--dry-run"]].concat();
    let output = run(&dry);
    assert!(output.status.success(), "the folder is free: {}", errors(&output));
    let summary = json(&output);
    assert!(
        summary["dry_run"] == true && summary["clamped"].is_null() && summary["commands"] == 0,
        "{summary}"
    );
    assert!(gaitfit_log::csv_files(&out).unwrap().is_empty(), "a fit would read the logs of a dry run");
    let walk = std::fs::read_to_string(out.join("dry-run/walk.csv")).unwrap();
    assert!(walk.starts_with("# dry run: nothing was sent\n"), "{walk:.200}");
}

#[test]
fn policies_and_commands_that_a_robot_may_not_be_given_are_refused_by_the_names_of_the_options() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out").display().to_string();
    let fast = commands(folder.path(), "0,5,0,0\n1,0,0,0\n");
    let stiff = folder.path().join("stiff.toml").display().to_string();
    let weights =
        std::fs::canonicalize(Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(WALK)).unwrap();
    std::fs::write(&stiff, format!("file = {:?}\nkp = 150.0\n", weights.display().to_string())).unwrap();
    let other = folder.path().join("playlist.csv").display().to_string();
    std::fs::write(&other, "trajectory,time,vx_cmd,vy_cmd,wz_cmd\n0,0,5,0,0\n").unwrap();
    let random = ["--random", "2"];
    for (first, more, words) in [
        (["run", WALK], &["--commands", &fast][..], ["vx = 5 is outside", "--beyond-training"]),
        (["run", "assets/go2-biped.safetensors"], &random, ["does not walk on four legs", "posture"]),
        (["run", &stiff], &random, ["kp = 150", "0 to 100"]),
        (["run", WALK], &["--commands", &other], ["vx = 5 is outside", "--beyond-training"]),
        (["run", WALK], &["--commands", &other, "--seconds", "0.5"], ["--seconds: 0.5 s", "1 to 3600"]),
        (
            ["run", WALK],
            &["--drift", "1", "--drift-speeds", "2,0,0"],
            ["--drift-speeds: vx = -2 is outside", "slower"],
        ),
        (["run", WALK], &["--drift", "99"], ["--drift: ", "give 1 to 50"]),
        (["run", WALK], &["--keyboard"], ["--keyboard", "no terminal"]),
        (["run", WALK], &["--remote", "--random", "2"], ["--remote", "--random"]),
        (["run", WALK], &[], ["--commands", "--keyboard"]),
        (["run", WALK], &["--random", "0"], ["--random: 0 s", "1 to 3600"]),
        (["collect", WALK], &["--seconds", "0"], ["--seconds: 0 s", "1 to 3600"]),
        (
            ["collect", WALK],
            &["--trajectories", "99999999999", "--seconds", "4"],
            ["--trajectories: 99999999999 of 4 s (--seconds)", "at most 600"],
        ),
        (["collect", WALK], &["--pause", "0.1"], ["--pause: 0.1 s", "0.5 to 60"]),
        (["collect", WALK], &["--commands", &other], ["vx = 5 is outside", "within that"]),
    ] {
        let robot = ["--robot", "simulated", "--yes", "--out", &out];
        let output = run(&[&first[..], more, &robot].concat());
        assert_eq!(output.status.code(), Some(2), "{first:?} {more:?}: {}", errors(&output));
        let said = errors(&output);
        assert!(words.iter().all(|word| said.contains(word)), "{first:?} {more:?}: {said}");
    }
    assert!(!Path::new(&out).exists(), "it is refused before anything is made");
    let held = folder.path().join("held");
    std::fs::create_dir_all(&held).unwrap();
    std::fs::write(held.join("walk.csv"), "time\n").unwrap();
    let allowed = ["run", WALK, "--commands", &fast, "--beyond-training", "--robot", "simulated", "--yes"];
    let output = run(&[&allowed[..], &["--out", &held.display().to_string()]].concat());
    // What comes after the commands is looked at.
    assert!(errors(&output).contains("holds a run already"), "{}", errors(&output));
}

/// Four trials of a robot that begins each after the pause; what a person would have measured then makes the table.
#[test]
fn drift_trials_leave_a_form_whose_numbers_make_the_table() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("trials");
    let shown = out.display().to_string();
    let trials = ["--drift", "1", "--drift-speeds", "0.5,0,0"];
    let robot = ["--robot", "simulated", "--yes", "--pause", "0.5", "--patience", "1000", "--json"];
    let output = run(&[&["run", WALK, "--out", &shown][..], &trials, &robot].concat());
    assert!(output.status.success(), "{}", errors(&output));
    let said = errors(&output);
    assert!(said.contains("trial 2 of 2: -x (-0.5 m/s") && said.contains("gaitfit drift"), "{said}");
    let logs = gaitfit_log::csv_files(&out).unwrap();
    assert_eq!(logs.len(), 2);
    let command = read_csv(&logs[1], &ReadOptions::default()).unwrap().command.unwrap();
    let walked = command.chunks_exact(3).filter(|row| row[0] == -0.5).count();
    assert!(command[0] == 0.0 && (100..=203).contains(&walked), "{walked}");
    let path = out.join("run/drift.csv");
    let form = std::fs::read_to_string(&path).unwrap();
    assert!(form.contains("# policy = \"assets/go2-walk.safetensors\""), "{form}");
    let path = path.display().to_string();
    let empty = run(&["drift", &path]);
    assert_eq!(empty.status.code(), Some(1));
    assert!(errors(&empty).contains("no row is filled in"), "{}", errors(&empty));
    std::fs::write(&path, form.replacen(",,,,,", ",1.7,-0.4,10,,", 1)).unwrap();
    let other = folder.path().join("other.csv").display().to_string();
    let both =
        form.replacen(",,,,,", ",2.1,0,0,,", 1).replacen(",,,,,", ",,,,yes,", 1).replace("go2-walk", "new");
    std::fs::write(&other, &both).unwrap();
    let output = run(&["drift", &path, &other]);
    assert!(output.status.success(), "{}", errors(&output));
    assert!(errors(&output).contains("1 rows are not filled in"), "{}", errors(&output));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let row = |words: [&str; 2]| {
        let line = text.lines().find(|line| words.iter().all(|word| line.contains(word)));
        line.unwrap_or_else(|| panic!("{words:?}: {text}")).to_owned()
    };
    let first = row(["+x", "go2-walk"]);
    assert!(["-0.300", "-0.400", "+0.175", "0.500"].iter().all(|cell| first.contains(cell)), "{first}");
    assert!(row(["-x", "new"]).contains('–'), "{text}");
    let document = json(&run(&["drift", &path, &other, "--json"]));
    assert_eq!((document[1]["fell"].as_u64(), document[0]["not_made"].as_u64()), (Some(1), Some(1)));
    std::fs::write(&other, both.replace("2.1,0,0", "2.1,,0")).unwrap();
    let wrong = run(&["drift", &other]);
    assert!(errors(&wrong).contains("other.csv: line 7: y_m is empty"), "{}", errors(&wrong));
}

#[test]
fn files_of_several_trajectories_are_walked_one_after_another() {
    let folder = tempfile::tempdir().unwrap();
    let playlist = folder.path().join("list.csv").display().to_string();
    let rows = "trajectory,time,vx_cmd,vy_cmd,wz_cmd\n0,0,0.5,0,0\n0,0.6,0,0,0.4\n1,0,-0.3,0,0\n1,9,1,0,0\n";
    std::fs::write(&playlist, rows).unwrap();
    let out = folder.path().join("logs");
    let shown = out.display().to_string();
    let asked = ["collect", WALK, "--robot", "simulated", "--commands", &playlist, "--seconds", "1"];
    let output =
        run(&[&asked[..], &["--pause", "0.5", "--yes", "--patience", "1000", "--out", &shown]].concat());
    assert!(output.status.success(), "{}", errors(&output));
    let logs = gaitfit_log::csv_files(&out).unwrap();
    let commands: Vec<Vec<f64>> =
        logs.iter().map(|log| read_csv(log, &ReadOptions::default()).unwrap().command.unwrap()).collect();
    assert_eq!(commands.len(), 2);
    assert!(commands[0][0] == 0.5 && commands[0].last().is_some_and(|turn| (turn - 0.4).abs() < 1e-6));
    assert!((commands[1][0] + 0.3).abs() < 1e-6 && commands[1].len() <= 3 * 51, "{}", commands[1].len());
}
