//! Official MuJoCo moves what is exported as the engine moves the fitted robot.

use super::*;
use gaitfit_sim::{Cpu, Engine, Recording, Replay, ReplayOptions};
use std::sync::Mutex;

/// Position targets of a clamped robot: a slow wave on every joint about where it rests in the file.
fn recording(model: &Model, gains: &Gains) -> Recording {
    let joints = model.joints.len();
    let rest: Vec<f64> = model
        .joints
        .iter()
        .map(|joint| match joint.range {
            Some([low, high]) if low > 0.0 || high < 0.0 => 0.5 * (low + high),
            _ => joint.reference,
        })
        .collect();
    let dt = 0.005;
    let wave = |sample: usize, joint: usize| {
        0.15 * (std::f64::consts::TAU * 1.5 * dt * sample as f64 + joint as f64).sin()
    };
    let target =
        (0..300).flat_map(|sample| rest.iter().enumerate().map(move |(j, q)| q + wave(sample, j))).collect();
    Recording {
        dt,
        q0: rest.clone(),
        dq0: vec![0.0; joints],
        target,
        kp: gains.kp.clone(),
        kd: gains.kd.clone(),
    }
}

#[test]
#[ignore = "needs the Python packages of tools/setup_venv.sh"]
fn python_mujoco_moves_as_the_fitted_robot() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    // Without the table that stands in the arm: contacts are not compared here.
    let table = ARM.find("<body name=\"table\"").unwrap()..ARM.find("</worldbody>").unwrap();
    let arm = &format!("{}{}", &ARM[..table.start], &ARM[table.end..]);
    for (name, text, delay) in [
        ("go2", builtin::GO2, 0.0),
        ("humanoid", HUMANOID, 0.0),
        ("arm", arm, 0.0),
        ("go2", builtin::GO2, 0.0073),
        ("humanoid", HUMANOID, 0.0073),
        ("arm", arm, 0.0073),
    ] {
        let clamped = ReadOptions { root: Some(Root::Fixed), ..ReadOptions::default() };
        let model = read_mjcf_str(text, &clamped).unwrap();
        let file = theta_of(&model, delay);
        let candidate = file.candidate(&model).unwrap();
        let gains = gains(&model);
        let recording = recording(&model, &gains);
        let options = ReplayOptions { substeps: 20, preset: Preset::Converged, max_delay: 0.01, isa: None };
        let replay = Replay::new(&model, vec![recording.clone()], options).unwrap();
        let positions = Mutex::new(Vec::new());
        let robot = candidate.robot.clone();
        Cpu { threads: 1 }
            .replay(
                &replay,
                &[robot],
                &|_, _, signals| *positions.lock().unwrap() = signals.position.clone(),
                &|| false,
            )
            .unwrap();
        let floating = read_mjcf_str(text, &ReadOptions::default()).unwrap();
        let exported = files_of(&file, &floating, text, false, &candidate, Some(&gains), STEP).unwrap();
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in &exported.files {
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        std::fs::write(folder.path().join("original.xml"), text).unwrap();
        let given = serde_json::json!({
            "joints": model.joints.iter().map(|joint| &joint.name).collect::<Vec<_>>(), "target": recording.target,
            "q0": recording.q0, "bias": candidate.robot.joints(JointParameter::EncoderBias),
            "position": positions.into_inner().unwrap(), "kp": 30.0, "kd": 1.0, "drive": delay > 0.0,
        });
        std::fs::write(folder.path().join("given.json"), given.to_string()).unwrap();
        let output = std::process::Command::new(PathBuf::from(&root).join(".venv/bin/python"))
            .arg(root.join("tools/check_export.py"))
            .arg(folder.path())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success(), "{name}: {said}{}", String::from_utf8_lossy(&output.stderr));
        eprintln!("{name}, {}: {said}", if delay > 0.0 { "drive.py" } else { "robot.xml" });
    }
}
