//! `report.html` of a training run: learning curves over several seeds, diagnostics, and the gait that came out.

mod data;

pub use data::{Link, SeedCurve, SeedResult, Series, TrainingReport};
