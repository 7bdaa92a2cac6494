//! The correction of a fit by simulated logs, and its rounds.

use serde::{Deserialize, Serialize};

/// How much more the corrected values depend on the choice of logs. It and [`SHARE`] were chosen with which nine of ten
/// intervals or more held the truth in fits of one seed of every kind of log in docs/results.
const STRENGTHENED: f64 = 1.2;
/// Part of a correction that counts as one standard deviation of its error.
const SHARE: f64 = 0.2;
/// The same where the logs leave no more than those of a simulated robot without noise: what the correction takes away
/// may then be of the simulated logs alone.
const SHARE_WITHOUT_NOISE: f64 = 1.0;

/// The correction of a fit by simulated logs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Correction {
    /// The values that the fit found.
    pub uncorrected: Vec<f64>,
    /// The values whose simulated logs, fitted, would give these.
    pub corrected: Vec<f64>,
    /// Standard deviation of fits over sets of simulated logs, in the last rounds.
    pub spread: Vec<f64>,
    /// Torque noise with which simulated logs are as far from predictions as the real ones, N·m.
    pub torque_noise: f64,
    /// Sets of simulated logs over which the correction is averaged.
    pub replicates: usize,
    /// How far the robot's values move where the fit of its logs moves by one, a row a value.
    pub response: Vec<Vec<f64>>,
    /// The rounds.
    pub rounds: Vec<Round>,
}

/// One round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// The values of the simulated robot.
    pub values: Vec<f64>,
    /// Its torque noise, N·m.
    pub torque_noise: f64,
    /// Ends of the fits of its logs, relative to a fit of the real ones that ends where the slope of its loss does.
    /// Bounds do not limit them.
    pub fits: Vec<Vec<f64>>,
}

impl Round {
    /// Mean of the fits.
    pub(super) fn mean(&self) -> Vec<f64> {
        (0..self.values.len()).map(|at| mean(self.fits.iter().map(|fit| fit[at]))).collect()
    }

    /// Standard deviation of that mean.
    pub(super) fn noise(&self) -> Vec<f64> {
        let standard_error = |at: usize| {
            let values: Vec<f64> = self.fits.iter().map(|fit| fit[at]).collect();
            // A single fit has no deviation, and counts as if it had no noise.
            gaitfit_sim::stats::deviation(&values).unwrap_or(0.0) / (values.len().max(1) as f64).sqrt()
        };
        (0..self.values.len()).map(standard_error).collect()
    }
}

impl Correction {
    /// How far the correction moves each value.
    pub fn by(&self) -> Vec<f64> {
        self.corrected.iter().zip(&self.uncorrected).map(|(to, from)| to - from).collect()
    }

    /// Standard deviation of the correction's own error: the simulated robot is not the real one.
    pub(super) fn doubt(&self) -> Vec<f64> {
        let share = if self.torque_noise > 0.0 { SHARE } else { SHARE_WITHOUT_NOISE };
        self.by().into_iter().map(|by| share * by).collect()
    }

    /// How much more than the fit's values the corrected ones depend on the choice of logs: simulated ones are few too,
    /// and what noise weakens a correction strengthens.
    pub(super) fn inflation(&self) -> f64 {
        // Simulated logs scatter like the real ones. A mean over R sets adds 1/R of their variance.
        STRENGTHENED * (1.0 + 1.0 / self.replicates.max(1) as f64).sqrt()
    }
}

/// Mean of values.
pub(super) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0usize), |(sum, count), value| (sum + value, count + 1));
    // The mean of nothing is 0.
    sum / count.max(1) as f64
}
