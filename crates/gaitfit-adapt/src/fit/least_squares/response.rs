//! How the fit of a robot's logs answers to the robot's values.
//!
//! A fit that is off by the same amount for all robots answers one to one. Where values make up for each other, motors' strength,
//! friction and a load for one, it answers to a change of all of them by a small part, and a correction that takes the answer for one
//! to one ends far from the robot. The answer is learnt from round to round (Broyden 1965, the good method), as far as it
//! stands out of the noise of the rounds.

use nalgebra::{DMatrix, DVector};

/// Least part of a change of the robot that the fit is taken to answer with: it limits what noise can be made of.
const LEAST: f64 = 0.1;

/// Change of a fit by a change of the robot, both in the entries' deviations.
pub(super) struct Response {
    matrix: DMatrix<f64>,
    /// Its inverse.
    inverse: DMatrix<f64>,
    scale: DVector<f64>,
}

impl Response {
    /// One to one. `scale`: a size of each entry, in its unit.
    pub fn one_to_one(scale: Vec<f64>) -> Self {
        let identity = DMatrix::identity(scale.len(), scale.len());
        Self { matrix: identity.clone(), inverse: identity, scale: DVector::from_vec(scale) }
    }

    /// Learns that fits moved by `answered` when the robot moved by `moved`, in the entries' units. `noise`: standard
    /// deviation of each number of `answered`.
    pub fn learn(&mut self, moved: &[f64], answered: &[f64], noise: &[f64]) {
        let scaled = |numbers: &[f64]| DVector::from_column_slice(numbers).component_div(&self.scale);
        let (moved, answered, noise) = (scaled(moved), scaled(answered), scaled(noise));
        let missed = answered - &self.matrix * &moved;
        let (size, chance) = (missed.norm_squared(), noise.norm_squared());
        // Stein's estimate (James and Stein 1961): what chance explains is not learnt.
        let part = (1.0 - chance / size).max(0.0) / moved.norm_squared();
        if !part.is_finite() {
            return;
        }
        let learnt = &self.matrix + missed * moved.transpose() * part;
        let parts = learnt.clone().svd(true, true);
        let (Some(left), Some(right)) = (parts.u, parts.v_t) else { return };
        let values = parts.singular_values.map(|value| value.max(LEAST));
        let inverse =
            right.transpose() * DMatrix::from_diagonal(&values.map(|value| 1.0 / value)) * left.transpose();
        if inverse.iter().all(|number| number.is_finite()) {
            self.matrix = left * DMatrix::from_diagonal(&values) * right;
            self.inverse = inverse;
        }
    }

    /// How far the robot moves where its fit is to move by `by`, in the entries' units.
    pub fn needed(&self, by: &[f64]) -> Vec<f64> {
        let scaled = DVector::from_column_slice(by).component_div(&self.scale);
        (&self.inverse * scaled).component_mul(&self.scale).as_slice().to_vec()
    }

    /// The inverse in the entries' units, row by row.
    pub fn rows(&self) -> Vec<Vec<f64>> {
        let row = |at: usize| {
            let of = |other: usize| self.inverse[(at, other)] * self.scale[at] / self.scale[other];
            (0..self.scale.len()).map(of).collect()
        };
        (0..self.scale.len()).map(row).collect()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    /// A fit that answers to a change of both values together by a tenth.
    fn answer(moved: &[f64]) -> Vec<f64> {
        let both = 0.5 * (moved[0] + moved[1] / 10.0);
        vec![moved[0] - 0.9 * both, moved[1] - 0.9 * both * 10.0]
    }

    #[test]
    fn a_weak_answer_is_learnt_and_undone() {
        let mut response = Response::one_to_one(vec![1.0, 10.0]);
        assert_eq!(response.needed(&[0.3, -2.0]), [0.3, -2.0]);
        for moved in [[0.2, 1.0], [0.1, 3.0], [-0.4, 0.5]] {
            response.learn(&moved, &answer(&moved), &[0.0, 0.0]);
        }
        let needed = response.needed(&answer(&[0.5, 4.0]));
        assert!((needed[0] - 0.5).abs() < 1e-9 && (needed[1] - 4.0).abs() < 1e-9, "{needed:?}");
        let rows = response.rows();
        let by = answer(&[0.5, 4.0]);
        assert!((rows[0][0] * by[0] + rows[0][1] * by[1] - 0.5).abs() < 1e-9);
    }

    #[test]
    fn noise_is_not_learnt() {
        let mut response = Response::one_to_one(vec![1.0, 1.0]);
        response.learn(&[0.1, 0.0], &[0.13, -0.02], &[0.03, 0.03]);
        assert_eq!(response.needed(&[1.0, 2.0]), [1.0, 2.0]);
    }

    #[test]
    fn nothing_is_made_of_no_answer_and_of_no_move() {
        let mut response = Response::one_to_one(vec![1.0, 1.0]);
        response.learn(&[0.0, 0.0], &[0.5, 0.5], &[0.0, 0.0]);
        assert_eq!(response.needed(&[1.0, 2.0]), [1.0, 2.0]);
        response.learn(&[0.1, 0.0], &[0.0, 0.0], &[0.0, 0.0]);
        let needed = response.needed(&[1.0, 2.0]);
        assert!((needed[0] - 10.0).abs() < 1e-9 && (needed[1] - 2.0).abs() < 1e-9, "{needed:?}");
    }
}
