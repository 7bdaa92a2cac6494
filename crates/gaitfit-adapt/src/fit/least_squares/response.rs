//! How the fit of a robot's logs answers to the robot's values.
//!
//! A fit that is off by the same amount for all robots answers one to one. Where values make up for each other, motors'
//! strength, friction and a load for one, it answers to a change of all of them by a small part, and a correction that takes
//! the answer for one to one ends far from the robot. So the answer is learnt from all rounds, as a linear one: ridge regression
//! (Hoerl and Kennard 1970) that keeps to one to one where rounds say nothing. Rounds near the last one count most, for
//! the answer is not linear far away.

use nalgebra::{DMatrix, DVector};

/// Standard deviation of the numbers of an answer about those of one to one, before anything is known.
const DOUBT: f64 = 0.3;
/// Least standard deviation of a fit, in an entry's deviations: answers are not linear.
const MIN_NOISE: f64 = 3e-3;
/// Least part of a change of the robot that the fit is taken to answer with: it limits what noise can be made of.
const MIN_ANSWER: f64 = 0.1;

/// The result of one round, each number in the entries' units.
pub(super) struct Shown {
    /// The robot's values.
    pub robot: Vec<f64>,
    /// Mean of the fits of its logs.
    pub fit: Vec<f64>,
    /// Standard deviation of that mean.
    pub noise: Vec<f64>,
}

/// Fits as a linear function of the robot's values, about a middle. All in the entries' deviations.
pub(super) struct Response {
    robot: DVector<f64>,
    fit: DVector<f64>,
    /// Change of the robot by a change of the fit.
    inverse: DMatrix<f64>,
    /// The change of the robot that the fit answers least to, of length 1, and the length of the answer.
    weakest: (f64, DVector<f64>),
    scale: DVector<f64>,
}

impl Response {
    /// Learns it from rounds, the last of which counts most. `scale`: the deviation of each entry. `None` of no round, or of
    /// numbers that are not finite.
    pub fn learnt(rounds: &[Shown], scale: &[f64]) -> Option<Self> {
        let scale = DVector::from_column_slice(scale);
        // In units of the deviations, so that one ridge fits all entries.
        let scaled = |numbers: &[f64]| DVector::from_column_slice(numbers).component_div(&scale);
        let robots: Vec<DVector<f64>> = rounds.iter().map(|round| scaled(&round.robot)).collect();
        let fits: Vec<DVector<f64>> = rounds.iter().map(|round| scaled(&round.fit)).collect();
        let last = robots.last()?;
        // A robot one deviation away counts half.
        let weights: Vec<f64> =
            robots.iter().map(|robot| 1.0 / (1.0 + (robot - last).norm_squared())).collect();
        let sum_of_weights: f64 = weights.iter().sum();
        let entries = scale.len();
        // Means are weighted like the rounds, because the regression is about them.
        let middle = |of: &[DVector<f64>]| {
            of.iter()
                .zip(&weights)
                .fold(DVector::zeros(entries), |sum, (one, weight)| sum + one * (weight / sum_of_weights))
        };
        let (robot, fit) = (middle(&robots), middle(&fits));
        let noises = || rounds.iter().flat_map(|round| scaled(&round.noise).as_slice().to_vec());
        // Entries without an effect have none.
        let noisy = noises().filter(|noise| *noise > 0.0).count();
        let noise =
            noises().map(|noise| noise * noise).sum::<f64>() / noisy.max(1) as f64 + MIN_NOISE.powi(2);
        // The response beyond one to one, times the differences of robots. The ridge is the variance of the fits
        // over that of the answer: what a normal prior of deviation DOUBT amounts to.
        // Only the part beyond the identity is learnt, so that no data means an answer of one to one.
        let mut beyond = DMatrix::zeros(entries, entries);
        let mut apart = DMatrix::identity(entries, entries) * (noise / DOUBT.powi(2));
        for ((one, its), weight) in robots.iter().zip(&fits).zip(&weights) {
            let (one, its) = (one - &robot, its - &fit);
            beyond += (&its - &one) * one.transpose() * *weight;
            apart += &one * one.transpose() * *weight;
        }
        let learnt = DMatrix::identity(entries, entries) + beyond * apart.cholesky()?.inverse();
        if !learnt.iter().all(|number| number.is_finite()) {
            return None;
        }
        // By singular values, so that no answer is taken for smaller than MIN_ANSWER.
        let parts = learnt.svd(true, true);
        let (left, right) = (parts.u?, parts.v_t?);
        // The weakest direction is where a change of the robot is seen least.
        let (min, part) = parts.singular_values.argmin();
        let weakest = (part, right.row(min).transpose());
        let values = parts.singular_values.map(|value| 1.0 / value.max(MIN_ANSWER));
        let inverse = right.transpose() * DMatrix::from_diagonal(&values) * left.transpose();
        Some(Self { robot, fit, inverse, weakest, scale })
    }

    /// The robot whose logs have the fit `wanted`, in the entries' units.
    pub fn robot_of(&self, wanted: &[f64]) -> Vec<f64> {
        let by = DVector::from_column_slice(wanted).component_div(&self.scale) - &self.fit;
        (&self.robot + &self.inverse * by).component_mul(&self.scale).as_slice().to_vec()
    }

    /// The part of a change of the robot that the fit answers with where it answers least, both measured in the entries'
    /// deviations, and that change in the entries' units: of the entry that it moves most by its deviation.
    pub fn weakest(&self) -> (f64, Vec<f64>) {
        let (part, change) = &self.weakest;
        // The entry that changes most changes by one deviation.
        (*part, (change / change.amax()).component_mul(&self.scale).as_slice().to_vec())
    }

    /// How far the robot's values move where those of the fit move by one, row by row, in the entries' units.
    pub fn rows(&self) -> Vec<Vec<f64>> {
        let row = |at: usize| {
            // The inverse is in deviations; both factors give it the units of the entries.
            let element = |other: usize| self.inverse[(at, other)] * self.scale[at] / self.scale[other];
            (0..self.scale.len()).map(element).collect()
        };
        (0..self.scale.len()).map(row).collect()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    const SCALE: [f64; 2] = [1.0, 10.0];

    /// A fit that is off, and that answers to a change of both values together by a fifth.
    fn shown(robot: [f64; 2], noise: f64) -> Shown {
        let both = 0.5 * (robot[0] + robot[1] / 10.0);
        let fit = vec![robot[0] - 0.8 * both + 0.3, robot[1] - 0.8 * both * 10.0];
        Shown { robot: robot.to_vec(), fit, noise: vec![noise, 10.0 * noise] }
    }

    #[test]
    fn one_round_is_answered_one_to_one() {
        let response = Response::learnt(&[shown([0.5, 3.0], 0.01)], &SCALE).unwrap();
        let wanted = [shown([0.5, 3.0], 0.0).fit[0] + 0.1, shown([0.5, 3.0], 0.0).fit[1] - 1.0];
        let robot = response.robot_of(&wanted);
        assert!((robot[0] - 0.6).abs() < 1e-12 && (robot[1] - 2.0).abs() < 1e-12, "{robot:?}");
        assert_eq!(response.rows(), [[1.0, 0.0], [0.0, 1.0]]);
        assert!(Response::learnt(&[], &SCALE).is_none());
        assert!(Response::learnt(&[shown([f64::NAN, 3.0], 0.01)], &SCALE).is_none());
    }

    #[test]
    fn a_weak_answer_is_learnt_and_undone() {
        let rounds = [[0.2, 1.0], [0.5, 3.0], [0.3, 6.0], [0.6, 4.5]].map(|robot| shown(robot, 0.0));
        let response = Response::learnt(&rounds, &SCALE).unwrap();
        let robot = response.robot_of(&shown([0.9, 8.0], 0.0).fit);
        assert!((robot[0] - 0.9).abs() < 0.01 && (robot[1] - 8.0).abs() < 0.1, "{robot:?}");
        let (rows, by) = (response.rows(), [0.1, 1.0]);
        let moved = rows[0][0] * by[0] + rows[0][1] * by[1];
        assert!((moved - 0.5).abs() < 0.02, "five times as far: {moved}");
        let (part, change) = response.weakest();
        assert!((part - 0.2).abs() < 0.01, "{part}");
        assert!((change[0] * SCALE[1] / change[1] - 1.0).abs() < 0.02, "both alike: {change:?}");
    }

    #[test]
    fn noise_is_not_learnt() {
        let mut rounds = [[0.5, 3.0], [0.52, 3.1]].map(|robot| shown(robot, 0.1));
        rounds[1].fit[0] += 0.1;
        let rows = Response::learnt(&rounds, &SCALE).unwrap().rows();
        assert!((rows[0][0] - 1.0).abs() < 0.05 && rows[1][0].abs() < 0.5, "{rows:?}");
    }
}
