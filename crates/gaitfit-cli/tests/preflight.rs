//! `gaitfit preflight`: what is refused, and a simulated robot that hangs, whose log and lines a fit takes as they are.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{errors, json, program, run};
use std::process::Stdio;

#[test]
fn what_cannot_be_checked_is_refused_before_anything_is_opened() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out").display().to_string();
    for (more, word) in [
        (&["--robot", "unitree-go2"][..], "--interface"),
        (&["--robot", "simulated", "--interface", "lo"], "in this program"),
        (&["--robot", "simulated", "--tilt"], "nobody can tilt"),
        (&["--robot", "simulated", "--seconds", "0"], "--seconds 0"),
        (&["--robot", "simulated", "--yes"], "--move"),
        (&["--robot", "simulated", "--move"], "no terminal"),
        (&["--robot", "unitree-go2", "--interface", "lo", "--move", "--yes"], "for simulators only"),
        (&["--robot", "unitree-go2", "--interface", "lo", "--tilt"], "no terminal"),
        (
            &["--robot", "unitree-g1", "--interface", "lo", "--model", "unitree-go2"],
            "no joint `left_hip_pitch`",
        ),
        (&["--robot", "spot"], "spot"),
    ] {
        let output =
            program().args(["preflight", "--out", &out]).args(more).stdin(Stdio::null()).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{more:?}: {}", errors(&output));
        assert!(errors(&output).contains(word), "{more:?}: {}", errors(&output));
    }
}

#[test]
fn a_simulated_robot_is_checked_on_the_clock_and_a_fit_takes_what_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("hung").display().to_string();
    // Rust and TOML write the combining accent as different escapes.
    let model = folder.path().join("go\u{301}2.xml");
    std::fs::copy(common::root().join("assets/go2.xml"), &model).unwrap();
    let model = model.display().to_string();
    let base = ["preflight", "--robot", "simulated", "--out", &out, "--seconds", "2", "--model", &model];
    let output = run(&[&base[..], &["--move", "--yes", "--patience", "1000", "--json"]].concat());
    let report = json(&output);
    // A machine that stands still for longer than a robot's patience is seen, and nothing else.
    let findings = report["findings"].as_array().unwrap();
    assert!(findings.iter().all(|one| one["check"] == "gaps"), "{findings:?}");
    assert!(output.status.success(), "{}", errors(&output));
    assert_eq!(report["moved"]["reason"], serde_json::Value::Null);
    assert_eq!(report["moved"]["joints"].as_array().unwrap().len(), 12);
    for name in ["preflight.json", "preflight.toml", "motion.csv", "listening/listening.csv"] {
        assert!(folder.path().join("hung").join(name).is_file(), "{name}");
    }
    // A second one would overwrite the log.
    let again = run(&base);
    assert_eq!(again.status.code(), Some(2), "{}", errors(&again));

    let lines = format!("{out}/preflight.toml");
    let runs = format!("runs={}", folder.path().display());
    // Simulated robots for the intervals, which nothing here reads, would take longer than the fit.
    let fitted = run(&["fit", &lines, "--json", "--set", &runs, "--set", "optimizer.replicates=0"]);
    // A verdict on the simulated robot is no matter of this test.
    assert!(matches!(fitted.status.code(), Some(0 | 3)), "{}", errors(&fitted));
    let result = json(&fitted);
    let value = |name: &str| {
        let all = result["parameters"].as_array().unwrap();
        all.iter().find(|one| one["name"] == name).unwrap()["value"].as_f64().unwrap()
    };
    // Those of the simulated robot. On a busy machine targets come late, and a log at 500 Hz shows it.
    for (name, truth, off) in [
        ("frictionloss_hip", 0.2, 0.06),
        ("frictionloss_calf", 0.6, 0.15),
        ("armature_hip", 0.015, 0.008),
        ("armature_calf", 0.048, 0.02),
        ("delay", 0.001, 0.004),
    ] {
        assert!((value(name) - truth).abs() < off, "{name} {}", value(name));
    }
}
