//! A robot beside itself in another trial of the same commands: how near any simulator can be expected to come.

use crate::log::Log;
use gaitfit_adapt::fit::Predicted;
use serde::{Deserialize, Serialize};

/// Commands of two trials that differ by less than this, mean over samples and parts, are the same; m/s and rad/s.
const SAME: f64 = 0.02;
/// Trials that a comparison needs.
const MIN_PAIRS: usize = 3;

/// Distances of held-out logs to another trial of their commands, and of the fitted robot to the same logs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trials {
    /// Held-out logs with another trial of their commands among the fitted ones.
    pub pairs: usize,
    /// `wass` of the robot in the other trial: of all logs pooled, and the mean of the logs one by one.
    pub itself: [f64; 2],
    /// The same of the fitted robot.
    pub fitted: [f64; 2],
}

impl Trials {
    /// Whether the fitted robot is as near as the other trial, all logs pooled and one by one.
    pub fn explained(&self) -> bool {
        self.fitted.iter().zip(&self.itself).all(|(fitted, itself)| fitted <= itself)
    }

    /// The fit's nearness, in words that follow "the fit explains … logs".
    pub fn words(&self) -> String {
        let ([pooled, each], [robot, robot_each]) = (self.fitted, self.itself);
        format!(
            "as well as another trial of the same commands does: {pooled:.4} against {robot:.4} pooled, {each:.4} against \
             {robot_each:.4} walk by walk, {} trials",
            self.pairs
        )
    }
}

/// The pairs of held-out logs and other trials of their commands, by number; of several trials the first.
pub(super) fn pairs(held: &[Log], others: &[Log]) -> Vec<(usize, usize)> {
    let pair = |(number, log): (usize, &Log)| {
        let other = others.iter().position(|other| same(log, other))?;
        Some((number, other))
    };
    let pairs: Vec<(usize, usize)> = held.iter().enumerate().filter_map(pair).collect();
    if pairs.len() < MIN_PAIRS { Vec::new() } else { pairs }
}

/// Whether two logs have the same commands, sample by sample as far as both go.
fn same(one: &Log, other: &Log) -> bool {
    let (Some(a), Some(b)) = (&one.trajectory.command, &other.trajectory.command) else { return false };
    let count = a.len().min(b.len());
    // Rows stand for the same times only if both logs have the same rate, but for the error of their clocks.
    let alike = (one.trajectory.dt() / other.trajectory.dt() - 1.0).abs() < 0.01;
    let sum: f64 = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum();
    alike && count > 0 && one.path != other.path && sum <= SAME * count as f64
}

/// The signals from sample number `from` on.
pub(super) fn tail(walk: &Predicted, from: usize, joints: usize) -> Predicted {
    let rows = |values: &[f32]| values[(from * joints).min(values.len())..].to_vec();
    Predicted {
        position: rows(&walk.position),
        velocity: rows(&walk.velocity),
        action: walk.action.as_deref().map(rows),
        fell_at: walk.fell_at.map(|fall| fall.saturating_sub(from)),
        ..Predicted::default()
    }
}
