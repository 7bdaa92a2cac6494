//! Any pickle ends in a log or an error; nothing in it is run.
//!
//! Run: `fuzz/seeds.sh`, then `cargo +nightly fuzz run pickle`.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| gaitfit_fuzz::read_log(b"\x80", bytes));
