//! Any MCAP file ends in a log or an error.
//!
//! Run: `fuzz/seeds.sh`, then `cargo +nightly fuzz run mcap`.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| gaitfit_fuzz::read_log(b"\x89MCAP0\r\n", bytes));
