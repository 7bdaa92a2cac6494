//! Walks of a real robot and of another simulator.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_log::{ReadOptions, Sensors, Trajectory, read_csv};
use gaitfit_swing::{Standing, SwingReport, SwingSettings, estimate};
use std::path::Path;
use std::process::Command;

/// Unpacks the walks, and reads those of `folder` whose names end in `ending`.
fn logs(folder: &str, ending: &str) -> Vec<Trajectory> {
    let archive = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/go2_walk.tar.xz");
    let place = tempfile::tempdir().unwrap();
    let done = Command::new("tar").arg("xJf").arg(&archive).arg("-C").arg(place.path()).status().unwrap();
    assert!(done.success(), "tar could not unpack {}", archive.display());
    let mut files: Vec<_> = std::fs::read_dir(place.path().join("go2_walk").join(folder))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.to_string_lossy().ends_with(ending))
        .collect();
    files.sort();
    assert!(!files.is_empty(), "no walks in {folder}");
    files.iter().map(|path| read_csv(path, &ReadOptions::default()).unwrap()).collect()
}

fn swings(logs: &[Trajectory]) -> SwingReport {
    let model = gaitfit_model::builtin::go2().unwrap();
    estimate(&model, &logs.iter().collect::<Vec<_>>(), &SwingSettings::default()).unwrap()
}

#[test]
#[ignore = "needs the walks of a real Go2 in ../shared/data"]
fn shared_two_trials_of_a_real_robot_show_the_same_joints() {
    let (one, two) = (logs("real", "trial1.csv"), logs("real", "trial2.csv"));
    let reports = [swings(&one), swings(&two)];
    for report in &reports {
        // As legs of another Go2 in the air show, within a factor of 1.5.
        for (group, friction) in report.groups.iter().zip([0.18, 0.14, 0.60]) {
            let [low, high] = group.friction.interval();
            assert!(low < 1.5 * friction && high > friction / 1.5, "{group:?}");
            assert!(group.friction.error < 0.2, "{group:?}");
            assert!(group.damping.holds(0.0) || group.damping.value.abs() < 0.15, "{group:?}");
        }
        assert!((0.004..0.0125).contains(&report.delay.value), "{:?}", report.delay);
    }
    for (one, two) in reports[0].groups.iter().zip(&reports[1].groups) {
        for (a, b) in [(one.friction, two.friction), (one.damping, two.damping), (one.armature, two.armature)]
        {
            assert!((a.value - b.value).abs() < 2.0 * a.error.hypot(b.error), "{}: {a:?} {b:?}", one.group);
        }
    }
    let all: Vec<&Trajectory> = one.iter().chain(&two).collect();
    let lag = Sensors::new(&all).velocity_lag.unwrap();
    assert!(lag.value.abs() < 0.001, "{lag:?}");
    let tilt = Standing::new(&gaitfit_model::builtin::go2().unwrap(), &all, 1).unwrap().tilt.unwrap();
    assert!(tilt.iter().all(|axis| axis.value.to_degrees().abs() < 0.5), "{tilt:?}");
}

#[test]
#[ignore = "needs walks in Isaac Sim in ../shared/data"]
fn shared_joints_without_friction_have_none() {
    let report = swings(&logs("isaac", "sim.csv"));
    for group in &report.groups {
        assert!(group.friction.value.abs() < 0.1, "{group:?}");
        assert!(group.armature.value.abs() < 0.01, "{group:?}");
    }
    // An action acts from the row before on.
    assert!((-0.009..-0.003).contains(&report.delay.value), "{:?}", report.delay);
}
