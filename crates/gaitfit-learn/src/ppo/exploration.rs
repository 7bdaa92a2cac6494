//! Exploration: actions drawn around the policy's means, and how probable each was.

use gaitfit_random::{Purpose, Stream, fill_normal_rows};

/// Draws actions a = μ + σ z from a Gaussian with a diagonal covariance; z is a function of seed, environment and
/// step.
#[derive(Clone, Debug)]
pub struct Exploration {
    seed: u64,
    /// Number of the first environment.
    first: u32,
    normals: Vec<f64>,
}

impl Exploration {
    /// Exploration of environments numbered from `first` on.
    pub fn new(seed: u64, first: u32) -> Self {
        Self { seed, first, normals: Vec::new() }
    }

    /// Fills `action` with draws around `mean`, both `environments × action`, and `log_probability` with their log
    /// densities, −½ Σ z² − Σ (ln σ + ½ ln 2π); `environments`. `step` is a number that no other step of these
    /// environments has. `log_std`: ln σ of each element of an action.
    ///
    /// # Panics
    /// If the slices are of different numbers of environments: an error of the caller.
    pub fn draw(
        &mut self,
        log_std: &[f32],
        step: u32,
        mean: &[f32],
        action: &mut [f32],
        log_probability: &mut [f32],
    ) {
        let width = log_std.len();
        assert!(
            mean.len() == action.len() && action.len() == width * log_probability.len(),
            "means, actions and probabilities are of different numbers of environments"
        );
        // The exponentials and the constant of the density are the same for all rows.
        let std: Vec<f32> = log_std.iter().map(|x| x.exp()).collect();
        let constant = log_std.iter().sum::<f32>() + 0.5 * width as f32 * std::f32::consts::TAU.ln();
        self.normals.resize(mean.len(), 0.0);
        let stream = Stream::new(self.seed, Purpose::EXPLORATION).step(step);
        // A row's draws depend on its environment and the step alone, whatever the tiles.
        fill_normal_rows(stream, self.first, width, &mut self.normals);
        let rows = action.chunks_exact_mut(width).zip(mean.chunks_exact(width));
        let draws = self.normals.chunks_exact(width).zip(log_probability);
        for ((action, mean), (normals, log_probability)) in rows.zip(draws) {
            let mut squares = 0.0;
            for k in 0..width {
                let z = normals[k] as f32;
                // The density is computed from the draw itself: (action − mean) / σ would round once more.
                action[k] = std[k].mul_add(z, mean[k]);
                squares += z * z;
            }
            *log_probability = -0.5 * squares - constant;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn densities_are_those_of_the_draws() {
        let log_std = [0.5f32.ln(), 2.0f32.ln()];
        let mean = [1.0, -1.0, 0.0, 3.0, -2.0, 0.5];
        let (mut action, mut density) = ([0.0; 6], [0.0; 3]);
        let mut exploration = Exploration::new(7, 10);
        exploration.draw(&log_std, 4, &mean, &mut action, &mut density);
        for row in 0..3 {
            let mut wanted = 0.0;
            for (k, std) in [0.5f64, 2.0].into_iter().enumerate() {
                let z = f64::from(action[2 * row + k] - mean[2 * row + k]) / std;
                wanted -= 0.5 * z * z + std.ln() + 0.5 * std::f64::consts::TAU.ln();
            }
            assert!((f64::from(density[row]) - wanted).abs() < 1e-5, "{} {wanted}", density[row]);
        }
        // Draws belong to the environment and the step, not to the tile.
        let (mut other, mut same) = ([0.0; 2], [0.0; 1]);
        Exploration::new(7, 12).draw(&log_std, 4, &mean[4..], &mut other, &mut same);
        assert_eq!((other, same[0]), ([action[4], action[5]], density[2]));
        Exploration::new(7, 12).draw(&log_std, 5, &mean[4..], &mut other, &mut same);
        assert_ne!(other, [action[4], action[5]]);
    }
}
