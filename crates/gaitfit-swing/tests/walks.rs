//! The example's walks, recorded in MuJoCo with joints that are known.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use gaitfit_log::{ReadOptions, Trajectory, read_csv};
use gaitfit_swing::{Standing, SwingSettings, estimate, usual_groups};
use std::path::Path;

fn logs(count: usize) -> Vec<Trajectory> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/go2-ground/logs");
    let log = |k: usize| read_csv(&folder.join(format!("trajectory_{k:02}.csv")), &ReadOptions::default());
    (0..count).map(|k| log(k).unwrap()).collect()
}

/// Friction 0.2, 0.15, 0.1 N·m, armature 0.02, 0.02, 0.05 kg·m², delay 10 ms, torque noise 1 N·m, and a spring at one calf
/// (robot.toml beside the logs), recorded at 50 Hz with four digits.
#[test]
fn swings_of_walks_show_the_joints() {
    let model = gaitfit_model::builtin::go2().unwrap();
    let logs = logs(6);
    // The calf with the spring is another joint than its siblings.
    let mut groups = usual_groups(&model);
    groups[2].1.retain(|&joint| model.joints[joint].name != "RR_calf_joint");
    let settings = SwingSettings { clearances_m: vec![0.03], groups, ..SwingSettings::default() };
    let report = estimate(&model, &logs.iter().collect::<Vec<_>>(), &settings).unwrap();
    assert!((report.delay.value - 0.0095).abs() < 0.0015, "{:?}", report.delay);
    for (group, (friction, armature)) in report.groups.iter().zip([(0.2, 0.02), (0.15, 0.02), (0.1, 0.05)]) {
        assert!((group.friction.value - friction).abs() < 0.15, "{group:?}");
        assert!((group.armature.value / armature - 1.0).abs() < 0.08, "{group:?}");
        assert!(group.damping.value.abs() < 0.06, "{group:?}");
        assert!(group.swings > 30, "{group:?}");
    }
}

#[test]
fn a_level_unit_is_level_and_a_tilted_one_is_turned_back() {
    let model = gaitfit_model::builtin::go2().unwrap();
    let mut logs = logs(4);
    let tilt = |logs: &[Trajectory]| {
        Standing::new(&model, &logs.iter().collect::<Vec<_>>(), 2).unwrap().tilt.unwrap()
    };
    assert!(tilt(&logs).iter().all(|axis| axis.value.abs() < 0.006));
    let (roll, pitch) = (1.7f64.to_radians(), 1.2f64.to_radians());
    let angle = roll.hypot(pitch);
    let turn = gaitfit_model::rotation::axis_angle([roll / angle, pitch / angle, 0.0], angle);
    for log in &mut logs {
        for quaternion in log.base.as_mut().unwrap().quaternion.as_mut().unwrap().chunks_exact_mut(4) {
            let turned = gaitfit_model::rotation::product(gaitfit_model::rotation::quat_of(quaternion), turn);
            quaternion.copy_from_slice(&turned);
        }
    }
    let estimate = tilt(&logs);
    assert!(
        (estimate[0].value - roll).abs() < 0.007 && (estimate[1].value - pitch).abs() < 0.007,
        "{estimate:?}"
    );
    let standing = Standing { tilt: Some(estimate) };
    let level: Vec<Trajectory> = logs.iter().map(|log| standing.corrected(log).0).collect();
    assert!(tilt(&level).iter().all(|axis| axis.value.abs() < 0.006), "{:?}", tilt(&level));
}
