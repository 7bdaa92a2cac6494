//! `gaitfit export`: policies between formats.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, json, root, run};

const FOREIGN: &str = "crates/gaitfit-policy-files/tests/fixtures/policies/foreign.toml";

#[test]
fn a_policy_trained_elsewhere_becomes_files_that_are_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (onnx, weights) = (path("a.onnx"), path("a.safetensors"));
    let document = json(&run(&["export", FOREIGN, "--onnx", &onnx, "--safetensors", &weights, "--json"]));
    assert_eq!(document["actor"]["layers"], serde_json::json!([45, 16, 8, 12]));
    assert_eq!(document["written"], serde_json::json!([onnx, weights]));
    assert_eq!(document["joints"][1]["name"], "FR_hip_joint");
    assert_eq!(document["observation"][4]["start"], 21);
    for file in [&onnx, &weights] {
        let again = json(&run(&["export", file, "--json"]));
        for key in ["actor", "observation", "joints", "control_dt"] {
            assert_eq!(again[key], document[key], "{key} of {file}");
        }
    }
    let text = String::from_utf8(run(&["export", &weights]).stdout).unwrap();
    for word in ["policy for go2", "45-16-8-12 elu", "joint_velocity", "21..33", "0.05", "trained elsewhere"]
    {
        assert!(text.contains(word), "`{word}` is not in:\n{text}");
    }
}

#[test]
fn bad_input_and_bad_names_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (out, cut) = (path("a.onnx"), path("cut.safetensors"));
    assert!(run(&["export", FOREIGN, "--safetensors", &cut]).status.success());
    let bytes = std::fs::read(&cut).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let cases = [
        (vec!["export", &cut, "--onnx", &out], 1, "cut short"),
        (vec!["export", "none.onnx", "--onnx", &out], 1, "cannot read none.onnx"),
        (vec!["export", "assets/go2.xml", "--onnx", &out], 1, "no policy by its ending"),
        (vec!["export", FOREIGN, "--onnx", &cut], 2, "ends in .onnx"),
        (vec!["export", FOREIGN, "--onnx", "/dev/null/a.onnx"], 1, "cannot write"),
    ];
    for (args, code, message) in cases {
        let output = run(&args);
        let error = errors(&output);
        assert_eq!(output.status.code(), Some(code), "{error}");
        assert!(error.contains(message), "`{message}` is not in `{error}`");
    }
    assert!(!folder.path().join("a.onnx").exists());
    // Neither the policy nor the weights that its description names are replaced.
    let fixtures = common::root().join("crates/gaitfit-policy-files/tests/fixtures/policies");
    let text = std::fs::read_to_string(fixtures.join("foreign.toml")).unwrap();
    let weights =
        text.lines().find_map(|line| line.strip_prefix("file = ")).unwrap().trim_matches('"').to_owned();
    std::fs::copy(fixtures.join(&weights), path(&weights)).unwrap();
    std::fs::write(path("p.toml"), text).unwrap();
    let option = if weights.ends_with(".onnx") { "--onnx" } else { "--safetensors" };
    let before = std::fs::read(path(&weights)).unwrap();
    let output = run(&["export", &path("p.toml"), option, &path(&weights)]);
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
    assert!(errors(&output).contains("would replace a file that this command reads"), "{}", errors(&output));
    assert_eq!(std::fs::read(path(&weights)).unwrap(), before);
}

#[test]
fn a_policy_becomes_a_bundle_and_cpp_and_nothing_is_replaced_silently() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (bundle, cpp) = (path("new/bundle"), path("cpp"));
    let walk = "assets/go2-walk.safetensors";
    let document = json(&run(&["export", walk, "--bundle", &bundle, "--cpp", &cpp, "--json"]));
    let names = ["exported/policy.onnx", "controller.yaml", "params/deploy.yaml"]
        .map(|name| format!("{bundle}/{name}"));
    let written: Vec<String> = serde_json::from_value(document["written"].clone()).unwrap();
    assert_eq!(written, [&names[..], &[format!("{cpp}/policy.hpp"), format!("{cpp}/example.cpp")]].concat());
    // The built-in Go2 gives its effort limits to its own policy.
    let yaml = std::fs::read_to_string(&names[1]).unwrap();
    assert!(yaml.contains("effort_limit: [23.7, 23.7, 45.43,"), "{yaml}");
    let not_said: Vec<String> = serde_json::from_value(document["not_said"].clone()).unwrap();
    assert!(not_said.iter().any(|line| line.contains("Unitree's SDK")), "{not_said:?}");
    let again = json(&run(&["export", &names[0], "--json"]));
    for key in ["observation", "joints", "control_dt"] {
        assert_eq!(again[key], document[key], "{key}");
    }
    // What is there stays, and says so.
    std::fs::write(&names[2], "mine").unwrap();
    let output = run(&["export", walk, "--bundle", &bundle]);
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
    assert!(
        errors(&output).contains("exists already; give another --bundle, or --force"),
        "{}",
        errors(&output)
    );
    assert_eq!(std::fs::read_to_string(&names[2]).unwrap(), "mine");
    let output = run(&["export", walk, "--bundle", &bundle, "--force"]);
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    assert!(output.status.success() && text.contains("not included: "), "{text}{}", errors(&output));
    assert_ne!(std::fs::read_to_string(&names[2]).unwrap(), "mine");
    // Not even --force replaces the policy that is read.
    let output = run(&["export", &names[0], "--bundle", &bundle, "--force"]);
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
    assert!(errors(&output).contains("would replace a file that this command reads"), "{}", errors(&output));

    // With a robot the header has its effort limits.
    let limited = path("limited");
    let robot = ["export", walk, "--cpp", &limited, "--robot", "assets/go2.xml", "--json"];
    let not_said = json(&run(&robot))["not_said"].to_string();
    assert!(!not_said.contains("effort limits"), "{not_said}");
    let header = std::fs::read_to_string(format!("{limited}/policy.hpp")).unwrap();
    assert!(header.contains("kEffortLimit[kJoints]") && header.contains("4.543e1f"), "effort limits");

    let onnx = path("not-written.onnx");
    let lstm = "crates/gaitfit-policy-files/tests/fixtures/policies/lstm.toml";
    let (fresh, text_file) = (path("fresh"), path("a.txt"));
    for (args, code, message) in [
        (vec!["export", walk, "--cpp", "README.md"], 2, "is a file; name the folder"),
        (vec!["export", walk, "--force"], 2, "--force is for --bundle and --cpp"),
        (vec!["export", walk, "--onnx", &onnx, "--robot", "assets/go2.xml"], 2, "are for --bundle and --cpp"),
        (vec!["export", walk, "--bundle", &fresh, "--lenient"], 2, "--robot"),
        (vec!["export", walk, "--bundle", &fresh, "--robot", "none.xml"], 1, "none.xml"),
        (vec!["export", walk, "--bundle", "/dev/null/bundle"], 1, "cannot make"),
        (vec!["export", lstm, "--bundle", &fresh], 1, "`--cpp` writes them as C++"),
        (vec!["export", walk, "--onnx", &text_file, "--bundle", &fresh], 2, "ends in .onnx"),
    ] {
        let output = run(&args);
        let error = errors(&output);
        assert_eq!(output.status.code(), Some(code), "{args:?}: {error}");
        assert!(error.contains(message), "`{message}` is not in `{error}`");
        assert!(!folder.path().join("fresh").exists(), "{args:?}");
    }
}

#[test]
fn recordings_become_logs_and_logs_become_recordings() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (log, mcap, again) = (path("a.csv"), path("a.mcap"), path("b.csv"));
    let fixtures = "crates/gaitfit-import/tests/fixtures";
    let recording = format!("{fixtures}/unitree_go.mcap");
    let text = String::from_utf8(run(&["import", &recording, "--out", &log]).stdout).unwrap();
    for word in [
        "/lowstate",
        "/lowcmd",
        "assumed: motors are those of a Unitree Go2",
        "12 joints, 40 samples at 200 Hz",
    ] {
        assert!(text.contains(word), "`{word}` is not in:\n{text}");
    }
    assert!(run(&["export-log", &log, "--out", &mcap]).status.success());
    let report = json(&run(&["import", &mcap, "--out", &again, "--json"]));
    assert_eq!((&report["samples"], &report["rate_hz"]), (&40.into(), &200.0.into()));
    let body = |path: &str| std::fs::read_to_string(path).unwrap();
    assert_eq!(body(&log), body(&again));

    let pace = format!("{fixtures}/pace.pt");
    let output = run(&["import", &pace, "--out", &log]);
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
    assert!(errors(&output).contains("joints = [...]"));
    let report = json(&run(&["import", &pace, "--robot", "assets/go2.xml", "--out", &log, "--json"]));
    assert_eq!(report["joints"].as_array().unwrap().len(), 12);
    let odd = format!("{fixtures}/odd.csv");
    let mapping = format!("{fixtures}/odd.toml");
    assert!(run(&["import", &odd, "--mapping", &mapping, "--out", &log]).status.success());
    assert!(body(&log).contains("# kp = [20.0"));

    // The G1's motors are not the Go2's, though the first of them could be.
    let humanoid = format!("{fixtures}/unitree_hg.mcap");
    let output = run(&["import", &humanoid, "--robot", "assets/go2.xml", "--out", &path("g1.csv")]);
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
    for part in ["motors 12 to 28 move", "only 12 are named", "go2", "--robot", "joints = [...]"] {
        assert!(errors(&output).contains(part), "{part}: {}", errors(&output));
    }
    assert!(!folder.path().join("g1.csv").exists());
    let output = run(&["import", &recording, "--take", "/lowstat", "--out", &log]);
    assert_eq!(output.status.code(), Some(1), "{}", errors(&output));
    assert!(errors(&output).contains("`/lowstat`, which `--take`"), "{}", errors(&output));
    let output = run(&["import", &pace, "--robot", "assets/go2.xml", "--clock-offset", "0.1", "--out", &log]);
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
    assert!(errors(&output).contains("--clock-offset"), "{}", errors(&output));

    // A rate is for recordings without times; a log that cannot be used is no success.
    let output = run(&["import", &recording, "--rate", "50", "--out", &log]);
    assert_eq!(output.status.code(), Some(1), "{}", errors(&output));
    assert!(errors(&output).contains("200.0 samples a second, not 50"), "{}", errors(&output));
    let gap = folder.path().join("gap.csv");
    std::fs::write(&gap, "time,q_a,dq_a\n0,0,0\n0.01,0.1,0\n0.02,nan,0\n0.03,0.3,0\n").unwrap();
    let output = run(&["import", &gap.display().to_string(), "--out", &log]);
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
}

#[test]
fn fitted_parameters_become_files_of_other_simulators() {
    let folder = tempfile::tempdir().unwrap();
    let theta = folder.path().join("theta.toml");
    let text = "format = 2\nrobot = \"go2\"\n[[parameter]]\nname = \"delay\"\nkind = \"delay\"\njoints = [\"FL_hip\"]\n\
                value = 0.01\nunit = \"s\"\n[[parameter]]\nname = \"armature\"\nkind = \"armature\"\njoints = \
                [\"FL_hip_joint\"]\nvalue = 0.02\nunit = \"kg·m²\"\ninterval = [0.019, 0.021]\nidentified = true\n";
    std::fs::write(&theta, text).unwrap();
    let (theta, out) = (theta.display().to_string(), folder.path().join("out"));
    let shown = out.display().to_string();
    let output = run(&["export-theta", &theta, "--kp", "25", "--kd", "0.5", "--out", &shown]);
    let text = String::from_utf8(output.stdout.clone()).unwrap();
    assert!(output.status.success(), "{}", errors(&output));
    assert!(text.contains("0.01900 to 0.02100") && text.contains("theta.json and code"), "{text}");
    let robot = std::fs::read_to_string(out.join("robot.xml")).unwrap();
    assert!(robot.contains("armature=\"0.02\"") && robot.contains("gainprm=\"25.0\""), "{robot}");
    assert!(std::fs::read_to_string(out.join("isaac_lab.py")).unwrap().contains("max_delay=2"));
    assert!(run(&["inspect", &out.join("robot.xml").display().to_string()]).status.success());
    let output = run(&["export-theta", &theta, "--kp", "25", "--out", &shown]);
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));

    // What another simulator would take for something else is refused, with the file and the parameter.
    let text = std::fs::read_to_string(&theta).unwrap();
    let odd = folder.path().join("odd.toml");
    for (from, to, part) in [
        ("[0.019, 0.021]", "[0.021, 0.019]", "`armature` has the interval [0.021, 0.019]"),
        ("[0.019, 0.021]", "[nan, 0.021]", "lower end first"),
        ("\"s\"", "\"ms\"", "`delay` is in `ms`, and delay is in `s`"),
        ("value = 0.01", "value = 100", "`delay` is 100; it must be a number from 0 to 1"),
        ("value = 0.01", "value = \"x\"", "line 7, column 9"),
    ] {
        std::fs::write(&odd, text.replace(from, to)).unwrap();
        let output = run(&["export-theta", &odd.display().to_string(), "--out", &shown]);
        let said = errors(&output);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains(part) && said.contains("odd.toml"), "{said}");
    }
    for (gain, part) in [("1e300", "from 0 to 1e6"), ("-1", "not negative"), ("nan", "finite")] {
        let kp = format!("--kp={gain}");
        let output = run(&["export-theta", &theta, &kp, "--kd", "0.5", "--out", &shown]);
        assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
        assert!(errors(&output).contains("--kp") && errors(&output).contains(part), "{}", errors(&output));
    }

    // The robot's own file is not replaced, whatever its name.
    let own = folder.path().join("robot.xml");
    std::fs::copy(root().join("assets/go2.xml"), &own).unwrap();
    let before = std::fs::read(&own).unwrap();
    let (own_path, beside) = (own.display().to_string(), folder.path().display().to_string());
    let output = run(&["export-theta", &theta, "--robot", &own_path, "--out", &beside]);
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
    assert!(errors(&output).contains("would replace"), "{}", errors(&output));
    assert_eq!(std::fs::read(&own).unwrap(), before);
}

/// `ulimit -f`, in blocks of 512 or 1,024 bytes.
#[cfg(unix)]
#[test]
fn a_file_beyond_the_limit_of_file_sizes_is_named_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("policy.onnx");
    let program = env!("CARGO_BIN_EXE_gaitfit");
    let policy = common::root().join("assets/go2-walk.safetensors");
    let line = format!("ulimit -f 8; exec {program} export {} --onnx {}", policy.display(), out.display());
    let output = std::process::Command::new("bash").args(["-c", &line]).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{:?} {}", output.status, errors(&output));
    let error = errors(&output);
    assert!(error.contains("policy.onnx") && error.contains("`ulimit -f`"), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "a temporary file");
}
