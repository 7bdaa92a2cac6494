//! How likely the candidates of a search are to fall, learned from those before them.
//!
//! Falls are rare and random. Two candidates can have the same risk, and only one of them falls in its few walks. A search that
//! counts only the falls it sees therefore moves to the edge where half of its candidates fall. So a logistic regression
//! learns from the last generations how the parameters change the risk. Each candidate pays for its own estimated risk.

use super::Evaluation;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

// Fewer candidates say little of up to 100 slopes. More would come from regions that the search has left.
/// How many of the last candidates are remembered.
const REMEMBERED: usize = 512;
/// Max entries of θ for a regression; with more, for example the weights of networks, falls count only where they are seen.
const MAX_ENTRIES: usize = 100;
/// A standard deviation below this part of the mean is rounding.
const ROUNDING: f64 = 1e-9;
// A much wider prior lets a few falls by chance make steep slopes.
/// Variance of the prior of each slope, with parameters scaled to a standard deviation of 1.
const SLOPE_VARIANCE: f64 = 0.25;
/// Max steps of Newton's method, and max halvings of a step.
const STEPS: usize = 25;
const HALVINGS: usize = 10;
/// Newton's method ends when a step lowers the objective by less than this.
const ENOUGH: f64 = 1e-6;

/// The last candidates of a search, from the first generation in which one fell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct FallRisk {
    seen: VecDeque<Seen>,
}

/// A candidate, and whether it fell in any of its recordings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Seen {
    values: Vec<f64>,
    fell: bool,
}

impl FallRisk {
    /// Whether it remembers nothing, because none of the last candidates fell.
    pub fn is_empty(&self) -> bool {
        self.seen.is_empty()
    }

    /// Remembers the candidates of a generation that were simulated to the end.
    pub fn remember(&mut self, candidates: &[Vec<f64>], evaluations: &[Evaluation]) {
        if candidates.first().is_none_or(|values| values.len() > MAX_ENTRIES) {
            return;
        }
        let simulated =
            candidates.iter().zip(evaluations).filter(|(_, evaluation)| evaluation.cost.is_some());
        self.seen.extend(
            simulated.map(|(values, evaluation)| Seen { values: values.clone(), fell: evaluation.falls > 0 }),
        );
        self.seen.drain(..self.seen.len().saturating_sub(REMEMBERED));
        // Without a fall there is nothing to learn, and no candidate pays.
        if self.seen.iter().all(|one| !one.fell) {
            self.seen.clear();
        }
    }

    /// The number of `recordings` in which each of `candidates` is expected to fall: N (1 − (1 − p)^(1/N)), where p is the
    /// probability that it falls in at least one of N. All are 0 if no remembered candidate fell.
    pub fn expected_falls(&self, candidates: &[Vec<f64>], recordings: usize) -> Vec<f64> {
        let entries = self.seen.front().map_or(0, |one| one.values.len());
        if entries == 0 || candidates.iter().any(|values| values.len() != entries) {
            // Nothing is learnt yet, so no candidate pays.
            return vec![0.0; candidates.len()];
        }
        // Entries have very different units; scaled ones make one prior for all slopes possible.
        let scaling = self.scaling(entries);
        let scaled = |values: &[f64]| {
            let entries = values.iter().zip(&scaling).map(|(value, (mean, scale))| (value - mean) * scale);
            std::iter::once(1.0).chain(entries).collect::<Vec<f64>>()
        };
        let rows: Vec<f64> = self.seen.iter().flat_map(|one| scaled(&one.values)).collect();
        let rows = DMatrix::from_row_slice(self.seen.len(), entries + 1, &rows);
        let slopes = self.slopes(&rows);
        let recordings = recordings as f64;
        let expected = |values: &Vec<f64>| {
            // −ln(1 − p) is ln(1 + eˣ) of the logit x.
            let none = softplus(DVector::from_vec(scaled(values)).dot(&slopes));
            // N (1 − (1 − p)^(1/N)); `exp_m1` keeps small risks exact.
            recordings * -(-none / recordings).exp_m1()
        };
        candidates.iter().map(expected).collect()
    }

    /// The mean of each entry, and 1 / standard deviation. The latter is 0 for an entry that does not vary.
    fn scaling(&self, entries: usize) -> Vec<(f64, f64)> {
        let count = self.seen.len() as f64;
        let each = |entry: usize| {
            let values = || self.seen.iter().map(|one| one.values[entry]);
            let mean = values().sum::<f64>() / count;
            let deviation = (values().map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt();
            // With the scale 0 an entry that does not change has no part in the risk.
            (mean, if deviation > ROUNDING * mean.abs() { deviation.recip() } else { 0.0 })
        };
        (0..entries).map(each).collect()
    }

    /// The intercept and slopes with the largest posterior density.
    fn slopes(&self, rows: &DMatrix<f64>) -> DVector<f64> {
        let fell = |row: usize| if self.seen[row].fell { 1.0 } else { 0.0 };
        let penalty = |slopes: &DVector<f64>| slopes.rows_range(1..).norm_squared() / (2.0 * SLOPE_VARIANCE);
        let objective = |slopes: &DVector<f64>| {
            let logits = rows * slopes;
            // The negative log likelihood of each fall and of each walk without one.
            let loss = logits.iter().enumerate().map(|(row, logit)| softplus(*logit) - fell(row) * logit);
            loss.sum::<f64>() + penalty(slopes)
        };
        // Newton's method; the loss is convex, and halved steps keep it falling.
        let mut slopes = DVector::zeros(rows.ncols());
        let mut value = objective(&slopes);
        for _ in 0..STEPS {
            let chances = (rows * &slopes).map(|logit| (1.0 + (-logit).exp()).recip());
            let apart = DVector::from_fn(rows.nrows(), |row, _| chances[row] - fell(row));
            let mut gradient = rows.tr_mul(&apart);
            let mut weighted = rows.clone();
            for (row, chance) in chances.iter().enumerate() {
                // The curvature of this loss is Xᵀ diag(p (1 − p)) X.
                weighted.row_mut(row).scale_mut((chance * (1.0 - chance)).sqrt());
            }
            let mut curvature = weighted.tr_mul(&weighted);
            // The intercept has no prior. If all candidates fell, its curvature would come near 0.
            curvature[(0, 0)] += ENOUGH;
            // The Gaussian prior of the slopes, in gradient and curvature.
            for entry in 1..rows.ncols() {
                gradient[entry] += slopes[entry] / SLOPE_VARIANCE;
                curvature[(entry, entry)] += SLOPE_VARIANCE.recip();
            }
            let Some(factor) = curvature.cholesky() else { break };
            let mut step = factor.solve(&gradient);
            let mut shorter = (0..HALVINGS).filter_map(|_| {
                let tried = &slopes - &step;
                step *= 0.5;
                let cost = objective(&tried);
                (cost < value).then_some((tried, cost))
            });
            // No shorter step lowers the loss: rounding has been reached.
            let Some((tried, cost)) = shorter.next() else { break };
            let fallen = value - cost;
            (slopes, value) = (tried, cost);
            if fallen < ENOUGH {
                break;
            }
        }
        slopes
    }
}

/// ln(1 + eˣ), without overflow.
fn softplus(logit: f64) -> f64 {
    // Written so, the exponential cannot overflow.
    logit.max(0.0) + (-logit.abs()).exp().ln_1p()
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaitfit_random::{Purpose, Stream};

    fn evaluation(falls: usize) -> Evaluation {
        Evaluation { cost: Some(0.1), falls }
    }

    /// Generations whose first entry alone decides how likely a fall is; the second does not vary.
    fn learned(generations: u32, logit: fn(f64) -> f64) -> FallRisk {
        let mut risk = FallRisk::default();
        for generation in 0..generations {
            let draws = Stream::new(7, Purpose::TORQUE_NOISE).environment(0).step(generation);
            let candidates: Vec<Vec<f64>> =
                (0..32).map(|at| vec![draws.normal(3 * at), 0.1, draws.normal(3 * at + 1)]).collect();
            let falls = |(at, values): (usize, &Vec<f64>)| {
                let chance = (1.0 + (-logit(values[0])).exp()).recip();
                evaluation(usize::from(draws.uniform(3 * at as u32 + 2) < chance))
            };
            let falls: Vec<Evaluation> = candidates.iter().enumerate().map(falls).collect();
            risk.remember(&candidates, &falls);
        }
        risk
    }

    #[test]
    fn the_risk_follows_the_parameter_that_makes_robots_fall() {
        let risk = learned(16, |value| 2.0 * value - 1.0);
        let candidates = [vec![-2.0, 0.1, 0.0], vec![0.0, 0.1, 0.0], vec![1.0, 0.1, 2.0]];
        let falls = risk.expected_falls(&candidates, 4);
        for (found, logit) in falls.iter().zip([-5.0_f64, -1.0, 1.0]) {
            let stands = (1.0 + logit.exp()).recip();
            let expected = 4.0 * (1.0 - stands.powf(0.25));
            assert!((found - expected).abs() < 0.25 * expected + 0.02, "{found} for {expected}");
        }
    }

    #[test]
    fn without_falls_nothing_is_remembered_and_nothing_is_paid() {
        let mut risk = learned(3, |_| -50.0);
        assert!(risk.is_empty());
        assert_eq!(risk.expected_falls(&[vec![0.0; 3]], 48), [0.0]);
        let diverged = Evaluation { cost: None, falls: 3 };
        risk.remember(&[vec![0.0; 3]], &[diverged]);
        assert!(risk.is_empty(), "a diverged simulation does not count");
    }

    #[test]
    fn if_all_fall_the_risk_is_large_and_finite() {
        let mut risk = FallRisk::default();
        let candidates = vec![vec![1.0, 2.0]; 8];
        risk.remember(&candidates, &[evaluation(40); 8]);
        let falls = risk.expected_falls(&candidates, 48);
        assert!(falls.iter().all(|falls| (3.0..48.0).contains(falls)), "{falls:?}");
        assert!(risk.expected_falls(&candidates, 1).iter().all(|falls| *falls <= 1.0));
    }

    #[test]
    fn the_last_candidates_are_remembered() {
        let mut risk = learned(40, |value| value);
        assert_eq!(risk.seen.len(), REMEMBERED);
        for _ in 0..REMEMBERED {
            risk.remember(&[vec![0.0; 3]], &[evaluation(0)]);
        }
        assert!(risk.is_empty(), "the falls are forgotten");
    }
}
