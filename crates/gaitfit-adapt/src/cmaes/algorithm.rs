//! Ask and tell.

use super::covariance::EPS;
use super::settings::MEAN_MAX;
use super::stop::reason;
use super::{
    AddressedNormals, Best, BoundHandling, CmaError, Constants, NormalSource, Settings, State, StopReason,
};

/// Largest step size, as the `cmaes` package.
const SIGMA_MAX: f64 = 1e32;

/// One run of CMA-ES.
#[derive(Clone, Debug, PartialEq)]
pub struct Cma {
    settings: Settings,
    constants: Constants,
    state: State,
}

/// The candidates of one generation.
#[derive(Clone, Debug, PartialEq)]
pub struct Population {
    generation: u32,
    x: Vec<Vec<f64>>,
    /// The same in scaled coordinates, unrounded by the way to `x` and back.
    scaled: Vec<Vec<f64>>,
}

impl Population {
    /// Candidates in the problem's units, inside the bounds; one vector a candidate.
    pub fn x(&self) -> &[Vec<f64>] {
        &self.x
    }

    /// Generation these candidates belong to, from 0.
    pub fn generation(&self) -> u32 {
        self.generation
    }
}

impl Cma {
    /// A run at generation 0.
    ///
    /// # Errors
    /// As [`Settings::check`].
    pub fn new(settings: Settings) -> Result<Self, CmaError> {
        settings.check()?;
        let state = State::new(&settings);
        Ok(Self::assemble(settings, state))
    }

    /// Continues from a saved `state` of a run with the same `settings`: the results are the same bits as those of
    /// an undisturbed run. When to stop (`tolerances`) may have changed.
    ///
    /// # Errors
    /// [`CmaError::State`] if the state does not fit the settings, and as [`Settings::check`].
    pub fn resume(settings: Settings, state: State) -> Result<Self, CmaError> {
        settings.check()?;
        state.check(&settings)?;
        Ok(Self::assemble(settings, state))
    }

    fn assemble(settings: Settings, state: State) -> Self {
        let constants = Constants::new(settings.covariance, settings.start.len(), settings.population);
        Self { settings, constants, state }
    }

    /// The candidates of the present generation. Pure: asking again returns the same.
    pub fn ask(&self) -> Population {
        self.ask_from(&AddressedNormals { seed: self.settings.seed })
    }

    /// [`Self::ask`] with the standard normals of `normals`: y = C^½ z, x = mean + σ y (eqs. 38–40).
    pub fn ask_from(&self, normals: &dyn NormalSource) -> Population {
        let n = self.settings.deviation.len();
        let mut first = vec![0.0; n * self.settings.population];
        normals.fill_all(self.state.generation, n, &mut first);
        let candidates = first.chunks_exact_mut(n).enumerate();
        let scaled: Vec<Vec<f64>> =
            candidates.map(|(candidate, z)| self.sample(candidate as u32, z, normals)).collect();
        let x = scaled.iter().map(|point| self.unscale(point)).collect();
        Population { generation: self.state.generation, x, scaled }
    }

    /// A point in scaled coordinates. With resampling it lies inside the bounds: after `max_resampling` draws
    /// outside, one more is clipped. `z`: the candidate's first normals.
    fn sample(&self, candidate: u32, z: &mut [f64], normals: &dyn NormalSource) -> Vec<f64> {
        let Settings { deviation, lower, upper, .. } = &self.settings;
        let n = deviation.len();
        // The distribution lives in scaled coordinates, so bounds are scaled too.
        let bound = |bounds: &[f64], i: usize| bounds[i] / deviation[i];
        let mut attempt = 0;
        loop {
            let mut point = self.state.covariance.root_times(z);
            for (value, mean) in point.iter_mut().zip(&self.state.mean) {
                *value = mean + self.state.sigma * *value;
            }
            let inside = (0..n).all(|i| point[i] >= bound(lower, i) && point[i] <= bound(upper, i));
            // Mirroring happens on the way to the problem's units, so a draw outside the bounds is kept here.
            if inside || self.settings.bound_handling == BoundHandling::Reflect {
                return point;
            }
            if attempt >= self.settings.max_resampling {
                for (i, value) in point.iter_mut().enumerate() {
                    *value = value.max(bound(lower, i)).min(bound(upper, i));
                }
                return point;
            }
            attempt += 1;
            normals.fill(self.state.generation, candidate, attempt, z);
        }
    }

    /// Scaled coordinates in the problem's units, inside the bounds (rounding may step over one).
    fn unscale(&self, point: &[f64]) -> Vec<f64> {
        let Settings { deviation, lower, upper, bound_handling, .. } = &self.settings;
        (0..point.len())
            .map(|i| {
                let x = point[i] * deviation[i];
                let x = match bound_handling {
                    BoundHandling::Resample => x,
                    BoundHandling::Reflect => reflect(x, lower[i], upper[i]),
                };
                x.max(lower[i]).min(upper[i])
            })
            .collect()
    }

    /// Updates the distribution with one cost a candidate, in the population's order; smaller is better. Costs that
    /// are not finite mean that the candidate failed: it ranks behind all others, among its like by number. Equal
    /// costs rank by number too. If every candidate failed the distribution stays and the next generation draws
    /// anew.
    ///
    /// # Errors
    /// [`CmaError::CostCount`], [`CmaError::Generation`]; the state is then unchanged.
    pub fn tell(&mut self, population: &Population, costs: &[f64]) -> Result<(), CmaError> {
        if costs.len() != population.x.len() || costs.len() != self.settings.population {
            return Err(CmaError::CostCount { got: costs.len(), expected: self.settings.population });
        }
        if population.generation != self.state.generation {
            return Err(CmaError::Generation { got: population.generation, expected: self.state.generation });
        }
        let ranking = rank(costs);
        self.remember(population, costs, &ranking);
        // A generation of failures alone counts too: the draws depend on its number, so the next one differs.
        self.state.generation += 1;
        if costs.iter().any(|cost| cost.is_finite()) {
            // The update works in place. It is dropped whole if any number leaves the finite range.
            let before = self.state.clone();
            if !self.update(&population.scaled, &ranking) {
                self.state = State { numerical_failure: true, ..before };
            }
        }
        Ok(())
    }

    fn remember(&mut self, population: &Population, costs: &[f64], ranking: &[usize]) {
        let state = &mut self.state;
        let (first, last) = (ranking[0], ranking[ranking.len() - 1]);
        // A failed candidate keeps `tolfun` from stopping the run, and the state stays free of infinities.
        let finite = |cost: f64| if cost.is_finite() { cost } else { f64::MAX };
        // The package `cmaes` raises its generation before it writes the ring, hence the 1.
        let slot = (state.generation as usize + 1) % state.history.len();
        state.history[slot] = [finite(costs[first]), finite(costs[last])];
        let improved = state.best.as_ref().is_none_or(|best| costs[first] < best.cost);
        if costs[first].is_finite() && improved {
            let x = population.x[first].clone();
            state.best = Some(Best { cost: costs[first], x, generation: state.generation });
        }
    }

    /// The update of mean, step size and covariance; false if it left the finite numbers.
    fn update(&mut self, points: &[Vec<f64>], ranking: &[usize]) -> bool {
        let Constants { mu, weights, mu_eff, c1, cmu, cc, c_sigma, d_sigma, chi_n, decompose_every } =
            &self.constants;
        let state = &mut self.state;
        let n = state.mean.len();

        // Steps in units of σ, best first.
        let steps: Vec<Vec<f64>> = ranking
            .iter()
            .map(|k| points[*k].iter().zip(&state.mean).map(|(x, m)| (x - m) / state.sigma).collect())
            .collect();

        // Selection and recombination (eqs. 41 and 42, with c_m = 1 of eq. 54).
        let mut y_w = vec![0.0; n];
        for (weight, step) in weights[..*mu].iter().zip(&steps) {
            for (sum, value) in y_w.iter_mut().zip(step) {
                *sum += weight * value;
            }
        }
        for (mean, step) in state.mean.iter_mut().zip(&y_w) {
            *mean += state.sigma * step;
        }

        // Step-size control (eqs. 43 and 44).
        let whitened = state.covariance.inverse_root_times(&y_w);
        let gain = (c_sigma * (2.0 - c_sigma) * mu_eff).sqrt();
        for (path, value) in state.p_sigma.iter_mut().zip(&whitened) {
            *path = (1.0 - c_sigma) * *path + gain * value;
        }
        let norm = squared_norm(&state.p_sigma).sqrt();
        // A path longer than that of random steps (χ_n) lets σ grow. The bound keeps σ finite.
        state.sigma = (state.sigma * (c_sigma / d_sigma * (norm / chi_n - 1.0)).exp()).min(SIGMA_MAX);

        // Covariance matrix adaptation. h_σ stalls the rank-one path while σ grows fast (page 28).
        // p_σ begins at 0, so in the first generations its length is too short by this factor.
        let decay = (1.0 - (1.0 - c_sigma).powf(2.0 * (f64::from(state.generation) + 1.0))).sqrt();
        let h_sigma = if norm / decay < (1.4 + 2.0 / (n as f64 + 1.0)) * chi_n { 1.0 } else { 0.0 };
        let gain = h_sigma * (cc * (2.0 - cc) * mu_eff).sqrt();
        for (path, value) in state.p_c.iter_mut().zip(&y_w) {
            *path = (1.0 - cc) * *path + gain * value; // eq. 45
        }
        // Negative weights are scaled by the length of their step, so that C stays positive definite.
        let scaled_weights: Vec<f64> = weights
            .iter()
            .zip(&steps)
            .map(|(weight, step)| {
                if *weight >= 0.0 {
                    return *weight;
                }
                // EPS avoids a division by 0 for a candidate at the mean.
                weight * n as f64 / (squared_norm(&state.covariance.inverse_root_times(step)) + EPS) // eq. 46
            })
            .collect();
        // Makes up for the variance that a stalled path does not add (eq. 47).
        let delta = (1.0 - h_sigma) * cc * (2.0 - cc);
        let keep = 1.0 + c1 * delta - c1 - cmu * weights.iter().sum::<f64>();
        // eq. 47
        state.covariance.update(keep, *c1, &state.p_c, *cmu, &scaled_weights, &steps);
        // Decomposing takes O(n³), so it is done only in some generations; in between the axes are slightly old.
        let due = state.generation.is_multiple_of(*decompose_every);
        let decomposed = !due || state.covariance.decompose();
        // NaN fails the comparison too.
        let finite = |vector: &[f64]| vector.iter().all(|value| value.abs() < MEAN_MAX);
        let scalar = state.sigma.is_finite() && state.sigma > 0.0;
        decomposed && scalar && finite(&state.mean) && finite(&state.p_sigma) && finite(&state.p_c)
    }

    /// Why the run should end, or `None` to continue.
    pub fn stop(&self) -> Option<StopReason> {
        reason(&self.settings, &self.state)
    }

    /// The best candidate so far.
    pub fn best(&self) -> Option<&Best> {
        self.state.best.as_ref()
    }

    /// The distribution's mean in the problem's units: the better estimate when costs are noisy.
    pub fn mean(&self) -> Vec<f64> {
        self.unscale(&self.state.mean)
    }

    /// Standard deviation of each coordinate in the problem's units, σ · deviation · √C_ii.
    pub fn deviations(&self) -> Vec<f64> {
        let diagonal = self.state.covariance.diagonal();
        diagonal.iter().zip(&self.settings.deviation).map(|(c, s)| self.state.sigma * s * c.sqrt()).collect()
    }

    /// Step size in scaled coordinates.
    pub fn sigma(&self) -> f64 {
        self.state.sigma
    }

    /// Generations told.
    pub fn generation(&self) -> u32 {
        self.state.generation
    }

    /// Candidates told.
    pub fn evaluations(&self) -> u64 {
        u64::from(self.state.generation) * self.settings.population as u64
    }

    /// The settings of this run.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Everything to save for [`Self::resume`].
    pub fn state(&self) -> &State {
        &self.state
    }
}

/// Candidate numbers from best to worst: finite costs ascending, then the failed; ties by number.
fn rank(costs: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..costs.len()).collect();
    let key = |k: &usize| if costs[*k].is_finite() { costs[*k] + 0.0 } else { f64::INFINITY };
    // The sort is stable; adding 0 makes −0 and +0 equal.
    order.sort_by(|i, j| key(i).total_cmp(&key(j)));
    order
}

/// `x` mirrored at the bounds, either of which may be infinite, until it lies between them.
fn reflect(x: f64, lower: f64, upper: f64) -> f64 {
    let width = upper - lower;
    if (lower..=upper).contains(&x) || width == 0.0 {
        return x;
    }
    match (lower.is_finite(), upper.is_finite()) {
        (true, true) => {
            // Mirrored coordinates repeat after two widths: one upwards, one downwards.
            let offset = (x - lower).rem_euclid(2.0 * width);
            lower + if offset > width { 2.0 * width - offset } else { offset }
        }
        // With a single bound one mirroring is enough.
        (true, false) => lower + (lower - x),
        // Without any bound `x` was returned above, so the upper bound is finite here.
        _ => upper - (x - upper),
    }
}

fn squared_norm(vector: &[f64]) -> f64 {
    vector.iter().map(|value| value * value).sum()
}

#[cfg(test)]
mod tests {
    use super::{rank, reflect};

    #[test]
    fn failed_candidates_rank_last_and_ties_by_number() {
        let costs = [f64::NAN, 2.0, f64::NEG_INFINITY, 1.0, 2.0, 0.0, -0.0, f64::INFINITY, -1.0];
        assert_eq!(rank(&costs), [8, 5, 6, 3, 1, 4, 0, 2, 7]);
    }

    #[test]
    fn reflection_by_hand() {
        let infinite = f64::INFINITY;
        for (x, lower, upper, expected) in [
            (0.25, 0.0, 1.0, 0.25),
            (-0.25, 0.0, 1.0, 0.25),
            (1.25, 0.0, 1.0, 0.75),
            (2.25, 0.0, 1.0, 0.25),
            (-3.25, 0.0, 1.0, 0.75),
            (-5.0, -2.0, infinite, 1.0),
            (9.0, -infinite, 7.0, 5.0),
            (9.0, -infinite, infinite, 9.0),
        ] {
            assert_eq!(reflect(x, lower, upper), expected, "{x} in [{lower}, {upper}]");
        }
        // A coordinate without room is clamped by the caller.
        assert_eq!(reflect(3.0, 2.0, 2.0), 3.0);
    }
}
