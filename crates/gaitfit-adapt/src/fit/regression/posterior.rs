//! The estimates of a regression combined with priors.

use crate::Theta;
use gaitfit_sim::stats;
use nalgebra::{DMatrix, DVector};

/// Added to each variance, as a part of it: correlations from few robots would make the matrix singular.
const INDEPENDENT: f64 = 1e-3;

/// A normal density of the values of θ.
#[derive(Clone, Debug)]
pub struct Posterior {
    /// Means.
    pub values: Vec<f64>,
    /// Standard deviations.
    pub deviations: Vec<f64>,
    /// Cholesky factor of the correlation matrix.
    factor: DMatrix<f64>,
}

impl Posterior {
    /// Correlated errors of the values, in units of their standard deviations. They are made from `independent`: independent
    /// numbers with a standard deviation of 1.
    pub fn correlated(&self, independent: &[f64]) -> Vec<f64> {
        (&self.factor * DVector::from_row_slice(independent)).iter().copied().collect()
    }
}

/// The product of two normal densities: that of `values`, and the priors of `theta`. `deviations`: the standard deviations of
/// `values`. `left`: leave-one-out errors (`entries × robots`), whose correlations are those of `values`. `None` without
/// robots, or if a matrix has no inverse.
pub fn with_priors(
    theta: &Theta,
    values: &[f64],
    deviations: &[f64],
    left: &[Vec<f64>],
) -> Option<Posterior> {
    let count = values.len();
    let size =
        |at: usize| stats::mean(&left[at].iter().map(|one| one * one).collect::<Vec<_>>()).map(f64::sqrt);
    let sizes: Vec<f64> = (0..count).map(size).collect::<Option<_>>()?;
    // Correlations: the covariance in units of the deviations.
    // `INDEPENDENT` on the diagonal keeps the matrix invertible if errors go together completely.
    let correlations = DMatrix::from_fn(count, count, |a, b| {
        if a == b {
            return 1.0 + INDEPENDENT;
        }
        let product = left[a].iter().zip(&left[b]).map(|(a, b)| a * b).sum::<f64>() / left[a].len() as f64;
        // Where all errors of an entry are 0 the quotient is not a number, and nothing correlates with it.
        let correlation = product / (sizes[a] * sizes[b]);
        if correlation.is_finite() { correlation.clamp(-1.0, 1.0) } else { 0.0 }
    });
    // Without priors the product is the first density itself.
    if theta.priors().all(|prior| prior.is_none()) {
        let factor = factor(&correlations)?;
        return Some(Posterior { values: values.to_vec(), deviations: deviations.to_vec(), factor });
    }
    // From here on all is in units of the deviations, about `values`.
    let mut precision = correlations.cholesky()?.inverse();
    let mut pull = DVector::<f64>::zeros(count);
    // In units of the deviations a prior is one more equation with an error of 1. It holds the value less what
    // strength and load change of it.
    for (at, prior) in theta.priors().enumerate() {
        let Some(prior) = prior else { continue };
        let mut row = DVector::<f64>::zeros(count);
        row[at] = deviations[at] / prior.deviation;
        let mut known = prior.value;
        if let Some(strength) = theta.strength(at) {
            row[strength] -= prior.by_strength * deviations[strength] / prior.deviation;
            known += prior.by_strength * (values[strength] - 1.0);
        }
        if let Some(load) = theta.load(at) {
            row[load] += prior.by_load * deviations[load] / prior.deviation;
            known -= prior.by_load * values[load];
        }
        let apart = (known - values[at]) / prior.deviation;
        precision += &row * row.transpose();
        pull += apart * row;
    }
    // Precisions and pulls of all sources add up; their inverse is the posterior's covariance.
    let covariance = precision.cholesky()?.inverse();
    let moved = &covariance * pull;
    let value = |at: usize| values[at] + deviations[at] * moved[at];
    let deviation = |at: usize| deviations[at] * covariance[(at, at)].max(0.0).sqrt();
    let (values, deviations) = ((0..count).map(value).collect(), (0..count).map(deviation).collect());
    Some(Posterior { values, deviations, factor: factor(&covariance)? })
}

/// The Cholesky factor of the correlations of `covariance`. `None` if the matrix has no inverse.
fn factor(covariance: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let mut factor = covariance.clone().cholesky()?.unpack();
    // Rows of length 1 make the covariance's factor one of its correlations.
    for mut row in factor.row_iter_mut() {
        let size = row.norm();
        row /= size;
    }
    Some(factor)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::{JointParameter, ParameterRule, Prior, Sharing};

    fn theta(known: &[(&str, Prior)]) -> Theta {
        let rule = |kind| ParameterRule { per: Sharing::All, ..ParameterRule::new(kind) };
        let rules = [JointParameter::FrictionLoss, JointParameter::TorqueScale].map(rule);
        let theta = Theta::from_rules(&rules, &[], &["calf".to_owned()]).unwrap();
        let known = known.iter().map(|(name, prior)| ((*name).to_owned(), *prior)).collect();
        theta.with_priors(&known, 0.01).unwrap()
    }

    #[test]
    fn two_equally_sure_estimates_meet_in_the_middle_and_pull_what_goes_with_them() {
        // Errors of friction and strength are the same, in their own units.
        let left = [vec![0.1, -0.1, 0.1, -0.1], vec![0.01, -0.01, 0.01, -0.01]];
        let theta = theta(&[("frictionloss", Prior::new(0.5, 0.1))]);
        let Posterior { values, deviations: errors, .. } =
            with_priors(&theta, &[0.3, 1.0], &[0.1, 0.01], &left).unwrap();
        assert!((values[0] - 0.4).abs() < 1e-3 && (values[1] - 1.01).abs() < 1e-4, "{values:?}");
        assert!((errors[0] - 0.1 / 2f64.sqrt()).abs() < 1e-3, "{errors:?}");
    }

    #[test]
    fn a_prior_that_depends_on_friction_under_load_moves_with_it() {
        let rule = |kind| ParameterRule { per: Sharing::All, ..ParameterRule::new(kind) };
        let rules = [JointParameter::FrictionLoss, JointParameter::LoadFriction].map(rule);
        let theta = Theta::from_rules(&rules, &[], &["calf".to_owned()]).unwrap();
        // The sum of friction and 2 N·m times the load friction is 0.5 N·m.
        let prior = Prior { by_load: 2.0, ..Prior::new(0.5, 1e-6) };
        let theta = theta.with_priors(&[("frictionloss".to_owned(), prior)].into(), 0.01).unwrap();
        let left = [vec![0.1, -0.1, 0.1, -0.1], vec![0.01, 0.01, -0.01, -0.01]];
        let Posterior { values, deviations: errors, .. } =
            with_priors(&theta, &[0.2, 0.1], &[0.1, 0.05], &left).unwrap();
        // Both are equally sure in N·m, so each makes up for half of the 0.1 N·m that lack.
        assert!((values[0] - 0.25).abs() < 1e-3 && (values[1] - 0.125).abs() < 1e-3, "{values:?}");
        assert!((errors[0] - 0.1 / 2f64.sqrt()).abs() < 1e-3, "{errors:?}");
    }

    #[test]
    fn a_prior_that_depends_on_the_strength_moves_with_it() {
        // Independent errors. The prior is of a robot with full strength; this one has 0.9.
        let left = [vec![0.1, -0.1, 0.1, -0.1], vec![0.01, 0.01, -0.01, -0.01]];
        let prior = Prior { by_strength: 2.0, ..Prior::new(0.5, 0.001) };
        let theta = theta(&[("frictionloss", prior)]);
        let Posterior { values, .. } = with_priors(&theta, &[0.3, 0.9], &[0.1, 1e-6], &left).unwrap();
        assert!((values[0] - 0.3).abs() < 1e-3, "{values:?}");
        let without = with_priors(&self::theta(&[]), &[0.3, 0.9], &[0.1, 1e-6], &left).unwrap();
        assert_eq!((without.values, without.deviations), (vec![0.3, 0.9], vec![0.1, 1e-6]));
    }
}
