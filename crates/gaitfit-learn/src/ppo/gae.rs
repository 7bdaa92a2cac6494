//! Generalised advantage estimation.

use gaitfit_sim::pool::share;

use super::{Samples, SamplesError, Widths};

impl Samples {
    /// Fills `advantage` and `returns` (Schulman et al. 2016, equations 11, 12 and 16, computed backwards):
    /// δₜ = rₜ + γ (1 − dₜ) Vₜ₊₁ − Vₜ, Aₜ = δₜ + γλ (1 − dₜ) Aₜ₊₁, Rₜ = Aₜ + Vₜ, with V after the last step in
    /// `last_value`.
    pub fn estimate_advantages(&mut self, gamma: f64, lambda: f64) {
        let (gamma, decay) = (gamma as f32, (gamma * lambda) as f32);
        let width = self.environments;
        // Behind the last step stands the value that the critic gives, and no further advantage.
        let mut next_value = self.last_value.clone();
        let mut next_advantage = vec![0.0; width];
        for step in (0..self.steps).rev() {
            let at = step * width;
            for environment in 0..width {
                let i = at + environment;
                // The next row of a robot whose episode ended is another episode: nothing of it counts.
                let alive = 1.0 - self.done[i];
                let delta = self.reward[i] + gamma * alive * next_value[environment] - self.value[i];
                let advantage = delta + decay * alive * next_advantage[environment];
                self.advantage[i] = advantage;
                self.returns[i] = advantage + self.value[i];
                next_advantage[environment] = advantage;
                next_value[environment] = self.value[i];
            }
        }
    }
}

/// Checks every tile against `widths` and estimates its advantages, tiles shared by `threads`.
///
/// # Errors
/// The first unfit tile's; advantages of others may have been filled.
pub(super) fn check_and_estimate(
    tiles: &mut [Samples],
    widths: Widths,
    gamma: f64,
    lambda: f64,
    threads: usize,
) -> Result<(), SamplesError> {
    let mut outcomes = vec![Ok(()); tiles.len()];
    // Workers need no memory of their own: they only set the number of threads.
    let mut workers = vec![(); threads.clamp(1, tiles.len().max(1))];
    let jobs = tiles.iter_mut().zip(&mut outcomes).enumerate();
    share(&mut workers, jobs, |(), (index, (tile, outcome))| {
        *outcome = tile.check(index, widths).map(|()| tile.estimate_advantages(gamma, lambda));
    });
    outcomes.into_iter().collect()
}

/// Shifts and scales the advantages of all tiles together to mean 0 and standard deviation 1 (n − 1 in the
/// denominator, 1e-8 added).
pub(super) fn normalise_advantages(tiles: &mut [Samples]) {
    let count = tiles.iter().map(Samples::rows).sum::<usize>() as f64;
    let mean = tiles.iter().flat_map(|tile| &tile.advantage).map(|&a| f64::from(a)).sum::<f64>() / count;
    let squares =
        tiles.iter().flat_map(|tile| &tile.advantage).map(|&a| (f64::from(a) - mean).powi(2)).sum::<f64>();
    // 1e-8 keeps advantages that are all equal at 0. One sample has no n − 1.
    let factor = 1.0 / ((squares / (count - 1.0).max(1.0)).sqrt() + 1e-8);
    for advantage in tiles.iter_mut().flat_map(|tile| &mut tile.advantage) {
        *advantage = ((f64::from(*advantage) - mean) * factor) as f32;
    }
}

/// 1 − Var(R − V) / Var(R) over all tiles: 1 where the critic foresaw the returns, 0 where a constant would do as
/// well. None if the returns do not vary.
pub(super) fn explained_variance(tiles: &[Samples]) -> Option<f64> {
    let count = tiles.iter().map(Samples::rows).sum::<usize>() as f64;
    let pairs = || tiles.iter().flat_map(|tile| tile.returns.iter().zip(&tile.value));
    // In two passes: the difference of mean square and squared mean would lose digits.
    let variance = |f: fn(f32, f32) -> f64| {
        let mean = pairs().map(|(&r, &v)| f(r, v)).sum::<f64>() / count;
        pairs().map(|(&r, &v)| (f(r, v) - mean).powi(2)).sum::<f64>() / count
    };
    let total = variance(|r, _| f64::from(r));
    (total > 0.0).then(|| 1.0 - variance(|r, v| f64::from(r) - f64::from(v)) / total)
}
