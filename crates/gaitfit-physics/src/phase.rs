//! The parts of a control period.
//!
//! [`control_period`](crate::control_period) is [`begin`], then for every physics step [`before`], [`iterate`] as often as
//! the settings say, and [`after`]. Who needs other loops calls the parts: a tracer records each once and keeps the
//! loops. Newton's loop hands on what [`carried`] lists; the loop over physics steps hands on the state, the memory of
//! the modifications, and the clock.

use crate::drive::pd;
use crate::modify::{Modify, for_each};
use crate::smooth::smooth;
use crate::{Owner, Period, Real, State, Tree, Work, solver, step};

/// At the start of a control period: modifications of the newest targets.
#[inline(always)]
pub fn begin<T: Real>(p: &mut Period<'_, T>) {
    let n = p.drives.len();
    // A row of targets for each control period, newest first: only the newest has not been sent yet.
    for_each(p.modifications, p.memory, |one, memory| {
        one.targets(p.substeps, p.params, p.state, memory, &mut p.targets[..n]);
    });
}

/// Before the solver's loop: torques, forces, and the rows of the constraints. `clock`: physics steps since the start
/// of the control period. `disturbance`: torques of this step, N·m, one a joint, or empty.
#[inline(always)]
pub fn before<T: Real>(p: &mut Period<'_, T>, clock: T, disturbance: &[T]) {
    let (settings, velocities) = (&p.tree.settings, &p.tree.velocity_targets[..]);
    pd(settings, velocities, p.params, p.state, p.targets, clock, p.substeps, p.drives);
    for (drive, &torque) in p.drives.iter_mut().zip(disturbance) {
        drive.torque = drive.torque + torque;
    }
    for_each(p.modifications, p.memory, |one, memory| {
        one.torques(&p.tree.settings, p.params, p.state, memory, p.drives);
    });
    // After all torques are known: a gear passes their sum on.
    for_each(p.modifications, p.memory, |one, memory| {
        one.engage(&p.tree.settings, p.params, p.state, memory, p.drives);
    });
    smooth(p.tree, p.params, p.state, p.drives, p.work);
}

/// One iteration of the solver. The `last` one may leave out what only a further one would read.
#[inline(always)]
pub fn iterate<T: Real>(p: &mut Period<'_, T>, last: bool) {
    solver::iterate(p.tree, last, p.state, p.work);
}

/// After the solver's loop: the state at the end of the physics step.
#[inline(always)]
pub fn after<T: Real>(p: &mut Period<'_, T>) {
    step::integrate(p.tree, p.state, p.work);
    for_each(p.modifications, p.memory, |one, memory| {
        one.release(&p.tree.settings, p.params, p.state, memory, p.drives);
    });
}

/// What one iteration of the solver hands to the next: accelerations, and the residuals at them. A contact point's
/// residual has a meaning only where the guard of its pair is active.
pub fn carried<'a, T: Real>(
    tree: &Tree<T::K>,
    state: &'a mut State<T>,
    work: &'a mut Work<T>,
) -> Vec<&'a mut T> {
    let mut all = Vec::new();
    state.visit_mut(|slot, number| {
        if matches!((slot.owner, slot.name), (Owner::Base, "acceleration") | (_, "qacc")) {
            all.push(number);
        }
    });
    work.visit_mut(tree, |slot, number| {
        // These are the numbers that the solver's `advance` changes for the next iteration.
        if matches!(slot.name, "wrench" | "residual") {
            all.push(number);
        }
    });
    all
}
