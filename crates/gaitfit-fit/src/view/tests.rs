//! A clamped log and a walk beside their simulations.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::*;
use crate::walk::fixtures;
use std::fs;

/// The repository.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Data of the page's replay.
fn frames(html: &str) -> Vec<(String, u64)> {
    let start = html.find(r#"id="replay">"#).unwrap() + r#"id="replay">"#.len();
    let end = start + html[start..].find("</script>").unwrap();
    let data: serde_json::Value = serde_json::from_str(&html[start..end]).unwrap();
    let robots = data["robots"].as_array().unwrap();
    robots
        .iter()
        .map(|robot| (robot["name"].as_str().unwrap().to_owned(), robot["frames"].as_u64().unwrap()))
        .collect()
}

#[test]
fn a_fit_brings_the_simulator_nearer_to_a_clamped_log() {
    let folder = tempfile::tempdir().unwrap();
    let theta = folder.path().join("theta.toml");
    // The parameters behind the log.
    let parameter = |kind: &str, joints: &str, value: f64| {
        format!(
            "[[parameter]]\nname = \"{kind}{}\"\nkind = \"{kind}\"\njoints = [\"{joints}\"]\nvalue = {value}\n",
            joints.len()
        )
    };
    let mut text = format!("format = 2\n{}", parameter("delay", "*", 0.007));
    for (kind, values) in [
        ("frictionloss", [0.21, 0.17, 0.62]),
        ("armature", [0.015, 0.019, 0.047]),
        ("damping", [0.19, 0.22, 0.31]),
    ] {
        for (joints, value) in ["*_hip*", "*_thigh*", "*_calf*"].into_iter().zip(values) {
            text += &parameter(kind, joints, value);
        }
    }
    fs::write(&theta, text).unwrap();
    let settings = ViewSettings {
        log: root().join("examples/go2-demo/validate.csv"),
        robot: Some(root().join("assets/go2.xml")),
        from_s: 1.0,
        seconds: Some(4.0),
        threads: Some(1),
        ..ViewSettings::default()
    };
    let nominal = view(&settings).unwrap();
    assert!(
        nominal.distance_rad[0].unwrap() > 0.01 && nominal.distance_rad[1].is_none(),
        "{}",
        nominal.headline
    );
    let robots = frames(&nominal.html);
    assert_eq!(robots.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["log", "robot file"]);
    assert!((190..=241).contains(&robots[0].1), "four seconds at up to 60 frames a second: {robots:?}");
    assert_eq!(nominal.html.matches("<figcaption>").count(), 12, "a chart a joint");
    assert!(nominal.html.contains("gaitfit-seek"), "curves and clock are joined");
    let fitted = view(&ViewSettings { theta: Some(theta), ..settings }).unwrap();
    let [Some(before), Some(after)] = fitted.distance_rad else { panic!("{}", fitted.headline) };
    assert_eq!(Some(before), nominal.distance_rad[0]);
    assert!(after < 0.25 * before, "{}", fitted.headline);
    assert_eq!(frames(&fitted.html)[1].0, "fitted simulator");
}

#[test]
fn a_walk_is_simulated_by_its_policy_and_shown_alone_without() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let scene = fixtures::scene();
    let policy = fixtures::policy(&scene, 3);
    fs::write(path("policy.safetensors"), gaitfit_policy_files::weights::write(&policy).unwrap()).unwrap();
    let mut log = fixtures::puppet(&policy, 1, 3.0);
    log.robot = Some("go2".into());
    gaitfit_log::write_csv(&path("walk.csv"), &log).unwrap();
    let settings = ViewSettings { log: path("walk.csv"), threads: Some(1), ..ViewSettings::default() };
    let alone = view(&settings).unwrap();
    assert_eq!(alone.distance_rad, [None, None]);
    assert!(alone.warnings.iter().any(|warning| warning.contains("--policy")), "{:?}", alone.warnings);
    assert_eq!(frames(&alone.html).len(), 1);
    let with = ViewSettings { policy: Some(path("policy.safetensors")), ..settings.clone() };
    let both = view(&with).unwrap();
    assert!(both.distance_rad[0].is_some(), "{}", both.headline);
    let robots = frames(&both.html);
    assert_eq!(robots.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["log", "robot file"]);
    assert_eq!(robots[0].1, robots[1].1, "one clock");
    // A policy that remembers its robot's file.
    let robot = root().join("assets/go2.xml").canonicalize().unwrap();
    let mut named = policy.clone();
    named.provenance.robot_file = Some(crate::robot_file::record(&robot, false).unwrap());
    fs::write(path("named.safetensors"), gaitfit_policy_files::weights::write(&named).unwrap()).unwrap();
    let again = view(&ViewSettings { policy: Some(path("named.safetensors")), ..settings.clone() }).unwrap();
    assert_eq!(again.distance_rad, both.distance_rad);
    let late = ViewSettings { from_s: 50.0, ..with };
    assert!(view(&late).unwrap_err().to_string().contains("--from"));
}

#[test]
fn a_strange_robot_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("log.csv");
    let rows: String = (0..30).map(|k| format!("{},0.1,0.0,0.1\n", 0.01 * f64::from(k))).collect();
    fs::write(&log, format!("time,q_left_knee,dq_left_knee,qdes_left_knee\n{rows}")).unwrap();
    let error = view(&ViewSettings { log, ..ViewSettings::default() }).unwrap_err().to_string();
    assert!(error.contains("--robot FILE") && error.contains("left_knee"), "{error}");
}
