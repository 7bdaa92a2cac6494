//! The program as a whole: help, exit codes, closed pipes, JSON.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, json, program, run};
use std::process::Stdio;

#[test]
fn wrong_usage_ends_with_2_and_help_with_0() {
    assert_eq!(run(&["--help"]).status.code(), Some(0));
    assert_eq!(run(&["fly"]).status.code(), Some(2));
    assert_eq!(run(&["adapt"]).status.code(), Some(2));
    assert_eq!(run(&["inspect", "README.md"]).status.code(), Some(2));
    assert_eq!(run(&["bench", "physics", "--threads", "0"]).status.code(), Some(2));
    let output = run(&["inspect", "/no/such/file"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(errors(&output).contains("cannot read /no/such/file"), "{}", errors(&output));
    let output = run(&["man", "README.md"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(errors(&output).contains("README.md: is a file; name the folder"), "{}", errors(&output));
}

/// Numbers that an option cannot have are its own error, negative ones too.
#[test]
fn options_say_what_they_take() {
    let policy = "assets/go2-walk.safetensors";
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out").display().to_string();
    for (args, words) in [
        (
            &["run", policy, "--robot", "simulated", "--drift", "-1"][..],
            ["'--drift <N>'", "a whole number, not negative"],
        ),
        (&["run", policy, "--robot", "simulated", "--random", "-1"], ["--random: -1 s", "1 to 3600"]),
        (
            &["run", policy, "--robot", "simulated", "--drift", "1", "--drift-speeds", "-1,0,0"],
            ["--drift: ", "from 0 to 5"],
        ),
        (&["run", policy, "--robot", "simulated", "--random", "x"], ["'--random <S>'", "give a number"]),
        (&["collect", policy, "--trajectories", "0"], ["'--trajectories <N>'", "give 1 or more"]),
        (&["collect", policy, "--log-shift", "-1", "2"], ["--log-shift", "from 0 to"]),
        (&["collect", policy, "--seconds", "-4"], ["--seconds", "-4"]),
        (&["excite", "assets/go2.xml", "--margin", "-1"], ["--margin", "-1"]),
    ] {
        let yes: &[&str] = if args[0] == "run" { &["--yes"] } else { &[] };
        let output = run(&[args, yes, &["--out", &out]].concat());
        let said = errors(&output);
        assert_eq!(output.status.code(), Some(2), "{args:?}: {said}");
        assert!(words.iter().all(|word| said.contains(word)), "{args:?}: {said}");
    }
    let help = String::from_utf8(run(&["collect", "-h"]).stdout).unwrap();
    assert!(help.contains("--robot <FILE|ROBOT>") && help.contains("simulated"), "{help}");
    let help = String::from_utf8(run(&["evaluate", "-h"]).stdout).unwrap();
    assert!(help.contains("--robot <FILE>") && !help.contains("unitree-go2"), "{help}");
}

/// As on a machine without a GPU: the driver, if there is one, shows none.
#[test]
fn a_missing_gpu_is_a_clear_error() {
    let runs = tempfile::tempdir().unwrap();
    let folder = format!("runs={}", runs.path().display());
    let logs = runs.path().join("logs").display().to_string();
    let policy = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2-walk.safetensors");
    let demo = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/go2-demo/adapt.toml");
    for args in [
        &["bench", "physics", "--device", "cuda", "--json"][..],
        &["bench", "train", "--device", "cuda", "--environments", "64"],
        &["bench", "train", "--device", "cuda:0,1", "--environments", "64"],
        &["train", "--device", "cuda:0", "--set", "train.environments=64", "--set", &folder],
        &[
            "train",
            "--device",
            "cuda:0,1",
            "--seeds",
            "2",
            "--set",
            "train.environments=64",
            "--set",
            &folder,
        ],
        &["adapt", demo, "--device", "cuda:0,1", "--set", &folder],
        &["evaluate", policy, "--device", "cuda", "--trajectories", "8", "--drift", "0"],
        &["collect", policy, "--device", "cuda", "--trajectories", "8", "--out", &logs],
    ] {
        // CUDA hides all devices from the first invalid number on.
        let output = program().args(args).env("CUDA_VISIBLE_DEVICES", "-1").output().unwrap();
        assert_eq!(output.status.code(), Some(4), "{args:?}: {}", errors(&output));
        assert!(output.stdout.is_empty());
        let said = errors(&output);
        assert!(said.contains("NVIDIA driver") || said.contains("there is no GPU 0"), "{said}");
    }
    for wrong in ["gpu", "cuda:x", "cuda:0,1"] {
        let output = run(&["bench", "physics", "--device", wrong]);
        assert_eq!(output.status.code(), Some(2), "{wrong}");
        assert!(errors(&output).contains("it must be cpu, cuda or cuda:N"), "{}", errors(&output));
    }
    for command in ["adapt", "loop"] {
        let output = run(&[command, demo, "--device", "cuda:1,1"]);
        assert_eq!(output.status.code(), Some(2), "{command}");
        assert!(errors(&output).contains("it names the GPU 1 twice"), "{}", errors(&output));
    }
    assert_eq!(run(&["bench", "physics", "--lanes", "3"]).status.code(), Some(2));
}

#[cfg(target_os = "linux")]
#[test]
fn output_that_cannot_be_written_is_an_error() {
    for args in [&["--help"][..], &["adapt", "--help"], &["--version"], &["config"], &["doctor", "--json"]] {
        // Every write to this device fails as on a full disk.
        let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let output = program().args(args).stdout(full).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{args:?}");
        assert!(errors(&output).contains("cannot write to standard output"), "{args:?}: {}", errors(&output));
    }
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let mut child = program().arg("config").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // The reading end closes, as after `| head`.
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", errors(&output));
    assert_eq!(errors(&output), "");
}

#[test]
fn printed_settings_are_a_configuration_to_start_from() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.toml");
    std::fs::write(&path, run(&["config"]).stdout).unwrap();
    let output = run(&["adapt", path.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2));
    assert!(errors(&output).contains("`robot` names no robot file"), "{}", errors(&output));
}

#[test]
fn doctor_tells_the_machine() {
    let machine = json(&run(&["doctor", "--json"]));
    assert!(machine["threads"].as_u64().unwrap() >= 1);
    assert!(["avx512", "avx2", "portable"].contains(&machine["engine"].as_str().unwrap()), "{machine}");
    // Either there is all that a GPU needs, or what is missing is said.
    let cuda = &machine["cuda"];
    let complete = !cuda["gpus"].as_array().unwrap().is_empty() && cuda["nvrtc"].is_string();
    assert_eq!(complete, cuda["problems"].as_array().unwrap().is_empty(), "{machine}");
    // What commands take without --device.
    assert_eq!(machine["device"].as_str().unwrap() == "cpu", !complete, "{machine}");
}

#[test]
fn bench_times_a_training_of_ones_own() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("mine.toml");
    std::fs::write(&config, "[train]\nenvironments = 16\nsteps = 4\n[ppo]\nepochs = 1\nminibatches = 2\n")
        .unwrap();
    let config = config.to_str().unwrap();
    let bench = json(&run(&["bench", "train", config, "--iterations", "1", "--device", "cpu", "--json"]));
    assert_eq!((bench["robot"].as_str(), bench["task"].as_str()), (Some("go2"), Some("velocity")));
    for (what, number) in [("environments", 16), ("steps", 4), ("epochs", 1), ("minibatches", 2)] {
        assert_eq!(bench[what], number, "{what}");
    }
    let output = run(&["bench", "train", "no-such.toml"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(errors(&output).contains("no-such.toml"), "{}", errors(&output));
}

#[test]
fn bench_prints_what_it_measured() {
    let bench = json(&run(&["bench", "physics", "--preset", "fast", "--geoms", "feet", "--json"]));
    assert!(bench["substeps_per_second"].as_f64().unwrap() > 0.0);
    assert_eq!((bench["preset"].as_str(), bench["geoms"].as_str()), (Some("fast"), Some("feet")));
    assert_eq!(bench["threads"], 1);
    assert!(bench["lanes"].as_u64().unwrap() >= 1);
    // Robots that fell over would measure another thing.
    assert!(bench["base_height_m"].as_f64().unwrap() > 0.15, "{bench}");
    assert_eq!(bench["own_pairs"], 0);
    let bench = json(&run(&["bench", "physics", "--self-contact", "limbs", "--json"]));
    assert_eq!(bench["own_pairs"], 6);
    assert!(bench["base_height_m"].as_f64().unwrap() > 0.15, "{bench}");
}

#[test]
fn shells_and_manuals_know_the_commands() {
    for shell in ["bash", "zsh", "fish"] {
        let script = String::from_utf8(run(&["completions", shell]).stdout).unwrap();
        assert!(script.contains("finetune") && script.contains("resume"), "{shell}");
    }
    let folder = tempfile::tempdir().unwrap();
    let man = folder.path().join("man");
    assert_eq!(run(&["man", man.to_str().unwrap()]).status.code(), Some(0));
    let page = std::fs::read_to_string(man.join("gaitfit-loop.1")).unwrap();
    assert!(page.contains("resume"), "{page}");
}

#[test]
fn a_policy_can_be_inspected() {
    let policy = "assets/go2-walk.safetensors";
    let shown = String::from_utf8(run(&["inspect", policy]).stdout).unwrap();
    assert!(shown.contains("base_angular_velocity") && shown.contains("FL_calf_joint"), "{shown}");
    assert_eq!(json(&run(&["inspect", policy, "--json"]))["control_dt"], 0.02);
}

#[test]
fn names_in_files_do_not_steer_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.csv");
    let rows: String = (0..50).map(|row| format!("{},0,0,0\n", 0.02 * f64::from(row))).collect();
    let name = "\u{1b}[2Jevil";
    std::fs::write(&path, format!("time,q_{name},dq_{name},qdes_{name}\n{rows}")).unwrap();
    for extra in [&[][..], &["--json"]] {
        let output = run(&[&["inspect", path.to_str().unwrap()], extra].concat());
        let said = [output.stdout, output.stderr].concat();
        assert!(String::from_utf8_lossy(&said).contains("evil"), "{}", String::from_utf8_lossy(&said));
        assert!(!said.contains(&0x1b), "{}", String::from_utf8_lossy(&said).escape_debug());
    }
}

#[test]
fn vector_instructions_can_be_chosen() {
    let bench = |set: &str| {
        run(&["bench", "train", "--environments", "32", "--iterations", "1", "--json", "--isa", set])
    };
    assert_eq!(json(&bench("portable"))["isa"], "portable");
    let wrong = bench("sse9");
    assert_eq!(wrong.status.code(), Some(2));
    assert!(errors(&wrong).contains("avx512"), "{}", errors(&wrong));
}

/// A desktop whose opener notes what it is given, or fails.
#[cfg(target_os = "linux")]
fn desktop(folder: &std::path::Path, fails: bool) -> std::path::PathBuf {
    use std::os::unix::fs::PermissionsExt;
    let (bin, opened) = (folder.join("bin"), folder.join("opened"));
    std::fs::create_dir_all(&bin).unwrap();
    let script =
        format!("#!/bin/sh\necho \"$1\" >> '{}'\nexit {}\n", opened.display(), if fails { 4 } else { 0 });
    let path = bin.join("xdg-open");
    std::fs::write(&path, script).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    opened
}

#[cfg(target_os = "linux")]
#[test]
fn pages_are_opened_where_that_is_asked_and_a_desktop_that_cannot_is_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let opened = desktop(folder.path(), false);
    let text = |name: &str| folder.path().join(name).display().to_string();
    let started = |args: &[String]| {
        let output = program().args(args).env("PATH", folder.path().join("bin")).output().unwrap();
        assert!(output.status.success(), "{args:?}: {}", errors(&output));
        errors(&output)
    };
    let words = |line: &[&str]| -> Vec<String> { line.iter().map(|&word| word.to_owned()).collect() };
    let (page, replay, plot) = (text("page.html"), text("replay.html"), text("plot.svg"));
    let policy = "assets/go2-walk.safetensors";
    let evaluate = ["evaluate", policy, "--trajectories", "2", "--seconds", "0.2", "--drift", "0"];
    let runs = format!("runs={}", folder.path().display());
    let train = ["train", "--name", "t", "--set", &runs, "--set", "train.iterations=1", "--set"];
    let small = ["train.environments=8", "--set", "train.steps=4"];
    let commands = [
        (words(&["inspect", "examples/go2-demo/fit.csv", "--plot", &plot]), plot.clone()),
        (words(&[&evaluate[..], &["--report", &page, "--replay", &replay]].concat()), page.clone()),
        (words(&[&evaluate[..], &["--replay", &replay]].concat()), replay.clone()),
        (words(&[&train[..], &small[..]].concat()), text("t/report.html")),
        (common::quick_demo(folder.path(), &["--name", "a"]), text("a/report.html")),
        (common::loops::args(folder.path(), common::loops::SIMULATED, &[]), text("l/report.html")),
    ];
    let mut wanted = String::new();
    for (command, file) in &commands {
        started(&[command.as_slice(), &["--open".to_owned()]].concat());
        wanted.push_str(file);
        wanted.push('\n');
        assert_eq!(std::fs::read_to_string(&opened).unwrap(), wanted, "{command:?}");
    }
    // Not asked, nothing is opened.
    started(&commands[0].0);
    assert_eq!(std::fs::read_to_string(&opened).unwrap(), wanted);

    desktop(folder.path(), true);
    let said = started(&[commands[0].0.as_slice(), &["--open".to_owned()]].concat());
    assert!(said.contains("warning: cannot open") && said.contains("plot.svg"), "{said}");
    let output = run(&["evaluate", policy, "--open"]);
    assert_eq!(output.status.code(), Some(2), "there is nothing to open");
    assert!(errors(&output).contains("--report"), "{}", errors(&output));
}
