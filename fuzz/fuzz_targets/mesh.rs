//! Any bytes given to the readers of meshes end in finite triangles or an error.
//!
//! Run: `fuzz/seeds.sh`, then `cargo +nightly fuzz run mesh`.
#![no_main]

use gaitfit_model::mesh::{Measure, parse};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    for ending in ["stl", "obj", "dae", "msh"] {
        if let Ok(mesh) = parse(ending, bytes) {
            assert!(mesh.triangles.iter().flatten().flatten().all(|x| x.is_finite()));
            let _ = Measure::new(&mesh);
        }
    }
});
