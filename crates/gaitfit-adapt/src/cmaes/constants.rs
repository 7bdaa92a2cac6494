//! The strategy's constants.

use super::CovarianceKind;

/// Default population 4 + ⌊3 ln n⌋ (eq. 48).
pub fn default_population(n: usize) -> usize {
    // ln 0 is not finite. `Settings::check` refuses a problem without coordinates later.
    4 + (3.0 * (n.max(1) as f64).ln()).floor() as usize
}

/// Constants of the update for n coordinates and λ candidates (table 1 of the tutorial).
#[derive(Clone, Debug, PartialEq)]
pub struct Constants {
    /// Parents: ⌊λ/2⌋.
    pub mu: usize,
    /// Recombination weights by rank, λ entries; the first μ sum to 1 (eq. 53).
    pub weights: Vec<f64>,
    /// Variance-effective selection mass μ_eff (eq. 8).
    pub mu_eff: f64,
    /// Learning rate of the rank-one update (eq. 57).
    pub c1: f64,
    /// Learning rate of the rank-μ update (eq. 58).
    pub cmu: f64,
    /// Cumulation rate of the rank-one path (eq. 56).
    pub cc: f64,
    /// Cumulation rate of the step-size path (eq. 55).
    pub c_sigma: f64,
    /// Damping of the step size (eq. 55).
    pub d_sigma: f64,
    /// E‖N(0, I)‖, by its expansion (page 28).
    pub chi_n: f64,
    /// Generations from one decomposition of C to the next, max(1, ⌊1/(10 n (c1 + cμ))⌋) (appendix B.2). It is 1 for
    /// fewer than about 200 coordinates; C hardly changes in one generation of many coordinates.
    pub decompose_every: u32,
}

/// α_cov of eqs. 57 and 58.
const ALPHA_COV: f64 = 2.0;

impl Constants {
    /// The constants of either form.
    pub fn new(kind: CovarianceKind, n: usize, population: usize) -> Self {
        match kind {
            CovarianceKind::Full => Self::full(n as f64, population),
            CovarianceKind::Separable => Self::separable(n as f64, population),
        }
    }

    fn full(n: f64, population: usize) -> Self {
        let mu = population / 2;
        // eq. 49
        let raw: Vec<f64> =
            (0..population).map(|i| ((population as f64 + 1.0) / 2.0).ln() - (i as f64 + 1.0).ln()).collect();
        // eq. 8, of the parents and of the rest
        let mu_eff = effective(&raw[..mu]);
        let mu_eff_minus = effective(&raw[mu..]);
        let c1 = ALPHA_COV / ((n + 1.3).powi(2) + mu_eff);
        // The margin of 1e-8 keeps 1 − c1 − cμ positive for large populations.
        let cmu = (1.0 - c1 - 1e-8)
            .min(ALPHA_COV * (mu_eff - 2.0 + 1.0 / mu_eff) / ((n + 2.0).powi(2) + ALPHA_COV * mu_eff / 2.0));
        // The smallest of three bounds on the sum of the negative weights. The last keeps C positive definite.
        let min_alpha = (1.0 + c1 / cmu) // eq. 50
            .min(1.0 + 2.0 * mu_eff_minus / (mu_eff + 2.0)) // eq. 51
            .min((1.0 - c1 - cmu) / (n * cmu)); // eq. 52
        // With an odd population the middle weight is 0 and belongs to neither sum.
        let positive: f64 = raw.iter().filter(|weight| **weight > 0.0).sum();
        let negative: f64 = raw.iter().filter(|weight| **weight < 0.0).map(|weight| -weight).sum();
        // eq. 53
        let weights = raw
            .iter()
            .map(|weight| if *weight >= 0.0 { weight / positive } else { min_alpha * weight / negative })
            .collect();
        let c_sigma = (mu_eff + 2.0) / (n + mu_eff + 5.0);
        let cc = (4.0 + mu_eff / n) / (n + 4.0 + 2.0 * mu_eff / n);
        Self {
            mu,
            weights,
            mu_eff,
            c1,
            cmu,
            cc,
            c_sigma,
            d_sigma: damping(n, mu_eff, c_sigma),
            chi_n: chi(n),
            // C changes little in so many generations (tutorial, appendix B.2).
            decompose_every: (1.0 / (10.0 * n * (c1 + cmu))).max(1.0) as u32,
        }
    }

    /// Ros and Hansen 2008, table 1: positive weights only, and a rank-μ rate (n + 2)/3 times that of the full
    /// form, since there are n numbers to learn instead of n(n + 1)/2. The product is capped at 1 − c1, which
    /// large populations would pass.
    fn separable(n: f64, population: usize) -> Self {
        let mu = population / 2;
        let raw: Vec<f64> = (0..mu).map(|i| (mu as f64 + 1.0).ln() - (i as f64 + 1.0).ln()).collect();
        let sum: f64 = raw.iter().sum();
        let mu_eff = effective(&raw);
        let mut weights: Vec<f64> = raw.iter().map(|weight| weight / sum).collect();
        // Ranks behind the parents count nothing, but keep the weights as many as the candidates.
        weights.resize(population, 0.0);
        let c1 = ALPHA_COV / ((n + 1.3).powi(2) + mu_eff);
        let cmu_full = 2.0 / mu_eff / (n + std::f64::consts::SQRT_2).powi(2)
            + (1.0 - 1.0 / mu_eff) * ((2.0 * mu_eff - 1.0) / ((n + 2.0).powi(2) + mu_eff)).min(1.0);
        // A diagonal has fewer numbers to learn, so it is learnt faster by (n + 2)/3 (Ros and Hansen 2008).
        let cmu = ((n + 2.0) / 3.0 * cmu_full).min(1.0 - c1);
        let c_sigma = (mu_eff + 2.0) / (n + mu_eff + 3.0);
        let cc = 4.0 / (n + 4.0);
        Self {
            mu,
            weights,
            mu_eff,
            c1,
            cmu,
            cc,
            c_sigma,
            d_sigma: damping(n, mu_eff, c_sigma),
            chi_n: chi(n),
            // The decomposition of a diagonal is a root for each coordinate, so it is made every time.
            decompose_every: 1,
        }
    }
}

/// (Σ w)² / Σ w² (eq. 8).
fn effective(weights: &[f64]) -> f64 {
    let sum: f64 = weights.iter().sum();
    sum * sum / weights.iter().map(|weight| weight * weight).sum::<f64>()
}

/// d_σ (eq. 55).
fn damping(n: f64, mu_eff: f64, c_sigma: f64) -> f64 {
    // The middle term is 0 unless μ_eff exceeds n + 2: only large populations need more damping.
    1.0 + 2.0 * (((mu_eff - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0) + c_sigma
}

fn chi(n: f64) -> f64 {
    n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn default_populations() {
        // ln 6 = 1.79, ln 36 = 3.58, ln 1164 = 7.06.
        assert_eq!([1, 6, 36, 1164].map(default_population), [4, 9, 14, 25]);
    }

    #[test]
    fn many_coordinates_are_decomposed_less_often() {
        for (n, generations) in [(12, 1), (97, 1), (250, 2), (1164, 9)] {
            let constants = Constants::new(CovarianceKind::Full, n, default_population(n));
            assert_eq!(constants.decompose_every, generations, "{n} coordinates");
        }
    }

    /// Every size gives rates that keep the covariance a convex combination, and weights that sum as they should.
    #[test]
    fn constants_are_sound_for_all_sizes() {
        for n in [1, 2, 3, 6, 36, 300] {
            for population in [2, 3, 4, 5, 9, 14, 100, 2_000] {
                for kind in [CovarianceKind::Full, CovarianceKind::Separable] {
                    let constants = Constants::new(kind, n, population);
                    let parents: f64 = constants.weights[..constants.mu].iter().sum();
                    let middle_is_zero = kind == CovarianceKind::Full && population % 2 == 1;
                    assert!((parents - 1.0).abs() < 1e-12 || middle_is_zero, "{kind:?} {n} {population}");
                    let kept = constants.c1 + constants.cmu;
                    assert!(constants.c1 > 0.0 && constants.cmu >= 0.0 && kept <= 1.0 + 1e-15);
                    assert!(constants.c_sigma < 1.0 && constants.cc <= 1.0 && constants.d_sigma >= 1.0);
                    // eq. 52 keeps C positive definite: the negative weights take no more than what decay leaves.
                    let negative: f64 = constants.weights.iter().filter(|w| **w < 0.0).sum();
                    let bound = n as f64 * constants.cmu * -negative;
                    assert!(bound <= 1.0 - kept + 1e-12, "{kind:?} {n} {population}");
                }
            }
        }
    }

    /// E‖N(0, I)‖ = √2 Γ((n + 1)/2) / Γ(n/2): √(2/π) for n = 1, √(π/2) for n = 2.
    #[test]
    fn chi_is_the_mean_norm() {
        assert!((chi(1.0) - (2.0 / std::f64::consts::PI).sqrt()).abs() < 2e-3);
        assert!((chi(2.0) - (std::f64::consts::PI / 2.0).sqrt()).abs() < 2e-3);
    }
}
