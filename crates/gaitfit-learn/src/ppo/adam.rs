//! Adam.

use std::ops::Range;

use gaitfit_policy::network::descend;

/// β₁, β₂ and ε of Kingma and Ba (2015), the usual values.
const BETA_1: f64 = 0.9;
const BETA_2: f64 = 0.999;
const EPSILON: f64 = 1e-8;

/// First and second moments of a flat vector of parameters, and the number of steps taken.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Adam {
    /// m, one a parameter.
    pub(super) first: Vec<f32>,
    /// v, one a parameter.
    pub(super) second: Vec<f32>,
    /// Steps taken.
    pub(super) steps: u64,
}

impl Adam {
    /// Adam for `size` parameters, before the first step.
    pub(super) fn new(size: usize) -> Self {
        Self { first: vec![0.0; size], second: vec![0.0; size], steps: 0 }
    }

    /// One step (Kingma and Ba 2015, algorithm 1) on several parts of the flat vector: `parts` pairs a range with
    /// its parameters. The gradient is multiplied by `factor` first. ε is added to √v̂.
    pub(super) fn step(
        &mut self,
        parts: &mut [(Range<usize>, &mut [f32])],
        gradient: &[f32],
        factor: f64,
        learning_rate: f64,
    ) {
        self.steps += 1;
        // `powi` takes an `i32`. Long before its limit both powers are 0 and the corrections 1.
        let t = self.steps.min(i32::MAX as u64) as i32;
        // Moments start at 0, so early ones are too small by these factors.
        let (c1, c2) = (1.0 - BETA_1.powi(t), 1.0 - BETA_2.powi(t));
        let rates =
            [1.0 - BETA_1, 1.0 - BETA_2, factor, learning_rate / c1, c2.sqrt(), EPSILON].map(|x| x as f32);
        for (range, parameters) in parts {
            let (first, second) = (&mut self.first[range.clone()], &mut self.second[range.clone()]);
            descend(parameters, first, second, &gradient[range.clone()], rates);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_steps_worked_by_hand() {
        // Step 1, g = 2: m = 0.2, v = 0.004, m̂ = 2, v̂ = 4, θ = 1 − 0.1 · 2/2 = 0.9.
        // Step 2, g = −1: m = 0.08, v = 0.004996, m̂ = 0.08/0.19, v̂ = 0.004996/0.001999, θ = 0.9 − 0.0266337.
        let mut adam = Adam::new(3);
        let mut theta = [1.0_f32];
        adam.step(&mut [(1..2, &mut theta)], &[9.0, 4.0, 9.0], 0.5, 0.1);
        assert!((theta[0] - 0.9).abs() < 1e-6, "{theta:?}");
        assert!((adam.first[1] - 0.2).abs() < 1e-7 && (adam.second[1] - 0.004).abs() < 1e-9);
        adam.step(&mut [(1..2, &mut theta)], &[9.0, -2.0, 9.0], 0.5, 0.1);
        assert!((theta[0] - 0.873_366_3).abs() < 1e-6, "{theta:?}");
        // What no part names is not moved.
        assert_eq!([adam.first[0], adam.first[2], adam.second[0], adam.second[2]], [0.0; 4]);
    }
}
