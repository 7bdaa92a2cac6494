//! Any text ends in a log or an error: by the reader of gaitfit's own logs, and by that of other programs' tables.
//!
//! Run: `fuzz/seeds.sh`, then `cargo +nightly fuzz run csv`.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    gaitfit_fuzz::read_own_log(text.as_bytes());
    gaitfit_fuzz::read_log(b"", text.as_bytes());
});
