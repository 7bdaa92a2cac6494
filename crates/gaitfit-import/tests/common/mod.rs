//! What the tests share.

#![allow(dead_code, clippy::unwrap_used)]

use gaitfit_import::{ImportError, Imported, Mapping, Options, import};
use std::path::PathBuf;

/// A committed file.
pub fn fixture(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name)
}

/// Imports a committed file by a mapping's text.
pub fn read(name: &str, mapping: &str) -> Result<Imported, ImportError> {
    import(&[fixture(name)], &Options { mapping: Mapping::parse(mapping)?, ..Options::default() })
}

/// Joint names of the fixtures, FL first.
pub const JOINTS: &str = "joints = ['FL_hip', 'FL_thigh', 'FL_calf', 'FR_hip', 'FR_thigh', 'FR_calf', 'RL_hip', \
                          'RL_thigh', 'RL_calf', 'RR_hip', 'RR_thigh', 'RR_calf']\n";

/// Largest difference of two rows of numbers.
pub fn apart(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}
