//! How precisely logs identify the parameters together, before any fit.

use gaitfit_adapt::fit::Sensitivity;
use nalgebra::DMatrix;

/// Share of the diagonal that is added to it, so that parameters that logs do not identify get a large spread. The
/// matrix is scaled to a unit diagonal first, so the share means the same in all units.
const RIDGE: f64 = 1e-9;

/// Information that logs have about `n` parameters. Logs add up. They may differ in how well they are predicted, which a fit by least
/// squares does not know, so that the covariance is A⁻¹ B A⁻¹ (Huber 1967).
#[derive(Clone, Debug)]
pub(super) struct Information {
    /// A = JᵀJ, `n × n`.
    curvature: DMatrix<f64>,
    /// B = s² τ JᵀJ, `n × n`, with the logs' own differences s and correlated samples τ.
    noise: DMatrix<f64>,
}

impl Information {
    /// No information about `count` parameters.
    pub fn nothing(count: usize) -> Self {
        Self { curvature: DMatrix::zeros(count, count), noise: DMatrix::zeros(count, count) }
    }

    /// The information in logs whose sensitivity is `found` and whose differences have the variance `variance`.
    pub fn new(sensitivity: &Sensitivity, variance: f64) -> Self {
        let count = sensitivity.curvature.len();
        let curvature = DMatrix::from_fn(count, count, |i, j| sensitivity.curvature[i][j]);
        Self { noise: &curvature * variance, curvature }
    }

    /// The information of `curvature`, with the variance 1.
    #[cfg(test)]
    pub fn from_curvature(curvature: DMatrix<f64>) -> Self {
        Self { noise: curvature.clone(), curvature }
    }

    /// Adds `times` the information of `other`: 1, or −1 to take it away.
    pub fn add(&mut self, other: &Self, times: f64) {
        self.curvature += &other.curvature * times;
        self.noise += &other.noise * times;
    }

    /// Standard deviations to expect in a fit; infinite for parameters that the logs do not identify.
    pub fn deviations(&self) -> Vec<f64> {
        let count = self.curvature.nrows();
        let diagonal = self.curvature.diagonal();
        // Scaled to a diagonal of ones: units differ by orders of magnitude, and the ridge must mean the same
        // for all.
        let scale = diagonal.map(|value| if value > 0.0 { 1.0 / value.sqrt() } else { 0.0 });
        let identified = diagonal.iter().filter(|value| **value > 0.0).count().max(1);
        let scaled = |matrix: &DMatrix<f64>| {
            DMatrix::from_fn(count, count, |i, j| matrix[(i, j)] * scale[i] * scale[j])
        };
        let (mut curvature, mut noise) = (scaled(&self.curvature), scaled(&self.noise));
        let variance = noise.trace() / identified as f64;
        // A parameter that nothing shows gets a diagonal of its own, so that it does not spoil the inverse.
        for i in 0..count {
            let seen = scale[i] > 0.0;
            curvature[(i, i)] += if seen { RIDGE } else { 1.0 };
            noise[(i, i)] += if seen { RIDGE * variance } else { 0.0 };
        }
        // Rounding may leave a matrix that is not positive definite: then nothing is identified.
        let Some(solved) = curvature.cholesky() else { return vec![f64::INFINITY; count] };
        let inverse = solved.inverse();
        // The sandwich form: inverse curvature, noise of the scores, inverse curvature (White 1982).
        let covariance = &inverse * noise * &inverse;
        let deviation = |i: usize| match scale[i] > 0.0 {
            true => covariance[(i, i)].max(0.0).sqrt() * scale[i],
            false => f64::INFINITY,
        };
        (0..count).map(deviation).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deviations_are_those_of_the_inverse() {
        let deviations =
            Information::from_curvature(DMatrix::from_row_slice(2, 2, &[4.0, 2.0, 2.0, 3.0])).deviations();
        assert!(
            (deviations[0] - (3.0f64 / 8.0).sqrt()).abs() < 1e-6
                && (deviations[1] - 0.5f64.sqrt()).abs() < 1e-6
        );
        let deviations =
            Information::from_curvature(DMatrix::from_diagonal(&vec![4.0, 0.0].into())).deviations();
        assert!((deviations[0] - 0.5).abs() < 1e-6 && deviations[1] == f64::INFINITY);
        // Two that act alike: neither is identified.
        let deviations =
            Information::from_curvature(DMatrix::from_row_slice(2, 2, &[1.0, 2.0, 2.0, 4.0])).deviations();
        assert!(deviations.iter().all(|one| *one > 1e3), "{deviations:?}");
    }

    #[test]
    fn logs_that_are_predicted_badly_spoil_those_that_are_predicted_well() {
        let information = |curvature: f64, variance: f64| {
            let curvature = DMatrix::from_element(1, 1, curvature);
            Information { noise: &curvature * variance, curvature }
        };
        let mut both = information(1.0, 1.0);
        both.add(&information(1.0, 9.0), 1.0);
        // A mean of one number with variance 1 and one with variance 9.
        assert!((both.deviations()[0] - (10.0f64 / 4.0).sqrt()).abs() < 1e-6);
        both.add(&information(1.0, 9.0), -1.0);
        assert!((both.deviations()[0] - 1.0).abs() < 1e-6);
    }
}
