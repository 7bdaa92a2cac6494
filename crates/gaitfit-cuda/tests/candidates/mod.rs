//! What tests of a fit's kernels share: numbers in the physics' tiles, and the kernels' arrays.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use std::collections::HashMap;

use gaitfit_cuda::emit::{Class, Place};
use gaitfit_cuda::fit::{Numbers, Tables};
use gaitfit_cuda::physics::Period;

use crate::host::bytes;

/// A file of the repository's assets.
pub fn asset(name: &str) -> String {
    format!("{}/../../assets/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// Numbers of each environment in the physics' tiles.
pub fn tiled(period: &Period, class: Class, tiles: usize, environments: &[Vec<f32>]) -> Vec<f32> {
    let layout = period.layout();
    let (size, per_tile) = (layout.size(class), layout.environments());
    let inputs: Vec<Place> = layout.inputs.iter().copied().filter(|place| place.class == class).collect();
    let outputs: Vec<Place> = layout.outputs.iter().copied().filter(|place| place.class == class).collect();
    let places = if inputs.is_empty() { outputs } else { inputs };
    let mut all = vec![0.0; tiles * size];
    for e in 0..tiles * per_tile {
        let numbers = &environments[e % environments.len()];
        assert_eq!(places.len(), numbers.len(), "{class:?}");
        for (place, number) in places.iter().zip(numbers) {
            all[e / per_tile * size + layout.offset(*place, e % per_tile)] = *number;
        }
    }
    all
}

/// The numbers of environment `e` in tiles.
pub fn of(period: &Period, class: Class, tiles: &[f32], e: usize) -> Vec<f32> {
    let layout = period.layout();
    let (size, per_tile) = (layout.size(class), layout.environments());
    let places = layout.inputs.iter().filter(|place| place.class == class);
    places.map(|place| tiles[e / per_tile * size + layout.offset(*place, e % per_tile)]).collect()
}

/// Largest difference relative to max(1, value).
pub fn apart(got: &[f32], want: &[f32]) -> f32 {
    assert_eq!(got.len(), want.len());
    got.iter().zip(want).fold(0.0, |worst, (got, want)| {
        let error = (got - want).abs() / want.abs().max(1.0);
        if error.is_nan() && got.to_bits() != want.to_bits() { f32::INFINITY } else { worst.max(error) }
    })
}

/// Arrays of a plan as files.
pub fn files_of(tables: &Tables, numbers: &Numbers) -> HashMap<String, Vec<u8>> {
    let mut files = HashMap::new();
    let words = |words: &[u32]| bytes(words, u32::to_ne_bytes);
    files.insert("numbers".to_owned(), bytes(&numbers.params, f32::to_ne_bytes));
    files.insert("factors".to_owned(), bytes(&numbers.factors, f64::to_ne_bytes));
    files.insert("every".to_owned(), words(&numbers.every));
    files.insert("seeds".to_owned(), words(&numbers.seeds));
    files.insert("begins".to_owned(), words(&numbers.begins));
    if !numbers.starts.is_empty() {
        files.insert("starts".to_owned(), bytes(&numbers.starts, f32::to_ne_bytes));
    }
    files.insert("deviation".to_owned(), bytes(&numbers.deviation, f64::to_ne_bytes));
    files.insert("imus".to_owned(), bytes(&numbers.imus, f32::to_ne_bytes));
    files.insert("lengths".to_owned(), words(&tables.lengths));
    for (name, singles) in &tables.singles {
        files.insert((*name).to_owned(), bytes(singles, f32::to_ne_bytes));
    }
    for (name, doubles) in &tables.doubles {
        files.insert((*name).to_owned(), bytes(doubles, f64::to_ne_bytes));
    }
    files
}
