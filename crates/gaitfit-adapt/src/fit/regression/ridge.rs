//! A ridge regression that learns the values of robots from their logs.

use gaitfit_sim::{pool, stats};
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use std::ops::Range;

/// Penalties that are tried, parts of the largest eigenvalue: 10^-8, 10^-7.5, … 10^1.
const PENALTIES: std::ops::RangeInclusive<i32> = -16..=2;
/// Numbers of a log that vary less, where the robot's range is 2, are rounding.
const STEADY: f64 = 1e-7;
/// Min slope of left-out predictions on true values at which shrinkage is undone: below, it would mostly enlarge noise.
const MIN_SLOPE: f64 = 0.3;
/// Fewest robots.
const FEWEST: usize = 8;

/// Robots and their logs.
#[derive(Clone, Debug, Default)]
pub struct Robots {
    /// The values of each; `robots × entries`.
    pub values: Vec<Vec<f64>>,
    /// The numbers of its logs; `robots × numbers`.
    pub logs: Vec<Vec<f64>>,
}

/// The values that a robot's logs show.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Values: the mean over the predictions of single groups of numbers.
    pub values: Vec<f64>,
    /// Values that all numbers together predict.
    pub together: Vec<f64>,
    /// Standard deviation of the errors of `together` for robots that were left out one by one.
    pub errors: Vec<f64>,
    /// Standard error of the mean in `values`, by the groups' own errors and by how much they disagree besides.
    pub scatter: Vec<f64>,
    /// Standard deviation by which they disagree besides their own errors; 0 if these explain it.
    pub disagreement: Vec<f64>,
    /// Leave-one-out errors of each value, from all numbers together; `entries × robots`.
    pub left_out: Vec<Vec<f64>>,
}

impl Robots {
    /// How many there are.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Those with values between `lower` and `upper`.
    pub fn between(&self, lower: &[f64], upper: &[f64]) -> Self {
        let inside = |values: &&Vec<f64>| {
            values
                .iter()
                .zip(lower)
                .zip(upper)
                .all(|((value, lower), upper)| lower <= value && value <= upper)
        };
        let kept = self.values.iter().zip(&self.logs).filter(|(values, _)| inside(values));
        let (values, logs) = kept.map(|(values, logs)| (values.clone(), logs.clone())).unzip();
        Self { values, logs }
    }

    /// The values of the robot that made `logs`, whose numbers come in `groups`. `None` of too few robots, or if all
    /// their logs are alike.
    ///
    /// Each group alone says the values, with an error that robots left out one by one show. A robot that is like the
    /// simulated ones differs among groups by these errors; one that is not differs by more. The mean and its standard
    /// error are those of a random-effects analysis (DerSimonian and Laird 1986), where the groups are the studies.
    pub fn estimate(&self, logs: &[f64], groups: &[Range<usize>], threads: usize) -> Option<Estimate> {
        let entries = self.values.first().filter(|_| self.len() >= FEWEST)?.len();
        // All numbers together, then each group.
        let mut learnt = pool::map(groups.len() + 1, threads, |part| {
            self.learn(logs, part.checked_sub(1).map_or(0..logs.len(), |group| groups[group].clone()))
        })
        .into_iter();
        let whole = learnt.next()??;
        let parts: Vec<Vec<Prediction>> = learnt.flatten().collect();
        let mut estimate = Estimate {
            values: Vec::new(),
            together: whole.iter().map(|one| one.value).collect(),
            errors: Vec::new(),
            scatter: Vec::new(),
            disagreement: Vec::new(),
            left_out: whole.iter().map(|one| one.left_out.clone()).collect(),
        };
        for entry in 0..entries {
            let predictions: Vec<&Prediction> = parts.iter().map(|part| &part[entry]).collect();
            let (value, scatter, disagreement) =
                if predictions.len() < 2 { (whole[entry].value, 0.0, 0.0) } else { mean(&predictions) };
            estimate.disagreement.push(disagreement);
            estimate.values.push(value);
            estimate.errors.push(whole[entry].error);
            estimate.scatter.push(scatter);
        }
        Some(estimate)
    }

    /// Predicts each value from the numbers in `range`, with the penalty that has the smallest leave-one-out error.
    /// `None` if the numbers are alike for all robots.
    ///
    /// A ridge regression shrinks its predictions towards the mean. Leave-one-out predictions show by how much: their
    /// slope on the true values is below 1. Predictions are divided by this slope if it is above [`MIN_SLOPE`].
    fn learn(&self, logs: &[f64], range: Range<usize>) -> Option<Vec<Prediction>> {
        // In the dual form the matrix has one row a robot instead of one a number, of which there are far more.
        let (kernel, row) = Scaled::new(&self.logs, logs, range)?.kernel();
        let SymmetricEigen { eigenvectors: vectors, mut eigenvalues } = kernel.symmetric_eigen();
        // A kernel has no negative eigenvalues; these are rounding.
        eigenvalues.apply(|value| *value = value.max(0.0));
        let largest = eigenvalues.max();
        if !(largest.is_finite() && largest > 0.0) {
            return None;
        }
        let (count, entries) = (self.len(), self.values.first()?.len());
        let values = DMatrix::from_fn(count, entries, |robot, entry| self.values[robot][entry]);
        let means = values.row_mean();
        let wanted = DMatrix::from_fn(count, entries, |robot, entry| values[(robot, entry)] - means[entry]);
        // In the eigenvectors' basis each penalty costs only a division.
        let turned = vectors.transpose() * &wanted;
        let squared = vectors.map(|one| one * one);
        let scaled =
            |by: &DVector<f64>| DMatrix::from_fn(count, entries, |k, entry| by[k] * turned[(k, entry)]);
        // Leave-one-out errors without another fit: a residual over 1 less its lever (PRESS, Allen 1974). The mean
        // of the values takes 1/count of each.
        let left_out = |penalty: f64| {
            let shrunk = eigenvalues.map(|value| value / (value + penalty));
            let levers = &squared * &shrunk;
            let mut errors = &vectors * scaled(&shrunk) - &wanted;
            for (mut row, lever) in errors.row_iter_mut().zip(levers.iter()) {
                // A robot that determines a prediction alone has a lever near 1; the bound keeps its error finite.
                row /= (1.0 - lever - 1.0 / count as f64).max(1e-9);
            }
            errors
        };
        let penalties: Vec<f64> =
            // Neighbouring penalties differ by the factor √10.
            PENALTIES.map(|power| largest * 10f64.powf(0.5 * f64::from(power))).collect();
        let tried: Vec<DMatrix<f64>> = penalties.iter().map(|&penalty| left_out(penalty)).collect();
        // Each value has a penalty of its own: some need many numbers, others few.
        let of_entry = |entry: usize| {
            let size = |at: &usize| tried[*at].column(entry).norm_squared();
            let best = (0..tried.len()).min_by(|a, b| size(a).total_cmp(&size(b)))?;
            let weights =
                DVector::from_fn(count, |k, _| turned[(k, entry)] / (eigenvalues[k] + penalties[best]));
            let (errors, wanted) = (tried[best].column(entry), wanted.column(entry));
            // The slope of the predictions (error plus value) on the values. A penalty only shrinks, so a slope
            // above 1 is chance.
            // Robots whose values are all alike have no variance to divide by.
            let slope = 1.0 + errors.dot(&wanted) / wanted.norm_squared().max(f64::MIN_POSITIVE);
            let slope = if slope.is_finite() && slope > MIN_SLOPE { slope.min(1.0) } else { 1.0 };
            let left_out: Vec<f64> = errors
                .iter()
                .zip(wanted.iter())
                .map(|(error, wanted)| (error + wanted) / slope - wanted)
                .collect();
            let error = (left_out.iter().map(|one| one * one).sum::<f64>() / count as f64).sqrt();
            let value = means[entry] + row.dot(&(&vectors * weights)) / slope;
            Some(Prediction { value, error, left_out })
        };
        (0..entries).map(of_entry).collect()
    }
}

/// A value, predicted from numbers of logs.
#[derive(Clone, Debug)]
struct Prediction {
    value: f64,
    /// Standard deviation of its errors.
    error: f64,
    /// Leave-one-out errors, one a robot.
    left_out: Vec<f64>,
}

/// Mean of the groups' predictions, its standard error, and the standard deviation by which they disagree besides their
/// own errors (DerSimonian and Laird 1986).
fn mean(said: &[&Prediction]) -> (f64, f64, f64) {
    // An error of 0 would have all the weight.
    let min = 1e-9 * said.iter().map(|one| one.error).fold(f64::MIN_POSITIVE, f64::max);
    let variance = |one: &&Prediction| one.error.max(min).powi(2);
    let weighted = |besides: f64| {
        let weights = || said.iter().map(|one| 1.0 / (variance(one) + besides));
        let sum: f64 = weights().sum();
        (said.iter().zip(weights()).map(|(one, weight)| weight * one.value).sum::<f64>() / sum, sum)
    };
    // Cochran's Q exceeds its degrees of freedom by what the groups disagree besides their errors.
    let (fixed, sum) = weighted(0.0);
    let squares: f64 = said.iter().map(|one| 1.0 / variance(one).powi(2)).sum();
    let spread: f64 = said.iter().map(|one| (one.value - fixed).powi(2) / variance(one)).sum();
    let besides = ((spread - (said.len() as f64 - 1.0)) / (sum - squares / sum)).max(0.0);
    let besides = if besides.is_finite() { besides } else { 0.0 };
    let (value, sum) = weighted(besides);
    (value, sum.recip().sqrt(), besides.sqrt())
}

/// Logs, each number less its mean over the robots and divided by its deviation.
struct Scaled {
    /// `robots × numbers`.
    robots: DMatrix<f64>,
    /// Those that ask.
    logs: DVector<f64>,
}

impl Scaled {
    fn new(robots: &[Vec<f64>], logs: &[f64], range: Range<usize>) -> Option<Self> {
        let varies = |at: usize| {
            let values: Vec<f64> = robots.iter().map(|one| one[at]).collect();
            let size = stats::deviation(&values)?;
            (size > STEADY).then(|| (at, stats::mean(&values).unwrap_or(0.0), size))
        };
        let numbers: Vec<(usize, f64, f64)> = range.filter_map(varies).collect();
        if numbers.is_empty() {
            return None;
        }
        let scaled = |one: &[f64], k: usize| {
            let (at, mean, size) = numbers[k];
            (one[at] - mean) / size
        };
        Some(Self {
            robots: DMatrix::from_fn(robots.len(), numbers.len(), |robot, k| scaled(&robots[robot], k)),
            logs: DVector::from_fn(numbers.len(), |k, _| scaled(logs, k)),
        })
    }

    /// The products of the robots with each other, and with the logs that ask.
    fn kernel(&self) -> (DMatrix<f64>, DVector<f64>) {
        let numbers = self.robots.ncols() as f64;
        (&self.robots * self.robots.transpose() / numbers, &self.robots * &self.logs / numbers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two groups with errors 1 and 3 apart: spread 4.5 over one degree, (4.5 − 1) / (2 − 1) besides, so the mean's
    /// error is √(4.5 / 2).
    #[test]
    fn groups_that_disagree_have_a_larger_error_by_hand() {
        let combined = |values: [f64; 2]| {
            let predictions = values.map(|value| Prediction { value, error: 1.0, left_out: Vec::new() });
            mean(&predictions.iter().collect::<Vec<_>>())
        };
        let (value, error, besides) = combined([1.0, 4.0]);
        assert!((value - 2.5).abs() < 1e-12 && (error - 2.25f64.sqrt()).abs() < 1e-12, "{value} {error}");
        assert!((besides - 3.5f64.sqrt()).abs() < 1e-12, "{besides}");
        let (value, error, besides) = combined([1.0, 1.5]);
        assert_eq!(besides, 0.0);
        assert!((value - 1.25).abs() < 1e-12 && (error - 0.5f64.sqrt()).abs() < 1e-12, "{value} {error}");
    }

    #[test]
    fn a_plane_is_learnt_exactly_and_nothing_is_said_of_too_few_or_like_robots() {
        let values: Vec<Vec<f64>> = (0..20).map(|k| vec![0.1 * f64::from(k), f64::from(k * k % 7)]).collect();
        let logs = |one: &Vec<f64>| vec![one[0] + one[1], one[0] - 2.0 * one[1], 3.0, one[1]];
        let robots = Robots { logs: values.iter().map(logs).collect(), values };
        let asked = logs(&vec![0.77, 2.5]);
        let estimate = robots.estimate(&asked, &[0..2, 2..4], 2);
        let (values, together, errors) = estimate
            .map(|estimate| (estimate.values, estimate.together, estimate.errors))
            .unwrap_or_default();
        assert!((together[0] - 0.77).abs() < 1e-4 && (together[1] - 2.5).abs() < 1e-4, "{together:?}");
        assert!(
            (values[1] - 2.5).abs() < 1e-4 && errors.iter().all(|error| *error < 1e-3),
            "{values:?} {errors:?}"
        );
        let few = robots.between(&[0.0, 0.0], &[0.65, 9.0]);
        assert!(few.len() == 7 && few.estimate(&asked, std::slice::from_ref(&(0..4)), 1).is_none());
        let alike = Robots { logs: vec![vec![1.0]; 20], values: robots.values };
        assert!(alike.estimate(&[1.0], std::slice::from_ref(&(0..1)), 1).is_none());
    }
}
