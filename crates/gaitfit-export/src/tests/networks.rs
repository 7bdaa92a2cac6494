//! Networks on joints as files.

use super::*;
use gaitfit_physics::{NETWORK_WEIGHTS, NetworkScales};

/// Weights of a network, no two alike.
fn weights(number: usize) -> [f64; NETWORK_WEIGHTS] {
    std::array::from_fn(|i| 0.8 * (0.7 * i as f64 + number as f64).sin())
}

/// Rest angle and scales of the networks in [`with_networks`].
const REST: f64 = 0.8;
const SCALES: NetworkScales = NetworkScales { position: 1.5, velocity: 0.1, output: 0.7 };

/// y = W₃ tanh(W₂ tanh(W₁ x + b₁) + b₂) + b₃, as the physics' own test has it.
fn output(weights: &[f64], motion: [[f64; 2]; 3]) -> f64 {
    let mut x: Vec<f64> =
        motion.iter().flat_map(|[q, dq]| [(q - REST) * SCALES.position, dq * SCALES.velocity]).collect();
    let mut rest = weights;
    for (layer, outputs) in [8, 4, 1].into_iter().enumerate() {
        let (matrix, after) = rest.split_at(x.len() * outputs);
        let (bias, after) = after.split_at(outputs);
        let sum = |unit: usize| {
            let terms = x.iter().enumerate().map(|(input, x)| x * matrix[input * outputs + unit]);
            bias[unit] + terms.sum::<f64>()
        };
        x = (0..outputs).map(|unit| if layer < 2 { sum(unit).tanh() } else { sum(unit) }).collect();
        rest = after;
    }
    assert!(rest.is_empty());
    SCALES.output * x[0]
}

/// A theta.toml of the Go2 with a network of each kind.
fn with_networks() -> ThetaFile {
    let mut text = "format = 2\nrobot = \"go2\"\nphysics_step = 0.005\n".to_owned();
    for (number, (kind, joint)) in
        [("action_delta", "FL_hip"), ("resid_act", "RR_calf")].into_iter().enumerate()
    {
        text.push_str(&format!(
            "[[network]]\nname = \"{kind}_{joint}\"\nkind = \"{kind}\"\njoint = \"{joint}\"\nrest = {REST:?}\n\
             position_scale = {:?}\nvelocity_scale = {:?}\noutput_scale = {:?}\nweights = {:?}\n",
            SCALES.position,
            SCALES.velocity,
            SCALES.output,
            weights(number)
        ));
    }
    ThetaFile::parse(&text).unwrap()
}

#[test]
fn networks_are_files_of_their_own() {
    let (exported, folder) = written(&with_networks());
    let names: Vec<&str> = exported.files.iter().map(|(name, _)| name.as_str()).collect();
    for name in ["action_delta_FL_hip.onnx", "resid_act_RR_calf.onnx", "networks.npz", "networks.py"] {
        assert!(names.contains(&name), "{name}: {names:?}");
    }
    let archive = std::fs::File::open(folder.path().join("networks.npz")).unwrap();
    let mut archive = zip::ZipArchive::new(archive).unwrap();
    assert_eq!(archive.len(), 2 * 8);
    let factor = npyz::NpyFile::new(archive.by_name("resid_act_RR_calf/factor.npy").unwrap()).unwrap();
    assert_eq!(factor.into_vec::<f64>().unwrap(), [1.5, 0.1, 1.5, 0.1, 1.5, 0.1]);
    // Names that are the same once they are names of files.
    let mut alike = with_networks();
    (alike.network[0].name, alike.network[1].name) = ("a_2".to_owned(), "A".to_owned());
    let third = gaitfit_adapt::SavedNetwork {
        name: "a".to_owned(),
        joint: "FL_calf".to_owned(),
        ..alike.network[1].clone()
    };
    alike.network.insert(1, third);
    let names: Vec<String> = written(&alike).0.files.into_iter().map(|(name, _)| name).collect();
    // Also on file systems that take `a` and `A` for one name.
    let onnx: std::collections::HashSet<String> =
        names.iter().filter(|name| name.ends_with(".onnx")).map(|name| name.to_lowercase()).collect();
    assert_eq!(onnx.len(), 3, "{names:?}");
    // The same fit gives the same bytes, and a fit without networks none of these files.
    assert_eq!(written(&with_networks()).0.files, exported.files);
    let model = read_mjcf_str(builtin::GO2, &ReadOptions::default()).unwrap();
    assert!(!written(&theta_of(&model, 0.0)).0.files.iter().any(|(name, _)| name.contains("network")));
}

#[test]
#[ignore = "needs the Python packages of tools/setup_venv.sh"]
fn python_networks_give_the_fits_outputs() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let (_, folder) = written(&with_networks());
    // Angles of a joint that moves by half a radian, velocities of up to 6 rad/s.
    let motion = |i: usize| {
        let at = |back: f64| [0.8 + 0.5 * (0.3 * i as f64 - back).sin(), 6.0 * (0.5 * i as f64 - back).cos()];
        [at(0.0), at(0.2), at(0.4)]
    };
    std::fs::write(
        folder.path().join("motion.json"),
        serde_json::json!((0..200).map(|i| motion(i).concat()).collect::<Vec<_>>()).to_string(),
    )
    .unwrap();
    let script = "
import json, pathlib, sys
import numpy as np, onnxruntime
folder = pathlib.Path(sys.argv[1])
sys.path.insert(0, str(folder))
import networks
motion = np.array(json.loads((folder / 'motion.json').read_text()))
out = {}
for name, network in networks.load().items():
    session = onnxruntime.InferenceSession(str(folder / f'{name}.onnx'), providers=['CPUExecutionProvider'])
    found = session.run(['actions'], {'obs': motion.astype(np.float32)})[0][:, 0]
    out[name] = {'numpy': network(motion).tolist(), 'onnx': found.tolist()}
print(json.dumps(out))
";
    let outputs: serde_json::Value =
        serde_json::from_str(&python(root.join(".venv/bin/python"), script, folder.path())).unwrap();
    for (number, name) in ["action_delta_FL_hip", "resid_act_RR_calf"].into_iter().enumerate() {
        let want: Vec<f64> = (0..200).map(|i| output(&weights(number), motion(i))).collect();
        let span = want.iter().fold(0.0f64, |max, y| max.max((y - want[0]).abs()));
        assert!(span > 0.1, "{span}");
        for (kind, tolerance) in [("numpy", 1e-12), ("onnx", 1e-6)] {
            let values: Vec<f64> = serde_json::from_value(outputs[name][kind].clone()).unwrap();
            let apart = values.iter().zip(&want).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(values.len() == 200 && apart <= tolerance, "{name}, {kind}: {apart:e}");
            eprintln!("{name}, {kind}: at most {apart:.1e} apart, outputs over {span:.2}");
        }
    }
}
