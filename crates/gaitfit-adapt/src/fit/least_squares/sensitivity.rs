//! How precisely logs can tell each parameter, from derivatives alone: no fit is made.
//!
//! With J the derivatives of all differences by θ and s their size, the covariance of a least-squares estimate is
//! s² τ (JᵀJ)⁻¹ (Gauss and Markov). Differences of neighbouring samples are alike, so that they count as fewer: τ samples
//! as one. It is the sum of their correlations, cut where they first are not positive (Geyer 1992, in its simplest form).

use super::normal::{Loss, Normal};
use super::residuals::{Problem, Residuals};
use super::{Around, around};
use crate::fit::FitError;
use nalgebra::{DMatrix, SymmetricEigen};
use serde::{Deserialize, Serialize};

/// A combination of parameters with less than this part of the largest effect cannot be identified.
const MIN_EFFECT: f64 = 1e-9;
/// Part of a parameter in such a combination from which it cannot be identified either.
const SHARE: f64 = 1e-3;
/// Most samples over which differences are compared with each other.
const MAX_APART: usize = 400;

/// How precisely logs can tell each entry of θ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sensitivity {
    /// Root mean square of the differences that the deviations hold for, where the robot's range is 2.
    pub difference: f64,
    /// Neighbouring samples that count as one.
    pub together: f64,
    /// Standard deviation to expect of each entry in a fit of all, in its unit; `None` where the logs do not tell it from
    /// others, or not at all.
    pub deviation: Vec<Option<f64>>,
    /// The same in a fit of that entry alone.
    pub alone: Vec<Option<f64>>,
    /// Correlations of the estimates, `entries × entries`; 0 where there are none.
    pub correlation: Vec<Vec<f64>>,
    /// JᵀJ, `entries × entries`. It adds up over logs that are compared in one scaling.
    pub curvature: Vec<Vec<f64>>,
}

/// How precisely the logs of `problem` can tell each entry of θ near `values`. `difference`: what the fitted simulator
/// will differ by from the logs, where the robot's range is 2; without it, what `values` differ by. `None` if the
/// simulation of `values` diverges.
///
/// # Errors
/// As [`super::super::Fit::step`].
pub fn sensitivity(
    problem: Problem<'_>,
    values: &[f64],
    difference: Option<f64>,
) -> Result<Option<Sensitivity>, FitError> {
    let Some(Around { residuals, jacobian, .. }) = around(&problem, values)? else { return Ok(None) };
    let curvature =
        Normal::whole(&jacobian, &residuals, Loss::square(), problem.simulator.threads()).curvature;
    let numbers: usize = residuals.recordings.iter().map(Vec::len).sum();
    let squares: f64 = residuals.recordings.iter().flatten().map(|one| f64::from(*one).powi(2)).sum();
    // Each fitted entry takes away the errors of one number.
    let rms = (squares / numbers.saturating_sub(values.len()).max(1) as f64).sqrt();
    // The caller may know better how far a fitted simulator stays from logs.
    let difference = difference.unwrap_or(rms);
    let together = together(&residuals, jacobian.width);
    let variance = difference * difference * together;
    let covariance = inverse(&curvature);
    let spread = |of: f64| (variance * of).sqrt();
    let entries = 0..values.len();
    let correlation = |i: usize, j: usize| match (covariance[i].get(i), covariance[j].get(j)) {
        (Some(one), Some(other)) => covariance[i][j] / (one * other).sqrt(),
        _ => 0.0,
    };
    Ok(Some(Sensitivity {
        difference,
        together,
        deviation: entries.clone().map(|i| covariance[i].get(i).map(|variance| spread(*variance))).collect(),
        alone: entries
            .clone()
            .map(|i| Some(curvature[(i, i)]).filter(|one| *one > 0.0).map(|one| spread(1.0 / one)))
            .collect(),
        correlation: entries.clone().map(|i| entries.clone().map(|j| correlation(i, j)).collect()).collect(),
        curvature: entries.clone().map(|i| curvature.row(i).iter().copied().collect()).collect(),
    }))
}

/// Rows of the inverse; empty for entries that some combination without an effect has a part of.
pub(super) fn inverse(curvature: &DMatrix<f64>) -> Vec<Vec<f64>> {
    let count = curvature.nrows();
    // Entries have units that differ by orders of magnitude.
    let scale: Vec<f64> = curvature
        .diagonal()
        .iter()
        .map(|value| if *value > 0.0 { 1.0 / value.sqrt() } else { 0.0 })
        .collect();
    let scaled = DMatrix::from_fn(count, count, |i, j| {
        if scale[i] * scale[j] == 0.0 { 0.0 } else { curvature[(i, j)] * scale[i] * scale[j] }
    });
    let eigen = SymmetricEigen::new(scaled);
    let min = MIN_EFFECT * eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
    // A pseudo-inverse: directions without an effect are left out, and every entry with a part in one is unknown.
    let (mut identified, mut total) = (vec![true; count], DMatrix::<f64>::zeros(count, count));
    for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if *value > min {
            total += vector * vector.transpose() / *value;
        } else {
            identified
                .iter_mut()
                .zip(vector.iter())
                .for_each(|(identified, part)| *identified &= part.abs() < SHARE);
        }
    }
    // Back to the entries' units.
    let row = |i: usize| (0..count).map(|j| total[(i, j)] * scale[i] * scale[j]).collect();
    (0..count).map(|i| if identified[i] { row(i) } else { Vec::new() }).collect()
}

/// Neighbouring samples that count as one, at least 1.
fn together(residuals: &Residuals, width: usize) -> f64 {
    // Correlation of differences so many samples apart, recordings not mixed.
    let product = |apart: usize| -> f64 {
        let product = |one: &Vec<f32>| -> f64 {
            // A recording that is shorter than that has no such pairs.
            let later = one.get(apart * width..).unwrap_or_default();
            one.iter().zip(later).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
        };
        residuals.recordings.iter().map(product).sum()
    };
    let whole = product(0);
    if whole <= 0.0 {
        return 1.0;
    }
    let samples = residuals.recordings.iter().map(|one| one.len() / width.max(1)).max().unwrap_or(0);
    let mut sum = 1.0;
    // Further apart than a quarter of a log, too few pairs of samples are left.
    for apart in 1..MAX_APART.min(samples / 4) {
        let alike = product(apart) / whole;
        if alike <= 0.0 {
            break;
        }
        // Pairs are so far apart in both directions.
        sum += 2.0 * alike;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_inverse_leaves_out_what_cannot_be_told() {
        // Entries 0 and 1 act alike; 2 is identified, in other units; 3 does nothing.
        let curvature = DMatrix::from_row_slice(
            4,
            4,
            &[4.0, 2.0, 0.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1e-8, 0.0, 0.0, 0.0, 0.0, 0.0],
        );
        let inverted = inverse(&curvature);
        assert!(inverted[0].is_empty() && inverted[1].is_empty() && inverted[3].is_empty());
        assert!((inverted[2][2] / 1e8 - 1.0).abs() < 1e-9);
        let whole = DMatrix::from_row_slice(2, 2, &[4.0, 2.0, 2.0, 3.0]);
        let inverted = inverse(&whole);
        assert!((inverted[0][0] - 3.0 / 8.0).abs() < 1e-12 && (inverted[0][1] + 2.0 / 8.0).abs() < 1e-12);
    }

    #[test]
    fn alike_neighbours_count_as_one() {
        let one_log = |numbers: Vec<f32>| Residuals { recordings: vec![numbers], cost: 0.0, falls: 0 };
        // Signs that do not follow each other, and runs of four of them.
        let sign = |i: u32| if (i.wrapping_mul(2_654_435_761) >> 16) & 1 == 0 { 1.0f32 } else { -1.0 };
        let apart = together(&one_log((0..4000).map(sign).collect()), 1);
        let runs = together(&one_log((0..4000).map(|i| sign(i / 4)).collect()), 1);
        assert!(apart < 1.5, "{apart}");
        // 1 + 2 (3/4 + 2/4 + 1/4).
        assert!((runs - 4.0).abs() < 0.6, "{runs}");
    }
}
