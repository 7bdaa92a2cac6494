//! How estimates depend on the true values of a robot, learnt from simulated robots.

use nalgebra::{DMatrix, DVector};

/// Prior standard deviation of the slopes around those of an estimator without bias (estimate = value).
const SLOPE: f64 = 0.3;
/// Passes, each with the scatter of the one before.
const PASSES: usize = 4;
/// Min number of robots beyond the number of values.
const SPARE: usize = 2;

/// Robots with known values, and what was estimated of each. Each number in a unit of its own.
#[derive(Clone, Debug, Default)]
pub struct Response {
    /// The values of each.
    pub values: Vec<Vec<f64>>,
    /// The estimates, in the same order.
    pub estimates: Vec<Vec<f64>>,
}

/// The values of the robot for which something was estimated.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// Its values.
    pub values: Vec<f64>,
    /// Their standard errors: how far estimates of robots with the same values scatter.
    pub errors: Vec<f64>,
}

impl Response {
    /// The values of the robot with this `estimate`. A ridge regression learns estimate = a + B · values and shrinks B
    /// towards 1. `units`: a scale for each number. `None` if there are too few robots, or if estimates do not depend on
    /// the values.
    pub fn answer(&self, estimate: &[f64], units: &[f64]) -> Option<Answer> {
        let (count, width) = (self.values.len(), units.len());
        if count < width + SPARE {
            return None;
        }
        // In units of the region, so that one penalty suits all numbers.
        let scaled = |rows: &[Vec<f64>]| DMatrix::from_fn(count, width, |row, at| rows[row][at] / units[at]);
        let (mut values, mut estimates) = (scaled(&self.values), scaled(&self.estimates));
        let middle = values.row_mean();
        let said = estimates.row_mean();
        values.row_iter_mut().for_each(|mut row| row -= &middle);
        estimates.row_iter_mut().for_each(|mut row| row -= &said);
        // Only the part beyond one to one is learnt.
        let apart = &estimates - &values;
        // The eigenvectors do not depend on the number that is learnt, so they are computed once.
        // With the eigenvectors a ridge regression of any penalty is a division, so the passes below cost
        // little.
        let parts = (values.transpose() * &values).symmetric_eigen();
        let turned = parts.eigenvectors.transpose() * values.transpose();
        let mut slopes = DMatrix::<f64>::identity(width, width);
        let mut left = DMatrix::<f64>::zeros(count, width);
        for at in 0..width {
            let wanted: DVector<f64> = apart.column(at).into_owned();
            // The penalty is that of a normal prior on the slopes, for the scatter that the regression itself leaves.
            // The first pass takes all that is to be explained for scatter, the next ones what leave-one-out leaves.
            let mut scatter = wanted.norm_squared() / count as f64;
            let mut slope = DVector::zeros(width);
            for _ in 0..PASSES {
                // The bound keeps the inverse finite where estimates follow the values without scatter.
                let penalty = (scatter / (SLOPE * SLOPE)).max(1e-12);
                let shrunk = parts.eigenvalues.map(|value| 1.0 / (value.max(0.0) + penalty));
                let weights = (&turned * &wanted).component_mul(&shrunk);
                slope = &parts.eigenvectors * &weights;
                let fitted = &values * &slope;
                for row in 0..count {
                    let column = turned.column(row);
                    // Leave-one-out residuals (PRESS, Allen 1974). A robot that determines a slope alone has a lever
                    // near 1; the bound keeps its residual finite.
                    let lever: f64 = column.iter().zip(shrunk.iter()).map(|(one, by)| one * one * by).sum();
                    left[(row, at)] =
                        // 1 / count is the lever of the mean, which was taken away before.
                        (wanted[row] - fitted[row]) / (1.0 - lever - 1.0 / count as f64).max(0.1);
                }
                scatter = left.column(at).norm_squared() / count as f64;
            }
            slopes.set_row(at, &(slopes.row(at) + slope.transpose()));
        }
        // Slopes without an inverse: some estimates do not depend on any value.
        let inverse = slopes.try_inverse()?;
        let asked = DVector::from_fn(width, |at, _| estimate[at] / units[at] - said[at]);
        let solution = &inverse * asked;
        let scatter = left.transpose() * &left / count as f64;
        // The scatter of estimates, carried back to the values by the inverse slopes.
        let covariance = &inverse * scatter * inverse.transpose();
        let answer = Answer {
            values: (0..width).map(|at| (solution[at] + middle[at]) * units[at]).collect(),
            errors: (0..width).map(|at| covariance[(at, at)].max(0.0).sqrt() * units[at]).collect(),
        };
        let finite = answer.values.iter().chain(&answer.errors).all(|one| one.is_finite());
        finite.then_some(answer)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_random::{Purpose, Stream};

    /// Robots of two values whose estimates are off by a constant, answer with a half of the first value, and scatter.
    fn response(scatter: f64) -> Response {
        let draws = Stream::new(1, Purpose::SIMULATED_ROBOTS).environment(0).step(0);
        let mut response = Response::default();
        for robot in 0..60 {
            let (x, y) = (draws.uniform(4 * robot), 0.01 * draws.uniform(4 * robot + 1));
            let noise = [2, 3].map(|k| scatter * draws.normal(1000 + 4 * robot + k));
            response.values.push(vec![x, y]);
            response.estimates.push(vec![0.5 * x + 20.0 * y - 0.3 + noise[0], y + 0.001 + 0.01 * noise[1]]);
        }
        response
    }

    #[test]
    fn an_estimate_that_is_off_and_answers_weakly_leads_to_the_values() {
        let answer = response(1e-4).answer(&[0.5 * 0.7 + 20.0 * 0.004 - 0.3, 0.005], &[1.0, 0.01]).unwrap();
        assert!((answer.values[0] - 0.7).abs() < 1e-3, "{answer:?}");
        assert!((answer.values[1] - 0.004).abs() < 1e-5, "{answer:?}");
        // Errors of 1e-4 in an estimate that answers by a half.
        assert!(answer.errors[0] > 1.5e-4 && answer.errors[0] < 4e-4, "{answer:?}");
    }

    #[test]
    fn scatter_is_in_the_errors_and_few_robots_say_nothing() {
        let answer = response(0.05).answer(&[0.1, 0.005], &[1.0, 0.01]).unwrap();
        assert!(answer.errors[0] > 0.05, "{answer:?}");
        let few = Response { values: vec![vec![0.0; 2]; 3], estimates: vec![vec![0.0; 2]; 3] };
        assert!(few.answer(&[0.1, 0.005], &[1.0, 0.01]).is_none());
    }
}
