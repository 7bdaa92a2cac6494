//! What trainings on CPU and GPU share: their seed, and how their iterations are measured.

use gaitfit_learn::Iteration;

/// Iterations before those that are measured: memory is touched, threads are there.
pub const WARM_UP: u32 = 2;
/// Seed of what is measured.
pub const SEED: u64 = 1;

/// Median over the iterations.
pub fn median(iterations: &[Iteration], value: fn(&Iteration) -> f64) -> f64 {
    let values: Vec<f64> = iterations.iter().map(value).collect();
    gaitfit_sim::stats::median(&values).unwrap_or_default()
}
