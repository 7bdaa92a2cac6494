//! Any text given to the MJCF reader ends in a model or an error.
//!
//! Run: `cargo +nightly fuzz run mjcf`, with a copy of assets/ and the test robots in fuzz/corpus/mjcf as seeds.
#![no_main]

use gaitfit_model::{ReadOptions, Root, read_mjcf_str};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    for root in [None, Some(Root::Fixed), Some(Root::Floating)] {
        for lenient in [false, true] {
            if let Ok(model) = read_mjcf_str(text, &ReadOptions { lenient, root }) {
                assert!(model.pairs.iter().all(|p| p.geom < model.geoms.len()));
                let _ = model.summary();
            }
        }
    }
});
