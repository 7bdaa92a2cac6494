//! Errors that a fit leaves unexplained, how far they could have moved its values, and whether more parameters explain
//! them.
//!
//! Noise of sensors forgets: an error says nothing of the next sample's. What a simulator lacks does not: its errors
//! are alike from sample to sample. The second part of the errors, their covariance with the next sample's, could be
//! the effect of wrong values that other wrong values hide. How far each entry would have to be off for all of it
//! follows from the derivatives: √(S (JᵀJ)⁻¹ᵢᵢ), S the sum of squares of that part. It repeats with the motion, so that
//! longer logs do not lessen it.

use super::normal::{Loss, Normal};
use super::residuals::{Problem, Residuals};
use super::sensitivity::inverse;
use super::{Around, FIRST_DAMPING, GaussNewton, around};
use crate::fit::FitError;
use serde::{Deserialize, Serialize};

/// Errors that a fit leaves unexplained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Unexplained {
    /// Root mean square of all errors, where the robot's range is 2.
    pub error: f64,
    /// Correlation of an error with the next sample's error, over all signals: 0 for noise, near 1 if the simulator
    /// lacks something.
    pub memory: f64,
    /// How far each entry would be off, in its unit, if it alone caused all correlated errors; `None` if the logs do
    /// not show the entry.
    pub reach: Vec<Option<f64>>,
}

/// The errors that `problem` leaves at `values`; `None` if the simulation of `values` diverges.
///
/// # Errors
/// As [`super::super::Fit::step`].
pub fn unexplained(problem: Problem<'_>, values: &[f64]) -> Result<Option<Unexplained>, FitError> {
    let Some(Around { residuals, jacobian, .. }) = around(&problem, values)? else { return Ok(None) };
    let covariance =
        inverse(&Normal::whole(&jacobian, &residuals, Loss::square(), problem.simulator.threads()).curvature);
    let (squares, alike) = sums(&residuals, jacobian.width);
    let count = residuals.recordings.iter().map(Vec::len).sum::<usize>().max(1);
    // An entry that the logs do not show has an empty row.
    let reach = |(at, row): (usize, &Vec<f64>)| row.get(at).map(|own| (alike * own).max(0.0).sqrt());
    Ok(Some(Unexplained {
        error: (squares / count as f64).sqrt(),
        memory: if squares > 0.0 { alike / squares } else { 0.0 },
        reach: covariance.iter().enumerate().map(reach).collect(),
    }))
}

/// Sum of squares of all errors, and of the part that is alike from sample to sample.
fn sums(residuals: &Residuals, width: usize) -> (f64, f64) {
    let mut sums = (0.0, 0.0);
    for column in 0..width {
        let (mut square, mut alike) = (0.0, 0.0);
        for recording in &residuals.recordings {
            let numbers = || recording.iter().skip(column).step_by(width).map(|one| f64::from(*one));
            square += numbers().map(|one| one * one).sum::<f64>();
            alike += numbers().zip(numbers().skip(1)).map(|(one, next)| one * next).sum::<f64>();
        }
        // Errors that alternate in sign are not alike.
        sums = (sums.0 + square, sums.1 + alike.max(0.0));
    }
    sums
}

/// Goes downhill from `values` by at most `steps` steps of least squares: the lowest values and their cost. `None` if a
/// simulation diverges.
///
/// # Errors
/// As [`super::super::Fit::step`].
pub fn descend(
    problem: Problem<'_>,
    values: &[f64],
    steps: usize,
    tolerance: f64,
) -> Result<Option<(Vec<f64>, f64)>, FitError> {
    let mut search = GaussNewton {
        generation: 0,
        values: values.to_vec(),
        damping: FIRST_DAMPING,
        best: None,
        stop: None,
    };
    while search.stop.is_none() {
        // A trial that diverges is not taken. `None` means that the present values diverge.
        if search.step(&problem, steps, tolerance)?.is_none() {
            return Ok(None);
        }
    }
    Ok(search.best.map(|best| (best.x, best.cost)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_alike_from_sample_to_sample_is_no_noise() {
        let one_log = |numbers: Vec<f32>| Residuals { recordings: vec![numbers], cost: 0.0, falls: 0 };
        let sign = |i: u32| if (i.wrapping_mul(2_654_435_761) >> 16) & 1 == 0 { 1.0f32 } else { -1.0 };
        let (squares, alike) = sums(&one_log((0..4000).map(sign).collect()), 1);
        assert!((squares - 4000.0).abs() < 1e-9 && alike < 200.0, "{squares} {alike}");
        // A slow wave in the first of two columns, noise in the second.
        let mixed = |i: u32| if i.is_multiple_of(2) { (0.01 * i as f32).sin() } else { sign(i / 2) };
        let (squares, alike) = sums(&one_log((0..8000).map(mixed).collect()), 2);
        assert!((squares - 6000.0).abs() < 60.0 && (alike - 2000.0).abs() < 200.0, "{squares} {alike}");
        assert_eq!(sums(&one_log(Vec::new()), 3), (0.0, 0.0));
    }
}
