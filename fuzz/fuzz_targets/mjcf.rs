//! Any text given to the MJCF reader ends in a model or an error.
//!
//! Run: `fuzz/seeds.sh`, then `cargo +nightly fuzz run mjcf`.
#![no_main]

use gaitfit_model::{ReadOptions, Root, read_mjcf_str};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    for root in [None, Some(Root::Fixed), Some(Root::Floating)] {
        for (lenient, mend) in [(false, false), (true, false), (false, true)] {
            // Both kinds of mistakes are passed over together.
            let (add_floor, in_the_air) = (lenient, mend);
            let options = ReadOptions { lenient, root, add_floor, in_the_air, mend };
            if let Ok(model) = read_mjcf_str(text, &options) {
                assert!(model.pairs.iter().all(|p| p.geom < model.geoms.len()));
                let _ = model.summary();
            }
        }
    }
});
