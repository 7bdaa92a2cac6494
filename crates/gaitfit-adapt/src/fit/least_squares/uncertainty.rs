//! How far the values of a least-squares fit can be trusted, all entries together.
//!
//! Two things move an estimate. The choice of logs does: pieces of logs are drawn anew with replacement, and one Newton
//! step from the values found leads to what the fit would have found with them (the one-step bootstrap of Davidson and
//! MacKinnon 1999; its covariance is the sandwich of Huber 1967, with pieces of logs as clusters). And the simulator is
//! not the robot, which no number of logs shows: one step leads to what other simulators would have found, those with
//! another step or solver. Each such shift counts as one standard deviation of an error along it.

use super::normal::{Loss, Normal};
use super::residuals::{Problem, Residuals};
use super::{Around, Correction, around, free};
use crate::fit::FitError;
use crate::{Entry, Simulator, Theta};
use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::{pool, stats};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::ops::Range;

// Student's quantile is 2.07 for 23 degrees of freedom. Far fewer pieces would widen all intervals.
/// Min number of pieces into which the logs are cut, if they have enough samples.
const PIECES: usize = 24;
/// Fewest samples of a piece, half a second at 50 Hz: what happens within belongs together.
const MIN_SAMPLES: usize = 25;
/// Draws of θ.
const DRAWS: usize = 64;
/// Damping that keeps equations solvable in which the logs say nothing of an entry.
pub(super) const RIDGE: f64 = 1e-9;

/// Distance of another estimate from the fit's, and what makes that one differ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shift {
    /// The difference that moves the estimate, in words.
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
    /// The simulator itself.
    pub simulator: &'a dyn Simulator,
}

/// Measures the joint uncertainty of `values`, where a search of least squares of `problem` ended, with its random
/// draws. With a `correction` it is that of the corrected values. `None` if the simulation of `values` diverges.
///
/// # Errors
/// As [`super::super::Fit::step`].
pub fn uncertainty(
    problem: Problem<'_>,
    alternatives: &[Alternative<'_>],
    values: &[f64],
    correction: Option<&Correction>,
) -> Result<Option<Uncertainty>, FitError> {
    let theta = problem.theta;
    let Some(here) = around(&problem, values)? else { return Ok(None) };
    let loss = Loss::new(&here.residuals);
    let parts = parts(&here, loss, problem.simulator.threads());
    let mut estimate = Estimate::new(theta, values, &parts);
    let mut shifts = Vec::new();
    // Where the slope ends; the search ends where the loss does, and derivatives are limited. A correction goes there.
    let further = estimate.step(&estimate.whole.slope).filter(|_| correction.is_none());
    if let Some(by) = further {
        shifts.push(Shift { what: "a further step of the search".to_owned(), by });
    }
    // Each other simulator would have its minimum elsewhere: how far away is the shift.
    for alternative in alternatives {
        let other = Problem { simulator: alternative.simulator, ..problem };
        // An alternative that diverges at these values says nothing.
        let Some(residuals) = other.residuals(&[values.to_vec()])?.pop().flatten() else { continue };
        // The Jacobian is this simulator's: the other one only moves the residuals, at the price of one
        // simulation.
        let slope = Normal::whole(&here.jacobian, &residuals, loss, problem.simulator.threads()).slope;
        if let Some(by) = estimate.step(&(slope - &estimate.whole.slope)) {
            shifts.push(Shift { what: alternative.what.clone(), by });
        }
    }
    // From here on the intervals belong to the corrected values.
    if let Some(correction) = correction {
        shifts.push(Shift { what: "a part of the correction".to_owned(), by: correction.doubt() });
        estimate.values = &correction.corrected;
        estimate.inflation = correction.inflation();
        let rows = &correction.response;
        estimate.response = Some(DMatrix::from_fn(rows.len(), rows.len(), |at, other| rows[at][other]));
    }
    Ok(estimate.together(&parts, shifts))
}

/// Normal equations of pieces of the logs, on `threads` threads.
fn parts(here: &Around, loss: Loss, threads: usize) -> Vec<Normal> {
    let pieces = pieces(&here.residuals, here.jacobian.width);
    pool::map(pieces.len(), threads, |piece| {
        let (recording, rows) = pieces[piece].clone();
        Normal::new(&here.jacobian, &here.residuals, loss, recording, rows)
    })
}

/// Entries of `theta` without an effect on logs, `here` where they were fitted.
pub(super) fn silent(theta: &Theta, here: &Around, loss: Loss, threads: usize) -> Vec<bool> {
    let values = vec![0.0; theta.len()];
    Estimate::new(theta, &values, &parts(here, loss, threads)).silent
}

/// The result, and the directions in which it can move.
struct Estimate<'a> {
    theta: &'a Theta,
    values: &'a [f64],
    /// Factor on the deviation from the choice of logs: corrected values depend on it more, as simulated logs are
    /// few.
    inflation: f64,
    /// Change of the corrected values per change of the fit's values, where there is a correction.
    response: Option<DMatrix<f64>>,
    whole: Normal,
    /// Entries that neither rest on a bound which holds them, nor lack an effect.
    free: Vec<bool>,
    /// Entries without an effect: over all of their range the logs' pieces differ more than the loss does.
    silent: Vec<bool>,
    /// Σ g gᵀ of the pieces' slopes, less their mean.
    scores: DMatrix<f64>,
}

impl<'a> Estimate<'a> {
    fn new(theta: &'a Theta, values: &'a [f64], parts: &[Normal]) -> Self {
        let mut whole = Normal::zero(values.len());
        parts.iter().for_each(|part| whole.add(part));
        let count = parts.len().max(1) as f64;
        let mut scores = DMatrix::zeros(values.len(), values.len());
        for part in parts {
            let score = &part.slope - &whole.slope / count;
            scores += &score * score.transpose();
        }
        // The scores are about their mean, so one of them is not free.
        if parts.len() > 1 {
            scores *= count / (count - 1.0);
        }
        let silent = |(at, entry): (usize, &Entry)| {
            let (curvature, noise) = (whole.curvature[(at, at)], scores[(at, at)].max(0.0).sqrt());
            // The first part stands for a curvature of 0: nothing in the logs depends on the entry.
            curvature <= 1e-300 || curvature * (entry.upper - entry.lower) <= 2.0 * noise
        };
        let silent: Vec<bool> = theta.entries().iter().enumerate().map(silent).collect();
        let free = free(theta, values, &whole).into_iter().zip(&silent).map(|(free, silent)| free && !silent);
        Self { free: free.collect(), theta, values, inflation: 1.0, response: None, whole, silent, scores }
    }

    /// Change of the estimate where the slope of the loss changes by `slope`.
    fn step(&self, slope: &DVector<f64>) -> Option<Vec<f64>> {
        self.solve(&self.whole.curvature, slope)
    }

    /// The step to the minimum of the quadratic model, on which free entries alone move.
    fn solve(&self, curvature: &DMatrix<f64>, slope: &DVector<f64>) -> Option<Vec<f64>> {
        let normal = Normal { curvature: curvature.clone(), slope: slope.clone() };
        Some(normal.step(RIDGE, &self.free)?.as_slice().to_vec())
    }

    /// Standard deviation of each entry from the choice of logs. One that rests on a bound has that of a fit of it
    /// alone, which says how firmly it rests. One without an effect has half of its range.
    fn sampling(&self) -> Option<Vec<f64>> {
        let entries = self.values.len();
        // H⁻¹ S H⁻¹ by two solutions, as each step is one with H.
        let mut half = DMatrix::zeros(entries, entries);
        for (at, column) in self.scores.column_iter().enumerate() {
            half.set_column(at, &DVector::from_vec(self.step(&column.into_owned())?));
        }
        let half = half.transpose();
        let mut covariance = DMatrix::zeros(entries, entries);
        for (at, column) in half.column_iter().enumerate() {
            covariance.set_column(at, &DVector::from_vec(self.step(&column.into_owned())?));
        }
        // The correction turns errors of the fit into errors of the robot's values.
        if let Some(response) = &self.response {
            covariance = response * covariance * response.transpose();
        }
        let deviation_at = |at: usize| {
            if self.silent[at] {
                // Half of the range: two deviations reach from bound to bound, and no correction widens the bounds.
                return 0.5 * (self.theta.entries()[at].upper - self.theta.entries()[at].lower);
            }
            let variance = if self.free[at] {
                covariance[(at, at)]
            } else {
                // Held at its bound it has no part in the joint equations, so it is judged alone.
                self.scores[(at, at)] / self.whole.curvature[(at, at)].powi(2)
            };
            self.inflation * variance.max(0.0).sqrt()
        };
        Some((0..entries).map(deviation_at).collect())
    }

    fn together(&self, parts: &[Normal], shifts: Vec<Shift>) -> Option<Uncertainty> {
        let sampling = self.sampling()?;
        let model = |at: usize| shifts.iter().map(|shift| shift.by[at].powi(2)).sum::<f64>();
        let deviation: Vec<f64> =
            sampling.iter().enumerate().map(|(at, one)| (one * one + model(at)).sqrt()).collect();
        // Pieces of logs are few, so the quantile is Student's.
        let quantile = stats::student_t_95(parts.len().saturating_sub(1).max(1));
        let entries = self.theta.entries().iter().zip(self.values).zip(&deviation).zip(&self.silent);
        let interval = entries.map(|(((entry, value), one), silent)| {
            if *silent {
                [entry.lower, entry.upper]
            } else {
                [value - quantile * one, value + quantile * one]
            }
        });
        Some(Uncertainty {
            interval: interval.collect(),
            draws: self.draws(parts, &shifts),
            sampling,
            deviation,
            shifts,
        })
    }

    /// Draws of θ: pieces drawn anew, and a step along each shift; anything for entries without an effect.
    fn draws(&self, parts: &[Normal], shifts: &[Shift]) -> Vec<Vec<f64>> {
        // The seed is fixed, so that the same fit gives the same draws. Step 0 of the stream is for pieces, step 1 for
        // shifts and step 2 for entries without an effect.
        let stream = Stream::new(0, Purpose::BOOTSTRAP);
        let place = |number: usize| u32::try_from(number).unwrap_or(u32::MAX);
        let one = |draw: usize| {
            let draws = stream.environment(place(draw));
            let mut drawn = Normal::zero(self.values.len());
            // The bootstrap: as many pieces as there are, drawn with replacement.
            for k in 0..parts.len() {
                let at = draws.step(0).uniform(place(k)) * parts.len() as f64;
                // Rounding may carry a draw to the end.
                drawn.add(&parts[(at as usize).min(parts.len() - 1)]);
            }
            let step = self.solve(&drawn.curvature, &(&drawn.slope - &self.whole.slope));
            // Equations that cannot be solved leave the values where they are.
            let step = DVector::from_vec(step.unwrap_or_else(|| vec![0.0; self.values.len()]));
            let step = self.response.as_ref().map_or_else(|| step.clone(), |response| response * &step);
            let entries = self.theta.entries().iter().zip(self.values).zip(step.iter()).enumerate();
            let moved = entries.map(|(at, ((entry, value), step))| {
                if self.silent[at] {
                    return entry.lower + draws.step(2).uniform(place(at)) * (entry.upper - entry.lower);
                }
                let along = |(k, shift): (usize, &Shift)| draws.step(1).normal(place(k)) * shift.by[at];
                let model: f64 = shifts.iter().enumerate().map(along).sum();
                (value + self.inflation * step + model).clamp(entry.lower, entry.upper)
            });
            moved.collect()
        };
        (0..DRAWS).map(one).collect()
    }
}

/// Recordings, or pieces of them where they are few.
fn pieces(residuals: &Residuals, width: usize) -> Vec<(usize, Range<usize>)> {
    // Where there are as many recordings as pieces are wanted, each stays whole.
    let each = PIECES.div_ceil(residuals.recordings.len().max(1));
    let blocks = |(recording, of_recording): (usize, &Vec<f32>)| {
        let samples = of_recording.len() / width.max(1);
        let length = samples.div_ceil(each).max(MIN_SAMPLES);
        (0..samples)
            .step_by(length)
            .map(move |from| (recording, from..(from + length).min(samples)))
            .collect::<Vec<_>>()
    };
    residuals.recordings.iter().enumerate().flat_map(blocks).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::{JointParameter, ParameterRule, Sharing};

    #[test]
    fn a_correction_does_not_widen_entries_without_an_effect() {
        let rule = ParameterRule { per: Sharing::All, ..ParameterRule::new(JointParameter::Damping) };
        let theta = Theta::from_rules(&[rule], &[], &["FL_hip".to_owned()]).unwrap();
        let mut estimate = Estimate::new(&theta, &[0.1], &[]);
        assert_eq!(estimate.silent, [true]);
        estimate.inflation = 1.5;
        let (entry, sampling) = (&theta.entries()[0], estimate.sampling().unwrap());
        assert!((sampling[0] - 0.5 * (entry.upper - entry.lower)).abs() < 1e-12, "{sampling:?}");
    }
}
