//! Policies as PyTorch's default exporter writes them: fixtures of `tools/make_export_fixtures.py`.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{act, fixture, largest_difference, rows};
use gaitfit_policy::network::{Activation, Scratch};
use gaitfit_policy::{ActionClip, Front, Policy};
use gaitfit_policy_files::{files_of, read};
use std::path::Path;

fn exported(name: &str) -> Policy {
    read(&fixture(&format!("exported/{name}.toml"))).unwrap()
}

/// How far the policy's actions, clipped as its interface says, are from onnxruntime's.
fn difference(name: &str, policy: &Policy) -> f32 {
    let [observation, wanted] = rows(&format!("exported/{name}_rows.json"));
    let mut actions = match &policy.front {
        None => act(policy, &observation),
        Some(_) => along(policy, &observation),
    };
    let joints = policy.interface.joints.len();
    for row in actions.chunks_exact_mut(joints) {
        for (joint, action) in row.iter_mut().enumerate() {
            let clip = policy.interface.clip(joint) as f32;
            *action = action.clamp(-clip, clip);
        }
    }
    largest_difference(&actions, &wanted)
}

/// Actions along a sequence of rows of one robot.
fn along(policy: &Policy, observation: &[f32]) -> Vec<f32> {
    let (mut memory, mut scratch) = (policy.memory(1), Scratch::default());
    let mut actions = Vec::new();
    for row in observation.chunks_exact(policy.interface.observation_width()) {
        let mut action = vec![f32::NAN; policy.interface.joints.len()];
        policy.act_with(1, row, &mut memory, &mut action, &mut scratch);
        actions.extend(action);
    }
    actions
}

#[test]
fn a_clip_behind_the_layers_is_the_action_clip() {
    for name in ["clip", "clip_scaled"] {
        let policy = exported(name);
        assert_eq!(policy.interface.action_clip, Some(ActionClip::All(1.0)), "{name}");
        assert!(difference(name, &policy) < 1e-5, "{name}: {}", difference(name, &policy));
        let [_, wanted] = rows(&format!("exported/{name}_rows.json"));
        assert!(wanted.contains(&1.0) && wanted.iter().any(|action| action.abs() < 0.9), "some are clipped");
        let note = policy.notes.join("; ");
        assert!(note.contains("action_clip (±1)") && note.contains("last_action"), "{note}");
    }
}

#[test]
fn a_smaller_clip_of_the_description_stays() {
    let folder = copied(&["clip.onnx", "clip.toml"]);
    let path = folder.path().join("clip.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("kp = ", "action_clip = 0.5\nkp = ")).unwrap();
    assert_eq!(read(&path).unwrap().interface.action_clip, Some(ActionClip::All(0.5)));
}

#[test]
fn an_actor_that_gives_mean_and_deviation_acts_with_its_first_half() {
    for name in ["gaussian", "gaussian_slice"] {
        let policy = exported(name);
        let shape = &policy.actor.shape;
        assert_eq!((shape.to_string().as_str(), shape.activation), ("45-16-12", Activation::Silu), "{name}");
        assert_eq!(policy.actor.output, Some(Activation::Tanh));
        assert!(difference(name, &policy) < 1e-5, "{name}: {}", difference(name, &policy));
    }
}

#[test]
fn recurrent_actors_of_the_default_exporter_give_onnxruntimes_actions() {
    for (name, layers) in [("lstm", 1), ("gru", 2)] {
        let policy = exported(name);
        let Some(Front::Recurrent(memory)) = &policy.front else { panic!("{name} is not recurrent") };
        assert_eq!((memory.cell.name(), memory.layers.len()), (name, layers));
        assert!(difference(name, &policy) < 1e-5, "{name}: {}", difference(name, &policy));
    }
}

/// A folder with these files of the fixtures.
fn copied(names: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in names {
        std::fs::copy(fixture(&format!("exported/{name}")), folder.path().join(name)).unwrap();
    }
    folder
}

#[test]
fn weights_in_a_file_beside_the_graph_are_read() {
    let policy = exported("external");
    assert!(difference("external", &policy) < 1e-5);
    let files = files_of(&fixture("exported/external.toml")).unwrap();
    let names: Vec<_> = files.iter().filter_map(|path| path.file_name()?.to_str()).collect();
    assert_eq!(names, ["external.toml", "external.onnx", "external.onnx.data"]);

    let folder = copied(&["external.onnx", "external.toml"]);
    let path = folder.path().join("external.toml");
    let error = || read(&path).unwrap_err().to_string();
    assert!(error().contains("external.onnx.data") && error().contains("external_data=False"), "{}", error());
    let data = std::fs::read(fixture("exported/external.onnx.data")).unwrap();
    std::fs::write(folder.path().join("external.onnx.data"), &data[..3000]).unwrap();
    assert!(error().contains("beyond the end of external.onnx.data, which has 3000 bytes"), "{}", error());
}

#[test]
fn weights_are_not_read_from_other_folders() {
    // As long as the name that stands there.
    for other in ["../ternal.onnx.dat", "/xternal.onnx.data"] {
        let folder = copied(&["external.onnx", "external.toml"]);
        let path = folder.path().join("external.onnx");
        let bytes = std::fs::read(&path).unwrap();
        let old = b"external.onnx.data";
        let mut changed = bytes.clone();
        for start in 0..bytes.len() - old.len() {
            if &bytes[start..start + old.len()] == old {
                changed[start..start + old.len()].copy_from_slice(other.as_bytes());
            }
        }
        assert_ne!(bytes, changed);
        std::fs::write(&path, changed).unwrap();
        let error = read(&folder.path().join("external.toml")).unwrap_err().to_string();
        assert!(error.contains("not a file in the folder of the ONNX file"), "{error}");
    }
}

/// The archive of a TorchScript program, as far as it is looked at.
const SCRIPT: &[u8] = b"PK\x03\x04policy/code/__torch__.py";

#[test]
fn pytorchs_own_files_are_refused_with_the_lines_that_convert_them() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        read(&path).unwrap_err().to_string()
    };
    let script = refused("walk.jit", SCRIPT);
    assert!(script.contains("torch.jit.load(\"walk.jit\"") && script.contains("dynamo=False"), "{script}");
    assert!(script.contains("zeros(1, WIDTH)") && script.contains("TOML"), "{script}");
    assert!(!script.contains("recurrent"), "{script}");
    assert!(refused("walk.pt", &[SCRIPT, b"hidden_state"].concat()).contains("recurrent"));
    let checkpoint = refused("model.pt", b"PK\x03\x04model_state_dict");
    assert!(checkpoint.contains("[\"model_state_dict\"]") && checkpoint.contains("model.safetensors"));
    assert!(refused("model.pt", b"PK\x03\x04actor_state_dict").contains("[\"actor_state_dict\"]"));
}

#[test]
fn a_description_of_pytorchs_own_file_says_the_same_with_the_numbers_it_knows() {
    let folder = copied(&["clip.toml"]);
    let write = |name: &str, text: &[u8]| std::fs::write(folder.path().join(name), text).unwrap();
    let text = std::fs::read_to_string(folder.path().join("clip.toml")).unwrap();
    write("p.toml", text.replace("clip.onnx", "policy.jit").as_bytes());
    write("policy.jit", SCRIPT);
    let error = read(Path::new(&folder.path().join("p.toml"))).unwrap_err().to_string();
    for word in ["policy.jit", "torch.zeros(1, 45)", "dynamo=False", "name policy.onnx as `file`"] {
        assert!(error.contains(word), "`{word}` is not in `{error}`");
    }
}
