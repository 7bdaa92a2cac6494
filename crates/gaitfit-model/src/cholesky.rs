//! The factor of a mass matrix.

/// Smallest pivot, so that hopeless inertias stay finite (MuJoCo's `mjMINVAL`).
const MIN_PIVOT: f64 = 1e-15;

/// Lower triangular L with L Lᵀ = M.
pub struct Cholesky {
    /// L column by column.
    columns: Vec<f64>,
    size: usize,
}

impl Cholesky {
    /// Factors the symmetric matrix `m`, `size × size`, row-major. Only its lower triangle is read.
    pub fn new(mut m: Vec<f64>, size: usize) -> Self {
        for j in 0..size {
            let mut pivot = m[j * size + j];
            for k in 0..j {
                pivot -= m[j * size + k] * m[j * size + k];
            }
            let pivot = pivot.max(MIN_PIVOT).sqrt();
            m[j * size + j] = pivot;
            for i in j + 1..size {
                let mut x = m[i * size + j];
                for k in 0..j {
                    x -= m[i * size + k] * m[j * size + k];
                }
                m[i * size + j] = x / pivot;
            }
        }
        // Transposed once here, because `inverse_form` goes through L column by column.
        let columns = (0..size * size).map(|at| m[at % size * size + at / size]).collect();
        Self { columns, size }
    }

    /// `vᵀ M⁻¹ v`; `v` has `size` numbers.
    pub fn inverse_form(&self, v: &[f64]) -> f64 {
        // With L y = v the form is yᵀ y.
        let n = self.size;
        let mut y = v.to_vec();
        // Column by column: the numbers below the diagonal do not wait for each other.
        for (k, column) in self.columns.chunks_exact(n.max(1)).enumerate() {
            y[k] /= column[k];
            let known = y[k];
            // Where the vector is still 0, as a unit vector is before its 1, nothing below changes.
            if known == 0.0 {
                continue;
            }
            for (below, factor) in y[k + 1..].iter_mut().zip(&column[k + 1..]) {
                *below -= factor * known;
            }
        }
        y.iter().map(|x| x * x).sum()
    }

    /// `(M⁻¹)ᵢᵢ`
    pub fn inverse_diagonal(&self, i: usize) -> f64 {
        let mut unit = vec![0.0; self.size];
        unit[i] = 1.0;
        self.inverse_form(&unit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// M = [[4, 2], [2, 3]] has the inverse [[3, −2], [−2, 4]] / 8.
    #[test]
    fn inverses_are_those_worked_by_hand() {
        let factor = Cholesky::new(vec![4.0, 2.0, 2.0, 3.0], 2);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-15, "{a}, not {b}");
        near(factor.inverse_diagonal(0), 0.375);
        near(factor.inverse_diagonal(1), 0.5);
        near(factor.inverse_form(&[1.0, 2.0]), (3.0 - 8.0 + 16.0) / 8.0);
    }

    #[test]
    fn a_matrix_without_inertia_stays_finite() {
        assert!(Cholesky::new(vec![0.0; 4], 2).inverse_diagonal(1).is_finite());
    }
}
