//! Any ONNX file ends in a policy or an error.
//!
//! Run: `fuzz/seeds.sh`, then `cargo +nightly fuzz run onnx`.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| gaitfit_fuzz::read_policy("onnx", bytes));
