//! Any database, such as a ROS 2 bag of the kind db3, ends in a log or an error.
//!
//! Run: `fuzz/seeds.sh`, then `cargo +nightly fuzz run sqlite`.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| gaitfit_fuzz::read_log(b"SQLite format 3\0", bytes));
