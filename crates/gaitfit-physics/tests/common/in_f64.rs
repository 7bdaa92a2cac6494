//! The step in `f64`, compiled once: it is inlined whole wherever it is called.

use gaitfit_physics::{Drive, Params, Period, State, Tree, Work};

/// [`gaitfit_physics::step`].
#[inline(never)]
pub fn step(
    tree: &Tree<f64>,
    params: &Params<f64>,
    drives: &[Drive<f64>],
    state: &mut State<f64>,
    work: &mut Work<f64>,
) {
    gaitfit_physics::step(tree, params, drives, state, work);
}

/// [`gaitfit_physics::accelerate`].
#[inline(never)]
pub fn accelerate(
    tree: &Tree<f64>,
    params: &Params<f64>,
    drives: &[Drive<f64>],
    state: &mut State<f64>,
    work: &mut Work<f64>,
) {
    gaitfit_physics::accelerate(tree, params, drives, state, work);
}

/// [`gaitfit_physics::control_period`].
#[inline(never)]
pub fn control_period(p: &mut Period<'_, f64>) {
    gaitfit_physics::control_period(p);
}
