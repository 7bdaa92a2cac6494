//! Running mean and variance of observations, and their use as the input of a network.

use serde::{Deserialize, Serialize};

/// Added to the variance, so that a quantity that never moved is not blown up: factors are at most 10.
const EPSILON: f64 = 1e-2;

/// Mean and variance of every element of an observation, over all rows seen so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Normaliser {
    /// Mean of each element.
    pub mean: Vec<f64>,
    /// Population variance of each element.
    pub variance: Vec<f64>,
    /// Rows seen.
    pub count: f64,
}

impl Normaliser {
    /// Statistics of `width` elements before any row: mean 0, variance 1. [`Self::apply`] then only divides
    /// by √1.01.
    pub fn new(width: usize) -> Self {
        Self { mean: vec![0.0; width], variance: vec![1.0; width], count: 0.0 }
    }

    /// Statistics of `input`, `rows × width` row-major, alone. Two passes, so nothing cancels.
    pub fn from_samples(width: usize, input: &[f32]) -> Self {
        let count = (input.len() / width.max(1)) as f64;
        if count == 0.0 {
            return Self::new(width);
        }
        let mut mean = vec![0.0; width];
        for row in input.chunks_exact(width) {
            for (mean, &x) in mean.iter_mut().zip(row) {
                *mean += f64::from(x);
            }
        }
        mean.iter_mut().for_each(|mean| *mean /= count);
        let mut variance = vec![0.0; width];
        for row in input.chunks_exact(width) {
            for ((variance, &mean), &x) in variance.iter_mut().zip(&mean).zip(row) {
                let difference = f64::from(x) - mean;
                *variance += difference * difference;
            }
        }
        variance.iter_mut().for_each(|variance| *variance /= count);
        Self { mean, variance, count }
    }

    /// Joins the statistics of other rows to these (Chan, Golub, LeVeque 1979, equation 2.1): with δ = μ_b − μ_a,
    /// μ = μ_a + δ n_b/n and n σ² = n_a σ_a² + n_b σ_b² + δ² n_a n_b/n. Both have one width.
    pub fn merge(&mut self, other: &Self) {
        let total = self.count + other.count;
        // Without rows on either side the shares would be 0/0.
        if other.count == 0.0 {
            return;
        }
        let (share, other_share) = (self.count / total, other.count / total);
        let mine = self.mean.iter_mut().zip(&mut self.variance);
        for ((mean, variance), (&other_mean, &other_variance)) in
            mine.zip(other.mean.iter().zip(&other.variance))
        {
            let delta = other_mean - *mean;
            *mean += delta * other_share;
            *variance =
                *variance * share + other_variance * other_share + delta * delta * share * other_share;
        }
        self.count = total;
    }

    /// output = (input − μ) / √(σ² + 0.01), row by row; both `rows × width`, row-major. In `f32`: the offset and
    /// factor of each element are rounded once, then output = input · factor + offset.
    pub fn apply(&self, input: &[f32], output: &mut [f32]) {
        let scale = self.scale();
        for (input, output) in input.chunks_exact(scale.len()).zip(output.chunks_exact_mut(scale.len())) {
            normalise_row(&scale, input, output);
        }
    }

    /// (factor, offset) of each element: 1/√(σ² + 0.01) and −μ times it.
    pub fn scale(&self) -> Vec<(f32, f32)> {
        let factors = self.variance.iter().map(|variance| 1.0 / (variance + EPSILON).sqrt());
        factors.zip(&self.mean).map(|(factor, mean)| (factor as f32, (-mean * factor) as f32)).collect()
    }
}

/// One row through the factors and offsets of [`Normaliser::scale`].
///
/// # Panics
/// If a width differs: an error of the caller.
#[inline]
pub fn normalise_row(scale: &[(f32, f32)], input: &[f32], output: &mut [f32]) {
    assert!(
        input.len() == scale.len() && output.len() == scale.len(),
        "a row and its statistics differ in width"
    );
    for ((output, &input), &(factor, offset)) in output.iter_mut().zip(input).zip(scale) {
        *output = input * factor + offset;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn merged_parts_have_the_statistics_of_the_whole() {
        // Two columns, the second with a mean far above its deviation.
        let rows: Vec<f32> = (0..60).flat_map(|i| [(i * i % 7) as f32, 1e4 + (i % 5) as f32]).collect();
        let whole = Normaliser::from_samples(2, &rows);
        let mut merged = Normaliser::new(2);
        for part in [&rows[..14], &rows[14..16], &[][..], &rows[16..]] {
            merged.merge(&Normaliser::from_samples(2, part));
        }
        assert_eq!(merged.count, 60.0);
        for c in 0..2 {
            assert!((merged.mean[c] - whole.mean[c]).abs() < 1e-9);
            assert!((merged.variance[c] - whole.variance[c]).abs() < 1e-9);
        }
        // Column two is 1e4 + 0, 1, 2, 3, 4 in turn: mean 1e4 + 2, variance 2.
        assert!((whole.mean[1] - 10_002.0).abs() < 1e-9 && (whole.variance[1] - 2.0).abs() < 1e-9);
    }

    #[test]
    fn applied_by_hand() {
        let normaliser = Normaliser { mean: vec![1.0, -2.0], variance: vec![3.99, 0.24], count: 5.0 };
        let mut output = [0.0; 4];
        normaliser.apply(&[5.0, -2.0, 1.0, 0.5], &mut output);
        // √(3.99 + 0.01) = 2, √(0.24 + 0.01) = 0.5.
        for (got, want) in output.iter().zip([2.0, 0.0, 0.0, 5.0]) {
            assert!((got - want).abs() < 1e-6, "{output:?}");
        }
    }
}
