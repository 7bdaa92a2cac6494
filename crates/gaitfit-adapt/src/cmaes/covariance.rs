//! The covariance matrix and its square root.

use super::CovarianceKind;
use nalgebra::{DMatrix, SymmetricEigen};
use serde::{Deserialize, Serialize};

/// Stands for eigenvalues that rounding made negative, as in the `cmaes` package.
pub(crate) const EPS: f64 = 1e-8;

/// Covariance C of the sampling distribution, without σ², in scaled coordinates, with its decomposition
/// C = B D² Bᵀ. With many coordinates the decomposition is some generations old (`Constants::decompose_every`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum Covariance {
    /// Any symmetric positive-definite matrix.
    Full {
        /// C; n × n, row-major.
        c: Vec<f64>,
        /// B, orthonormal eigenvectors in columns; n × n, row-major.
        b: Vec<f64>,
        /// D, square roots of the eigenvalues, ascending; n.
        d: Vec<f64>,
    },
    /// A diagonal matrix.
    Separable {
        /// Diagonal of C; n.
        c: Vec<f64>,
        /// Square roots of `c`; n.
        d: Vec<f64>,
    },
}

impl Covariance {
    /// The n × n identity.
    pub(crate) fn identity(kind: CovarianceKind, n: usize) -> Self {
        match kind {
            CovarianceKind::Full => {
                let mut identity = vec![0.0; n * n];
                identity.iter_mut().step_by(n + 1).for_each(|entry| *entry = 1.0);
                Self::Full { c: identity.clone(), b: identity, d: vec![1.0; n] }
            }
            CovarianceKind::Separable => Self::Separable { c: vec![1.0; n], d: vec![1.0; n] },
        }
    }

    /// Full or separable.
    pub fn kind(&self) -> CovarianceKind {
        match self {
            Self::Full { .. } => CovarianceKind::Full,
            Self::Separable { .. } => CovarianceKind::Separable,
        }
    }

    /// The diagonal of C.
    pub fn diagonal(&self) -> Vec<f64> {
        match self {
            Self::Full { c, d, .. } => c.iter().step_by(d.len() + 1).copied().collect(),
            Self::Separable { c, .. } => c.clone(),
        }
    }

    /// Standard deviations along the principal axes, D.
    pub fn axis_lengths(&self) -> &[f64] {
        match self {
            Self::Full { d, .. } | Self::Separable { d, .. } => d,
        }
    }

    /// Direction `i` that the no-effect-axis test adds: eigenvector i, or all ones in the separable form, as the
    /// `cmaes` package has it.
    pub(crate) fn axis(&self, i: usize) -> Vec<f64> {
        match self {
            Self::Full { b, d, .. } => (0..d.len()).map(|row| b[row * d.len() + i]).collect(),
            Self::Separable { d, .. } => vec![1.0; d.len()],
        }
    }

    /// C^½ z. The symmetric root B D Bᵀ does not depend on the signs and the order of the eigenvectors, which a
    /// decomposition is free to choose; the plain B D z would.
    pub(crate) fn root_times(&self, z: &[f64]) -> Vec<f64> {
        match self {
            Self::Full { b, d, .. } => rotate(b, d, z, |length| length),
            Self::Separable { d, .. } => z.iter().zip(d).map(|(z, d)| z * d).collect(),
        }
    }

    /// C^−½ y.
    pub(crate) fn inverse_root_times(&self, y: &[f64]) -> Vec<f64> {
        match self {
            Self::Full { b, d, .. } => rotate(b, d, y, |length| 1.0 / length),
            Self::Separable { d, .. } => y.iter().zip(d).map(|(y, d)| y / d).collect(),
        }
    }

    /// C ← keep·C + c1·p pᵀ + cμ Σ wₖ yₖ yₖᵀ (eq. 47). The decomposition stays as it is.
    pub(crate) fn update(
        &mut self,
        keep: f64,
        c1: f64,
        path: &[f64],
        cmu: f64,
        weights: &[f64],
        steps: &[Vec<f64>],
    ) {
        match self {
            Self::Full { c, d, .. } => {
                let n = d.len();
                // Each value is computed once for both triangles, so that C stays symmetric to the last bit.
                for i in 0..n {
                    for j in 0..=i {
                        let rank_mu: f64 = weights.iter().zip(steps).map(|(w, y)| w * (y[i] * y[j])).sum();
                        let value = keep * c[i * n + j] + c1 * (path[i] * path[j]) + cmu * rank_mu;
                        c[i * n + j] = value;
                        c[j * n + i] = value;
                    }
                }
            }
            Self::Separable { c, .. } => {
                // −0 is the neutral element of addition: it keeps the sign of a sum of zeros.
                let mut rank_mu = vec![-0.0; c.len()];
                for (w, y) in weights.iter().zip(steps) {
                    rank_mu.iter_mut().zip(y).for_each(|(sum, y)| *sum += w * (y * y));
                }
                for i in 0..c.len() {
                    c[i] = keep * c[i] + c1 * (path[i] * path[i]) + cmu * rank_mu[i];
                }
            }
        }
    }

    /// Decomposes C. False if that failed; the value is then of no use.
    pub(crate) fn decompose(&mut self) -> bool {
        match self {
            Self::Full { c, b, d } => decompose(c, b, d),
            Self::Separable { c, d } => {
                d.iter_mut().zip(&*c).for_each(|(d, c)| *d = positive(*c).sqrt());
                // An overflow of the update shows here.
                c.iter().chain(&*d).all(|value| value.is_finite())
            }
        }
    }

    /// Whether all lengths fit n coordinates and all numbers are usable.
    pub(crate) fn is_valid(&self, n: usize) -> bool {
        let (lengths_fit, rest) = match self {
            Self::Full { c, b, d } => (c.len() == n * n && b.len() == n * n && d.len() == n, b),
            Self::Separable { c, d } => (c.len() == n && d.len() == n, c),
        };
        let (Self::Full { c, d, .. } | Self::Separable { c, d }) = self;
        lengths_fit
            && c.iter().chain(rest).all(|value| value.is_finite())
            && d.iter().all(|value| value.is_finite() && *value > 0.0)
    }
}

/// Eigenvalues are positive but for rounding.
fn positive(eigenvalue: f64) -> f64 {
    if eigenvalue > 0.0 { eigenvalue } else { EPS }
}

/// B f(D) Bᵀ v.
fn rotate(b: &[f64], d: &[f64], v: &[f64], f: impl Fn(f64) -> f64) -> Vec<f64> {
    let n = d.len();
    let mut inner = vec![0.0; n];
    // B is stored row by row, so Bᵀ v is summed in rows of B, without jumps in memory.
    for (row, value) in b.chunks_exact(n).zip(v) {
        for (sum, entry) in inner.iter_mut().zip(row) {
            *sum += entry * value;
        }
    }
    for (value, length) in inner.iter_mut().zip(d) {
        *value *= f(*length);
    }
    b.chunks_exact(n).map(|row| row.iter().zip(&inner).map(|(entry, value)| entry * value).sum()).collect()
}

/// Decomposes `c`, repairs eigenvalues that are not positive and recomposes `c` from the result.
fn decompose(c: &mut [f64], b: &mut [f64], d: &mut [f64]) -> bool {
    let n = d.len();
    if !c.iter().all(|value| value.is_finite()) {
        return false;
    }
    // The bound only guards against a decomposition that never ends; a few sweeps a row are usual.
    let Some(eigen) = SymmetricEigen::try_new(DMatrix::from_row_slice(n, n, c), f64::EPSILON, 1_000 * n)
    else {
        return false;
    };
    let mut order: Vec<usize> = (0..n).collect();
    // Ascending, so that the number of an axis does not depend on the order in which the decomposition finds them.
    order.sort_by(|i, j| eigen.eigenvalues[*i].total_cmp(&eigen.eigenvalues[*j]));
    for (column, source) in order.into_iter().enumerate() {
        d[column] = positive(eigen.eigenvalues[source]).sqrt();
        for row in 0..n {
            b[row * n + column] = eigen.eigenvectors[(row, source)];
        }
    }
    // C is computed again from the repaired eigenvalues, so that it and its root belong together.
    for i in 0..n {
        for j in 0..=i {
            // d², not the eigenvalue: C must be the square of the very root that draws use.
            let value: f64 = (0..n).map(|k| b[i * n + k] * (d[k] * d[k]) * b[j * n + k]).sum();
            c[i * n + j] = value;
            c[j * n + i] = value;
        }
    }
    c.iter().chain(b.iter()).chain(d.iter()).all(|value| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A matrix with known roots: C = R diag(4, 9) Rᵀ with R a rotation by 30°.
    #[test]
    fn roots_multiply_back() {
        let (cosine, sine) = (0.75_f64.sqrt(), 0.5);
        let (a, b) = (4.0, 9.0);
        let off = (a - b) * cosine * sine;
        let matrix = [a * cosine * cosine + b * sine * sine, off, off, a * sine * sine + b * cosine * cosine];
        let mut covariance = Covariance::identity(CovarianceKind::Full, 2);
        if let Covariance::Full { c, b, d } = &mut covariance {
            c.copy_from_slice(&matrix);
            assert!(decompose(c, b, d));
        }
        assert!(covariance.axis_lengths().iter().zip([2.0, 3.0]).all(|(d, root)| (d - root).abs() < 1e-14));
        let z = [0.3, -1.7];
        let twice = covariance.root_times(&covariance.root_times(&z));
        let direct = [matrix[0] * z[0] + matrix[1] * z[1], matrix[2] * z[0] + matrix[3] * z[1]];
        assert!(twice.iter().zip(direct).all(|(x, y)| (x - y).abs() < 1e-13));
        let back = covariance.inverse_root_times(&covariance.root_times(&z));
        assert!(back.iter().zip(z).all(|(x, y)| (x - y).abs() < 1e-14));
    }

    #[test]
    fn indefinite_matrices_are_repaired_and_nan_is_refused() {
        let (mut b, mut d) = (vec![0.0; 4], vec![0.0; 2]);
        let mut indefinite = vec![1.0, 2.0, 2.0, 1.0]; // eigenvalues −1 and 3
        assert!(decompose(&mut indefinite, &mut b, &mut d));
        assert!((d[0] * d[0] - EPS).abs() < 1e-15 && (d[1] * d[1] - 3.0).abs() < 1e-14);
        assert!(indefinite[0] > 1.4, "recomposed from the repaired eigenvalues");
        assert!(!decompose(&mut [f64::NAN, 0.0, 0.0, 1.0], &mut b, &mut d));
    }
}
