//! Means, spreads and confidence intervals of independent values.

use serde::Serialize;

/// Mean; `None` without values.
pub fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Median; `None` without values.
pub fn median(values: &[f64]) -> Option<f64> {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => None,
        odd if odd % 2 == 1 => Some(values[middle]),
        _ => Some(0.5 * (values[middle - 1] + values[middle])),
    }
}

/// Σ (x − x̄)² over the values; 0 of nothing.
pub fn squares(values: &[f64]) -> f64 {
    // In two passes: the mean square less the squared mean would lose digits where the mean is large.
    let mean = mean(values).unwrap_or(0.0);
    values.iter().map(|value| (value - mean) * (value - mean)).sum()
}

/// Standard deviation with n − 1; none of fewer than two values.
pub fn deviation(values: &[f64]) -> Option<f64> {
    (values.len() > 1).then(|| (squares(values) / (values.len() as f64 - 1.0)).sqrt())
}

/// A mean and half the width of its 95 % confidence interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Mean.
    pub mean: f64,
    /// Half the width; unknown for a single value.
    pub ci95: Option<f64>,
}

/// 97.5 % quantile of the standard normal distribution.
const Z: f64 = 1.959_963_984_540_054;

/// The same to three digits, as tables have it.
pub const NORMAL_95: f64 = 1.96;

/// 97.5 % points of Student's t with 1, 2, … degrees of freedom.
const STUDENT: [f64; 30] = [
    12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131,
    2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042,
];

/// 97.5 % point of Student's t; for zero degrees of freedom, that for one.
pub fn student_t_95(degrees: usize) -> f64 {
    // Beyond the table the normal distribution's point is at most 4 % too small (2.040 at 31 degrees).
    STUDENT.get(degrees.saturating_sub(1)).copied().unwrap_or(NORMAL_95)
}

impl Estimate {
    /// Estimate from many values, with 1.96 standard errors of the mean (normal approximation); `None`
    /// without values.
    pub fn from_values(values: &[f64]) -> Option<Self> {
        // n − 1 for the variance of the values, n for that of their mean.
        let error = || (squares(values) / (values.len() as f64 - 1.0) / values.len() as f64).sqrt();
        Some(Self { mean: mean(values)?, ci95: (values.len() > 1).then(|| Z * error()) })
    }

    /// Estimate from a few values, by Student's t; `None` without values.
    pub fn of_few(values: &[f64]) -> Option<Self> {
        let error = || (squares(values) / (values.len() as f64 - 1.0) / values.len() as f64).sqrt();
        let student = student_t_95(values.len().saturating_sub(1));
        Some(Self { mean: mean(values)?, ci95: (values.len() > 1).then(|| student * error()) })
    }

    /// Estimate of a share: `hits` of `count`, with Wilson's interval (Wilson 1927), whose half width is not
    /// zero at 0 and 1. The mean is the plain share; there is none of nothing.
    pub fn share(hits: usize, count: usize) -> Option<Self> {
        if count == 0 {
            return None;
        }
        let (n, p) = (count as f64, hits as f64 / count as f64);
        // Wilson's interval is not centred on the plain share; its half width is given all the same.
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
        let values = [1.0, 2.0, 3.0, 4.0];
        assert_eq!(
            (median(&[3.0, 1.0, 2.0, 10.0]), median(&[5.0, 1.0, 2.0]), median(&[])),
            (Some(2.5), Some(2.0), None)
        );
        let (estimate, error) = (Estimate::from_values(&values).unwrap(), (5.0f64 / 12.0).sqrt());
        assert!((estimate.mean - 2.5).abs() < 1e-12);
        assert!((estimate.ci95.unwrap() - 1.959_963_984_540_054 * error).abs() < 1e-12);
        assert!((deviation(&values).unwrap() - (5.0f64 / 3.0).sqrt()).abs() < 1e-12);
        // Student's t with three degrees of freedom.
        assert!((Estimate::of_few(&values).unwrap().ci95.unwrap() - 3.182 * error).abs() < 1e-12);
        // Wilson, 0 of 10: the interval is [0, z²/(n + z²)] = [0, 0.2775].
        let none = Estimate::share(0, 10).unwrap();
        assert!(none.mean == 0.0 && (2.0 * none.ci95.unwrap() - 0.27753).abs() < 1e-4);
    }

    #[test]
    fn nothing_has_no_mean_and_one_value_no_spread() {
        assert_eq!(
            (mean(&[]), deviation(&[]), Estimate::from_values(&[]), Estimate::share(0, 0)),
            (None, None, None, None)
        );
        let one = Some(Estimate { mean: 7.0, ci95: None });
        assert_eq!(
            (deviation(&[7.0]), Estimate::from_values(&[7.0]), Estimate::of_few(&[7.0])),
            (None, one, one)
        );
    }
}
