//! How much torque noise the real robot has, by the residuals of its legs in the air.

use super::{NOISE, World};
use crate::walk::swing::SwingReport;

/// A group shows torque noise if [`NOISE`] makes its mean square residual more than this many times as large.
const SHOWN: f64 = 1.2;
/// Largest torque noise, part of the weakest joint's torque limit.
const MAX_NOISE: f64 = 0.06;

/// Torque noise of the real robot.
pub(super) struct Noise {
    /// Its variance, (N·m)².
    pub variance: f64,
    /// How fast the group's mean square residual grows with this variance.
    pub slope: f64,
    /// The group.
    pub group: usize,
    /// Why torque noise cannot explain the residuals. Then `variance` is the largest possible one.
    pub too_large: Option<String>,
}

impl World<'_> {
    /// The torque noise that gives one group the mean square residual of the real logs. It is the group that needs the least
    /// noise: effects that the model lacks enlarge residuals too, but seldom in all groups.
    pub(super) fn noise(&self, real: &SwingReport, values: &[f64]) -> Result<Noise, String> {
        // Estimates below what a robot can have would not simulate.
        let least = self.least(values.len() + 1);
        let values: Vec<f64> = values.iter().zip(least).map(|(value, least)| value.max(least)).collect();
        // Two robots that differ in their noise alone give the line of residual against variance.
        let robots = [0.0, NOISE * NOISE].map(|noise| [values.as_slice(), &[noise]].concat());
        let reports = self.observe(&robots, 0, false)?;
        let [Some(quiet), Some(noisy)] = [0, 1].map(|at| reports.get(at).cloned().flatten()) else {
            return Err("the simulated robot falls in most logs".to_owned());
        };
        let square = |report: &SwingReport, group: usize| report.groups[group].residual.powi(2);
        let asks = |group: usize| {
            let (none, some) = (square(&quiet, group), square(&noisy, group));
            let slope = (some - none) / (NOISE * NOISE);
            // A group that hardly answers to noise would ask for any amount.
            (some > SHOWN * none).then(|| (((square(real, group) - none) / slope).max(0.0), slope, group))
        };
        let least = (0..real.groups.len()).filter_map(asks).min_by(|a, b| a.0.total_cmp(&b.0));
        let (variance, slope, group) =
            least.ok_or("torque noise of simulated robots does not show in their logs")?;
        let model = self.robot.model;
        // The weakest joint bounds the noise, because it has the same noise as the others.
        let efforts = (0..model.joints.len()).filter_map(|joint| model.effort(joint));
        let max = MAX_NOISE * efforts.fold(f64::INFINITY, f64::min);
        let too_large = (variance.sqrt() > max).then(|| {
            format!("the logs leave more unexplained than torque noise of {max:.2} N·m would, so the model lacks an effect")
        });
        // Bounded even where it is too large: the robots of the comparison must still walk.
        Ok(Noise { variance: variance.min(max * max), slope, group, too_large })
    }
}
