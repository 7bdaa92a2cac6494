//! Means with errors, and small least squares.

use gaitfit_log::MEDIAN_TO_DEVIATION;
use gaitfit_sim::stats;
use serde::Serialize;

/// A number with its standard error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Measured {
    /// The number.
    pub value: f64,
    /// Its standard error.
    pub error: f64,
}

/// Blocks whose means give the error of a mean: neighbouring samples are not independent.
const BLOCKS: usize = 10;

pub(super) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Standard deviation of samples.
pub(super) fn deviation(values: &[f64]) -> f64 {
    let centre = mean(values);
    let squares: f64 = values.iter().map(|x| (x - centre).powi(2)).sum();
    (squares / values.len().saturating_sub(1).max(1) as f64).sqrt()
}

/// The mean, with its error by blocks of time.
pub(super) fn mean_of_blocks(values: &[f64]) -> Measured {
    let length = values.len() / BLOCKS;
    if length == 0 {
        return Measured { value: mean(values), error: deviation(values) };
    }
    let means: Vec<f64> = values.chunks_exact(length).take(BLOCKS).map(mean).collect();
    Measured { value: mean(values), error: deviation(&means) / (BLOCKS as f64).sqrt() }
}

/// The value in the middle; 0 of none.
pub(super) fn median(values: &[f64]) -> f64 {
    stats::median(values).unwrap_or(0.0)
}

/// The median with its error by the median distance from it (the second factor is that of a normal density).
pub(super) fn robust(values: &[f64]) -> Measured {
    let centre = median(values);
    let distances: Vec<f64> = values.iter().map(|x| (x - centre).abs()).collect();
    let spread = MEDIAN_TO_DEVIATION * median(&distances);
    // √(π/2): the median of normal samples scatters by this factor more than their mean.
    Measured { value: centre, error: 1.2533 * spread / (values.len().max(1) as f64).sqrt() }
}

/// Distance between the lowest and the highest.
pub(super) fn span(values: impl IntoIterator<Item = f64>) -> f64 {
    let (low, high) = values
        .into_iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    if high >= low { high - low } else { 0.0 }
}

/// Slope of `y` over `x`; 0 where `x` does not change.
pub(super) fn slope(x: &[f64], y: &[f64]) -> f64 {
    let (of_x, of_y) = (mean(x), mean(y));
    let power: f64 = x.iter().map(|x| (x - of_x).powi(2)).sum();
    let product: f64 = x.iter().zip(y).map(|(x, y)| (x - of_x) * (y - of_y)).sum();
    if power > 0.0 { product / power } else { 0.0 }
}

/// Least squares of `N` unknowns: coefficients, their covariance without the factor of the noise, and the sum of squares that
/// is left. `None` where the columns do not determine them.
pub(super) fn least_squares<const N: usize>(
    rows: &[([f64; N], f64)],
) -> Option<([f64; N], [[f64; N]; N], f64)> {
    let mut normal = [[0.0; N]; N];
    let mut right = [0.0; N];
    for (row, y) in rows {
        for i in 0..N {
            right[i] += row[i] * y;
            for j in 0..N {
                normal[i][j] += row[i] * row[j];
            }
        }
    }
    // Columns are scaled to length 1: then a small pivot means that they depend on each other, whatever their units.
    let scale: [f64; N] = std::array::from_fn(|i| normal[i][i].sqrt());
    if scale.iter().any(|scale| *scale <= 0.0 || !scale.is_finite()) {
        return None;
    }
    // `left` becomes the identity and `inverse` the inverse of the scaled matrix.
    let mut left: [[f64; N]; N] =
        std::array::from_fn(|i| std::array::from_fn(|j| normal[i][j] / (scale[i] * scale[j])));
    let mut inverse: [[f64; N]; N] =
        std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    // Gauss–Jordan elimination with row pivoting.
    for pivot in 0..N {
        let best = (pivot..N).max_by(|a, b| left[*a][pivot].abs().total_cmp(&left[*b][pivot].abs()))?;
        left.swap(pivot, best);
        inverse.swap(pivot, best);
        let factor = left[pivot][pivot];
        // The pivot is 1 for columns at right angles. Below 1e-9 rounding (1e-16) leaves less than seven
        // digits.
        if factor.abs() < 1e-9 {
            return None;
        }
        for j in 0..N {
            left[pivot][j] /= factor;
            inverse[pivot][j] /= factor;
        }
        for other in (0..N).filter(|other| *other != pivot) {
            let factor = left[other][pivot];
            for j in 0..N {
                left[other][j] -= factor * left[pivot][j];
                inverse[other][j] -= factor * inverse[pivot][j];
            }
        }
    }
    let covariance: [[f64; N]; N] =
        std::array::from_fn(|i| std::array::from_fn(|j| inverse[i][j] / (scale[i] * scale[j])));
    let coefficients: [f64; N] =
        std::array::from_fn(|i| covariance[i].iter().zip(&right).map(|(a, b)| a * b).sum());
    // Summed from the rows: computed from the sums above it would be a small difference of large numbers.
    let left = rows
        .iter()
        .map(|(row, y)| (y - row.iter().zip(&coefficients).map(|(a, b)| a * b).sum::<f64>()).powi(2))
        .sum();
    Some((coefficients, covariance, left))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn coefficients_of_made_up_rows_come_back_and_the_rest_is_left() {
        let rows: Vec<([f64; 3], f64)> = (0..50)
            .map(|k| {
                let x = f64::from(k) * 0.1;
                let odd = if k % 2 == 0 { 0.01 } else { -0.01 };
                ([1.0, x, x * x], 3.0 - 2.0 * x + 0.5 * x * x + odd)
            })
            .collect();
        let (coefficients, _, left) = least_squares(&rows).unwrap();
        for (coefficient, truth) in coefficients.iter().zip([3.0, -2.0, 0.5]) {
            assert!((coefficient - truth).abs() < 0.01, "{coefficient} {truth}");
        }
        assert!((left - 50.0 * 1e-4).abs() < 5e-4, "{left}");
        let twice: Vec<([f64; 2], f64)> = (0..9).map(|k| ([f64::from(k), 2.0 * f64::from(k)], 1.0)).collect();
        assert!(least_squares(&twice).is_none());
    }

    #[test]
    fn medians_slopes_and_spans() {
        assert_eq!((median(&[3.0, 1.0, 2.0]), median(&[4.0, 1.0]), median(&[])), (2.0, 2.5, 0.0));
        assert_eq!(slope(&[0.0, 1.0, 2.0], &[1.0, -1.0, -3.0]), -2.0);
        assert_eq!((span([1.0, -2.0, 0.5]), span([])), (3.0, 0.0));
        assert_eq!(robust(&[1.0, 1.0, 1.0, 9.0]).value, 1.0);
    }
}
