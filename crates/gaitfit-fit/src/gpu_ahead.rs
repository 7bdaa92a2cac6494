//! The GPU program of a fit's robots, compiled while the fit reads its logs.

use crate::walk::walking::Walking;
use gaitfit_adapt::Theta;
use gaitfit_sim::Candidate;

/// A program that is being compiled. Dropping it waits for the compiler.
#[cfg(feature = "cuda")]
pub type Ahead = gaitfit_cuda::runtime::Ahead;

/// A build without the feature `cuda` compiles none.
#[cfg(not(feature = "cuda"))]
pub struct Ahead;

/// Begins to compile the physics of robots that θ makes of `base`, if GPUs of `walking` simulate them.
#[cfg(feature = "cuda")]
pub fn compile_ahead(walking: &Walking, theta: &Theta, base: &Candidate) -> Ahead {
    use gaitfit_cuda::fit::Subject;
    let Some(gpu) = walking.gpus.first() else { return Ahead::default() };
    let joints = &walking.task.walker.batch.model().joints;
    let names: Vec<String> = joints.iter().map(|joint| joint.name.clone()).collect();
    // Within the bounds, so the program has every effect that θ can add. Not in their middle, which is often 0: no effect.
    let values: Vec<f64> =
        theta.entries().iter().map(|entry| 0.4 * entry.lower + 0.6 * entry.upper).collect();
    let mut candidate = base.clone();
    theta.apply(&values, &names, &mut candidate);
    let period = Subject::Walk(&walking.task.walker, &walking.policy).period(&candidate);
    // What is wrong with the robot is reported when it is simulated.
    gpu.compile_ahead(period.ok().map(|period| period.program()))
}

/// A build without the feature `cuda` compiles none.
#[cfg(not(feature = "cuda"))]
pub fn compile_ahead(_: &Walking, _: &Theta, _: &Candidate) -> Ahead {
    Ahead
}
