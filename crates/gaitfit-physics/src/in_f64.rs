//! The step in `f64`, compiled once: the generic functions are inlined whole wherever they are called, and take the
//! compiler half a minute each time.

use crate::step::integrate;
use crate::{Drive, Params, Period, State, Tree, Work};

/// [`step`](crate::step()).
pub fn step(
    tree: &Tree<f64>,
    params: &Params<f64>,
    drives: &[Drive<f64>],
    state: &mut State<f64>,
    work: &mut Work<f64>,
) {
    accelerate(tree, params, drives, state, work);
    integrate(tree, state, work);
}

/// [`accelerate`](crate::accelerate()).
#[inline(never)]
pub fn accelerate(
    tree: &Tree<f64>,
    params: &Params<f64>,
    drives: &[Drive<f64>],
    state: &mut State<f64>,
    work: &mut Work<f64>,
) {
    crate::step::accelerate(tree, params, drives, state, work);
}

/// [`control_period`](crate::control_period()).
#[inline(never)]
pub fn control_period(period: &mut Period<'_, f64>) {
    crate::step::control_period(period);
}
