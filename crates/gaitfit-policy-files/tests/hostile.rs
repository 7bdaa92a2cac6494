//! Policies that were damaged on the way, or made to harm: no panic, no hang, no runaway memory.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::common;

use common::{fixture, policy};
use gaitfit_damage::{Bounds, Counting, Draws, Outcome, bytes, protobuf, text};
use gaitfit_policy::network::Activation;
use gaitfit_policy_files::{onnx, read, weights};
use std::time::Duration;

/// Sees how much memory readers take.
#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// What reading one of these files may take, each of at most 80 kB.
const BOUNDS: Bounds = Bounds { bytes: 8 << 20, time: Duration::from_secs(10) };

const GRAPHS: &[&str] = &[
    "foreign",
    "gru",
    "lstm",
    "exported/clip",
    "exported/clip_scaled",
    "exported/gaussian_slice",
    "functions/norm",
    "functions/gelu_tanh",
    "mjlab",
    "graphs/him_old",
    "graphs/dreamwaq",
    "graphs/rma",
    "graphs/moe",
    "graphs/estimator",
    "graphs/bounds",
    "graphs/operators",
];

/// Graphs of other programs, which carry no checksum, with their descriptions beside them.
fn attack_graphs(rounds: usize) -> Outcome {
    let mut all = Outcome::default();
    for name in GRAPHS {
        let folder = tempfile::tempdir().unwrap();
        let graph = std::fs::read(fixture(&format!("{name}.onnx"))).unwrap();
        let file = name.rsplit('/').next().unwrap();
        let path = folder.path().join(format!("{file}.onnx"));
        let description = fixture(&format!("{name}.toml"));
        let entry = if description.exists() { path.with_extension("toml") } else { path.clone() };
        if description.exists() {
            std::fs::copy(description, &entry).unwrap();
        }
        let damaged = |draws: &mut Draws| match draws.below(4) {
            0 => bytes(&graph, draws),
            _ => protobuf(&graph, draws),
        };
        let outcome = gaitfit_damage::attack(name, rounds, BOUNDS, damaged, |graph| {
            std::fs::write(&path, graph).unwrap();
            let result = read(&entry);
            // Some file systems flush a file that is overwritten; a new one is quicker.
            std::fs::remove_file(&path).unwrap();
            result.is_ok_and(|policy| policy.check().is_ok())
        });
        all.read += outcome.read;
        all.refused += outcome.refused;
    }
    all
}

/// A safetensors file with damage in its header, whose length fits, or anywhere.
fn damaged_tensors(file: &[u8], draws: &mut Draws) -> Vec<u8> {
    if draws.below(4) == 0 {
        return bytes(file, draws);
    }
    let (length, rest) = file.split_first_chunk::<8>().unwrap();
    let (header, numbers) = rest.split_at(u64::from_le_bytes(*length) as usize);
    let words =
        ["0", "-1", "1e308", "18446744073709551615", "null", "[]", "{}", "F64", "actor.0.bias", "NaN"];
    let header = text(header, b"0123456789{}[]\",:.e-\\ ", &words, b"\",:[]", draws);
    [&(header.len() as u64).to_le_bytes(), header.as_slice(), numbers].concat()
}

/// Files of this program without a checksum: with one, damage ends there.
fn attack_tensors(rounds: usize) -> Outcome {
    let file = weights::plain(&policy(Activation::Elu)).unwrap();
    let damaged = |draws: &mut Draws| damaged_tensors(&file, draws);
    gaitfit_damage::attack("safetensors", rounds, BOUNDS, damaged, |file| {
        weights::read(file).is_ok_and(|policy| policy.check().is_ok())
    })
}

/// Weights of another program, beside their description.
fn attack_foreign_tensors(rounds: usize) -> Outcome {
    let folder = tempfile::tempdir().unwrap();
    let file = std::fs::read(fixture("trainer.safetensors")).unwrap();
    let (path, entry) = (folder.path().join("trainer.safetensors"), folder.path().join("trainer.toml"));
    std::fs::copy(fixture("trainer.toml"), &entry).unwrap();
    let damaged = |draws: &mut Draws| damaged_tensors(&file, draws);
    gaitfit_damage::attack("safetensors of others", rounds, BOUNDS, damaged, |file| {
        std::fs::write(&path, file).unwrap();
        let result = read(&entry);
        std::fs::remove_file(&path).unwrap();
        result.is_ok_and(|policy| policy.check().is_ok())
    })
}

#[test]
fn damaged_graphs_are_refused_or_read() {
    let outcome = attack_graphs(150);
    assert!(outcome.read > 50 && outcome.refused > 500, "{outcome:?}");
    let written = onnx::write(&policy(Activation::Elu)).unwrap();
    let whole = onnx::read(&written).unwrap();
    let damaged = |draws: &mut Draws| protobuf(&written, draws);
    gaitfit_damage::attack("own ONNX", 200, BOUNDS, damaged, |file| {
        let read = onnx::read(file);
        // Some damage undoes itself.
        assert!(read.as_ref().is_err() || read.as_ref().is_ok_and(|read| *read == whole));
        read.is_ok()
    });
}

#[test]
fn damaged_weights_are_refused_or_read() {
    let ours = attack_tensors(1000);
    let foreign = attack_foreign_tensors(1000);
    for outcome in [ours, foreign] {
        assert!(outcome.read > 20 && outcome.refused > 500, "{outcome:?}");
    }
}

#[test]
#[ignore = "long: thousands of damaged files of each kind"]
fn long_damaged_policies_are_refused_or_read() {
    attack_graphs(5_000);
    attack_tensors(20_000);
    attack_foreign_tensors(20_000);
}
