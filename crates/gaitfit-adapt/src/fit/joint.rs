//! Intervals of all parameters together, for costs without residuals.
//!
//! [`super::identify`] moves one parameter at a time. Two that make up for each other would both look well known. Here
//! the square of the cost becomes a quadratic in all free parameters, from moves of one and of two of them at once, as
//! far as the single intervals reach. A cost is a distance: near its minimum a parabola, further away a cone; its square
//! is a parabola throughout. One Newton step leads to where the minimum would be without a group of recordings (a
//! jackknife of one-step estimates; its covariance is the sandwich of Huber 1967), and to where another simulator would
//! have its minimum: each such shift counts as one standard deviation, for no number of recordings shows that the
//! simulator is not the robot. Where parameters compensate each other, the cost itself shows how far ([`super::valley`]).

use super::identification::Identification;
use super::valley::reach;
use super::views::{Views, jackknife};
use super::{Alternative, FitError};
use crate::{Cancel, Rollout, Simulator, Theta};
use gaitfit_sim::stats;
use nalgebra::{DMatrix, DVector};

/// Max free parameters whose pairs are simulated: 20 are 380 moves of two.
const MAX_FREE: usize = 20;
// Half of it doubles a Newton step along the flattest direction. Far lower, noise alone would set the interval.
/// Least eigenvalue of the curvature, parts of its mean diagonal: flatter directions are not told apart from noise.
const FLATTEST: f64 = 0.05;
/// Part of a parameter's range that it must be able to move to both sides.
const ROOM: f64 = 1e-6;

/// A cost around values, as [`super::identify`] measured it.
pub(super) struct Around<'a> {
    pub(super) simulator: &'a dyn Simulator,
    pub(super) theta: &'a Theta,
    pub(super) values: &'a [f64],
    /// All recordings, then each part of them.
    pub(super) views: &'a Views<'a>,
    /// The costs at the values, one a view.
    pub(super) centre: &'a [f64],
    pub(super) draw: u64,
    /// The rise of costs, one a view, above those at the values, and the part of it that may be noise.
    pub(super) rise: &'a dyn Fn(&Vec<f64>) -> (f64, f64),
    /// The part of that noise that does not grow with the distance from the values.
    pub(super) fixed: f64,
    pub(super) cancel: &'a Cancel<'a>,
}

/// A parameter that can move: its number, and how far it is moved.
#[derive(Clone, Copy)]
pub(super) struct Free {
    pub(super) entry: usize,
    pub(super) size: f64,
}

/// Widens the intervals of `identifications` to joint ones. Those of parameters that rest on a bound, or that the logs do not
/// identify alone, stay; all do, if more than [`MAX_FREE`] are left or the simulation of a move diverges.
///
/// # Errors
/// As [`super::evaluate`].
pub(super) fn joint(
    around: &Around<'_>,
    alternatives: &[Alternative<'_>],
    identifications: &mut [Identification],
) -> Result<(), FitError> {
    let Around { theta, values, views, .. } = *around;
    let free = free(theta, values, identifications);
    if free.is_empty() || free.len() > MAX_FREE {
        return Ok(());
    }
    // Central differences: moves of one give slopes and the diagonal, moves of two the rest of the curvature.
    let ones = moves_of_one(&free);
    let twos = moves_of_two(&free);
    let candidates: Vec<Vec<f64>> =
        ones.iter().chain(&twos).map(|moved| around.moved(&free, moved)).collect();
    let Some(costs) = around.costs(around.simulator, views, &candidates)? else { return Ok(()) };
    let (single, double) = costs.split_at(ones.len());
    let curvature = curvature(around.centre[0].powi(2), single, double, free.len());
    let Some((inverse, flat)) = inverse(&curvature) else { return Ok(()) };
    // The search need not end where the slope is 0. What all recordings have of it is taken off below.
    let here = slope(single, 0);

    // Where the minimum would lie without each group of recordings: one Newton step from the values.
    let mut without = vec![Vec::new(); free.len()];
    for view in 1..views.count() {
        let step = -(&inverse * (slope(single, view) - &here));
        without.iter_mut().zip(step.iter()).for_each(|(steps, step)| steps.push(*step));
    }
    // Along a direction in which the cost hardly rises, recordings do not pull either way: how far it may be off follows
    // from the least rise alone, as two deviations.
    let along = |at: usize| flat.iter().map(|one| 0.25 / FLATTEST * one[at] * one[at]).sum();
    let mut shifts: Vec<f64> = (0..free.len()).map(along).collect();
    let whole = Views::whole(views.cost(), around.simulator.recordings());
    for alternative in alternatives {
        let singles = &candidates[..ones.len()];
        // An alternative whose simulation of a move diverges says nothing.
        let Some(costs) = around.costs(alternative.simulator, &whole, singles)? else { continue };
        let step = -(&inverse * (slope(&costs, 0) - &here));
        shifts.iter_mut().zip(step.iter()).for_each(|(sum, step)| *sum += step * step);
    }
    // One recording has no parts; its noise is then not estimated here.
    // A view is of all recordings, the others leave out one group each: g groups have g − 1 degrees of freedom.
    let degrees = views.count().checked_sub(2).unwrap_or(usize::MAX);
    let quantile = stats::student_t_95(degrees);
    for (at, free) in free.iter().enumerate() {
        // With one recording only the noise along each parameter is known, as two deviations of it alone.
        let sampling = match &without[at][..] {
            [] => 0.5 * (curvature[(at, at)] * inverse[(at, at)]).max(1.0).sqrt(),
            steps => jackknife(steps),
        };
        let half = quantile * (sampling * sampling + shifts[at]).sqrt() * free.size;
        if half.is_finite() {
            identifications[free.entry].widen(&theta.entries()[free.entry], values[free.entry], half);
        }
    }
    // Straight intervals miss bent valleys, so the cost itself is followed along each flat direction.
    flat.iter().try_for_each(|direction| reach(around, &free, direction, identifications))
}

impl Around<'_> {
    /// The values, moved by `by` sizes of each free parameter.
    fn moved(&self, free: &[Free], by: &[f64]) -> Vec<f64> {
        let mut values = self.values.to_vec();
        for (free, by) in free.iter().zip(by) {
            values[free.entry] += by * free.size;
        }
        values
    }

    /// Squares of the costs of moved values, one a view; `None` if one of them diverges.
    fn costs(
        &self,
        simulator: &dyn Simulator,
        views: &Views<'_>,
        moved: &[Vec<f64>],
    ) -> Result<Option<Vec<Vec<f64>>>, FitError> {
        let resets = views.cost().resets();
        let rollout = |values: &Vec<f64>| Rollout { values: values.clone(), resets, draw: self.draw };
        let rollouts: Vec<Rollout> = moved.iter().map(rollout).collect();
        let (costs, _) = simulator.views(self.theta, views, &rollouts, &|| (), self.cancel)?;
        let squares = |costs: Vec<f64>| costs.iter().map(|cost| cost * cost).collect();
        Ok(costs.into_iter().map(|costs| costs.map(squares)).collect())
    }
}

/// Parameters that the logs identify and that do not rest on a bound.
fn free(theta: &Theta, values: &[f64], identifications: &[Identification]) -> Vec<Free> {
    let entries = theta.entries().iter().zip(values).zip(identifications).enumerate();
    let free_entry =
        |(entry, ((one, value), identification)): (usize, ((&crate::Entry, &f64), &Identification))| {
            // Moves go to both sides, so the nearer bound limits their size.
            let room = (value - one.lower).min(one.upper - value);
            let size = (0.5 * (identification.upper - identification.lower)).min(room);
            (identification.identified && size > ROOM * (one.upper - one.lower))
                .then_some(Free { entry, size })
        };
    entries.filter_map(free_entry).collect()
}

/// Each parameter up and down.
fn moves_of_one(free: &[Free]) -> Vec<Vec<f64>> {
    let unit = |at: usize, by: f64| (0..free.len()).map(|k| if k == at { by } else { 0.0 }).collect();
    (0..free.len()).flat_map(|at| [unit(at, 1.0), unit(at, -1.0)]).collect()
}

/// Each pair of parameters up and down together.
fn moves_of_two(free: &[Free]) -> Vec<Vec<f64>> {
    let unit = |pair: [usize; 2], by: f64| {
        (0..free.len()).map(|k| if pair.contains(&k) { by } else { 0.0 }).collect()
    };
    pairs(free.len()).flat_map(|pair| [unit(pair, 1.0), unit(pair, -1.0)]).collect()
}

fn pairs(count: usize) -> impl Iterator<Item = [usize; 2]> {
    (0..count).flat_map(move |a| (a + 1..count).map(move |b| [a, b]))
}

/// Half the difference of each parameter's squared costs up and down, of one view.
fn slope(single: &[Vec<f64>], view: usize) -> DVector<f64> {
    // A central difference: the two moves of an entry lie 2 apart.
    let differences = single.chunks_exact(2).map(|both| 0.5 * (both[0][view] - both[1][view]));
    DVector::from_iterator(single.len() / 2, differences)
}

/// Second differences of the square of the whole cost, in units of the moves.
fn curvature(centre: f64, single: &[Vec<f64>], double: &[Vec<f64>], count: usize) -> DMatrix<f64> {
    // Moves have the length 1, so the second difference is the curvature.
    let rise = |both: &[Vec<f64>]| both[0][0] + both[1][0] - 2.0 * centre;
    let mut curvature = DMatrix::zeros(count, count);
    for (at, both) in single.chunks_exact(2).enumerate() {
        curvature[(at, at)] = rise(both);
    }
    for ([a, b], both) in pairs(count).zip(double.chunks_exact(2)) {
        // Two entries that move together rise by both diagonals and twice the mixed part.
        let mixed = 0.5 * (rise(both) - curvature[(a, a)] - curvature[(b, b)]);
        curvature[(a, b)] = mixed;
        curvature[(b, a)] = mixed;
    }
    curvature
}

/// The inverse with no direction flatter than [`FLATTEST`], and the directions that are; `None` if the cost does not
/// rise: a Newton step along a flat direction would be as long as noise makes it.
fn inverse(curvature: &DMatrix<f64>) -> Option<(DMatrix<f64>, Vec<DVector<f64>>)> {
    let min = FLATTEST * curvature.trace() / curvature.nrows() as f64;
    // NaN fails here too, as does a cost that falls in the moves on average.
    if !(min.is_finite() && min > 0.0) {
        return None;
    }
    let mut parts = curvature.clone().symmetric_eigen();
    let columns = parts.eigenvectors.column_iter().zip(parts.eigenvalues.iter());
    let flat = columns.filter(|(_, value)| **value < min).map(|(one, _)| one.into_owned()).collect();
    parts.eigenvalues.apply(|value| *value = value.max(min).recip());
    Some((parts.recompose(), flat))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// f = ½ uᵀ H u: second differences give H, and mixed ones its off-diagonal.
    #[test]
    fn the_curvature_of_a_quadratic_is_exact() {
        let h = [[2.0, 0.9], [0.9, 1.0]];
        let f = |u: &[f64]| {
            (0..2)
                .flat_map(|a| (0..2).map(move |b| (a, b)))
                .map(|(a, b)| 0.5 * u[a] * h[a][b] * u[b])
                .sum::<f64>()
                + 3.0
        };
        let free = [Free { entry: 0, size: 1.0 }, Free { entry: 1, size: 1.0 }];
        let evaluated = |moves: Vec<Vec<f64>>| moves.iter().map(|u| vec![f(u)]).collect::<Vec<_>>();
        let (single, double) = (evaluated(moves_of_one(&free)), evaluated(moves_of_two(&free)));
        let curvature = curvature(3.0, &single, &double, 2);
        let (back, flat) =
            inverse(&curvature).map(|(inverse, flat)| (inverse * &curvature, flat)).unwrap_or_default();
        assert!(flat.is_empty());
        for (a, row) in h.iter().enumerate() {
            for (b, value) in row.iter().enumerate() {
                assert!((curvature[(a, b)] - value).abs() < 1e-14);
                assert!((back[(a, b)] - f64::from(u8::from(a == b))).abs() < 1e-13);
            }
        }
        assert!(slope(&single, 0).norm() < 1e-14);
        assert!(inverse(&DMatrix::zeros(2, 2)).is_none());
        let ridge = DMatrix::from_element(2, 2, 1.0);
        let flat = inverse(&ridge).map(|(_, flat)| flat).unwrap_or_default();
        assert!(flat.len() == 1 && (flat[0][0] + flat[0][1]).abs() < 1e-12, "{flat:?}");
    }
}
