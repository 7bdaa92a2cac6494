//! Length of a valley of the cost: a direction in which parameters compensate each other. An example is `kd_scale` and
//! `damping` of one joint: the motion shows only their sum.
//!
//! A quadratic around the best values shows only that such a direction is flat there. So [`reach`] moves the values along
//! it, in steps that double, up to the first bound. The valley ends where the cost rises by more than its noise; a single
//! parameter's interval ends there too.

use super::FitError;
use super::identification::Identification;
use super::identify::end;
use super::joint::{Around, Free};
use crate::Rollout;
use nalgebra::DVector;

/// Max steps to either side; the last is 2¹⁵ of a parameter's own interval.
const STEPS: i32 = 16;

/// Widens the intervals of `identifications` as far as the values can move along `direction`, in units of the `free`
/// parameters' sizes.
///
/// # Errors
/// As [`super::evaluate`].
pub(super) fn reach(
    around: &Around<'_>,
    free: &[Free],
    direction: &DVector<f64>,
    identifications: &mut [Identification],
) -> Result<(), FitError> {
    let entries = around.theta.entries();
    // Both ways: a valley need not be as long on both sides.
    for sign in [-1.0, 1.0] {
        let along: Vec<f64> = free.iter().zip(direction).map(|(one, part)| sign * part * one.size).collect();
        let room = |(one, by): (&Free, &f64)| {
            let (entry, value) = (&entries[one.entry], around.values[one.entry]);
            let bound = if *by < 0.0 { entry.lower } else { entry.upper };
            if *by == 0.0 { f64::INFINITY } else { (bound - value) / by }
        };
        // The first bound that any of the parameters reaches ends the line.
        let last = free.iter().zip(&along).map(room).fold(f64::INFINITY, f64::min);
        if !(last.is_finite() && last > 0.0) {
            continue;
        }
        // A step that nearly reaches the bound would only repeat its point.
        // Steps double, because a valley can be many times as long as the intervals.
        let inside = (0..STEPS).map(|step| 2f64.powi(step)).filter(|step| *step < 0.9 * last);
        let steps: Vec<f64> = inside.chain([last]).collect();
        let moved = |step: &f64| {
            let mut values = around.values.to_vec();
            for (one, by) in free.iter().zip(&along) {
                let entry = &entries[one.entry];
                values[one.entry] = (values[one.entry] + step * by).clamp(entry.lower, entry.upper);
            }
            Rollout { values, resets: around.views.cost().resets(), draw: around.draw }
        };
        let rollouts: Vec<Rollout> = steps.iter().map(moved).collect();
        let (costs, _) =
            around.simulator.views(around.theta, around.views, &rollouts, &|| (), around.cancel)?;
        let rises: Vec<_> = steps
            .iter()
            .zip(&costs)
            .map(|(step, costs)| (*step, costs.as_ref().map(|costs| (around.rise)(costs))))
            .collect();
        // One number for all: along the valley the parameters move together.
        let far = end(&rises, around.fixed).0;
        for (one, by) in free.iter().zip(&along) {
            identifications[one.entry].reach(&entries[one.entry], around.values[one.entry] + far * by);
        }
    }
    Ok(())
}
