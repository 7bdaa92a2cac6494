//! Means with confidence intervals.

use serde::Serialize;

/// A mean and half the width of its 95 % confidence interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Mean.
    pub mean: f64,
    /// 1.96 standard errors of the mean (normal approximation); unknown for a single value.
    pub ci95: Option<f64>,
}

/// 97.5 % quantile of the standard normal distribution.
const Z: f64 = 1.959_963_984_540_054;

impl Estimate {
    /// Of a list of values; none of an empty one.
    pub fn of(values: impl IntoIterator<Item = f64> + Clone) -> Option<Self> {
        let (mut count, mut sum) = (0.0, 0.0);
        for value in values.clone() {
            count += 1.0;
            sum += value;
        }
        if count == 0.0 {
            return None;
        }
        let mean = sum / count;
        if count < 2.0 {
            return Some(Self { mean, ci95: None });
        }
        let squares: f64 = values.into_iter().map(|value| (value - mean) * (value - mean)).sum();
        Some(Self { mean, ci95: Some(Z * (squares / (count - 1.0) / count).sqrt()) })
    }

    /// Of a share: `hits` of `count`, with Wilson's interval (Wilson 1927), whose half width is not zero at 0 and
    /// 1. The mean is the plain share; there is none of nothing.
    pub fn share(hits: usize, count: usize) -> Option<Self> {
        if count == 0 {
            return None;
        }
        let (n, p) = (count as f64, hits as f64 / count as f64);
        let half = Z / (1.0 + Z * Z / n) * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
        Some(Self { mean: p, ci95: Some(half) })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn intervals_by_hand() {
        // Mean 2.5, variance 5/3, standard error sqrt(5/12).
        let estimate = Estimate::of([1.0, 2.0, 3.0, 4.0]).unwrap();
        assert!((estimate.mean - 2.5).abs() < 1e-12);
        assert!((estimate.ci95.unwrap() - 1.959_963_984_540_054 * (5.0f64 / 12.0).sqrt()).abs() < 1e-12);
        // Wilson, 0 of 10: the interval is [0, z²/(n + z²)] = [0, 0.2775].
        let none = Estimate::share(0, 10).unwrap();
        assert!(none.mean == 0.0 && (2.0 * none.ci95.unwrap() - 0.27753).abs() < 1e-4);
    }

    #[test]
    fn nothing_has_no_mean_and_one_value_no_interval() {
        assert_eq!(Estimate::of([]), None);
        assert_eq!(Estimate::of([7.0]), Some(Estimate { mean: 7.0, ci95: None }));
        assert_eq!(Estimate::share(0, 0), None);
    }
}
