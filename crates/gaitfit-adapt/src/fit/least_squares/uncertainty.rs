//! How far the values of a least-squares fit can be trusted, all entries together.
//!
//! Two things move an estimate. The choice of logs does: pieces of logs are drawn anew with replacement, and one Newton
//! step from the values found leads to what the fit would have found with them (the one-step bootstrap of Davidson and
//! MacKinnon 1999; its covariance is the sandwich of Huber 1967, with pieces of logs as clusters). And the simulator is
//! not the robot, which no number of logs shows: one step leads to what other simulators would have found, those with
//! another step or solver. Each such shift counts as one standard deviation of an error along it.

use super::normal::{Loss, Normal};
use super::residuals::{Problem, Residuals};
use super::{Around, around};
use crate::cost::Cost;
use crate::fit::FitError;
use crate::{Cancel, Simulator, Theta};
use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::stats;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Pieces that the logs are cut into, at least, as far as they have so many samples.
const PIECES: usize = 24;
/// Fewest samples of a piece: what happens within belongs together.
const LEAST_SAMPLES: usize = 25;
/// Draws of θ.
const DRAWS: usize = 64;
/// Damping that keeps equations solvable in which the logs say nothing of an entry.
const RIDGE: f64 = 1e-9;

/// Where the estimate would be if something were otherwise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shift {
    /// What is otherwise.
    pub what: String,
    /// How far it is from the values found, one number an entry, in the entry's unit.
    pub by: Vec<f64>,
}

/// Joint uncertainty of a fit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Uncertainty {
    /// Standard deviation of each entry from the choice of logs.
    pub sampling: Vec<f64>,
    /// Errors of the simulator, as far as others show them.
    pub shifts: Vec<Shift>,
    /// Standard deviation of each entry from both.
    pub deviation: Vec<f64>,
    /// 95 % interval of each entry, not limited to its bounds.
    pub interval: Vec<[f64; 2]>,
    /// Draws of θ from the joint distribution, within the bounds.
    pub draws: Vec<Vec<f64>>,
}

/// A simulator that could stand in for the fit's.
pub struct Alternative<'a> {
    /// How it differs, in words.
    pub what: String,
    /// It.
    pub simulator: &'a dyn Simulator,
}

/// Measures it around `values`, where a search of least squares ended. `None` if their simulation diverges.
///
/// # Errors
/// As [`super::super::Fit::step`].
pub fn uncertainty(
    simulator: &dyn Simulator,
    alternatives: &[Alternative<'_>],
    theta: &Theta,
    cost: &dyn Cost,
    values: &[f64],
    cancel: &Cancel<'_>,
) -> Result<Option<Uncertainty>, FitError> {
    let problem = Problem { simulator, theta, cost, draw: 0, cancel };
    let Some(Around { residuals, jacobian, .. }) = around(&problem, values)? else { return Ok(None) };
    let loss = Loss::of(&residuals);
    let pieces = pieces(&residuals, jacobian.width).into_iter();
    let part = |(recording, rows)| Normal::of(&jacobian, &residuals, loss, recording, rows);
    let parts: Vec<Normal> = pieces.map(part).collect();
    let mut whole = Normal::zero(values.len());
    parts.iter().for_each(|part| whole.add(part));

    let mut shifts = Vec::new();
    for alternative in alternatives {
        let other = Problem { simulator: alternative.simulator, ..problem };
        let Some(found) = other.residuals(&[values.to_vec()])?.pop().flatten() else { continue };
        let slope = Normal::whole(&jacobian, &found, loss).slope;
        if let Some(by) = solve(&whole.curvature, &(slope - &whole.slope)) {
            shifts.push(Shift { what: alternative.what.clone(), by });
        }
    }
    Ok(together(theta, values, &parts, &whole, shifts))
}

fn together(
    theta: &Theta,
    values: &[f64],
    parts: &[Normal],
    whole: &Normal,
    shifts: Vec<Shift>,
) -> Option<Uncertainty> {
    let entries = values.len();
    let count = parts.len() as f64;
    let mut scores = DMatrix::zeros(entries, entries);
    for part in parts {
        let score = &part.slope - &whole.slope / count;
        scores += &score * score.transpose();
    }
    let factor = if parts.len() > 1 { count / (count - 1.0) } else { 1.0 };
    let mut half = DMatrix::zeros(entries, entries);
    for (at, column) in scores.column_iter().enumerate() {
        half.set_column(at, &DVector::from_vec(solve(&whole.curvature, &column.into_owned())?));
    }
    let half = half.transpose();
    let mut covariance = DMatrix::zeros(entries, entries);
    for (at, column) in half.column_iter().enumerate() {
        covariance.set_column(at, &DVector::from_vec(solve(&whole.curvature, &column.into_owned())?));
    }
    let sampling: Vec<f64> = (0..entries).map(|at| (factor * covariance[(at, at)]).max(0.0).sqrt()).collect();
    let deviation: Vec<f64> = (0..entries)
        .map(|at| {
            let model: f64 = shifts.iter().map(|shift| shift.by[at].powi(2)).sum();
            (sampling[at] * sampling[at] + model).sqrt()
        })
        .collect();
    let quantile = stats::student_t_95(parts.len().saturating_sub(1).max(1));
    let interval =
        values.iter().zip(&deviation).map(|(value, one)| [value - quantile * one, value + quantile * one]);
    Some(Uncertainty {
        interval: interval.collect(),
        draws: draws(theta, values, parts, &shifts),
        sampling,
        deviation,
        shifts,
    })
}

/// Draws of θ: pieces drawn anew, and a step along each shift.
fn draws(theta: &Theta, values: &[f64], parts: &[Normal], shifts: &[Shift]) -> Vec<Vec<f64>> {
    let stream = Stream::new(0, Purpose::BOOTSTRAP);
    let one = |draw: usize| {
        let own = stream.environment(u32::try_from(draw).unwrap_or(u32::MAX));
        let pick = |k: usize| {
            let at = own.step(0).uniform(u32::try_from(k).unwrap_or(u32::MAX)) * parts.len() as f64;
            &parts[(at as usize).min(parts.len() - 1)]
        };
        let mut drawn = Normal::zero(values.len());
        (0..parts.len()).for_each(|k| drawn.add(pick(k)));
        let step = solve(&drawn.curvature, &drawn.slope).unwrap_or_else(|| vec![0.0; values.len()]);
        let entries = theta.entries().iter().zip(values).zip(step).enumerate();
        let moved = entries.map(|(at, ((entry, value), step))| {
            let model: f64 = shifts
                .iter()
                .enumerate()
                .map(|(k, shift)| own.step(1).normal(u32::try_from(k).unwrap_or(u32::MAX)) * shift.by[at])
                .sum();
            (value + step + model).clamp(entry.lower, entry.upper)
        });
        moved.collect()
    };
    (0..DRAWS).map(one).collect()
}

/// The step to the minimum of the quadratic model.
fn solve(curvature: &DMatrix<f64>, slope: &DVector<f64>) -> Option<Vec<f64>> {
    let normal = Normal { curvature: curvature.clone(), slope: slope.clone() };
    Some(normal.step(RIDGE, &vec![true; slope.len()])?.as_slice().to_vec())
}

/// Recordings, or pieces of them where they are few.
fn pieces(residuals: &Residuals, width: usize) -> Vec<(usize, Range<usize>)> {
    let each = PIECES.div_ceil(residuals.recordings.len().max(1));
    let of = |(recording, found): (usize, &Vec<f32>)| {
        let samples = found.len() / width.max(1);
        let length = samples.div_ceil(each).max(LEAST_SAMPLES);
        (0..samples)
            .step_by(length)
            .map(move |from| (recording, from..(from + length).min(samples)))
            .collect::<Vec<_>>()
    };
    residuals.recordings.iter().enumerate().flat_map(of).collect()
}
