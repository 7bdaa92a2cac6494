//! The project's own policy files, safetensors and ONNX: there and back, and everything that can be wrong.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{ACTIVATIONS, act, largest_difference, numbers, policy, root};
use gaitfit_policy::network::{Activation, LayerNorm, Network, Shape};
use gaitfit_policy::{FrameOrder, History, HistoryStart, Policy};
use gaitfit_policy_files::{onnx, read, weights};

fn bits(network: &Network) -> Vec<u32> {
    network.parameters.iter().map(|x| x.to_bits()).collect()
}

#[test]
fn safetensors_come_back_bit_for_bit() {
    for activation in ACTIVATIONS {
        let policy = policy(activation);
        let bytes = weights::write(&policy).unwrap();
        assert_eq!(bytes, weights::write(&policy).unwrap(), "the same policy gives the same bytes");
        let back = weights::read(&bytes).unwrap();
        assert_eq!(back, policy);
        assert_eq!(bits(&back.actor), bits(&policy.actor));
        assert_eq!(weights::write(&back).unwrap(), bytes);
    }
    let bare = Policy { critic: None, normaliser: None, critic_normaliser: None, ..policy(Activation::Elu) };
    assert_eq!(weights::read(&weights::write(&bare).unwrap()).unwrap(), bare);
}

#[test]
fn a_history_goes_through_both_files_and_is_not_named_without_one() {
    let mut policy =
        Policy { normaliser: None, critic: None, critic_normaliser: None, ..policy(Activation::Elu) };
    let plain = weights::write(&policy).unwrap();
    assert!(!String::from_utf8_lossy(&plain).contains("history"));
    for term in &mut policy.interface.observation {
        term.history = 3;
    }
    policy.interface.history = History { order: FrameOrder::Frames, start: HistoryStart::Zeros };
    let error = weights::write(&policy).unwrap_err().to_string();
    assert!(error.starts_with("observation is 135 numbers (3 × 3 base_angular_velocity + "), "{error}");
    let shape = Shape { inputs: 135, ..policy.actor.shape.clone() };
    policy.actor = Network::random(shape, 1, 0, 1.0).unwrap();
    assert_eq!(weights::read(&weights::write(&policy).unwrap()).unwrap(), policy);
    assert_eq!(onnx::read(&onnx::write(&policy).unwrap()).unwrap(), policy);
}

#[test]
fn layer_norms_and_an_output_function_go_through_both_files() {
    let mut policy = policy(Activation::Silu);
    let norm = |width: usize| LayerNorm { weight: numbers(width, 1), bias: numbers(width, 2), epsilon: 1e-3 };
    policy.actor.norms = vec![None, Some(norm(16))];
    policy.actor.output = Some(Activation::Tanh);
    policy.critic.as_mut().unwrap().norms = vec![Some(norm(24)), Some(norm(16))];
    assert_eq!(weights::read(&weights::write(&policy).unwrap()).unwrap(), policy);
    let back = onnx::read(&onnx::write(&policy).unwrap()).unwrap();
    assert_eq!(back.actor, policy.actor);
    policy.critic.as_mut().unwrap().norms[0].as_mut().unwrap().epsilon = 1e-5;
    assert!(weights::write(&policy).unwrap_err().to_string().contains("different epsilons"));
}

#[test]
fn weights_lie_as_pytorch_has_them() {
    let policy = policy(Activation::Elu);
    let bytes = weights::write(&policy).unwrap();
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let weight = file.tensor("actor.2.weight").unwrap();
    assert_eq!(weight.shape(), [16, 24]);
    // Output 3, input 5 of the second layer; the flat vector is inputs × outputs.
    let layer = &policy.actor.shape.layers()[1];
    let expected = policy.actor.parameters[layer.weight.start + 5 * 16 + 3];
    let at = 4 * (3 * 24 + 5);
    assert_eq!(f32::from_le_bytes(weight.data()[at..at + 4].try_into().unwrap()), expected);
}

#[test]
fn a_file_cut_anywhere_is_refused() {
    let policy = policy(Activation::Elu);
    let bytes = weights::write(&policy).unwrap();
    for length in (0..bytes.len()).step_by(97).chain([bytes.len() - 1]) {
        let error = weights::read(&bytes[..length]).unwrap_err().to_string();
        assert!(error.contains("cut short"), "{length}: {error}");
    }
    let graph = onnx::write(&policy).unwrap();
    for length in (0..graph.len()).step_by(97).chain([graph.len() - 1]) {
        assert!(onnx::read(&graph[..length]).is_err(), "{length}");
    }
}

#[test]
fn flipped_bytes_never_panic() {
    let policy = policy(Activation::Elu);
    for (bytes, read) in [
        (weights::write(&policy).unwrap(), weights::read as fn(&[u8]) -> _),
        (onnx::write(&policy).unwrap(), onnx::read),
    ] {
        for at in (0..bytes.len()).step_by(41).chain(0..300) {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x5a;
            let _: Result<Policy, _> = read(&damaged);
        }
    }
}

/// One bit of every byte of the header, and of many others: no other policy comes out, and no file of another program.
#[test]
fn a_flipped_bit_is_never_another_policy() {
    let policy = policy(Activation::Elu);
    for (bytes, read) in [
        (weights::write(&policy).unwrap(), weights::read as fn(&[u8]) -> _),
        (onnx::write(&policy).unwrap(), onnx::read),
    ] {
        for at in (0..1500).chain((1500..bytes.len()).step_by(5)) {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1 << (at % 8);
            let found: Result<Policy, _> = read(&damaged);
            assert!(found.is_err(), "byte {at} of {}", bytes.len());
        }
    }
}

#[test]
fn files_without_a_checksum_are_read_and_told_apart() {
    let policy = policy(Activation::Elu);
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let plain = weights::plain(&policy).unwrap();
    assert_eq!(weights::read(&plain).unwrap(), policy);
    std::fs::write(path("plain.safetensors"), &plain).unwrap();
    std::fs::write(path("own.safetensors"), weights::write(&policy).unwrap()).unwrap();
    std::fs::write(path("own.onnx"), onnx::write(&policy).unwrap()).unwrap();
    let foreign = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/policies/mjlab.onnx");
    std::fs::copy(foreign, path("foreign.onnx")).unwrap();
    for (name, sealed) in
        [("plain.safetensors", false), ("own.safetensors", true), ("own.onnx", true), ("foreign.onnx", false)]
    {
        let expected = if sealed { Vec::new() } else { vec![path(name)] };
        assert_eq!(gaitfit_policy_files::unsealed(&path(name)).unwrap(), expected, "{name}");
        gaitfit_policy_files::read(&path(name)).unwrap();
    }
    // Damage is seen where a description names the file, too.
    let mut damaged = weights::write(&policy).unwrap();
    *damaged.last_mut().unwrap() ^= 1;
    std::fs::write(path("own.safetensors"), &damaged).unwrap();
    std::fs::write(path("own.toml"), "file = \"own.safetensors\"\n").unwrap();
    for name in ["own.safetensors", "own.toml"] {
        let error = gaitfit_policy_files::read(&path(name)).unwrap_err().to_string();
        assert!(error.contains("its checksum does not fit"), "{name}: {error}");
    }
}

#[test]
fn parts_that_do_not_fit_are_named() {
    let good = policy(Activation::Elu);
    let wide = Shape { inputs: 48, ..good.actor.shape.clone() };
    let wide = Network::random(wide, 1, 0, 1.0).unwrap();
    let error = weights::write(&Policy { actor: wide, ..good.clone() }).unwrap_err().to_string();
    assert!(
        error.starts_with("observation is 45 numbers (3 base_angular_velocity + 3 projected_gravity + ")
            && error.ends_with("the actor takes 48"),
        "{error}"
    );
    type Change = fn(&mut Policy);
    let wrong: [(Change, &str); 8] = [
        (|p| p.log_std.truncate(3), "log_std has 3 numbers for 12 joints"),
        (|p| p.actor.parameters[7] = f32::NAN, "the actor holds NaN"),
        (|p| p.actor.parameters.truncate(9), "parameters, it needs"),
        (|p| p.actor.shape.hidden = vec![usize::MAX, usize::MAX], "has more than"),
        (|p| p.interface.critic_observation.clear(), "critic_observation has no terms"),
        (|p| p.normaliser.as_mut().unwrap().mean.truncate(44), "normaliser has 44 means and 45 variances"),
        (|p| p.critic_normaliser.as_mut().unwrap().variance[0] = -1.0, "variances and a count that are not"),
        (|p| p.critic = None, "there is a critic_normaliser, but no critic"),
    ];
    for (change, message) in wrong {
        let mut policy = good.clone();
        change(&mut policy);
        for error in [weights::write(&policy).unwrap_err(), onnx::write(&policy).unwrap_err()] {
            let error = error.to_string();
            assert!(error.contains(message), "`{message}` is not in `{error}`");
        }
    }
}

/// What is said of the file of a policy with its JSON header changed: without a checksum, which would be wrong first.
fn edited(from: &str, to: &str) -> String {
    let bytes = weights::plain(&policy(Activation::Elu)).unwrap();
    let length = usize::try_from(u64::from_le_bytes(bytes[..8].try_into().unwrap())).unwrap();
    let header = std::str::from_utf8(&bytes[8..8 + length]).unwrap();
    assert!(header.contains(from), "{header}");
    let header = header.replacen(from, to, 1);
    let mut file = (header.len() as u64).to_le_bytes().to_vec();
    file.extend(header.as_bytes());
    file.extend(&bytes[8 + length..]);
    weights::read(&file).unwrap_err().to_string()
}

#[test]
fn a_damaged_header_is_named() {
    let cases = [
        ("\"actor.2.weight\"", "\"actor.2.wait\"", "layer 1 gives 24 numbers, layer 2 takes 16"),
        ("\"log_std\"", "\"log_sdt\"", "tensor log_std is missing"),
        ("[24,45]", "[45,24]", "tensor actor.0.bias has 24 numbers"),
        ("\\\"format\\\":1", "\\\"format\\\":2", "it has format 2"),
        ("\"gaitfit\"", "\"geitfit\"", "docs/policies.md"),
        ("\\\"kd\\\"", "\\\"kq\\\"", "unknown field `kq`"),
        (
            "\\\"joints\\\":[\\\"FL_hip_joint\\\",",
            "\\\"joints\\\":[",
            "default_pose has 12 numbers for 11 joints",
        ),
    ];
    for (from, to, message) in cases {
        let error = edited(from, to);
        assert!(error.contains(message), "`{message}` is not in `{error}`");
    }
}

#[test]
fn onnx_comes_back_with_the_same_actor() {
    let observation: Vec<f32> = numbers(45 * 20, 9).into_iter().map(|x| 3.0 * x).collect();
    for activation in ACTIVATIONS {
        for normalised in [true, false] {
            let mut policy = policy(activation);
            if !normalised {
                policy.normaliser = None;
            }
            let back = onnx::read(&onnx::write(&policy).unwrap()).unwrap();
            assert_eq!(bits(&back.actor), bits(&policy.actor));
            assert_eq!((&back.interface, &back.log_std), (&policy.interface, &policy.log_std));
            assert_eq!((&back.normaliser, &back.provenance), (&policy.normaliser, &policy.provenance));
            assert_eq!(act(&back, &observation), act(&policy, &observation));
        }
    }
}

#[test]
#[ignore = "needs the Python packages of tools/setup_venv.sh"]
fn python_onnxruntime_gives_the_same_actions() {
    let python = root().join(".venv/bin/python");
    let folder = tempfile::tempdir().unwrap();
    let policy = policy(Activation::Elu);
    let observation: Vec<f32> = numbers(45 * 200, 9).into_iter().map(|x| 3.0 * x).collect();
    let actions = act(&policy, &observation);
    assert!(actions.iter().any(|action| action.abs() > 0.1), "actions of zero would prove nothing");
    let rows = |values: &[f32], width| values.chunks_exact(width).map(<[f32]>::to_vec).collect::<Vec<_>>();
    let table = serde_json::json!({ "observation": rows(&observation, 45), "actions": rows(&actions, 12) });
    std::fs::write(folder.path().join("rows.json"), table.to_string()).unwrap();
    std::fs::write(folder.path().join("policy.onnx"), onnx::write(&policy).unwrap()).unwrap();
    std::fs::write(folder.path().join("policy.safetensors"), weights::write(&policy).unwrap()).unwrap();
    let output = std::process::Command::new(python)
        .current_dir(folder.path())
        .arg(root().join("tools/check_onnx.py"))
        .args([
            "policy.onnx",
            "--rows",
            "rows.json",
            "--weights",
            "policy.safetensors",
            "--tolerance",
            "1e-5",
        ])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
    eprintln!("{text}");
}

#[test]
fn paths_are_read_by_their_ending() {
    let folder = tempfile::tempdir().unwrap();
    let policy = policy(Activation::Elu);
    let path = folder.path().join("a.safetensors");
    std::fs::write(&path, weights::write(&policy).unwrap()).unwrap();
    assert_eq!(read(&path).unwrap(), policy);
    let graph = folder.path().join("a.onnx");
    std::fs::write(&graph, onnx::write(&policy).unwrap()).unwrap();
    assert!(largest_difference(&read(&graph).unwrap().log_std, &policy.log_std) == 0.0);
    std::fs::write(folder.path().join("a.txt"), "a policy").unwrap();
    for (name, message) in [("a.txt", "no policy by its ending"), ("none.onnx", "cannot read")] {
        let error = read(&folder.path().join(name)).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains(message), "{error}");
    }
    let error = read(folder.path().join("a.onnx").parent().unwrap()).unwrap_err().to_string();
    assert!(error.contains("no policy by its ending"), "{error}");
}

#[test]
fn a_function_of_the_callers_is_in_no_file() {
    let whole = policy(Activation::Elu).interface;
    let policy = Policy::of_function(whole, std::sync::Arc::new(|_, _, _| true)).unwrap();
    assert!(weights::write(&policy).is_err());
    assert!(onnx::write(&policy).unwrap_err().to_string().contains("function"));
}
